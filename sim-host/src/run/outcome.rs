//! What a run came to, before and after it is judged.

use super::options::Fidelity;
use crate::emergent::Prediction;
use crate::engine::NodeEvent;
use crate::record::{
    BenchSummary, BusSummary, EmergentSummary, Expectation, FunnelSummary, PerComponent, ReferenceSummary,
    Row, Summary, SyncSummary, TraceHash,
};
use crate::scenario::Scenario;
use funnel_core::Event;
use funnel_protocol::report::Counters;
use std::collections::BTreeSet;

/// What a run came to.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Trajectory.
    pub rows: Vec<Row>,
    /// States at the end, by index and then by component.
    pub last: Vec<f64>,
    /// Widest funnel at the end, as the nodes had it: floored at the resolution of `nu`, where it is.
    pub widest: f64,
    /// What was predicted: at the end, and over the recorded rows.
    pub prediction: Prediction,
    /// Largest `|nu| / psi` over all nodes and ticks.
    pub max_ratio: f64,
    /// Node-ticks with `|nu| >= psi`.
    pub breaches: u64,
    /// Hash of all states, where f32 nodes ran.
    pub hash: Option<TraceHash>,
    /// Distance to the reference, where there is a whole one.
    pub reference: Option<ReferenceSummary>,
    /// What the bus carried.
    pub bus: Option<BusSummary>,
    /// What f32 nodes counted, by index.
    pub counters: Vec<Counters>,
    /// What nodes reported.
    pub events: Vec<NodeEvent>,
    /// The nodes of a bench, and how they differ from loopback.
    pub bench: Option<BenchSummary>,
    /// Logs of emulated nodes: id and text.
    pub logs: Vec<(u8, String)>,
}

impl Outcome {
    /// The summary, with the scenario's expectations judged.
    pub fn judge(&self, scenario: &Scenario, on: Fidelity) -> Summary {
        let final_spread = spread(&self.last, scenario.components());
        let emergent = self.emergent();
        Summary {
            scenario: scenario.title.clone(),
            seed: scenario.seed,
            on: on.to_string(),
            nodes: scenario.nodes.len(),
            ticks: scenario.time.ticks,
            tick_s: scenario.time.tick_s(),
            trace_hash: self.hash.map(|hash| hash.to_string()),
            funnel: Some(FunnelSummary { max_ratio: self.max_ratio, breaches: self.breaches }),
            sync: Some(SyncSummary {
                final_spread,
                bound: scenario.sync_bound(self.widest),
                lambda2: scenario.graph.lambda2(),
            }),
            expect: self.expectations(scenario, final_spread, &emergent),
            emergent: Some(emergent),
            reference: self.reference,
            bus: self.bus.clone(),
            bench: self.bench.clone(),
            stopped: self.stopped(scenario),
            overruns: self.counters.iter().map(|counters| u64::from(counters.overruns)).sum(),
            wall_s: 0.0,
        }
    }

    /// Ids of the nodes that stopped by themselves, ascending.
    fn stopped(&self, scenario: &Scenario) -> Vec<u16> {
        let faults = self.events.iter().filter(|event| matches!(event.event, Event::Fault(_)));
        let ids = faults.filter_map(|event| scenario.nodes.get(event.node).map(|node| node.id));
        ids.collect::<BTreeSet<_>>().into_iter().collect()
    }

    fn emergent(&self) -> EmergentSummary {
        let prediction = &self.prediction;
        let known = |values: &[f64]| (!values.is_empty()).then(|| PerComponent(values.to_vec()));
        // The distance to what was not resolved is no measurement.
        let known_error = |values: &[f64]| !values.is_empty() && prediction.unresolved.is_none();
        let error = |values: &[f64]| known_error(values).then(|| distance(&self.last, values));
        EmergentSummary {
            unresolved: prediction.unresolved.clone(),
            final_error: error(&prediction.xi),
            xi_final: known(&prediction.xi),
            blended_error: error(&prediction.blended),
            blended_final: known(&prediction.blended),
            contraction: prediction.contraction,
            steady_ratio: prediction.steady_ratio.clone(),
            steady_ratio_max: prediction.steady_ratio_max.clone(),
        }
    }

    fn expectations(
        &self,
        scenario: &Scenario,
        final_spread: f64,
        emergent: &EmergentSummary,
    ) -> Vec<Expectation> {
        let expect = &scenario.expect;
        let beside = self.reference.zip(expect.reference_error);
        let reference_error = beside.and_then(|(reference, limit)| reference.measured(limit));
        let judged = [
            ("funnel_ratio", expect.funnel_ratio, Some(self.max_ratio)),
            ("final_spread", expect.final_spread, Some(final_spread)),
            ("emergent_error", expect.emergent_error, emergent.final_error),
            ("blended_error", expect.blended_error, emergent.blended_error),
            ("reference_error", expect.reference_error, reference_error),
        ];
        let final_value = expect.final_value.map(|expected| {
            Expectation::below(
                "final_value",
                expected.within,
                Some(distance(&self.last, &vec![expected.is; scenario.components()])),
            )
        });
        let judge = |(name, limit, value): (&str, Option<f64>, _)| {
            limit.map(|limit| Expectation::below(name, limit, value))
        };
        judged.into_iter().filter_map(judge).chain(final_value).collect()
    }
}

/// `max x - min x`, of the component in which the states are farthest apart.
fn spread(states: &[f64], components: usize) -> f64 {
    let apart = |component| {
        let states = || states.iter().copied().skip(component).step_by(components.max(1));
        states().fold(f64::NEG_INFINITY, f64::max) - states().fold(f64::INFINITY, f64::min)
    };
    (0..components).map(apart).fold(0.0, f64::max)
}

/// The largest distance of a state, by index and then by component, to a point.
fn distance(states: &[f64], point: &[f64]) -> f64 {
    states.iter().zip(point.iter().cycle()).map(|(x, xi)| (x - xi).abs()).fold(0.0, f64::max)
}
