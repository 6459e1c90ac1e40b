//! A node's own vector field, affine in the state and driven by sines.

use super::Sine;
use funnelnet_law::math;

/// `f(t, x) = slope x + offset + sum amplitude sin(frequency t + phase)`, in state units per second, for a
/// state of n components.
///
/// The methods without a component are for scalar states.
#[derive(Clone, Debug, PartialEq)]
pub struct Affine {
    /// 1/s: one number for all components, or n times n, row by row.
    pub slope: Vec<f64>,
    /// State units / s, n numbers.
    pub offset: Vec<f64>,
    /// The sines, in the order of the file and then by component.
    pub sines: Vec<Sine>,
}

impl Affine {
    /// The field of a scalar state: 1/s, state units / s.
    #[must_use]
    pub fn scalar(slope: f64, offset: f64, sines: Vec<Sine>) -> Self {
        Self { slope: vec![slope], offset: vec![offset], sines }
    }

    /// `df/dx` of a scalar state (1/s).
    #[must_use]
    pub fn slope(&self) -> f64 {
        self.slope_of(0, 0)
    }

    /// The offset of a scalar state (state units / s).
    #[must_use]
    pub fn offset(&self) -> f64 {
        self.offset.first().copied().unwrap_or(0.0)
    }

    /// `f(t, x) - slope x` of a scalar state, the part that does not depend on it (state units / s).
    #[must_use]
    pub fn forcing(&self, t: f64) -> f64 {
        self.forcing_of(0, t)
    }

    /// `f(t, x)` of a scalar state (state units / s).
    #[must_use]
    pub fn value(&self, t: f64, x: f64) -> f64 {
        self.slope() * x + self.forcing(t)
    }

    /// The partial derivative of `f` by time, of a scalar state (state units / s^2).
    #[must_use]
    pub fn rate_of_forcing(&self, t: f64) -> f64 {
        let rate = |sine: &Sine| sine.amplitude * sine.frequency * math::cos(sine.frequency * t + sine.phase);
        self.sines.iter().filter(|sine| sine.component == 0).map(rate).sum()
    }

    /// `df_row / dx_column` (1/s).
    #[must_use]
    pub fn slope_of(&self, row: usize, column: usize) -> f64 {
        match self.slope.as_slice() {
            [common] => {
                if row == column {
                    *common
                } else {
                    0.0
                }
            }
            entries => entries.get(row * self.offset.len() + column).copied().unwrap_or(0.0),
        }
    }

    /// The part of one component that does not depend on the state (state units / s).
    #[must_use]
    pub fn forcing_of(&self, component: usize, t: f64) -> f64 {
        let sines = self.sines.iter().filter(|sine| usize::from(sine.component) == component);
        self.offset.get(component).copied().unwrap_or(0.0) + sines.map(|sine| wave(sine, t)).sum::<f64>()
    }

    /// One component of `f(t, x)` (state units / s).
    #[must_use]
    pub fn component(&self, component: usize, t: f64, x: &[f64]) -> f64 {
        let linear = x.iter().enumerate().map(|(column, x)| self.slope_of(component, column) * x);
        linear.sum::<f64>() + self.forcing_of(component, t)
    }

    /// A Lipschitz constant in the maximum norm, the largest row sum of `|df/dx|` (1/s).
    #[must_use]
    pub fn lipschitz(&self) -> f64 {
        let n = self.offset.len();
        let row = |row| (0..n).map(|column| self.slope_of(row, column).abs()).sum();
        crate::extremes::largest(0.0, (0..n).map(row))
    }
}

/// The value of a sine at time `t` (s), state units / s.
fn wave(sine: &Sine, t: f64) -> f64 {
    sine.amplitude * math::sin(sine.frequency * t + sine.phase)
}
