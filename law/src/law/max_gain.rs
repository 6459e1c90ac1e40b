//! Maximum gain for vector states (paper, remark on the high order case):
//! `u = gamma(|nu|_inf / psi) nu / psi`.
//!
//! In (**), `psi s + b u = r` with `u = gamma(|s|_inf) s`, the vectors `s`, `u` and `r` are parallel: it is
//! the scalar equation for the largest component of `r`, whose solution is then scaled along `r`.

use super::node_wise::{Memory, NodeWise};
use crate::funnel::Widths;
use crate::gain::GainFunction;
use crate::math::{Real, larger};

/// One component of the diffusive term, and the input that the law finds for it.
///
/// ```
/// use funnelnet_law::funnel::Widths;
/// use funnelnet_law::gain::Reciprocal;
/// use funnelnet_law::law::max_gain::{Term, step};
/// use funnelnet_law::law::node_wise::{Memory, NodeWise};
/// // Both components get the gain of the larger one: the input points where the diffusive term does.
/// let law = NodeWise::new(Reciprocal { scale: 1.0 }, 0.01, 1.0);
/// let mut terms = [0.8, 0.4].map(|nu| Term { nu, dnu: 0.0, u: 0.0_f64, memory: Memory::default() });
/// step(&law, &mut terms, Widths { now: 1.0, ahead: 1.0 });
/// assert!((terms[0].u / terms[1].u - 2.0).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term<F> {
    /// Diffusive term, state units.
    pub nu: F,
    /// Change of `nu` over the last tick, state units.
    pub dnu: F,
    /// Input of this tick, state units / s, once it is found.
    pub u: F,
    /// Memory of the law, as for each component by itself.
    pub memory: Memory<F>,
}

/// One tick for all components.
pub fn step<F: Real, G: GainFunction<F>>(law: &NodeWise<F, G>, terms: &mut [Term<F>], psi: Widths<F>) {
    if terms.iter().any(|term| term.memory.last_input().is_none()) {
        let longest = terms.iter().fold(F::ZERO, |most, term| larger(most, term.nu.abs()));
        let u = law.first_input(longest, psi);
        terms.iter_mut().for_each(|term| term.memory.feed_back(share(u, term.nu, longest)));
    }
    // From here on `u` holds the right side, until it is the input.
    for term in terms.iter_mut() {
        let last = last_input(term);
        term.u = law.right_side(&term.memory, term.nu, term.dnu, last);
    }
    let longest = terms.iter().fold(F::ZERO, |most, term| larger(most, term.u.abs()));
    let u = law.gain.solve(psi.ahead, law.b, longest).u;
    for term in terms {
        term.u = share(u, term.u, longest);
        term.memory.note(last_input(term), term.u, term.dnu);
    }
}

fn last_input<F: Real>(term: &Term<F>) -> F {
    term.memory.last_input().unwrap_or(F::ZERO)
}

/// `length part / longest`, and zero where there is no direction.
fn share<F: Real>(length: F, part: F, longest: F) -> F {
    if longest == F::ZERO { F::ZERO } else { length * (part / longest) }
}
