//! Takes what f32 nodes see, tick by tick, and keeps what a run is judged by.

use super::outcome::Outcome;
use crate::emergent::{Prediction, Predictor};
use crate::record::{ReferenceSummary, Row, TraceHash, shortest};
use crate::reference::ReferenceSolution;
use crate::scenario::Scenario;
use funnel_core::Observation;

/// Collector of one run.
pub struct Collector<'a> {
    scenario: &'a Scenario,
    stride: u64,
    predictor: Predictor<'a>,
    /// Continuous-time states at every tick, where they are asked for.
    reference: Option<&'a ReferenceSolution>,
    hash: TraceHash,
    max_ratio: f32,
    breaches: u64,
    reference_error: ReferenceSummary,
    outcome: Outcome,
}

impl<'a> Collector<'a> {
    /// For `scenario`, with a row every `stride` ticks.
    pub fn new(scenario: &'a Scenario, stride: u64, reference: Option<&'a ReferenceSolution>) -> Self {
        Self {
            scenario,
            stride,
            predictor: Predictor::new(scenario),
            reference,
            hash: TraceHash::new(),
            max_ratio: 0.0,
            breaches: 0,
            reference_error: reference.map(ReferenceSummary::beside).unwrap_or_default(),
            outcome: Outcome::default(),
        }
    }

    /// Takes what the nodes saw at tick `k`, by index and then by component.
    pub fn tick(&mut self, k: u64, seen: &[Observation<f32>]) {
        for observation in seen {
            self.hash.push(observation.x);
            self.max_ratio = self.max_ratio.max(observation.ratio);
            // A node that has stopped keeps its last observation, which is no breach of this tick.
            self.breaches += u64::from(observation.ratio >= 1.0 && u64::from(observation.tick) == k);
        }
        self.compare(k, seen);
        let last = k == self.scenario.time.ticks;
        if last || k.is_multiple_of(self.stride) {
            let t = k as f64 * self.scenario.time.tick_s();
            let prediction = self.predictor.advance(t);
            if last {
                self.outcome.last = seen.iter().map(|o| f64::from(o.x)).collect();
                self.outcome.widest = seen.iter().map(|o| f64::from(o.psi)).fold(0.0, f64::max);
            }
            if k.is_multiple_of(self.stride) {
                self.outcome.rows.push(row(t, seen, prediction));
            }
        }
    }

    /// What the run came to.
    pub fn finish(self) -> Outcome {
        Outcome {
            hash: Some(self.hash),
            max_ratio: shortest(self.max_ratio),
            breaches: self.breaches,
            reference: self.reference.map(|_| self.reference_error),
            prediction: self.predictor.finish(),
            ..self.outcome
        }
    }

    fn compare(&mut self, k: u64, seen: &[Observation<f32>]) {
        let Some(exact) = self.reference.and_then(|exact| exact.x.chunks_exact(exact.nodes).nth(k as usize))
        else {
            return;
        };
        let error = seen.iter().zip(exact).map(|(o, x)| (f64::from(o.x) - x).abs()).fold(0.0, f64::max);
        self.reference_error.max_error = self.reference_error.max_error.max(error);
        self.reference_error.final_error = error;
    }
}

fn row(t: f64, seen: &[Observation<f32>], prediction: &Prediction) -> Row {
    let column = |value: fn(&Observation<f32>) -> f32| seen.iter().map(|o| f64::from(value(o))).collect();
    Row {
        t,
        x: column(|o| o.x),
        nu: column(|o| o.nu),
        psi: column(|o| o.psi),
        u: column(|o| o.u),
        xi: prediction.xi.clone(),
        blended: prediction.blended.clone(),
    }
}
