//! Takes what f32 nodes see, tick by tick, and keeps what a run is judged by.

use super::between::Round;
use super::error::RunError;
use super::outcome::{Believed, Outcome};
use super::rows::Rows;
use crate::emergent::{Prediction, Predictor};
use crate::extremes::{larger, largest};
use crate::judge::{Account, Accounts, Judge, Moment, ReferenceSummary};
use crate::number::shortest;
use crate::presence::Presence;
use crate::record::{OnBus, Row, TraceHash};
use crate::reference::ReferenceSolution;
use crate::scenario::Scenario;
use funnelnet_node::Observation;

/// What the hash takes for a state that a node does not have, or of which nothing is known: no run without
/// such a gap is equal to one with it.
const NO_STATE: f32 = f32::from_bits(0x7fc0_0000);
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
    accounts: Accounts<'a>,
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
    /// For `scenario`, with a row every `stride` steps of the nodes' fields, which goes to `rows`. Where a
    /// tick is a round of several steps, there are rows between two ticks for [`Self::between_rounds`] only.
    pub fn new(
        scenario: &'a Scenario,
        stride: u64,
        reference: Option<&'a ReferenceSolution>,
        rows: &'a mut dyn Rows,
    ) -> Self {
        Self {
            scenario,
            stride,
            round: None,
            looks_into_rounds: false,
            predictor: Predictor::new(scenario),
            judge: Judge::new(scenario),
            reference,
            hash: TraceHash::new(),
            accounts: Accounts::new(scenario),
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

    /// Takes what the nodes saw at tick `k`, by index and then by component, and what is known of them there,
    /// by index.
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
        self.accounts.tick(k, seen, presence, self.judge.psi());
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
        let (findings, accounts) = (self.judge.finish(), self.accounts.finish());
        Outcome {
            hash: Some(self.hash),
            max_ratio: findings.max_ratio,
            breaches: findings.breaches,
            believed: Some(believed(&accounts)),
            last: findings.last.clone(),
            findings,
            accounts,
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
