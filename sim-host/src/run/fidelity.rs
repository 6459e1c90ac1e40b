//! Drives networks of f32 nodes: in this program, or on emulators.

use super::collect::Collector;
use super::error::RunError;
use super::heard;
use super::options::{RunOptions, Verbosity};
use super::outcome::{EarlyEnd, Outcome};
use super::reference;
use crate::bus::ideal::{IdealBus, IdealParams, Traffic};
use crate::central::Central;
use crate::configure::{Drive, central_configs, listeners, node_configs};
use crate::emulator;
use crate::engine::Engine;
use crate::hub::{Hub, HubError};
use crate::noise::Noise;
use crate::progress::Progress;
use crate::record::BusSummary;
use crate::scenario::{Coupling, Scenario};
use funnelnet_node::{Node, Params};
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::report::Report;
use funnelnet_protocol::{NodeConfig, Refusal};
use std::collections::BTreeMap;

/// Drive of nodes in this program.
const LOOPBACK: Drive = Drive { tick_source: TickSource::Timer, telemetry_every: 0 };
/// Drive of nodes behind streams of bytes: they tick when the hub says so, and tell all they see.
pub(super) const LOCKSTEP: Drive = Drive { tick_source: TickSource::Sync, telemetry_every: 1 };

/// Fidelity `loopback`.
pub fn loopback(scenario: &Scenario, options: &RunOptions) -> Result<Outcome, RunError> {
    if scenario.coupling == Coupling::WeaklyCentralised {
        return central(scenario, options);
    }
    let mut engine = engine(scenario)?;
    let exact = reference::where_expected(scenario, options)?;
    let mut collector = Collector::new(scenario, options.stride(scenario.time.ticks), exact.as_ref());
    let progress = progress("loopback", scenario, options);
    engine.start();
    // One tick more than the run has: it is what makes the diffusive terms at the end.
    let mut early = None;
    for k in 0..=scenario.time.ticks {
        if let Err(interrupted) = check_interrupt(options) {
            let Some(last) = last_of(k) else { return Err(interrupted) };
            collector.end_at(last, engine.observations(), &engine.presence(last));
            early = Some(EarlyEnd::after(k, scenario, interrupted));
            break;
        }
        // `None` where all nodes have stopped by themselves: what they saw last stays.
        let _ = engine.advance();
        collector.tick(k, engine.observations(), &engine.presence(k));
        progress.at(k as f64 * scenario.time.tick_s());
    }
    let reports: Vec<_> = engine.nodes().iter().map(Node::report).collect();
    let bus = Some(bus_record(engine.traffic(), &reports));
    let events = engine.events().to_vec();
    // Of a run that was cut off nobody knows who would still have been heard.
    let (unheard, silent) = match early {
        Some(_) => (Vec::new(), Vec::new()),
        None => heard::unheard_and_silent(scenario, &engine),
    };
    let outcome = collector.finish().with_reports(reports);
    Ok(Outcome { bus, events, unheard, silent, ended_early: early, ..outcome })
}

/// The nodes of a scenario in this program, on its bus, not started yet.
pub(crate) fn engine(scenario: &Scenario) -> Result<Engine, RunError> {
    let configs = node_configs(scenario, LOOPBACK).map_err(RunError::bad_input)?;
    let params = accepted(&configs)?.into_iter();
    let nodes = params.zip(&configs).map(|(params, config)| Node::new(params, &config.neighbours)).collect();
    Ok(Engine::new(nodes, bus(scenario)).with_noise(Noise::of(scenario)))
}

/// What the nodes make of their configurations.
fn accepted(configs: &[NodeConfig]) -> Result<Vec<Params<f32>>, RunError> {
    let params = |config: &NodeConfig| {
        Params::new(config).map_err(|error| {
            RunError::bad_input(format!("node {} refused its configuration: {error}", config.id))
        })
    };
    configs.iter().map(params).collect()
}

/// Weakly-centralised coupling, in one loop over all nodes and without a bus.
fn central(scenario: &Scenario, options: &RunOptions) -> Result<Outcome, RunError> {
    let params = accepted(&central_configs(scenario, LOOPBACK).map_err(RunError::bad_input)?)?;
    let exact = reference::where_expected(scenario, options)?;
    let mut collector = Collector::new(scenario, options.stride(scenario.time.ticks), exact.as_ref());
    let mut central = Central::new(params, &scenario.graph, Noise::of(scenario));
    let progress = progress("loopback", scenario, options);
    let (mut seen, mut early) = (Vec::new(), None);
    for k in 0..=scenario.time.ticks {
        if let Err(interrupted) = check_interrupt(options) {
            let Some(last) = last_of(k) else { return Err(interrupted) };
            collector.end_at(last, &seen, &central.presence());
            early = Some(EarlyEnd::after(k, scenario, interrupted));
            break;
        }
        seen = central.advance().to_vec();
        collector.tick(k, &seen, &central.presence());
        progress.at(k as f64 * scenario.time.tick_s());
    }
    let reports = central.reports();
    let bus = Some(bus_record(Traffic::default(), &reports));
    let events = central.events().to_vec();
    Ok(Outcome { bus, events, ended_early: early, ..collector.finish().with_reports(reports) })
}

/// Fidelity `emulator`.
pub fn emulator(scenario: &Scenario, options: &RunOptions) -> Result<Outcome, RunError> {
    let configs = node_configs(scenario, LOCKSTEP).map_err(RunError::bad_input)?;
    let ids: Vec<_> = configs.iter().map(|config| config.id).collect();
    let attached = emulator::attach(&ids, &options.emulator())?;
    let hub = Hub::new(attached, &configs, bus(scenario), emulator::PATIENCE)?;
    let mut hub = hub.with_noise(Noise::of(scenario));
    let outcome = lockstep("emulator", scenario, options, &mut hub, |_, _| Ok(()))?;
    Ok(Outcome { logs: hub.into_logs(), ..outcome })
}

