//! The plants of simulated nodes: the ones that drive a board, in front of a simulated world.

use funnelnet_law::field::State;
use funnelnet_plant::{Failure, Plant};

/// What an engine asks of a [`Plant`], whatever its model is.
pub trait Driven {
    /// See [`Plant::measure`].
    ///
    /// # Errors
    /// As there.
    fn measure(&mut self) -> Result<State<f32>, Failure>;

    /// See [`Plant::actuate`].
    ///
    /// # Errors
    /// As there.
    fn actuate(&mut self, u: &[f32]) -> Result<(), Failure>;

    /// See [`Plant::safe`].
    ///
    /// # Errors
    /// As there.
    fn safe(&mut self) -> Result<(), Failure>;
}

impl<P: Plant> Driven for P {
    fn measure(&mut self) -> Result<State<f32>, Failure> {
        Plant::measure(self)
    }

    fn actuate(&mut self, u: &[f32]) -> Result<(), Failure> {
        Plant::actuate(self, u)
    }

    fn safe(&mut self) -> Result<(), Failure> {
        Plant::safe(self)
    }
}

/// The plants of an engine, by index. A node without one is virtual: it has nothing to drive and nothing to
/// measure.
#[derive(Default)]
pub struct Plants(pub(super) Vec<Option<Box<dyn Driven>>>);

impl Plants {
    /// Of so many nodes as there are entries.
    #[must_use]
    pub fn new(plants: Vec<Option<Box<dyn Driven>>>) -> Self {
        Self(plants)
    }
}
