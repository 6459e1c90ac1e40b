//! A node's own vector field, of whatever kind.

use super::Sine;
use super::affine::Affine;
use super::expression::Expression;
use super::host_field::Hosted;
use crate::extremes::largest;

/// `f(t, x)` in state units per second.
///
/// The methods without a component are for scalar states.
// One for each node: a box would save 400 bytes of each, and cost every evaluation a look elsewhere.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Debug, PartialEq)]
pub enum Dynamics {
    /// Affine in the state, and sines.
    Affine(Affine),
    /// An expression for each component.
    Expression(Expression),
    /// What the program around the simulation computes: no scenario file has it, and no board.
    Hosted(Hosted),
}

impl Dynamics {
    /// The affine field, where it is one.
    #[must_use]
    pub fn affine(&self) -> Option<&Affine> {
        match self {
            Self::Affine(affine) => Some(affine),
            Self::Expression(_) | Self::Hosted(_) => None,
        }
    }

    /// The same, to change it.
    pub fn affine_mut(&mut self) -> Option<&mut Affine> {
        match self {
            Self::Affine(affine) => Some(affine),
            Self::Expression(_) | Self::Hosted(_) => None,
        }
    }

    /// The expression, where it is one.
    #[must_use]
    pub fn expression(&self) -> Option<&Expression> {
        match self {
            Self::Affine(_) | Self::Hosted(_) => None,
            Self::Expression(expression) => Some(expression),
        }
    }

    /// The field of the program around the simulation, where it is one.
    #[must_use]
    pub fn hosted(&self) -> Option<&Hosted> {
        match self {
            Self::Hosted(hosted) => Some(hosted),
            Self::Affine(_) | Self::Expression(_) => None,
        }
    }

    /// One component of `f(t, x)` (state units / s).
    #[must_use]
    pub fn component(&self, component: usize, t: f64, x: &[f64]) -> f64 {
        match self {
            Self::Affine(affine) => affine.component(component, t, x),
            Self::Expression(expression) => expression.component(component, t, x),
            Self::Hosted(hosted) => hosted.component(component, t, x),
        }
    }

    /// `f(t, x)` of a scalar state (state units / s).
    #[must_use]
    pub fn value(&self, t: f64, x: f64) -> f64 {
        match self {
            Self::Affine(affine) => affine.value(t, x),
            Self::Expression(expression) => expression.component(0, t, &[x]),
            Self::Hosted(hosted) => hosted.component(0, t, &[x]),
        }
    }

    /// `df_row / dx_column` at a time (s) and a state (1/s).
    #[must_use]
    pub fn slope_of(&self, row: usize, column: usize, t: f64, x: &[f64]) -> f64 {
        match self {
            Self::Affine(affine) => affine.slope_of(row, column),
            Self::Expression(expression) => expression.slope_of(row, column, t, x),
            Self::Hosted(hosted) => hosted.slope_of(row, column, t, x),
        }
    }

    /// `df/dx` of a scalar state (1/s).
    #[must_use]
    pub fn slope(&self, t: f64, x: f64) -> f64 {
        self.slope_of(0, 0, t, &[x])
    }

    /// The partial derivative of `f` by time, of a scalar state (state units / s^2).
    #[must_use]
    pub fn rate(&self, t: f64, x: f64) -> f64 {
        match self {
            Self::Affine(affine) => affine.rate_of_forcing(t),
            Self::Expression(expression) => expression.rate_of(0, t, &[x]),
            Self::Hosted(hosted) => hosted.rate_of(0, t, &[x]),
        }
    }

    /// The largest row sum of `|df/dx|` (1/s): a Lipschitz constant of an affine field, the steepest that was
    /// found of any other.
    #[must_use]
    pub fn steepness(&self) -> f64 {
        match self {
            Self::Affine(affine) => affine.lipschitz(),
            Self::Expression(expression) => expression.steepness(),
            Self::Hosted(hosted) => hosted.steepness(),
        }
    }

    /// Its sines; those of an expression are what it reads.
    #[must_use]
    pub fn sines(&self) -> &[Sine] {
        match self {
            Self::Affine(affine) => &affine.sines,
            Self::Expression(expression) => &expression.waves,
            Self::Hosted(_) => &[],
        }
    }

    /// The fastest of its sines (rad/s). One without amplitude drives nothing.
    #[must_use]
    pub fn fastest_sine(&self) -> f64 {
        let driving = self.sines().iter().filter(|sine| sine.amplitude != 0.0);
        largest(0.0, driving.map(|sine| sine.frequency.abs()))
    }
}

impl From<Affine> for Dynamics {
    fn from(affine: Affine) -> Self {
        Self::Affine(affine)
    }
}
