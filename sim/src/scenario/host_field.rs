//! A vector field that the program around the simulation computes, in whatever language that is written.

use super::steepest::steepest;
use crate::extremes::{larger, largest};
use std::fmt;
use std::sync::Arc;

/// A vector field of the program around the simulation.
pub trait HostField: Send + Sync {
    /// One component of `f(t, x)` (state units / s) at a time (s) and a state. What is not known is NaN.
    fn component(&self, component: usize, t: f64, x: &[f64]) -> f64;

    /// Says that all nodes will be asked at `t` (s), each at its state of `x`, by index and then by component:
    /// who computes many at once does so here.
    fn announce(&self, _t: f64, _x: &[f64]) {}
}

/// Such a field as part of a scenario. It is equal to its clones alone.
#[derive(Clone)]
pub struct Hosted {
    field: Arc<dyn HostField>,
    /// See [`Hosted::steepness`].
    steepness: f64,
}

/// Step of difference quotients, relative to the state: the cube root of the resolution of f64.
const QUOTIENT: f64 = 6.1e-6;

impl Hosted {
    /// A field of the host's, for a node that starts at `state`; its steepest slope is looked for where the
    /// node may come to, at times up to `end` (s).
    pub fn new(field: Arc<dyn HostField>, state: &[f64], end: f64) -> Self {
        /// Sizes of the start, as for an expression.
        const AROUND: f64 = 4.0;
        let size = AROUND * largest(1.0, state.iter().map(|x| x.abs()));
        let hosted = Self { field, steepness: f64::NAN };
        let slope = |row: usize, column: usize, t: f64, x: &[f64]| {
            // Where the field is not defined there is nothing to be found.
            Some(hosted.slope_of(row, column, t, x)).filter(|slope| slope.is_finite()).unwrap_or(0.0)
        };
        let steepness = steepest(state.len(), size, end, slope);
        Self { steepness, ..hosted }
    }

    /// The field itself.
    #[must_use]
    pub fn field(&self) -> &Arc<dyn HostField> {
        &self.field
    }

    /// The largest row sum of `|df/dx|` (1/s) that was found where the node may come to; there may be a larger
    /// one elsewhere.
    #[must_use]
    pub fn steepness(&self) -> f64 {
        self.steepness
    }

    /// One component of `f(t, x)` (state units / s).
    #[must_use]
    pub fn component(&self, component: usize, t: f64, x: &[f64]) -> f64 {
        self.field.component(component, t, x)
    }

    /// Step (state units) to both sides of `x` at which a slope is looked for.
    #[must_use]
    pub fn quotient_step(x: f64) -> f64 {
        QUOTIENT * larger(1.0, x.abs())
    }

    /// `df_row / dx_column` (1/s), as a difference quotient.
    #[must_use]
    pub fn slope_of(&self, row: usize, column: usize, t: f64, x: &[f64]) -> f64 {
        let step = Self::quotient_step(x.get(column).copied().unwrap_or(0.0));
        let at = |by: f64| {
            let moved: Vec<f64> =
                x.iter().enumerate().map(|(at, x)| if at == column { x + by } else { *x }).collect();
            self.field.component(row, t, &moved)
        };
        (at(step) - at(-step)) / (2.0 * step)
    }

    /// The partial derivative of one component by time (state units / s^2), as a difference quotient that
    /// looks at no time before 0.
    #[must_use]
    pub fn rate_of(&self, component: usize, t: f64, x: &[f64]) -> f64 {
        let step = QUOTIENT * larger(1.0, t.abs());
        let (before, after) = (larger(t - step, 0.0), t + step);
        let at = |t: f64| self.field.component(component, t, x);
        (at(after) - at(before)) / (after - before)
    }
}

impl fmt::Debug for Hosted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Hosted")
    }
}

impl PartialEq for Hosted {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.field, &other.field)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `f = -x^2 + 3 t`, and `2 x_1` in the second component.
    struct Parabola;

    impl HostField for Parabola {
        fn component(&self, component: usize, t: f64, x: &[f64]) -> f64 {
            if component == 0 { 3.0 * t - x[0] * x[0] } else { 2.0 * x[0] }
        }
    }

    fn hosted() -> Hosted {
        Hosted::new(Arc::new(Parabola), &[1.0, 1.0], 1.0)
    }

    #[test]
    fn its_steepest_slope_is_that_of_where_the_node_may_come_to() {
        // 8 at x = 4 = 4 times the start.
        assert!((7.8..=8.001).contains(&hosted().steepness()), "{}", hosted().steepness());
    }

    #[test]
    fn derivatives_are_those_of_the_field() {
        let field = hosted();
        for (t, x) in [(0.0, 0.5), (2.0, -30.0)] {
            let state = [x, 1.0];
            assert!((field.slope_of(0, 0, t, &state) + 2.0 * x).abs() < 1e-6);
            assert!((field.slope_of(1, 0, t, &state) - 2.0).abs() < 1e-6);
            assert!(field.slope_of(0, 1, t, &state).abs() < 1e-9);
            assert!((field.rate_of(0, t, &state) - 3.0).abs() < 1e-4);
        }
    }

    #[test]
    fn it_is_equal_to_its_clones_alone() {
        let field = hosted();
        assert!(field == field.clone() && field != hosted());
    }
}
