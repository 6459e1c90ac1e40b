//! Drives networks of f32 nodes: in this program, or on emulators.

use super::collect::Collector;
use super::error::RunError;
use super::options::{RunOptions, Verbosity};
use super::outcome::Outcome;
use super::reference;
use crate::bus::ideal::{IdealBus, IdealParams, Traffic};
use crate::central::Central;
use crate::configure::{Drive, central_configs, listeners, node_configs};
use crate::emulator;
use crate::engine::Engine;
use crate::extremes::largest;
use crate::hub::Hub;
use crate::noise::Noise;
use crate::progress::Progress;
use crate::record::BusSummary;
use crate::scenario::{CouplingKind, Scenario};
use funnel_core::{Node, Params};
use funnel_protocol::config::TickSource;
use funnel_protocol::report::Report;
use funnel_protocol::{NodeConfig, Refusal};
use std::collections::BTreeMap;

/// Drive of nodes in this program.
const LOOPBACK: Drive = Drive { tick_source: TickSource::Timer, telemetry_every: 0 };
/// Drive of nodes behind streams of bytes: they tick when the hub says so, and tell all they see.
pub(super) const LOCKSTEP: Drive = Drive { tick_source: TickSource::Sync, telemetry_every: 1 };

/// Fidelity `loopback`.
pub fn loopback(scenario: &Scenario, options: &RunOptions) -> Result<Outcome, RunError> {
    if scenario.coupling == CouplingKind::WeaklyCentralised {
        return central(scenario, options);
    }
    let mut engine = engine(scenario)?;
    let exact = reference::where_expected(scenario, options)?;
    let mut collector = Collector::new(scenario, options.stride(scenario.time.ticks), exact.as_ref());
    let progress = progress("loopback", scenario, options);
    engine.start();
    let mut ended_early = None;
    // One tick more than the run has: it is what makes the diffusive terms at the end.
    for k in 0..=scenario.time.ticks {
        // `None` where all nodes have stopped by themselves: what they saw last stays.
        let _ = engine.advance();
        collector.tick(k, engine.observations(), &engine.presence(k));
        progress.at(k as f64 * scenario.time.tick_s());
        ended_early = interrupted(k, scenario, options);
        if ended_early.is_some() {
            break;
        }
    }
    let reports: Vec<_> = engine.nodes().iter().map(Node::report).collect();
    let bus = Some(bus_record(engine.traffic(), &reports));
    let outcome = ended(collector.finish().with_reports(reports), ended_early);
    Ok(Outcome { bus, events: engine.events().to_vec(), ..outcome })
}

/// What there is to say where the user wants to stop after tick `k`, and there are more.
fn interrupted(k: u64, scenario: &Scenario, options: &RunOptions) -> Option<String> {
    let more = k < scenario.time.ticks;
    (more && options.interrupt.is_set()).then(|| options.interrupted_at(k, scenario))
}

/// An outcome with what it is to be judged by where the run has not come to its end.
fn ended(outcome: Outcome, ended_early: Option<String>) -> Outcome {
    let widest = match (&ended_early, outcome.rows.last()) {
        (Some(_), Some(last)) => largest(0.0, last.asked_psi.iter().copied()),
        _ => outcome.widest,
    };
    Outcome { widest, ended_early, ..outcome }
}

/// The nodes of a scenario in this program, on its bus, not started yet.
pub(super) fn engine(scenario: &Scenario) -> Result<Engine, RunError> {
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
    let mut ended_early = None;
    for k in 0..=scenario.time.ticks {
        let seen = central.advance().to_vec();
        collector.tick(k, &seen, &central.presence());
        progress.at(k as f64 * scenario.time.tick_s());
        ended_early = interrupted(k, scenario, options);
        if ended_early.is_some() {
            break;
        }
    }
    let reports = central.reports();
    let bus = Some(bus_record(Traffic::default(), &reports));
    let outcome = ended(collector.finish().with_reports(reports), ended_early);
    Ok(Outcome { bus, events: central.events().to_vec(), ..outcome })
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

/// Runs a network tick by tick; `each` sees the hub after every tick.
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
    for k in 0..=scenario.time.ticks {
        check_interrupt(options)?;
        hub.advance()?;
        collector.tick(k, hub.observations(), &hub.presence(k));
        each(k, hub)?;
        progress.at(k as f64 * scenario.time.tick_s());
    }
    let reports = hub.finish()?;
    let bus = Some(bus_record(hub.traffic(), &reports));
    Ok(Outcome { bus, events: hub.events().to_vec(), ..collector.finish().with_reports(reports) })
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

fn bus_record(traffic: Traffic, reports: &[Report]) -> BusSummary {
    let mut refused: BTreeMap<_, _> =
        Refusal::ALL.iter().map(|reason| (reason.name().to_owned(), 0)).collect();
    for Report { counters, .. } in reports {
        for &reason in Refusal::ALL {
            *refused.entry(reason.name().to_owned()).or_default() += u64::from(counters.refused(reason));
        }
    }
    BusSummary { utilisation: 0.0, sent: traffic.sent, lost: traffic.lost, refused }
}
