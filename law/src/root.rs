//! Root of an increasing function: Newton, safeguarded by bisection.

use crate::math::Real;

/// Largest number of evaluations. Bisection alone would need 24 for an f32 and 53 for an f64 inside one
/// binade, and every second step at least halves the bracket or the Newton step.
pub const EVALUATION_LIMIT: u32 = 128;

/// The root of an increasing function in `[low, high]`, from `start` inside; `f` gives value and slope.
///
/// A step that leaves the bracket, or that is not at most half as long as the one before the last, is
/// replaced by a bisection (Press et al., Numerical Recipes, `rtsafe`), so that kinks and flat ends cost no
/// more than bisection does.
///
/// ```
/// use funnelnet_law::root::increasing;
/// // x^3 = 8.
/// let root = increasing(0.0_f64, 10.0, 5.0, |x| (x * x * x - 8.0, 3.0 * x * x));
/// assert!((root - 2.0).abs() < 1e-15);
/// ```
#[must_use]
pub fn increasing<F: Real>(low: F, high: F, start: F, mut f: impl FnMut(F) -> (F, F)) -> F {
    let (mut low, mut high, mut x) = (low, high, start);
    let mut last_steps = (high - low, high - low);
    for _ in 0..EVALUATION_LIMIT {
        let (value, slope) = f(x);
        if value < F::ZERO {
            low = x;
        } else {
            high = x;
        }
        let newton = x - value / slope;
        let shrinks = (value + value).abs() <= (last_steps.0 * slope).abs();
        let next =
            if newton >= low && newton <= high && shrinks { newton } else { low + (high - low) * F::HALF };
        let step = next - x;
        last_steps = (last_steps.1, step);
        x = next;
        if step.abs() <= F::EPSILON * F::HALF * x.abs() {
            break;
        }
    }
    x
}
