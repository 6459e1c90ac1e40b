//! What nodes say of themselves, tick by tick, for who compares it with what they were seen to do.

use super::Account;
use crate::extremes::larger;
use crate::presence::Presence;
use crate::scenario::{FloorSpec, Funnel, Scenario, Shape};
use funnelnet_node::Observation;

/// A funnel may differ by this share from the scenario's for the rounding of f32.
const FUNNEL_SHARE: f64 = 1e-3;
/// And by this share of its width at the start, where a funnel closes at a time: the time that is left has
/// rounding of its own.
const FUNNEL_OF_START: f64 = 1e-6;
/// The floor of f32 is judged by true states and present inputs; a node has measured ones and its last input.
const FLOOR_SHARE: f64 = 1.5;
/// Wider than any f32 funnel.
const WIDEST: f64 = 1e17;

/// The accounts of all nodes.
pub struct Accounts<'a> {
    scenario: &'a Scenario,
    /// By index.
    all: Vec<Account>,
}

impl<'a> Accounts<'a> {
    /// Of the nodes of a scenario, of which nothing was seen yet.
    #[must_use]
    pub fn new(scenario: &'a Scenario) -> Self {
        let account = |id| Account { id, ..Account::default() };
        Self { scenario, all: scenario.nodes.iter().map(|node| account(node.id)).collect() }
    }

    /// All of them, by index.
    #[must_use]
    pub fn finish(self) -> Vec<Account> {
        self.all
    }

    /// Takes what each node says of itself at tick `k`, by index and then by component, and the funnels `psi`
    /// that it is judged by (state units).
    pub fn tick(&mut self, k: u64, seen: &[Observation<f32>], presence: &[Presence], psi: &[f64]) {
        let components = self.scenario.components();
        let asked = psi.chunks(components);
        let nodes = self.all.iter_mut().enumerate().zip(presence);
        for (((index, account), presence), (seen, asked)) in nodes.zip(seen.chunks(components).zip(asked)) {
            match presence {
                Presence::Ran => {}
                Presence::Stopped | Presence::Off => continue,
                Presence::Unrecorded | Presence::Absent => {
                    account.unknown += 1;
                    continue;
                }
            }
            let (Some(first), Some(&asked)) = (seen.first(), asked.first()) else { continue };
            let Some(mut node) = self.scenario.node_at(index, k) else { continue };
            let (mut k, mut asked) = (k, asked);
            if !self.scenario.clocks.is_empty() {
                let own = u64::from(first.tick);
                // Before its first tick it has no funnel.
                if first.psi == 0.0 || !is_next(account, own) {
                    continue;
                }
                node = self.scenario.node_at(index, own).unwrap_or(node);
                (k, asked) = (own, larger(asked, node.funnel.width(self.scenario.time.at_s(own))));
            }
            account.ran += 1;
            // A node counts a tick once, whatever its number of components.
            let ratio = seen.iter().fold(0.0, |most: f32, part| {
                if part.ratio > most || part.ratio.is_nan() { part.ratio } else { most }
            });
            if ratio > account.max_ratio || ratio.is_nan() {
                account.max_ratio = ratio;
            }
            // What is not a number is not inside.
            let inside = ratio < 1.0;
            account.breaches += u64::from(!inside);
            let (own, t) = (f64::from(first.psi), self.scenario.time.at_s(k));
            let drawn = node.funnel.width(t);
            let rounding = rounding(&node.funnel);
            let share = if self.scenario.floor == FloorSpec::F32 && asked > drawn {
                FLOOR_SHARE
            } else {
                1.0 + FUNNEL_SHARE
            };
            if drawn > WIDEST {
                continue;
            }
            if own > asked * share + rounding {
                account.widened.get_or_insert((k, own, asked));
            } else if own.is_nan() || own < drawn * (1.0 - FUNNEL_SHARE) - rounding {
                account.other_funnel.get_or_insert((k, own, drawn));
            }
        }
    }
}

/// Whether a node that ticks by a clock of its own has come to a tick that was not seen yet. Those that
/// nobody has seen are not known: one of them may come before it is asked for its report.
fn is_next(account: &mut Account, own: u64) -> bool {
    let last = account.last_tick.replace(own);
    if last == Some(own) {
        return false;
    }
    account.unknown += last.map_or(own + 1, |last| own.saturating_sub(last + 1));
    true
}

/// What a node's f32 makes of a funnel beyond [`FUNNEL_SHARE`] of it, state units.
fn rounding(funnel: &Funnel<f64>) -> f64 {
    match funnel.shape {
        Shape::FiniteTime { .. } => FUNNEL_OF_START * funnel.width(0.0),
        _ => 0.0,
    }
}
