//! Drives networks of f32 nodes: in this program, or on emulators.

use super::drive::{Cut, Record, drive};
use super::error::RunError;
use super::heard;
use super::network::Network;
use super::options::RunOptions;
use super::outcome::{EarlyEnd, Outcome};
use super::rows::Rows;
use crate::bus::Medium;
use crate::bus::can::{CanBus, SAMPLE_PER_MILLE};
use crate::bus::ideal::{IdealBus, IdealParams, Traffic};
use crate::central::Central;
use crate::configure::{Drive, central_configs, listeners, node_configs};
use crate::emulator;
use crate::engine::{Engine, World};
use crate::hub::Hub;
use crate::noise::Noise;
use crate::random::{self, Purpose};
use crate::record::BusSummary;
use crate::scenario::{BusModel, Coupling, Scenario};
use funnelnet_can_bus::{BitErrors, BitRate, Timing};
use funnelnet_node::{Node, Params};
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::message::NodeId;
use funnelnet_protocol::report::Report;
use funnelnet_protocol::{NodeConfig, Refusal};
use rand_pcg::rand_core::Rng as _;
use std::collections::BTreeMap;

/// Drive of nodes in this program.
const LOOPBACK: Drive = Drive { tick_source: TickSource::Timer, telemetry_every: 0, is_simulated: true };
/// Drive of nodes in this program that come during a run: only SYNC tells them the tick.
const JOINING: Drive = Drive { tick_source: TickSource::Sync, telemetry_every: 0, is_simulated: true };
/// Drive of nodes behind streams of bytes: they tick when the hub says so, and tell all they see.
pub(super) const LOCKSTEP: Drive =
    Drive { tick_source: TickSource::Sync, telemetry_every: 1, is_simulated: false };

/// Fidelity `loopback`.
pub fn loopback(scenario: &Scenario, options: &RunOptions, rows: &mut dyn Rows) -> Result<Outcome, RunError> {
    if scenario.coupling == Coupling::WeaklyCentralised {
        return central(scenario, options, rows);
    }
    match scenario.bus.model {
        BusModel::Can => {
            let engine = Engine::new(nodes(scenario, LOOPBACK)?, can_bus(scenario)?);
            in_program(scenario, options, rows, engine.with_noise(Noise::of(scenario)))
        }
        BusModel::Ideal | BusModel::CanFd | BusModel::Uart => {
            in_program(scenario, options, rows, engine(scenario)?)
        }
    }
}

fn in_program<M: Medium>(
    scenario: &Scenario,
    options: &RunOptions,
    rows: &mut dyn Rows,
    mut engine: Engine<M>,
) -> Result<Outcome, RunError> {
    let record = drive("loopback", scenario, options, &mut engine, rows, |_, _| Ok(()))?;
    // Of a run that was cut off nobody knows who would still have been heard.
    let (unheard, silent) = match record.cut {
        Some(_) => (Vec::new(), Vec::new()),
        None => heard::unheard_and_silent(scenario, &engine),
    };
    let (happened, reports) = (scenario.events.clone(), engine.reports());
    Ok(Outcome { unheard, silent, happened, ..with_reports(reports, scenario, &mut engine, record) })
}

/// The nodes of a scenario in this program, on an ideal bus, not started yet.
pub(crate) fn engine(scenario: &Scenario) -> Result<Engine, RunError> {
    let engine = Engine::new(nodes(scenario, LOOPBACK)?, bus(scenario)).with_noise(Noise::of(scenario));
    if scenario.events.is_empty() {
        return Ok(engine);
    }
    let fresh = nodes(scenario, JOINING)?;
    let world = World::new(
        &scenario.course().on_clock(&scenario.time),
        scenario.time.tick_ns,
        listeners(scenario),
        fresh,
    );
    Ok(engine.with_world(world))
}

/// The nodes of a scenario, configured.
fn nodes(scenario: &Scenario, drive: Drive) -> Result<Vec<Node>, RunError> {
    let configs = node_configs(scenario, drive).map_err(RunError::bad_input)?;
    let params = accepted(&configs)?.into_iter();
    Ok(params.zip(&configs).map(|(params, config)| Node::new(params, &config.neighbours)).collect())
}

/// The scenario's CAN bus, with as many bit errors as it asks for.
fn can_bus(scenario: &Scenario) -> Result<CanBus<impl funnelnet_can_bus::Noise>, RunError> {
    let spec = &scenario.bus;
    let rate = BitRate::new(spec.bitrate, SAMPLE_PER_MILLE).map_err(RunError::bad_input)?;
    let mut stream = random::stream(scenario.seed, Purpose::BitErrors, 0);
    let errors =
        BitErrors::on_the_bus(spec.bit_errors, move || stream.next_u64()).map_err(RunError::bad_input)?;
    let configs = node_configs(scenario, LOOPBACK).map_err(RunError::bad_input)?;
    let ids: Vec<NodeId> = configs.iter().filter_map(|config| NodeId::new(config.id)).collect();
    Ok(CanBus::new(Timing::classic(rate), errors, &ids, &listeners(scenario)))
}

/// Nodes that are not in this program have no bus but the ideal one of the hub, or a real one.
pub(super) fn needs_no_can(scenario: &Scenario) -> Result<(), RunError> {
    if scenario.bus.model == BusModel::Ideal {
        return Ok(());
    }
    Err(RunError::bad_input(
        "bus.model = \"can\" is for nodes in this program; run it with --on loopback, or set bus.model to \"ideal\"",
    ))
}

