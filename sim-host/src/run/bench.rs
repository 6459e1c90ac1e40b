//! Fidelity `bench`: the nodes of a bench file, with this program as the bus between them.

use super::bench_buses::Logged;
use super::error::RunError;
use super::fidelity::{LOCKSTEP, can_engine, lockstep, needs_no_can, staged};
use super::makes::{Reach, Skipped};
use super::network::Network;
use super::options::{RunOptions, Verbosity};
use super::outcome::Outcome;
use super::own_clock;
use super::rows::Rows;
use crate::bench::{
    BenchFile, BenchNode, Clock, Comparison, Difference, Skew, Stampings, Where, Wire, attach, can_sides,
};
use crate::conductor::{Conductor, Staged};
use crate::configure::node_configs;
use crate::engine::Lies;
use crate::hub::{Absence, CanCounts, Contact, Hub};
use crate::judge::AbsenceSummary;
use crate::loopback::{engine, ideal_bus_between};
use crate::noise::Noise;
use crate::record::{BenchNodeSummary, BenchSummary, BusSummary, CanSummary, PerInterface, WiresSummary};
use crate::scenario::{BusModel, ClockSpec, EventKind, Scenario, SyncSpec};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::service::Identity;
use std::collections::BTreeSet;
use std::fmt::Display;
use std::io::Write;

/// Runs `scenario` on the nodes of `options.bench`, beside loopback. However the run ends, all nodes are told
/// to stop.
pub fn run(scenario: &Scenario, options: &RunOptions, rows: &mut dyn Rows) -> Result<Outcome, RunError> {
    let file = options.bench.as_ref().ok_or_else(|| RunError::defect("a bench without a bench file"))?;
    fits_the_bus(scenario, file)?;
    let reach = reach(scenario, file);
    let (made, left_out) = reach.divide(scenario);
    tell_left_out(&left_out, options);
    // What does not happen is not judged as if it had, nor is it in the loopback beside.
    let sync = scenario.sync.clone().filter(|_| file.clock == Clock::Own);
    let clocks = skipped_clocks(scenario, file.clock, options);
    let mut expect = scenario.expect.clone();
    // A file without events has no time to recover in.
    let no_recovery = made.is_empty() && expect.recovered_within_ns.take().is_some();
    let without = scenario.without_events();
    // Events of this kind are made together.
    let sets = made.iter().any(|event| event.kind == EventKind::Set);
    let staged = if sets { scenario.staged.clone() } else { Vec::new() };
    let scenario = &Scenario { events: made, staged, clocks: Vec::new(), sync: None, expect, ..without };
    let no_recovery = tell_no_recovery(no_recovery, options);
    file.covers(scenario).map_err(RunError::bad_input)?;
    let configs = configs(scenario, sync.as_ref(), file)?;
    let staged = staged_beside(scenario, file, &configs)?;
    let comparison = match scenario.bus.model {
        BusModel::Can => Comparison::new(can_engine(scenario)?),
        _ => Comparison::new(engine(scenario)?),
    };
    let ids: Vec<_> = configs.iter().map(|config| config.id).collect();
    // Before any node is touched.
    let can = can_sides(file, &ids)?;
    let wired = wires(file, &ids);
    let skipped = if can.is_empty() && wired == 0 { Vec::new() } else { skipped(scenario) };
    tell_skipped(&skipped, options);
    if sync.is_none() {
        warn_of_drift(scenario, file, options);
    }
    let files = Files::create(options)?;
    let mut rows = Logged::new(rows, scenario, options.interfaces(scenario));
    let attached = attach(file, &ids, &options.emulator())?;
    let id = |index: usize| ids.get(index).copied().unwrap_or(0);
    let bus = ideal_bus_between(scenario, |from, to| !file.is_wired(id(from), id(to)));
    let hub = Hub::new(attached, &configs, bus, file.patience())?;
    let hub = if wired > 0 { hub.with_wires(file.settle) } else { hub };
    let hub = hub.with_noise(Noise::of(scenario)).with_loss(file.on_loss).with_staged(staged);
    let hub = hub.with_events(reach.scene(scenario), Lies::of(scenario));
    let interfaces = file.interfaces(&ids);
    let hub = hub.with_can(can, |index| {
        let interface = ids.get(index).and_then(|&id| file.node(id))?.can.as_ref()?;
        interfaces.iter().position(|&other| other == interface)
    });
    let mut hub = match file.clock {
        Clock::Host => hub,
        Clock::Own if sync.is_some() => hub.with_own_clock().with_sync(own_clock::silences(scenario)),
        Clock::Own => hub.with_own_clock(),
    };
    hub.conductor().members().for_each(|(node, identity)| warn_of_reset(node.id(), identity));
    match compared(scenario, (options, file.clock), &mut hub, &mut rows, (comparison, files)) {
        Ok(outcome) => {
            let can = rows.tables(outcome.ended_early.is_none());
            let bus = outcome.bus.map(|bus| with_tables(bus, can));
            let sum = |count: fn(&funnelnet_protocol::report::Counters) -> u32| {
                outcome.counters.iter().map(|all| u64::from(count(all))).sum()
            };
            let wires = (wired > 0).then(|| WiresSummary {
                count: wired,
                settle_s: file.settle.as_secs_f64(),
                extrapolated: sum(|counters| counters.extrapolated),
                late: sum(|counters| counters.late),
            });
            let skipped = skipped
                .into_iter()
                .chain(clocks)
                .chain(no_recovery)
                .map(str::to_owned)
                .chain(kinds(&left_out))
                .collect();
            let bench = outcome.bench.map(|bench| BenchSummary { skipped, wires, ..bench });
            Ok(Outcome { logs: hub.into_logs(), bench, bus, ..outcome })
        }
        Err(error) => Err(error.and(hub.halt())),
    }
}

