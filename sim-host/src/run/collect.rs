//! Takes what f32 nodes see, tick by tick, and keeps what a run is judged by.

use super::between::Round;
use super::error::RunError;
use super::outcome::{Believed, Outcome};
use super::rows::Rows;
use crate::emergent::{Prediction, Predictor};
use crate::extremes::{larger, largest};
use crate::judge::{Account, Judge, Moment, ReferenceSummary};
use crate::number::shortest;
use crate::presence::Presence;
use crate::record::{OnBus, Row, TraceHash};
use crate::reference::ReferenceSolution;
use crate::scenario::{FloorSpec, Funnel, Scenario, Shape};
use funnelnet_node::Observation;

/// A funnel may differ by this share from the scenario's for the rounding of f32.
const FUNNEL_SHARE: f64 = 1e-3;
/// And by this share of its width at the start, where a funnel closes at a time: the time that is left has rounding of its own.
const FUNNEL_OF_START: f64 = 1e-6;
/// The floor of f32 is judged by true states and present inputs; a node has measured ones and its last input.
const FLOOR_SHARE: f64 = 1.5;
/// What the hash takes for a state that a node does not have, or of which nothing is known: no run without such a gap is equal to one
/// with it.
const NO_STATE: f32 = f32::from_bits(0x7fc0_0000);
/// Wider than any f32 funnel.
const WIDEST: f64 = 1e17;

/// Collector of one run.
pub struct Collector<'a> {
    scenario: &'a Scenario,
    /// Steps of the nodes' fields from one row to the next.
    stride: u64,
    /// The round that has begun, where what happens in it is looked at.
    round: Option<Round>,
    looks_into_rounds: bool,
    predictor: Predictor<'a>,
    judge: Judge<'a>,
    /// Continuous-time states at every tick, where they are asked for.
    reference: Option<&'a ReferenceSolution>,
    hash: TraceHash,
    accounts: Vec<Account>,
    reference_error: ReferenceSummary,
    outcome: Outcome,
    rows: &'a mut dyn Rows,
    /// Deliveries that were lost so far, and how many of them before the last row.
    lost: (u64, u64),
    /// Of the tick, by index and then by component.
    x: Vec<f64>,
    u: Vec<f64>,
}

impl<'a> Collector<'a> {
    /// For `scenario`, with a row every `stride` steps of the nodes' fields, which goes to `rows`. Where a tick is a round of several steps, there are rows
    /// between two ticks for [`Self::between_rounds`] only.
    pub fn new(
        scenario: &'a Scenario,
        stride: u64,
        reference: Option<&'a ReferenceSolution>,
        rows: &'a mut dyn Rows,
    ) -> Self {
        let account = |id| Account { id, ..Account::default() };
        Self {
            scenario,
            stride,
            round: None,
            looks_into_rounds: false,
            predictor: Predictor::new(scenario),
            judge: Judge::new(scenario),
            reference,
            hash: TraceHash::new(),
            accounts: scenario.nodes.iter().map(|node| account(node.id)).collect(),
            reference_error: reference.map(ReferenceSummary::beside).unwrap_or_default(),
            outcome: Outcome::default(),
            rows,
            lost: (0, 0),
            x: Vec::new(),
            u: Vec::new(),
        }
    }

    /// Looks into the rounds, too: nodes have no plants.
    pub fn between_rounds(self) -> Self {
        Self { looks_into_rounds: self.scenario.time.round > 1, ..self }
    }

    /// Takes how many deliveries were lost up to the tick that is taken next.
    pub fn lost(&mut self, so_far: u64) {
        self.lost.0 = so_far;
    }

    /// Takes what the nodes saw at tick `k`, by index and then by component, and what is known of them there, by index.
    ///
    /// # Errors
    /// The row cannot be written.
    pub fn tick(&mut self, k: u64, seen: &[Observation<f32>], presence: &[Presence]) -> Result<(), RunError> {
        if self.looks_into_rounds {
            self.end_round(presence)?;
            self.round = Some(Round::new(k, seen, presence));
        }
        for (seen, presence) in seen.chunks(self.scenario.components()).zip(presence) {
            let known = presence.is_known();
            self.hash.extend(seen.iter().map(|seen| if known { seen.x } else { NO_STATE }));
        }
        self.judge((k, 0), seen, presence);
        self.account(k, seen, presence);
        self.predict(k, seen, presence)
    }

    /// Judges what the nodes saw so many steps after tick `k`.
    fn judge(&mut self, (k, part): (u64, u8), seen: &[Observation<f32>], presence: &[Presence]) {
        self.x.clear();
        self.x.extend(seen.iter().map(|observation| f64::from(observation.x)));
        self.u.clear();
        self.u.extend(seen.iter().map(|observation| f64::from(observation.u)));
        let step = k * u64::from(self.scenario.time.round) + u64::from(part);
        let exact = self.reference.and_then(|exact| exact.x.chunks_exact(exact.nodes).nth(step as usize));
        self.judge.tick(&Moment { k, part, x: &self.x, u: &self.u, presence }, exact);
        if let Some(exact) = exact {
            self.compare(exact, presence);
        }
    }

    /// Takes what has happened in the round that ends, now that these are at its end.
    fn end_round(&mut self, presence: &[Presence]) -> Result<(), RunError> {
        let Some(mut round) = self.round.take() else { return Ok(()) };
        round.ends_with(presence);
        for part in 1..self.scenario.time.round {
            round.step(self.scenario, part - 1);
            self.judge((round.k, part), &round.seen, &round.presence);
            if self.has_row(round.k, part) {
                self.row((round.k, part), &round.seen, &round.presence)?;
            }
        }
        Ok(())
    }

