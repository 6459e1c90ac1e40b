//! The narrowest funnel that rounding leaves a meaning: the one formula for nodes, the simulator, `check` and
//! whoever judges a run.
//!
//! ```text
//! floor = max(SHARED ulp(x), STEEP d (ulp(x) + T ulp(u)))
//! ```
//!
//! with the largest `|x|` that the node sees, its own last input `u`, its weighted degree `d` and the tick
//! period `T`; `ulp(y)` stands for `epsilon |y|`. The second term is what rounding does to `nu` and to `b u`
//! in (*), times a margin. It differs from node to node, and funnels that differ weigh the nodes in the
//! emergent dynamics (paper, (19), alg). So all nodes share the first term, which covers rounding at every
//! node of up to `SHARED / STEEP` in degree. The factor of a funnel is no part of it: rounding knows nothing
//! of it.

use crate::math::Real;

/// Floor of every funnel, in ulp of `x`.
///
/// Measured on the medians, asymptotic-path-11 and finite-time, with what each expects
/// (docs/notes/2026-11-28-floor.md): without this term all of them but the last end farther from `xi` than
/// they may; 512 leaves median-51 too wide; at 256 rounding takes 2 % of the floor of a path.
pub const SHARED: f64 = 256.0;
/// Ulp of `x` and of `T u` for each unit of the degree: 1.6 times [`ROUNDING`]. At 32 the floors of median-51
/// (degrees 12 and 16) are no longer the same, and it ends 6e-3 from `xi` instead of 1e-4.
pub const STEEP: f64 = 16.0;
/// Largest change of `nu` by rounding, in `d (ulp(x) + T ulp(u))`: 9.2 was the largest in 100 random
/// networks, on two nodes; 3 and less is common (node/tests/floor.rs,
/// `rounding_moves_nu_by_no_more_than_the_floor_allows_for`).
pub const ROUNDING: f64 = 10.0;

/// The floor of one node, or of one edge, prepared.
///
/// ```
/// use funnelnet_law::floor::Floor;
/// // A node of degree 2 at 1 ms whose states are near 100 does not keep a funnel narrower than 3 thousandths.
/// let floor = Floor::<f32>::new(2.0, 1e-3).width(100.0, 0.0);
/// assert!((0.003..0.0031).contains(&floor));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Floor<F> {
    /// `SHARED epsilon`.
    shared: F,
    /// `STEEP epsilon d`.
    steep: F,
    /// Tick period, s.
    tick: F,
}

impl<F: Real> Floor<F> {
    /// Floor of a node that computes in `F`, with weighted degree `degree`, at tick period `tick_s` (s).
    #[must_use]
    pub fn new(degree: f64, tick_s: f64) -> Self {
        Self::rounded_by(F::EPSILON.to_f64(), degree, tick_s)
    }

    /// Floor of a node that computes in f32, for a caller that computes in `F`.
    #[must_use]
    pub fn of_f32(degree: f64, tick_s: f64) -> Self {
        Self::rounded_by(f32::EPSILON.into(), degree, tick_s)
    }

    fn rounded_by(epsilon: f64, degree: f64, tick_s: f64) -> Self {
        Self {
            shared: F::from_f64(SHARED * epsilon),
            steep: F::from_f64(STEEP * epsilon * degree),
            tick: F::from_f64(tick_s),
        }
    }

    /// Floor for `degree` times the degree, such as that of an edge where this is the floor of degree 1.
    #[inline]
    #[must_use]
    pub fn times(self, degree: F) -> Self {
        Self { steep: self.steep * degree, ..self }
    }

    /// The unit of [`ROUNDING`], `d (ulp(x) + T ulp(u))`, state units, for what [`Floor::width`] takes.
    #[inline]
    #[must_use]
    pub fn unit(&self, largest_state: F, largest_input: F) -> F {
        self.steep * F::from_f64(1.0 / STEEP) * (largest_state + self.tick * largest_input)
    }

    /// The floor, state units, for the largest `|x|` that is seen (state units) and the largest `|u|` of the
    /// last tick (state units / s). Not a number where one of them is none.
    #[inline]
    #[must_use]
    pub fn width(&self, largest_state: F, largest_input: F) -> F {
        // More than nothing, so that ratios are defined.
        let shared = self.shared * largest_state + F::TINY;
        let steep = self.steep * (largest_state + self.tick * largest_input);
        // Written so that NaN stays: this runs at every tick.
        if steep <= shared { shared } else { steep }
    }
}