/// The key of an expectation that nothing is left for, where it is so.
fn tell_no_recovery(is_so: bool, options: &RunOptions) -> Option<&'static str> {
    let key = "expect.recovered_within";
    if is_so && options.verbosity != Verbosity::Quiet {
        eprint_line(&format!("skipped: {key}, since no event of the file is made"));
    }
    is_so.then_some(key)
}

/// A scenario on CAN is for a bench that has all of its nodes on one such bus.
fn fits_the_bus(scenario: &Scenario, file: &BenchFile) -> Result<(), RunError> {
    if scenario.bus.model != BusModel::Can {
        return needs_no_can(scenario);
    }
    let interface = |id: u16| file.node(u8::try_from(id).ok()?)?.can.as_ref();
    let first = scenario.nodes.first().and_then(|node| interface(node.id));
    let elsewhere =
        scenario.nodes.iter().find(|node| first.is_none() || interface(node.id) != first).map(|node| node.id);
    match elsewhere {
        None if file.can_fd => Err(RunError::bad_input(
            "bus.model = \"can\" is classic CAN, and the bench file has can_fd = true; take that out, or set bus.model to \"ideal\"",
        )),
        None => Ok(()),
        Some(id) => Err(RunError::bad_input(format!(
            "bus.model = \"can\" needs a bench with all nodes on one CAN interface, and node {id} is not on it; set bus.model to \"ideal\""
        ))),
    }
}

/// Wires between nodes of the run.
fn wires(file: &BenchFile, ids: &[u8]) -> usize {
    let of_run = |wire: &&Wire| ids.contains(&wire.between.0) && ids.contains(&wire.between.1);
    file.wires.iter().filter(of_run).count()
}

/// What a scenario asks of its bus that a real one does not do between nodes on it, nor a wire between its
/// ends.
fn skipped(scenario: &Scenario) -> Vec<&'static str> {
    let bus = &scenario.bus;
    let asked = [
        ("bus.loss", !bus.loss.is_none()),
        ("bus.latency", bus.latency_ns > 0),
        ("bus.jitter", bus.jitter_ns > 0),
        ("bus.bit_errors", bus.bit_errors > 0),
        ("link", !scenario.links.is_empty()),
        ("noise", !Noise::of(scenario).is_none()),
    ];
    asked.into_iter().filter(|&(_, asked)| asked).map(|(key, _)| key).collect()
}

/// How the nodes of a scenario are reached.
fn reach(scenario: &Scenario, file: &BenchFile) -> Reach {
    let id = |index: usize| u8::try_from(index + 1).unwrap_or(0);
    let is_on_can = |&index: &usize| file.node(id(index)).is_some_and(|node| node.can.is_some());
    let edges = scenario.graph.edges.iter().map(|edge| (edge.a.min(edge.b), edge.a.max(edge.b)));
    Reach {
        own_clock: file.clock == Clock::Own,
        has_masters: file.clock == Clock::Own && scenario.sync.is_some(),
        on_can: (0..scenario.nodes.len()).filter(is_on_can).collect(),
        wires: edges.filter(|&(a, b)| file.is_wired(id(a), id(b))).collect(),
        forgetful: (0..scenario.nodes.len())
            .filter(|&index| file.node(id(index)).is_some_and(forgets))
            .collect(),
    }
}

/// Whether a node is known to keep nothing that is staged in it.
fn forgets(node: &BenchNode) -> bool {
    matches!(node.at, Where::Host) && node.storage.is_none()
}