    /// Whether there is a row so many steps after tick `k`.
    fn has_row(&self, k: u64, part: u8) -> bool {
        (k * u64::from(self.scenario.time.round) + u64::from(part)).is_multiple_of(self.stride)
    }

    /// Takes tick `k`, which was the last to come, as the end of the run.
    ///
    /// # Errors
    /// Its row cannot be written.
    pub fn end_at(
        &mut self,
        k: u64,
        seen: &[Observation<f32>],
        presence: &[Presence],
    ) -> Result<(), RunError> {
        self.judge.end(&Moment { k, part: 0, x: &self.x, u: &self.u, presence });
        self.outcome.widest = largest(0.0, self.judge.psi().iter().copied());
        if self.has_row(k, 0) { Ok(()) } else { self.row((k, 0), seen, presence) }
    }

    /// Takes what was on the buses since the last call.
    ///
    /// # Errors
    /// It cannot be written.
    pub fn hear(&mut self, heard: &[OnBus]) -> Result<(), RunError> {
        if heard.is_empty() { Ok(()) } else { self.rows.hear(heard) }
    }

    /// What the run came to.
    pub fn finish(self) -> Outcome {
        let believed = |accounts: &[Account]| Believed {
            max_ratio: shortest(accounts.iter().fold(0.0, |most: f32, account| {
                if account.max_ratio > most || account.max_ratio.is_nan() { account.max_ratio } else { most }
            })),
            breaches: accounts.iter().map(|account| account.breaches).sum(),
        };
        let findings = self.judge.finish();
        Outcome {
            hash: Some(self.hash),
            max_ratio: findings.max_ratio,
            breaches: findings.breaches,
            believed: Some(believed(&self.accounts)),
            last: findings.last.clone(),
            findings,
            accounts: self.accounts,
            reference: self.reference.map(|_| self.reference_error),
            prediction: self.predictor.finish(),
            ..self.outcome
        }
    }

    fn predict(&mut self, k: u64, seen: &[Observation<f32>], presence: &[Presence]) -> Result<(), RunError> {
        let last = k == self.scenario.time.ticks;
        if !last && !self.has_row(k, 0) {
            return Ok(());
        }
        if last {
            self.outcome.widest = largest(0.0, self.judge.psi().iter().copied());
        }
        self.row((k, 0), seen, presence)
    }

    fn row(
        &mut self,
        (k, part): (u64, u8),
        seen: &[Observation<f32>],
        presence: &[Presence],
    ) -> Result<(), RunError> {
        let t = self.scenario.time.part_at_s(k, part);
        let prediction = self.predictor.advance(t);
        let (so_far, before) = self.lost;
        self.lost.1 = so_far;
        let row = row(t, seen, presence, prediction, &self.judge);
        self.rows.take(Row { lost: so_far.saturating_sub(before), ..row })
    }

    /// What each node says of itself at the tick.
    fn account(&mut self, k: u64, seen: &[Observation<f32>], presence: &[Presence]) {
        let components = self.scenario.components();
        let asked = self.judge.psi().chunks(components);
        let nodes = self.accounts.iter_mut().zip(&self.scenario.nodes).zip(presence);
        for (((account, node), presence), (seen, asked)) in nodes.zip(seen.chunks(components).zip(asked)) {
            match presence {
                Presence::Ran => {}
                Presence::Stopped | Presence::Off => continue,
                Presence::Unrecorded | Presence::Absent => {
                    account.unknown += 1;
                    continue;
                }
            }
            let (Some(first), Some(&asked)) = (seen.first(), asked.first()) else { continue };
            let (mut k, mut asked) = (k, asked);
            if !self.scenario.clocks.is_empty() {
                let own = u64::from(first.tick);
                // Before its first tick it has no funnel.
                if first.psi == 0.0 || !is_next(account, own) {
                    continue;
                }
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

    fn compare(&mut self, exact: &[f64], presence: &[Presence]) {
        let components = self.scenario.components();
        let known = |&(at, _): &(usize, (&f64, &f64))| {
            presence.get(at / components).is_some_and(|presence| presence.is_known())
        };
        let apart =
            self.x.iter().zip(exact).enumerate().filter(known).map(|(_, (x, exact))| (x - exact).abs());
        let error = largest(0.0, apart);
        self.reference_error.max_error = larger(self.reference_error.max_error, error);
        self.reference_error.final_error = error;
    }
}

/// Whether a node that ticks by a clock of its own has come to a tick that was not seen yet. Those that nobody has seen are not known: one of them may come
/// before it is asked for its report.
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

/// A row of the trajectory; what is not known at the tick is NaN.
fn row(
    t: f64,
    seen: &[Observation<f32>],
    presence: &[Presence],
    prediction: &Prediction,
    judge: &Judge<'_>,
) -> Row {
    let components = seen.len().checked_div(presence.len()).unwrap_or(1).max(1);
    let column = |value: fn(&Observation<f32>) -> f32, known: fn(Presence) -> bool| {
        let of = |(at, observation): (usize, &Observation<f32>)| {
            let known = presence.get(at / components).is_some_and(|&presence| known(presence));
            if known { f64::from(value(observation)) } else { f64::NAN }
        };
        seen.iter().enumerate().map(of).collect()
    };
    let ran = |presence: Presence| presence == Presence::Ran;
    Row {
        t,
        x: column(|o| o.x, Presence::is_known),
        nu: column(|o| o.nu, ran),
        psi: column(|o| o.psi, ran),
        u: column(|o| o.u, ran),
        true_nu: judge.terms().to_vec(),
        asked_psi: judge.psi().to_vec(),
        xi: prediction.xi.clone(),
        blended: prediction.blended.clone(),
        lost: 0,
    }
}
