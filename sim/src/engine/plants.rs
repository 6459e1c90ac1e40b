//! The plants of simulated nodes: the ones that drive a board, in front of a simulated world.

use funnelnet_law::field::{State, VectorField};
use funnelnet_node::{Action, Node};
use funnelnet_plant::{Failure, Plant};
use funnelnet_protocol::message::FaultCode;

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
pub struct Plants(Vec<Option<Box<dyn Driven>>>);

impl Plants {
    /// Of so many nodes as there are entries.
    #[must_use]
    pub fn new(plants: Vec<Option<Box<dyn Driven>>>) -> Self {
        Self(plants)
    }

    /// Does what a node asks of its plant, as the app on a board does: what fails is told to the node, which
    /// counts it or stops.
    #[cold]
    pub(super) fn act<V: VectorField<f32>>(
        &mut self,
        index: usize,
        action: &Action,
        node: &mut Node<f32, V>,
    ) {
        let Some(Some(plant)) = self.0.get_mut(index) else { return };
        match action {
            Action::Sample => match plant.measure() {
                Ok(x) => node.measured(&x),
                Err(_) => node.sample_failed(),
            },
            Action::Actuate => {
                if plant.actuate(node.inputs()).is_err() {
                    node.fail(FaultCode::PLANT, 0);
                }
            }
            // An actuator that cannot be made safe has nobody left to be told: the node has stopped.
            Action::Safe => {
                let _ = plant.safe();
            }
            Action::Send(_) | Action::Report(_) => {}
        }
    }

    /// The power of a node fails: its actuators fall into their safe position.
    pub(super) fn power_off(&mut self, index: usize) {
        if let Some(Some(plant)) = self.0.get_mut(index) {
            let _ = plant.safe();
        }
    }
}