/// The keys of clocks that are not done, where a scenario has them: nodes of a bench have the clocks that they have, and
/// keep them together only where they tick by them.
fn skipped_clocks(scenario: &Scenario, clock: Clock, options: &RunOptions) -> Vec<&'static str> {
    let syncs = scenario.sync.is_some();
    // With [sync] each node has a clock, be it a right one.
    let is_wrong = |clock: &ClockSpec| clock != &ClockSpec::default();
    let has_clocks = scenario.clocks.iter().any(is_wrong);
    let asked = [("clock", has_clocks), ("sync", syncs && clock == Clock::Host)];
    let keys: Vec<_> = asked.into_iter().filter(|&(_, asked)| asked).map(|(key, _)| key).collect();
    if !keys.is_empty() && options.verbosity != Verbosity::Quiet {
        // Nobody is left to tell where standard error is closed.
        let _ =
            writeln!(std::io::stderr(), "skipped: {}: the clocks of a bench are its own", keys.join(", "));
    }
    keys
}

/// The kinds of events that are left out, each once.
fn kinds(left_out: &[Skipped]) -> BTreeSet<String> {
    left_out.iter().map(|skipped| format!("event.{}", skipped.event.kind.name())).collect()
}

fn tell_left_out(left_out: &[Skipped], options: &RunOptions) {
    for Skipped { event, why } in left_out.iter().filter(|_| options.verbosity != Verbosity::Quiet) {
        let at = event.at_ns as f64 / 1e9;
        // Nobody is left to tell where standard error is closed.
        let _ = writeln!(std::io::stderr(), "skipped: {at} s, event {event}: {why}");
    }
}

fn tell_skipped(skipped: &[&str], options: &RunOptions) {
    if !skipped.is_empty() && options.verbosity != Verbosity::Quiet {
        // Nobody is left to tell where standard error is closed.
        let _ = writeln!(
            std::io::stderr(),
            "skipped between nodes on CAN or wired to each other, whose lines are real: {}",
            skipped.join(", ")
        );
    }
}

fn warn_of_drift(scenario: &Scenario, file: &BenchFile, options: &RunOptions) {
    let warning = own_clock::warning(scenario, file).filter(|_| file.clock == Clock::Own);
    if let Some(warning) = warning.filter(|_| options.verbosity != Verbosity::Quiet) {
        eprint_line(&warning);
    }
}

/// What a bench writes tick by tick.
struct Files {
    stampings: Option<Stampings>,
}

impl Files {
    fn create(options: &RunOptions) -> Result<Self, RunError> {
        let stampings = options.out.as_ref().map(|folder| Stampings::create(folder.join("bench.csv")));
        Ok(Self { stampings: stampings.transpose()? })
    }

    fn tick(&mut self, k: u64, hub: &Hub) -> Result<(), RunError> {
        if let Some(file) = &mut self.stampings {
            let conductor = hub.conductor();
            file.tick(k, conductor.members().map(|(node, _)| node.id()).zip(conductor.stamps()))?;
        }
        Ok(())
    }

    fn finish(self) -> Result<(), RunError> {
        Ok(self.stampings.map_or(Ok(()), Stampings::finish)?)
    }
}

/// With what was on the buses, by identifier; those of a run on one bus whose bit rate is known say how busy
/// that was.
fn with_tables(bus: BusSummary, can: crate::bus::table::BusTables) -> BusSummary {
    let utilisation = match can.0.as_slice() {
        [table] => table.utilisation.unwrap_or(0.0),
        _ => 0.0,
    };
    BusSummary { utilisation, can, ..bus }
}

/// What the nodes are told. This program may die, and a node without it must not go on for ever.
fn configs(
    scenario: &Scenario,
    sync: Option<&SyncSpec>,
    file: &BenchFile,
) -> Result<Vec<NodeConfig>, RunError> {
    if file.clock == Clock::Own {
        let mut configs = node_configs(scenario, own_clock::DRIVE).map_err(RunError::bad_input)?;
        own_clock::stop_when_alone(&mut configs);
        if let Some(sync) = sync {
            own_clock::keep_time(&mut configs, sync, file)?;
        }
        return Ok(configs);
    }
    lockstep_configs(scenario, file)
}

/// What events stage in the nodes, by index. What a bench tells its nodes beside the scenario holds there, too.
fn staged_beside(
    scenario: &Scenario,
    file: &BenchFile,
    configs: &[NodeConfig],
) -> Result<Vec<Option<Staged>>, RunError> {
    let drive = if file.clock == Clock::Own { own_clock::DRIVE } else { LOCKSTEP };
    let mut staged = staged(scenario, drive)?;
    for (Staged { config: next, .. }, now) in
        staged.iter_mut().zip(configs).filter_map(|(staged, now)| Some((staged.as_mut()?, now)))
    {
        next.holdover_ns = now.holdover_ns;
        next.lost_neighbours = now.lost_neighbours;
        next.extrapolate_ticks = now.extrapolate_ticks;
        next.time = now.time;
    }
    Ok(staged)
}

