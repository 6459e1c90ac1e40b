//! The funnel of a node at a tick: its floor, whether it was left, and how much wider that has made it.

use super::Node;
use crate::observe::Event;
use crate::params::OnBreach;
use funnelnet_law::field::VectorField;
use funnelnet_law::funnel::Widths;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::math::{Real, larger};
use funnelnet_protocol::report::count;

/// History of a funnel, as far as the next tick depends on it.
#[derive(Clone, Debug)]
pub(super) struct FunnelRecord<F> {
    /// Width that a breach has added, state units, at the tick that is computed next.
    reopened: F,
    /// The largest `|nu| / psi` so far.
    pub max_ratio: F,
    in_breach: bool,
    floored: bool,
}

impl<F: Real> FunnelRecord<F> {
    pub fn new() -> Self {
        Self { reopened: F::ZERO, max_ratio: F::ZERO, in_breach: false, floored: false }
    }
}

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    /// The funnel at tick `k`, not narrower than what the rounding of `nu` can resolve (law.md 4), and what a
    /// breach has added to it.
    pub(super) fn widths(&mut self, k: u32, floor: F) -> Widths<F> {
        let psi = self.floored_widths(k, floor);
        let OnBreach::Reopen { decay, partial_decay, .. } = self.params.on_breach else { return psi };
        let added = self.funnel.reopened;
        self.funnel.reopened = added * decay;
        Widths { now: psi.now + added, ahead: psi.ahead + added * partial_decay }
    }

    /// The funnel at tick `k`, not narrower than what the rounding of `nu` can resolve (law.md 4).
    fn floored_widths(&mut self, k: u32, floor: F) -> Widths<F> {
        let psi = self.params.widths(k);
        if psi.clears(floor) {
            return psi;
        }
        count(&mut self.counters.floored);
        if !self.funnel.floored {
            self.funnel.floored = true;
            self.outbox.report(Event::FunnelFloored { tick: k, width: floor.to_f32() });
        }
        psi.floored(floor)
    }

    /// The funnel after a breach under the policy `reopen`: as much wider as the margin asks for (law.md 5).
    /// Otherwise the same one.
    pub(super) fn reopen(&mut self, k: u32, ratio: F, psi: Widths<F>) -> Widths<F> {
        let OnBreach::Reopen { margin, decay, partial_decay } = self.params.on_breach else { return psi };
        let added = psi.now * (ratio * margin - F::ONE);
        self.funnel.reopened += added * decay;
        count(&mut self.counters.reopened);
        let now = psi.now + added;
        self.outbox.report(Event::FunnelReopened { tick: k, width: now.to_f32() });
        Widths { now, ahead: psi.ahead + added * partial_decay }
    }

    /// Counts a breach and says when it begins and ends; what follows from it is up to the policy (law.md 5).
    pub(super) fn judge(&mut self, k: u32, ratio: F) -> bool {
        // What is not a number is not inside, and stays the largest.
        let inside = ratio < F::ONE;
        let breach = !inside;
        let funnel = &mut self.funnel;
        if breach {
            count(&mut self.counters.breaches);
            funnel.max_ratio = larger(funnel.max_ratio, ratio);
        } else if ratio > funnel.max_ratio {
            funnel.max_ratio = ratio;
        }
        if breach != funnel.in_breach {
            funnel.in_breach = breach;
            self.outbox.report(match breach {
                true => Event::BreachBegan { tick: k, ratio: ratio.to_f32() },
                false => Event::BreachEnded { tick: k },
            });
        }
        breach
    }
}
