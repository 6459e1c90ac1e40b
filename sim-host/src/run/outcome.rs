//! What a run came to, before and after it is judged.

use super::error::RunError;
use super::event_log::MoreEvents;
use super::options::Fidelity;
use crate::emergent::Prediction;
use crate::engine::NodeEvent;
use crate::exit::Exit;
use crate::extremes::larger;
use crate::judge::{
    Account, Check, CounterSummary, EventFigures, Evidence, Findings, Recovered, ReferenceSummary, Stop,
    WindowFigures, checks,
};
use crate::record::{
    BelievedSummary, BenchSummary, BusSummary, ClockSummary, DuringEventsSummary, EmergentSummary,
    EventSummary, Expectation, FunnelSummary, PerComponent, Row, Summary, SyncSummary, TraceHash,
};
use crate::scenario::{EventSpec, Scenario, Window};
use funnelnet_protocol::report::{Counters, Report};
use std::collections::BTreeSet;

/// What nodes believe of their funnels, for who compares it with what is true.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Believed {
    /// The largest `|nu| / psi` that a node has seen.
    pub max_ratio: f64,
    /// Node-ticks at which a node believed to be outside.
    pub breaches: u64,
}

/// How a run ended before its last tick.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EarlyEnd {
    /// After how many ticks of how many, and why, in one line.
    pub why: String,
    /// All that there is to say about it, a line each.
    pub words: String,
    /// How the program ends for it.
    pub exit: Exit,
}

impl EarlyEnd {
    /// After `recorded` ticks of a run of `scenario`.
    pub fn after(recorded: u64, scenario: &Scenario, error: RunError) -> Self {
        let RunError { message, exit } = error;
        let first = match exit {
            Exit::Interrupted => "interrupted",
            _ => message.lines().next().unwrap_or_default(),
        };
        let why = format!("after {recorded} of {} ticks: {first}", scenario.time.ticks.saturating_add(1));
        Self { why, words: message, exit }
    }

    /// What there is to say of it on the terminal; `is_written`: what was recorded has gone into files.
    pub fn told(&self, is_written: bool) -> String {
        if self.exit != Exit::Interrupted {
            return self.words.clone();
        }
        let after = self.why.trim_end_matches(": interrupted");
        let recorded = match is_written {
            true => "what was recorded until then was written, and says so",
            false => "no output was asked for",
        };
        let others = self.words.lines().skip(1).map(|line| format!("\n{line}")).collect::<String>();
        format!("interrupted {after}; {recorded}{others}")
    }
}

/// What a run came to.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    /// Where it ended before its last tick. The rest is of the ticks that it had.
    pub ended_early: Option<EarlyEnd>,
    /// Trajectory, where it is kept rather than written as it comes.
    pub rows: Vec<Row>,
    /// States at the end, by index and then by component; NaN where one is not known.
    pub last: Vec<f64>,
    /// Widest funnel at the end that the run is judged by.
    pub widest: f64,
    /// What was predicted: at the end, and over the recorded rows.
    pub prediction: Prediction,
    /// Largest true `|nu| / psi` over all nodes and ticks; NaN where one was not a number.
    pub max_ratio: f64,
    /// Node-ticks with a true `|nu| >= psi`.
    pub breaches: u64,
    /// The same as nodes believe it, where f32 nodes ran.
    pub believed: Option<Believed>,
    /// All that the judge found.
    pub findings: Findings,
    /// What each node said of itself, by index; empty where no f32 node ran.
    pub accounts: Vec<Account>,
    /// Ids of nodes that no neighbour has ever heard.
    pub unheard: Vec<u16>,
    /// Ids of nodes that all neighbours have lost at the end.
    pub silent: Vec<u16>,
    /// What contradicts the run, as sentences.
    pub contradictions: Vec<String>,
    /// FAULT frames that did not stop their node.
    pub warnings: u64,
    /// Hash of all states, where f32 nodes ran.
    pub hash: Option<TraceHash>,
    /// Distance to the reference, where there is a whole one.
    pub reference: Option<ReferenceSummary>,
    /// What the bus carried.
    pub bus: Option<BusSummary>,
    /// What came of the nodes' clocks, where they have clocks of their own.
    pub clocks: Option<ClockSummary>,
    /// What f32 nodes counted, by index.
    pub counters: Vec<Counters>,
    /// What nodes reported: of each the first hundred of a kind.
    pub events: Vec<NodeEvent>,
    /// The scenario's events, where they have been made to happen.
    pub happened: Vec<EventSpec>,
    /// What came of the others.
    pub more_events: Vec<MoreEvents>,
    /// The nodes of a bench, and how they differ from loopback.
    pub bench: Option<BenchSummary>,
    /// Logs of emulated nodes: id and text.
    pub logs: Vec<(u8, String)>,
}

