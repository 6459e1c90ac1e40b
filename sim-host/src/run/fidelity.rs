//! Drives networks of f32 nodes: in this program, or on emulators.

use super::drive::{Cut, Record, drive};
use super::error::RunError;
use super::makes::{Reach, Skipped};
use super::network::Network;
use super::options::RunOptions;
use super::outcome::{EarlyEnd, Outcome};
use super::rows::Rows;
use crate::bus::can::CanBus;
use crate::bus::table::{BusTable, BusTables};
use crate::bus::{Medium, SIMULATED, Traffic};
use crate::central::Central;
use crate::conductor::Staged;
use crate::configure::{Drive, central_configs, node_configs, staged_configs};
use crate::emulator;
use crate::engine::{Engine, Lies};
use crate::hub::Hub;
use crate::judge::missed;
use crate::loopback::{
    LOOPBACK, accepted, can_bus, engine, engine_on, engine_with_host, ideal_bus, uart_bus,
};
use crate::noise::Noise;
use crate::record::{BusSummary, ClockSummary};
use crate::scenario::{self, BusModel, Coupling, Scenario};
use funnelnet_law::field::VectorField;
use funnelnet_link::{Classic, Fd};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::Refusal;
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::report::Report;
use std::collections::BTreeMap;

/// Drive of nodes behind streams of bytes: they tick when the hub says so, and tell all they see.
pub(crate) const LOCKSTEP: Drive =
    Drive { tick_source: TickSource::Sync, telemetry_every: 1, is_simulated: false };

/// Fidelity `loopback`.
pub fn loopback(scenario: &Scenario, options: &RunOptions, rows: &mut dyn Rows) -> Result<Outcome, RunError> {
    if scenario.coupling == Coupling::WeaklyCentralised {
        return central(scenario, options, rows);
    }
    match scenario.bus.model {
        BusModel::Can => on(can_bus::<Classic>(scenario)?, scenario, options, rows),
        BusModel::CanFd => on(can_bus::<Fd>(scenario)?, scenario, options, rows),
        BusModel::Ideal if scenario.has_hosted_fields() => {
            with_host(ideal_bus(scenario), scenario, options, rows)
        }
        BusModel::Ideal => in_program(scenario, options, rows, engine(scenario)?, |_, _| ()),
        BusModel::Uart => on(uart_bus(scenario), scenario, options, rows),
    }
}

/// Runs on a medium that makes no events.
fn on<M: Medium>(
    medium: M,
    scenario: &Scenario,
    options: &RunOptions,
    rows: &mut dyn Rows,
) -> Result<Outcome, RunError> {
    if scenario.has_hosted_fields() {
        return with_host(medium, scenario, options, rows);
    }
    let mut engine = engine_on(scenario, medium)?;
    watch(&mut engine, scenario, options);
    in_program(scenario, options, rows, engine, |_, _| ())
}

/// Runs nodes whose fields the program around this one computes.
fn with_host<M: Medium>(
    medium: M,
    scenario: &Scenario,
    options: &RunOptions,
    rows: &mut dyn Rows,
) -> Result<Outcome, RunError> {
    let mut engine = engine_with_host(scenario, medium)?;
    watch(&mut engine, scenario, options);
    in_program(scenario, options, rows, engine, |k, engine| {
        // What each node will ask for first at the next tick.
        let x: Vec<f64> = engine.nodes().iter().flat_map(|node| node.state()).map(f64::from).collect();
        scenario.announce(scenario.time.at_s(k + 1), &x);
    })
}

fn watch<M: Medium, V: VectorField<f32> + Clone>(
    engine: &mut Engine<M, V>,
    scenario: &Scenario,
    options: &RunOptions,
) {
    let log = options.out.is_some() && options.bus_logs.any();
    engine.bus_mut().watch(scenario.time.tick_ns, log);
}

/// Runs an engine; `after` sees it after every tick.
fn in_program<M: Medium, V: VectorField<f32> + Clone>(
    scenario: &Scenario,
    options: &RunOptions,
    rows: &mut dyn Rows,
    mut engine: Engine<M, V>,
    after: impl Fn(u64, &Engine<M, V>),
) -> Result<Outcome, RunError> {
    let mut load = Load::default();
    let record = drive("loopback", scenario, options, &mut engine, rows, |k, engine| {
        load.at(k, engine.bus().busy_ns(scenario.time.tick_ns.saturating_mul(k + 1)));
        after(k, engine);
        Ok(())
    })?;
    // Of a run that was cut off nobody knows who would still have been heard.
    let (unheard, silent) = match record.cut {
        Some(_) => (Vec::new(), Vec::new()),
        None => engine.unheard_and_silent(&scenario.graph),
    };
    let (happened, reports) = (scenario.events.clone(), engine.reports());
    let contradictions = missed(scenario, engine.missed());
    let clocks = engine.skew().map(|skew| ClockSummary::of(&skew, scenario));
    let outcome = with_reports(reports, scenario, &mut engine, record);
    let utilisation = load.share(scenario.time.tick_ns);
    let can = tables(&mut engine, scenario, utilisation);
    let bus = outcome.bus.map(|bus| BusSummary { utilisation, can, ..bus });
    Ok(Outcome { unheard, silent, happened, bus, clocks, contradictions, ..outcome })
}

/// How busy the bus was, from the scenario's t = 0 on.
#[derive(Default)]
struct Load {
    /// Busy time before t = 0, ns.
    before: u64,
    /// The last tick, and the busy time by then, ns.
    last: (u64, u64),
}