/// Parameters that the nodes make of their configurations.
fn accepted(configs: &[NodeConfig]) -> Result<Vec<Params<f32>>, RunError> {
    let params = |config: &NodeConfig| {
        Params::new(config).map_err(|error| {
            RunError::bad_input(format!("node {} refused its configuration: {error}", config.id))
        })
    };
    configs.iter().map(params).collect()
}

/// Weakly-centralised coupling, in one loop over all nodes and without a bus.
fn central(scenario: &Scenario, options: &RunOptions, rows: &mut dyn Rows) -> Result<Outcome, RunError> {
    let params = accepted(&central_configs(scenario, LOOPBACK).map_err(RunError::bad_input)?)?;
    let mut central = Central::new(params, &scenario.graph, Noise::of(scenario));
    let record = drive("loopback", scenario, options, &mut central, rows, |_, _| Ok(()))?;
    let reports = central.reports().into_iter().map(Some).collect();
    Ok(with_reports(reports, scenario, &mut central, record))
}

/// Adds what a network in this program says at the end to what was recorded of it.
fn with_reports(
    reports: Vec<Option<Report>>,
    scenario: &Scenario,
    network: &mut impl Network,
    Record { outcome, mut log, cut }: Record,
) -> Outcome {
    let traffic = bus_record(network.traffic(), reports.iter().flatten());
    let bus = Some(BusSummary { utilisation: network.utilisation(), ..traffic });
    network.tell(&mut log);
    let ((events, more_events), ended_early) = (log.finish(), cut.map(|cut| cut.told(scenario)));
    Outcome { bus, events, more_events, ended_early, ..outcome.with_reports(reports) }
}

/// Fidelity `emulator`.
pub fn emulator(scenario: &Scenario, options: &RunOptions, rows: &mut dyn Rows) -> Result<Outcome, RunError> {
    needs_no_can(scenario)?;
    if !scenario.events.is_empty() {
        return Err(RunError::bad_input(
            "emulated nodes have no [[event]] yet; run this scenario with --on loopback",
        ));
    }
    let configs = node_configs(scenario, LOCKSTEP).map_err(RunError::bad_input)?;
    let ids: Vec<_> = configs.iter().map(|config| config.id).collect();
    let attached = emulator::attach(&ids, &options.emulator())?;
    let hub = Hub::new(attached, &configs, bus(scenario), emulator::PATIENCE)?;
    let mut hub = hub.with_noise(Noise::of(scenario));
    let outcome = lockstep("emulator", (scenario, options), &mut hub, rows, |_, _| Ok(()))?;
    Ok(Outcome { logs: hub.into_logs(), ..outcome })
}

/// Runs a network tick by tick; `each` sees the hub after every tick. However nodes fail once there is a
/// tick, what was recorded is kept.
pub(super) fn lockstep(
    what: &'static str,
    (scenario, options): (&Scenario, &RunOptions),
    hub: &mut Hub,
    rows: &mut dyn Rows,
    each: impl FnMut(u64, &mut Hub) -> Result<(), RunError>,
) -> Result<Outcome, RunError> {
    let Record { outcome, mut log, cut } = drive(what, scenario, options, hub, rows, each)?;
    let closed = close(scenario, hub, cut);
    hub.tell(&mut log);
    let (events, more_events) = log.finish();
    Ok(Outcome { events, more_events, ..with_words_of(hub, closed, outcome) })
}

/// The reports of all nodes, by index, and why the run has ended where it has done so early: with this error
/// after so many ticks, or as the nodes were asked for their reports.
fn close(scenario: &Scenario, hub: &mut Hub, cut: Option<Cut>) -> (Vec<Option<Report>>, Option<EarlyEnd>) {
    let Cut { after, error } = match cut {
        Some(cut) => cut,
        None => match hub.finish() {
            Ok(reports) => return (reports, None),
            Err(error) => {
                Cut { after: scenario.time.ticks.saturating_add(1), error: RunError::in_the_run(error) }
            }
        },
    };
    let halted = hub.halt();
    let cut = Cut { after, error: error.and(&halted) };
    (halted.reports, Some(cut.told(scenario)))
}

/// With all that the nodes have said beside their ticks.
fn with_words_of(
    hub: &Hub,
    (reports, early): (Vec<Option<Report>>, Option<EarlyEnd>),
    outcome: Outcome,
) -> Outcome {
    let conductor = hub.conductor();
    let (unheard, silent) = match early {
        // Who has had no time to be heard, and who was told to stop first, are none of them.
        Some(_) => (Vec::new(), Vec::new()),
        None => (conductor.unheard(&reports), conductor.silent(&reports)),
    };
    let mut contradictions = conductor.contradictions();
    let unseen = conductor.unseen(early.is_some());
    let bus = Some(bus_record(conductor.traffic(), reports.iter().flatten()));
    let mut outcome = outcome.with_reports(reports);
    for (index, account) in outcome.accounts.iter_mut().enumerate() {
        (account.unseen, account.whole) = (unseen, conductor.was_there_throughout(index));
        contradictions.extend(conductor.cannot_have_counted(index, account));
    }
    let warnings = conductor.warnings();
    Outcome { bus, warnings, unheard, silent, contradictions, ended_early: early, ..outcome }
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