/// Runs a network tick by tick; `each` sees the hub after every tick. However nodes fail once there is a tick, what was recorded is kept.
pub(super) fn lockstep(
    what: &'static str,
    scenario: &Scenario,
    options: &RunOptions,
    hub: &mut Hub,
    mut each: impl FnMut(u64, &mut Hub) -> Result<(), RunError>,
) -> Result<Outcome, RunError> {
    let exact = reference::where_expected(scenario, options)?;
    let mut collector = Collector::new(scenario, options.stride(scenario.time.ticks), exact.as_ref());
    let progress = progress(what, scenario, options);
    hub.start()?;
    let (mut seen, mut presence, mut failed) = (Vec::new(), Vec::new(), None);
    for k in 0..=scenario.time.ticks {
        let ran =
            if options.interrupt.is_set() { Err(HubError::Interrupted) } else { hub.advance().map(drop) };
        if let Err(error) = ran {
            let Some(last) = last_of(k) else { return Err(RunError::in_the_run(error)) };
            // An observation may be of the tick that has failed.
            collector.end_at(last, &seen, &presence);
            failed = Some((k, error));
            break;
        }
        seen.clear();
        seen.extend_from_slice(hub.observations());
        presence.clear();
        presence.extend_from_slice(hub.presence());
        collector.tick(k, &seen, &presence);
        each(k, hub)?;
        progress.at(k as f64 * scenario.time.tick_s());
    }
    let closed = close(scenario, hub, failed);
    Ok(with_words_of(hub, closed, collector.finish()))
}

/// The last of so many ticks, where that is enough for a record: a picture takes two.
fn last_of(ticks: u64) -> Option<u64> {
    ticks.checked_sub(1).filter(|&last| last > 0)
}

/// The reports of all nodes, by index, and why the run has ended where it has done so early: with this error after so many ticks, or as the
/// nodes were asked for their reports.
fn close(
    scenario: &Scenario,
    hub: &mut Hub,
    failed: Option<(u64, HubError)>,
) -> (Vec<Option<Report>>, Option<EarlyEnd>) {
    let (recorded, error) = match failed {
        Some(failed) => failed,
        None => match hub.finish() {
            Ok(reports) => return (reports, None),
            Err(error) => (scenario.time.ticks.saturating_add(1), error),
        },
    };
    let halted = hub.halt();
    let error = RunError::in_the_run(error).and(&halted);
    (halted.reports, Some(EarlyEnd::after(recorded, scenario, error)))
}

/// With all that the nodes have said beside their ticks.
fn with_words_of(
    hub: &Hub,
    (reports, early): (Vec<Option<Report>>, Option<EarlyEnd>),
    outcome: Outcome,
) -> Outcome {
    let (unheard, silent) = match early {
        // Who has had no time to be heard, and who was told to stop first, are none of them.
        Some(_) => (Vec::new(), Vec::new()),
        None => (hub.unheard(&reports), hub.silent(&reports)),
    };
    let mut contradictions = hub.contradictions();
    let unseen = hub.unseen(early.is_some());
    let bus = Some(bus_record(hub.traffic(), reports.iter().flatten()));
    let mut outcome = outcome.with_reports(reports);
    for (index, account) in outcome.accounts.iter_mut().enumerate() {
        (account.unseen, account.whole) = (unseen, hub.was_there_throughout(index));
        contradictions.extend(hub.cannot_have_counted(index, account));
    }
    let (events, warnings) = (hub.events().to_vec(), hub.warnings());
    Outcome { bus, events, warnings, unheard, silent, contradictions, ended_early: early, ..outcome }
}

pub(super) fn bus<P>(scenario: &Scenario) -> IdealBus<P> {
    bus_between(scenario, |_, _| true)
}

/// The same, where it carries the frames of one node to another only if `carries` says so, by index.
pub(super) fn bus_between<P>(scenario: &Scenario, carries: impl Fn(usize, usize) -> bool) -> IdealBus<P> {
    let mut listeners = listeners(scenario);
    for (from, list) in listeners.iter_mut().enumerate() {
        list.retain(|&to| carries(from, to));
    }
    let spec = &scenario.bus;
    let params = IdealParams { loss: spec.loss, latency_ns: spec.latency_ns, jitter_ns: spec.jitter_ns };
    IdealBus::new(params, scenario.seed, listeners)
}

fn progress(what: &'static str, scenario: &Scenario, options: &RunOptions) -> Progress {
    Progress::new(what, scenario.time.end_s(), options.verbosity == Verbosity::Quiet)
}

fn check_interrupt(options: &RunOptions) -> Result<(), RunError> {
    if options.interrupt.is_set() { Err(RunError::interrupted()) } else { Ok(()) }
}

fn bus_record<'a>(traffic: Traffic, reports: impl IntoIterator<Item = &'a Report>) -> BusSummary {
    let mut refused: BTreeMap<_, _> =
        Refusal::ALL.iter().map(|reason| (reason.name().to_owned(), 0)).collect();
    for Report { counters, .. } in reports {
        for &reason in Refusal::ALL {
            *refused.entry(reason.name().to_owned()).or_default() += u64::from(counters.refused(reason));
        }
    }
    BusSummary { utilisation: 0.0, sent: traffic.sent, lost: traffic.lost, refused }
}
