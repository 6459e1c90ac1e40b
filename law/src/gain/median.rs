//! The gain that finds the median.

use super::Reciprocal;
use crate::math::Real;

/// The gain of the distributed median (paper, Section "Finding median agent"): a reciprocal one whose inverse meets
/// `mu^-1(s) >= 1 - eps` for `s >= eta` (paper, eq. (beta_bound)) with equality, `scale = eta eps / (1 - eps)`.
///
/// `eta` in state units / s, above zero; `eps` in (0, 1). The result is within `eta` of the weighted median (paper, Lemma med)
/// if `eps < 2 / (N + 1)` and all funnels are equal.
pub fn median<F: Real>(eta: F, eps: F) -> Reciprocal<F> {
    Reciprocal { scale: eta * eps / (F::ONE - eps) }
}
