//! Drives networks of f32 nodes: in this program, or on emulators.

use super::collect::Collector;
use super::error::RunError;
use super::options::{RunOptions, Verbosity};
use super::outcome::Outcome;
use super::reference;
use crate::bus::ideal::{IdealBus, IdealParams, Traffic};
use crate::central::Central;
use crate::configure::{Drive, central_configs, listeners, node_configs};
use crate::emulator::{Emulator, EmulatorOptions, decode_log};
use crate::engine::Engine;
use crate::noise::Noise;
use crate::progress::Progress;
use crate::record::BusSummary;
use crate::scenario::{CouplingKind, Scenario};
use funnel_core::{Node, Params};
use funnel_protocol::config::TickSource;
use funnel_protocol::report::Counters;
use funnel_protocol::{NodeConfig, Refusal};
use std::collections::BTreeMap;

/// Drive of nodes in this program.
const LOOPBACK: Drive = Drive { tick_source: TickSource::Timer, telemetry_every: 0 };

/// Fidelity `loopback`.
pub fn loopback(scenario: &Scenario, options: &RunOptions) -> Result<Outcome, RunError> {
    if scenario.coupling == CouplingKind::WeaklyCentralised {
        return central(scenario, options);
    }
    let configs = node_configs(scenario, LOOPBACK).map_err(RunError::bad_input)?;
    let nodes = accepted(&configs)?.into_iter().map(Node::new).collect();
    let exact = reference::where_expected(scenario, options)?;
    let mut collector = Collector::new(scenario, options.stride(scenario.time.ticks), exact.as_ref());
    let mut engine = Engine::new(nodes, bus(scenario)).with_noise(Noise::of(scenario));
    let progress = progress("loopback", scenario, options);
    engine.start();
    // One tick more than the run has: it is what makes the diffusive terms at the end.
    for k in 0..=scenario.time.ticks {
        check_interrupt(options)?;
        match engine.advance() {
            Some(seen) => collector.tick(k, seen),
            // All nodes have stopped by themselves; what they saw last stays.
            None => collector.tick(k, engine.observations()),
        }
        progress.at(k as f64 * scenario.time.tick_s());
    }
    let counters: Vec<_> = engine.nodes().iter().map(|node| node.counters().clone()).collect();
    Ok(Outcome {
        bus: Some(bus_record(engine.traffic(), &counters)),
        counters,
        events: engine.events().to_vec(),
        ..collector.finish()
    })
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
    for k in 0..=scenario.time.ticks {
        check_interrupt(options)?;
        collector.tick(k, central.advance());
        progress.at(k as f64 * scenario.time.tick_s());
    }
    let counters = central.counters();
    let bus = Some(bus_record(Traffic::default(), &counters));
    Ok(Outcome { bus, counters, events: central.events().to_vec(), ..collector.finish() })
}

/// Fidelity `emulator`.
pub fn emulator(scenario: &Scenario, options: &RunOptions) -> Result<Outcome, RunError> {
    let drive = Drive { tick_source: TickSource::Sync, telemetry_every: 1 };
    let configs = node_configs(scenario, drive).map_err(RunError::bad_input)?;
    let emulator_options = EmulatorOptions {
        image: options.image.clone(),
        qemu: "qemu-system-arm".to_owned(),
        interrupt: options.interrupt.clone(),
    };
    let mut emulator =
        Emulator::new(&configs, bus(scenario), &emulator_options)?.with_noise(Noise::of(scenario));
    let exact = reference::where_expected(scenario, options)?;
    let mut collector = Collector::new(scenario, options.stride(scenario.time.ticks), exact.as_ref());
    let progress = progress("emulator", scenario, options);
    emulator.start()?;
    for k in 0..=scenario.time.ticks {
        check_interrupt(options)?;
        collector.tick(k, emulator.advance()?);
        progress.at(k as f64 * scenario.time.tick_s());
    }
    let counters: Vec<_> = emulator.finish()?.into_iter().map(|report| report.counters).collect();
    let bus = Some(bus_record(emulator.traffic(), &counters));
    let events = emulator.events().to_vec();
    // The image was there when the nodes started; without it the logs stay undecoded.
    let image = std::fs::read(&options.image).unwrap_or_default();
    let decoded = emulator.into_logs().into_iter().map(|log| decode_log(&image, &log));
    let logs = configs.iter().map(|config| config.id).zip(decoded).collect();
    Ok(Outcome { bus, counters, events, logs, ..collector.finish() })
}

fn bus<P>(scenario: &Scenario) -> IdealBus<P> {
    let spec = &scenario.bus;
    let params = IdealParams { loss: spec.loss, latency_ns: spec.latency_ns, jitter_ns: spec.jitter_ns };
    IdealBus::new(params, scenario.seed, listeners(scenario))
}

fn progress(what: &'static str, scenario: &Scenario, options: &RunOptions) -> Progress {
    Progress::new(what, scenario.time.end_s(), options.verbosity == Verbosity::Quiet)
}

fn check_interrupt(options: &RunOptions) -> Result<(), RunError> {
    if options.interrupt.is_set() { Err(RunError::interrupted()) } else { Ok(()) }
}

fn bus_record(traffic: Traffic, counters: &[Counters]) -> BusSummary {
    let mut refused: BTreeMap<_, _> =
        Refusal::ALL.iter().map(|reason| (reason.name().to_owned(), 0)).collect();
    for counters in counters {
        for &reason in Refusal::ALL {
            *refused.entry(reason.name().to_owned()).or_default() += u64::from(counters.refused(reason));
        }
    }
    BusSummary { utilisation: 0.0, sent: traffic.sent, lost: traffic.lost, refused }
}
