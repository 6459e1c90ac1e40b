//! Fidelity `bench`: the nodes of a bench file, with this program as the bus between them.

use super::error::RunError;
use super::fidelity::{LOCKSTEP, bus, engine, lockstep};
use super::options::{RunOptions, Verbosity};
use super::outcome::Outcome;
use crate::bench::{BenchFile, Comparison, Difference, Stampings, attach};
use crate::configure::node_configs;
use crate::hub::{Absence, Hub, Link};
use crate::noise::Noise;
use crate::record::{AbsenceSummary, BenchNodeSummary, BenchSummary};
use crate::scenario::Scenario;
use funnel_protocol::NodeConfig;
use funnel_protocol::service::Identity;
use std::fmt::Display;
use std::io::Write;

/// Runs `scenario` on the nodes of `options.bench`, beside loopback. However the run ends, all nodes are told to stop.
pub fn run(scenario: &Scenario, options: &RunOptions) -> Result<Outcome, RunError> {
    let file = options.bench.as_ref().ok_or_else(|| RunError::defect("a bench without a bench file"))?;
    file.covers(scenario).map_err(RunError::bad_input)?;
    let configs = configs(scenario, file)?;
    let comparison = Comparison::new(engine(scenario)?);
    let stampings =
        options.out.as_ref().map(|folder| Stampings::create(folder.join("bench.csv"))).transpose()?;
    let ids: Vec<_> = configs.iter().map(|config| config.id).collect();
    let attached = attach(file, &ids, &options.emulator())?;
    let hub = Hub::new(attached, &configs, bus(scenario), file.patience())?;
    let mut hub = hub.with_noise(Noise::of(scenario)).with_loss(file.on_loss);
    hub.members().for_each(|(link, identity)| warn_of_reset(link.id(), identity));
    match compared(scenario, options, &mut hub, comparison, stampings) {
        Ok(outcome) => Ok(Outcome { logs: hub.into_logs(), ..outcome }),
        Err(error) => Err(error.and(hub.halt())),
    }
}

/// What the nodes are told. This program may die, and a node without it must not go on for ever.
fn configs(scenario: &Scenario, file: &BenchFile) -> Result<Vec<NodeConfig>, RunError> {
    let mut configs = node_configs(scenario, LOCKSTEP).map_err(RunError::bad_input)?;
    if scenario.safety.holdover_ns.is_none() {
        let holdover_ns = file.holdover_ns(configs.len());
        configs.iter_mut().for_each(|config| config.holdover_ns = holdover_ns.max(config.tick_ns.into()));
    }
    Ok(configs)
}

fn compared(
    scenario: &Scenario,
    options: &RunOptions,
    hub: &mut Hub,
    mut comparison: Comparison,
    mut stampings: Option<Stampings>,
) -> Result<Outcome, RunError> {
    let mut told = Vec::new();
    let outcome = lockstep("bench", scenario, options, hub, |k, hub| {
        if options.verbosity != Verbosity::Quiet {
            tell(hub.absences(), &mut told);
        }
        comparison.tick(k, hub.observations());
        let stamps = hub.members().map(|(link, _)| link.id()).zip(hub.stamps());
        stampings.as_mut().map_or(Ok(()), |file| file.tick(k, stamps)).map_err(RunError::from)
    })?;
    stampings.map_or(Ok(()), Stampings::finish)?;
    Ok(Outcome { bench: Some(summary(hub, &comparison)), ..outcome })
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

fn summary(hub: &Hub, comparison: &Comparison) -> BenchSummary {
    let node = |((link, identity), difference): ((&Link, Identity), &Difference)| {
        let [major, minor, patch] = identity.firmware;
        BenchNodeSummary {
            node: link.id(),
            place: link.place().to_owned(),
            uid: format!("{:016x}", identity.uid),
            firmware: format!("{major}.{minor}.{patch}"),
            unreadable: link.refused().0,
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
    BenchSummary {
        absences: hub.absences().iter().map(absence).collect(),
        bit_for_bit: differences.iter().all(|difference| difference.first.is_none()),
        nodes: hub.members().zip(differences).map(node).collect(),
    }
}
