//! Fidelity `bench`: the nodes of a bench file, with this program as the bus between them.

use super::error::RunError;
use super::fidelity::{LOCKSTEP, bus, engine, lockstep};
use super::options::RunOptions;
use super::outcome::Outcome;
use crate::bench::{Comparison, Difference, Stampings, attach};
use crate::configure::node_configs;
use crate::hub::{Hub, Link};
use crate::noise::Noise;
use crate::record::{BenchNodeSummary, BenchSummary};
use crate::scenario::Scenario;
use funnel_protocol::service::Identity;

/// Runs `scenario` on the nodes of `options.bench`, beside loopback. However the run ends, all nodes are told to stop.
pub fn run(scenario: &Scenario, options: &RunOptions) -> Result<Outcome, RunError> {
    let file = options.bench.as_ref().ok_or_else(|| RunError::defect("a bench without a bench file"))?;
    file.covers(scenario).map_err(RunError::bad_input)?;
    let configs = node_configs(scenario, LOCKSTEP).map_err(RunError::bad_input)?;
    let comparison = Comparison::new(engine(scenario)?);
    let stampings =
        options.out.as_ref().map(|folder| Stampings::create(folder.join("bench.csv"))).transpose()?;
    let ids: Vec<_> = configs.iter().map(|config| config.id).collect();
    let attached = attach(file, &ids, &options.emulator())?;
    let hub = Hub::new(attached, &configs, bus(scenario), file.patience())?;
    let mut hub = hub.with_noise(Noise::of(scenario));
    match compared(scenario, options, &mut hub, comparison, stampings) {
        Ok(outcome) => Ok(Outcome { logs: hub.into_logs(), ..outcome }),
        Err(error) => Err(error.and(hub.halt())),
    }
}

fn compared(
    scenario: &Scenario,
    options: &RunOptions,
    hub: &mut Hub,
    mut comparison: Comparison,
    mut stampings: Option<Stampings>,
) -> Result<Outcome, RunError> {
    let outcome = lockstep("bench", scenario, options, hub, |k, hub| {
        comparison.tick(k, hub.observations());
        let stamps = hub.members().map(|(link, _)| link.id()).zip(hub.stamps());
        stampings.as_mut().map_or(Ok(()), |file| file.tick(k, stamps)).map_err(RunError::from)
    })?;
    stampings.map_or(Ok(()), Stampings::finish)?;
    Ok(Outcome { bench: Some(summary(hub, &comparison)), ..outcome })
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
    BenchSummary {
        bit_for_bit: differences.iter().all(|difference| difference.first.is_none()),
        nodes: hub.members().zip(differences).map(node).collect(),
    }
}