impl Outcome {
    /// With the closing reports of all nodes, by index; `None` for one that has given none.
    #[must_use]
    pub fn with_reports(mut self, reports: impl IntoIterator<Item = impl Into<Option<Report>>>) -> Self {
        let reports: Vec<Option<Report>> = reports.into_iter().map(Into::into).collect();
        for (account, report) in self.accounts.iter_mut().zip(&reports) {
            account.report = report.as_ref().map(|report| (report.max_ratio, report.counters.clone()));
        }
        let counters = |report: Option<Report>| report.map(|report| report.counters).unwrap_or_default();
        Self { counters: reports.into_iter().map(counters).collect(), ..self }
    }

    /// The summary, with the scenario's expectations judged.
    pub fn judge(&self, scenario: &Scenario, on: Fidelity) -> Summary {
        let emergent = self.emergent();
        let mut summary = Summary {
            scenario: scenario.title.clone(),
            seed: scenario.seed,
            on: on.to_string(),
            nodes: scenario.nodes.len(),
            ticks: scenario.time.ticks,
            tick_s: scenario.time.tick_s(),
            ended_early: self.ended_early.as_ref().map(|early| early.why.clone()),
            trace_hash: self.hash.map(|hash| hash.to_string()),
            funnel: Some(self.funnel()),
            events: self.events(),
            sync: Some(SyncSummary {
                final_spread: self.findings.final_spread.unwrap_or(f64::NAN),
                max_spread: self.findings.max_spread.unwrap_or(f64::NAN),
                // The bound is that of the whole graph.
                bound: if self.findings.off.contains(&true) {
                    f64::NAN
                } else {
                    scenario.sync_bound(self.widest)
                },
                lambda2: scenario.graph.lambda2(),
            }),
            max_input: self.findings.max_input.unwrap_or(f64::NAN),
            expect: self.expectations(scenario, &emergent),
            checks: self.checks(scenario),
            emergent: Some(emergent),
            reference: self.reference,
            bus: self.bus.clone(),
            clocks: self.clocks,
            counters: self.believed.map(|_| self.count()),
            bench: self.bench.clone(),
            stopped: self.stopped(scenario),
            own_fields: hosted(scenario),
            overruns: self.counters.iter().map(|counters| u64::from(counters.overruns)).sum(),
            ..Summary::default()
        };
        summary.passed = summary.passes();
        summary
    }

    fn funnel(&self) -> FunnelSummary {
        let believed = |believed: Believed| BelievedSummary {
            max_ratio: believed.max_ratio,
            breaches: believed.breaches,
        };
        let reopened = self.counters.iter().any(|counters| counters.reopened > 0);
        FunnelSummary {
            max_ratio: self.ratio().unwrap_or(f64::NAN),
            breaches: self.breaches,
            during_events: self.findings.during_events.map(|during| DuringEventsSummary {
                max_ratio: if during.judged > 0 { during.max_ratio } else { f64::NAN },
                breaches: during.breaches,
                node_ticks: during.judged,
            }),
            unknown: self.findings.unknown,
            uncoupled: self.findings.uncoupled,
            reopened_ratio: self.believed.filter(|_| reopened).map(|believed| believed.max_ratio),
            believed: self.believed.map(believed),
        }
    }

    /// What each event did that was made.
    fn events(&self) -> Vec<EventSummary> {
        let of = |(event, figures): (&EventSpec, &EventFigures)| EventSummary {
            event: event.to_string(),
            from_s: event.at_ns as f64 / 1e9,
            to_s: figures.end_ns.map(|end| end as f64 / 1e9),
            max_ratio: if figures.during.judged > 0 { figures.during.max_ratio } else { f64::NAN },
            breaches: figures.during.breaches,
            node_ticks: figures.during.judged,
            recovered_s: figures.recovery.after_s(),
            recovery: match figures.recovery {
                Recovered::After(_) => "inside",
                Recovered::Outside => "outside",
                Recovered::NotSeen => "not seen",
            },
        };
        self.happened.iter().zip(&self.findings.events).map(of).collect()
    }

    /// The largest true ratio, where a term was known at all: zero would pass.
    fn ratio(&self) -> Option<f64> {
        (self.findings.judged > 0).then_some(self.max_ratio)
    }

    fn count(&self) -> CounterSummary {
        let ratios: Vec<f32> =
            self.accounts.iter().filter_map(|a| a.report.as_ref().map(|&(ratio, _)| ratio)).collect();
        CounterSummary::of(&self.counters, &ratios, self.warnings)
    }