impl Load {
    fn at(&mut self, k: u64, busy_ns: u64) {
        if k == 0 {
            self.before = busy_ns;
        }
        self.last = (k, busy_ns);
    }

    /// Part of the time, 0 to 1.
    fn share(&self, tick_ns: u64) -> f64 {
        let (ticks, busy) = self.last;
        let time = ticks.saturating_mul(tick_ns).max(1);
        busy.saturating_sub(self.before) as f64 / time as f64
    }
}

/// The table of the bus, where one was kept.
fn tables<M: Medium, V: VectorField<f32> + Clone>(
    engine: &mut Engine<M, V>,
    scenario: &Scenario,
    utilisation: f64,
) -> BusTables {
    let queue_overflows = Some(engine.bus().queue_overflows());
    let table = engine.bus_mut().watched().map(|watch| BusTable {
        interface: SIMULATED.to_owned(),
        bitrate: Some(scenario.bus.bitrate),
        utilisation: Some(utilisation),
        queue_overflows,
        ..BusTable::of_simulation(watch.table(), &watch.unsent())
    });
    BusTables(table.into_iter().collect())
}

/// The nodes of a scenario in this program, on its CAN bus, not started yet.
pub(crate) fn can_engine(
    scenario: &Scenario,
) -> Result<Engine<CanBus<impl funnelnet_can_bus::Noise + use<>>>, RunError> {
    Ok(engine_on(scenario, can_bus(scenario)?)?)
}

/// Nodes that are not in this program have no bus but the ideal one of the hub, or a real one.
pub(super) fn needs_no_can(scenario: &Scenario) -> Result<(), RunError> {
    if scenario.bus.model == BusModel::Ideal {
        return Ok(());
    }
    let model = scenario.bus.model.name();
    Err(RunError::bad_input(format!(
        "bus.model = \"{model}\" is for nodes in this program; run it with sim-host run --on loopback, or set bus.model to \"ideal\""
    )))
}

/// Weakly-centralised coupling, in one loop over all nodes and without a bus.
fn central(scenario: &Scenario, options: &RunOptions, rows: &mut dyn Rows) -> Result<Outcome, RunError> {
    if scenario.has_hosted_fields() {
        return Err(RunError::bad_input(
            "weakly-centralised coupling is one loop over all nodes, which has no fields of the host; take another coupling",
        ));
    }
    let params = accepted(&central_configs(scenario, LOOPBACK).map_err(RunError::bad_input)?, scenario)?;
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
    let reach = Reach::default();
    if let Some(Skipped { event, why }) = reach.divide(scenario).1.first() {
        return Err(RunError::bad_input(format!(
            "emulated nodes cannot have this [[event]]: {event}: {why}; run this scenario with sim-host run --on loopback, or leave the event out"
        )));
    }
    if !scenario.clocks.is_empty() {
        // Loopback has SYNC on CAN alone.
        let instead = match scenario.sync.is_some() {
            true => "run it on a bench with clock = \"own\" and emulator = true, or leave out [sync]",
            false => "run this scenario with sim-host run --on loopback",
        };
        return Err(RunError::bad_input(format!(
            "emulated nodes tick by this program's clock, without [clock] and [sync]; {instead}"
        )));
    }
    let configs = node_configs(scenario, LOCKSTEP).map_err(RunError::bad_input)?;
    let ids: Vec<_> = configs.iter().map(|config| config.id).collect();
    let attached = emulator::attach(&ids, &options.emulator())?;
    let hub = Hub::new(attached, &configs, ideal_bus(scenario), emulator::PATIENCE)?;
    let hub = hub.with_noise(Noise::of(scenario)).with_staged(staged(scenario, LOCKSTEP)?);
    let mut hub = hub.with_events(reach.scene(scenario), Lies::of(scenario));
    let outcome = lockstep("emulator", (scenario, options), &mut hub, rows, |_, _| Ok(()))?;
    Ok(Outcome { logs: hub.into_logs(), ..outcome })
}

/// What events stage in the nodes, by index.
pub(super) fn staged(scenario: &Scenario, drive: Drive) -> Result<Vec<Option<Staged>>, RunError> {
    let configs = staged_configs(scenario, drive).map_err(RunError::bad_input)?.unwrap_or_default();
    let of_node = |(config, staged): (NodeConfig, &Option<scenario::Staged>)| {
        // A run has as many ticks as a node counts.
        let tick = u32::try_from(staged.as_ref()?.tick).ok()?;
        Some(Staged { tick, config })
    };
    Ok(configs.into_iter().zip(&scenario.staged).map(of_node).collect())
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
    let happened = scenario.events.clone();
    let mut outcome = with_words_of(hub, closed, outcome);
    outcome.contradictions.extend(missed(scenario, hub.conductor().missed_commits()));
    Ok(Outcome { events, more_events, happened, ..outcome })
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

fn bus_record<'a>(traffic: Traffic, reports: impl IntoIterator<Item = &'a Report>) -> BusSummary {
    let mut refused: BTreeMap<_, _> =
        Refusal::ALL.iter().map(|reason| (reason.name().to_owned(), 0)).collect();
    for Report { counters, .. } in reports {
        for &reason in Refusal::ALL {
            *refused.entry(reason.name().to_owned()).or_default() += u64::from(counters.refused(reason));
        }
    }
    let Traffic { sent, lost, no_room, replaced, corrupted, duplicated, reordered } = traffic;
    BusSummary {
        sent,
        lost,
        no_room,
        replaced,
        corrupted,
        duplicated,
        reordered,
        refused,
        ..BusSummary::default()
    }
}