/// The same for nodes that tick by this program's clock.
pub(super) fn lockstep_configs(scenario: &Scenario, file: &BenchFile) -> Result<Vec<NodeConfig>, RunError> {
    let mut configs = node_configs(scenario, LOCKSTEP).map_err(RunError::bad_input)?;
    if scenario.safety.holdover_ns.is_none() {
        let holdover_ns = file.holdover_ns(configs.len());
        configs.iter_mut().for_each(|config| config.holdover_ns = holdover_ns.max(config.period_ns()));
    }
    Ok(configs)
}

fn compared(
    scenario: &Scenario,
    (options, clock): (&RunOptions, Clock),
    hub: &mut Hub,
    rows: &mut Logged<'_>,
    (mut comparison, mut files): (Comparison, Files),
) -> Result<Outcome, RunError> {
    let (mut told, mut skew) = (Vec::new(), Skew::default());
    let outcome = lockstep("bench", (scenario, options), hub, rows, |k, hub| {
        if options.verbosity != Verbosity::Quiet {
            tell(hub.conductor().absences(), &mut told);
        }
        let conductor = hub.conductor();
        comparison.tick(k, conductor.observations(), conductor.presence());
        skew.tick(k, conductor.stamps());
        files.tick(k, hub)
    })?;
    // What was on the buses after the last tick.
    rows.hear(&Network::take_heard(hub))?;
    files.finish()?;
    let conductor = hub.conductor();
    comparison.faults(conductor.events());
    if outcome.ended_early.is_some() {
        comparison.cut();
    }
    let own_clock = (clock == Clock::Own).then(|| own_clock::summary(conductor, &skew, &outcome.counters));
    Ok(Outcome { bench: Some(BenchSummary { own_clock, ..summary(conductor, &comparison) }), ..outcome })
}

/// Says who was lost and who is back since the last call.
fn tell(absences: &[Absence], told: &mut Vec<Absence>) {
    if absences == told.as_slice() {
        return;
    }
    for (n, absence) in absences.iter().enumerate().filter(|&(n, absence)| told.get(n) != Some(absence)) {
        // One that has come to an end within a tick was not told yet.
        if told.get(n).is_none() {
            eprint_line(&Absence { to: None, ..absence.clone() });
        }
        if absence.to.is_some() {
            eprint_line(absence);
        }
    }
    *told = absences.to_vec();
}

/// Says when something went wrong before a node's last start.
fn warn_of_reset(node: u8, identity: Identity) {
    let Identity { reset, starts, .. } = identity;
    if reset.is_alarming() {
        eprint_line(&format_args!("node {node}: last reset: {reset} (starts since power-on: {starts})"));
    }
}

fn eprint_line(absence: &impl Display) {
    // Nobody is left to tell where standard error is closed.
    let _ = writeln!(std::io::stderr(), "{absence}");
}

fn summary(conductor: &Conductor, comparison: &Comparison) -> BenchSummary {
    let node = |((contact, identity), difference): ((&Contact, Identity), &Difference)| {
        let [major, minor, patch] = identity.firmware;
        BenchNodeSummary {
            node: contact.id(),
            place: contact.place().to_owned(),
            uid: format!("{:016x}", identity.uid),
            firmware: format!("{major}.{minor}.{patch}"),
            unreadable: contact.refused().0,
            unrecorded: difference.unrecorded,
            first_difference: difference.first,
            largest_deviation: difference.largest,
        }
    };
    let differences = comparison.differences();
    let absence = |absence: &Absence| AbsenceSummary {
        node: absence.node,
        from_tick: absence.from,
        to_tick: absence.to,
        why: absence.why.lines().next().unwrap_or_default().to_owned(),
    };
    let can = |(interface, counts): (&str, &CanCounts)| CanSummary {
        interface: interface.to_owned(),
        frames: counts.frames,
        strangers: counts.strangers,
        unreadable: counts.unreadable,
        incomplete: counts.incomplete,
        errors: counts.errors.0,
        last_error: counts.errors.1.clone(),
    };
    BenchSummary {
        own_clock: None,
        wires: None,
        can: PerInterface(conductor.can().map(can).collect()),
        skipped: Vec::new(),
        absences: conductor.absences().iter().map(absence).collect(),
        unrecorded: differences.iter().map(|difference| difference.unrecorded).sum(),
        bit_for_bit: differences.iter().all(|difference| difference.first.is_none()),
        nodes: conductor.members().zip(differences).map(node).collect(),
    }
}