    fn checks(&self, scenario: &Scenario) -> Vec<Check> {
        let stops = self.stops(scenario);
        let absences = self.bench.as_ref().map_or(&[][..], |bench| bench.absences.as_slice());
        checks(
            scenario,
            &Evidence {
                findings: &self.findings,
                accounts: &self.accounts,
                stops: &stops,
                absences,
                unheard: &self.unheard,
                silent: &self.silent,
                contradictions: &self.contradictions,
                reference: self.reference.as_ref(),
                ended_early: self.ended_early.as_ref().map(|early| early.why.as_str()),
            },
        )
    }

    /// The nodes that stopped by themselves, in the order in which they did.
    pub fn stops(&self, scenario: &Scenario) -> Vec<Stop> {
        self.events.iter().filter_map(|event| Stop::of(event, scenario)).collect()
    }

    /// Ids of the nodes that stopped by themselves, ascending.
    fn stopped(&self, scenario: &Scenario) -> Vec<u16> {
        self.stops(scenario).into_iter().map(|stop| stop.id).collect::<BTreeSet<_>>().into_iter().collect()
    }

    fn emergent(&self) -> EmergentSummary {
        let prediction = &self.prediction;
        let known = |values: &[f64]| (!values.is_empty()).then(|| PerComponent(values.to_vec()));
        // The distance to what was not resolved is no measurement.
        let known_error = |values: &[f64]| !values.is_empty() && prediction.unresolved.is_none();
        let error = |values: &[f64]| if known_error(values) { self.distance(values) } else { None };
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

    /// The largest distance of a state at the end to a point; `None` where one is not known, or none is
    /// there. A node that an event keeps off has none.
    fn distance(&self, point: &[f64]) -> Option<f64> {
        let states = self.last.iter().zip(point.iter().cycle()).enumerate();
        let on = states.filter(|(at, _)| !self.findings.off.get(*at).is_some_and(|off| *off));
        let farthest = on.map(|(_, (x, point))| (x - point).abs()).reduce(larger);
        farthest.filter(|distance| !distance.is_nan())
    }

    fn expectations(&self, scenario: &Scenario, emergent: &EmergentSummary) -> Vec<Expectation> {
        let (expect, findings) = (&scenario.expect, &self.findings);
        let final_value = expect.final_value.map(|expected| {
            let value = self.distance(&vec![expected.is; scenario.components()]);
            Expectation::below("final_value", expected.within, value)
        });
        let reference = self.reference.zip(expect.reference_error);
        let reference = reference.and_then(|(reference, limit)| reference.measured(limit));
        let before = judged([
            ("funnel_ratio".to_owned(), expect.funnel_ratio, self.ratio()),
            ("final_spread".to_owned(), expect.final_spread, findings.final_spread),
            ("emergent_error".to_owned(), expect.emergent_error, emergent.final_error),
            ("blended_error".to_owned(), expect.blended_error, emergent.blended_error),
            ("reference_error".to_owned(), expect.reference_error, reference),
        ]);
        let within = expect.recovered_within_ns.map(|ns| ns as f64 / 1e9);
        let after = judged([
            ("max_input".to_owned(), expect.max_input, findings.max_input),
            ("recovered_within".to_owned(), within, findings.recovered_s),
        ]);
        let windows = expect.windows.iter().zip(&findings.windows).enumerate();
        let beside = self.reference.unwrap_or_default();
        let windows = windows.flat_map(|(n, (window, figures))| of_window(n + 1, window, figures, beside));
        before.chain(final_value).chain(after).chain(windows).collect()
    }
}

/// Ids of the nodes whose fields the program around the simulation computes.
fn hosted(scenario: &Scenario) -> Vec<u16> {
    scenario.nodes.iter().filter(|node| node.dynamics.hosted().is_some()).map(|node| node.id).collect()
}

/// Those of a list of names, limits and values that have a limit.
fn judged<const N: usize>(
    list: [(String, Option<f64>, Option<f64>); N],
) -> impl Iterator<Item = Expectation> {
    list.into_iter().filter_map(|(name, limit, value)| Some(Expectation::below(name, limit?, value)))
}

fn of_window(
    number: usize,
    window: &Window,
    figures: &WindowFigures,
    beside: ReferenceSummary,
) -> impl Iterator<Item = Expectation> {
    let name = |key: &str| format!("window.{number}.{key}");
    let reference_error = window.reference_error.zip(figures.reference_error);
    let reference_error = reference_error
        .and_then(|(limit, max_error)| ReferenceSummary { max_error, ..beside }.measured(limit));
    judged([
        (name("funnel_ratio"), window.funnel_ratio, figures.funnel_ratio),
        (name("spread"), window.spread, figures.spread),
        (name("emergent_error"), window.emergent_error, figures.emergent_error),
        (name("reference_error"), window.reference_error, reference_error),
        (name("max_input"), window.max_input, figures.max_input),
    ])
}
