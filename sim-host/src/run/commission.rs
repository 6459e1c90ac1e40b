//! Commissioning of a bench: what its nodes keep for ever after, and in which words this program says so.

use super::error::RunError;
use super::options::RunOptions;
use crate::bench::{BenchFile, Clock, Where, attach};
use crate::configure::{Drive, node_configs};
use crate::hub::{Commissioned, Commissioning, Failed, Known};
use crate::scenario::Scenario;
use funnelnet_protocol::config::TickSource;

/// Stores the configurations of `scenario` in the nodes of `options.bench`, all or none of them.
///
/// Nobody may listen when they run: they tell no telemetry. They tick as the bench file's `clock` says.
///
/// # Errors
/// What happened, and which nodes have changed.
pub fn commission(scenario: &Scenario, options: &RunOptions) -> Result<Vec<Commissioned>, RunError> {
    let file = bench_file(options)?;
    file.covers(scenario).map_err(RunError::bad_input)?;
    let tick_source = match file.clock {
        Clock::Host => TickSource::Sync,
        Clock::Own => TickSource::Timer,
    };
    let configs = node_configs(scenario, Drive { tick_source, telemetry_every: 0, is_simulated: false })
        .map_err(RunError::bad_input)?;
    let ids: Vec<_> = configs.iter().map(|config| config.id).collect();
    refuse_emulators(file, &ids)?;
    let nodes = meet(file, &ids, options).and_then(|nodes| nodes.commission(&configs));
    nodes.map_err(|failed| told(failed, "committed", "`bench --list` shows each checksum"))
}

/// An emulator has a storage that ends with it, and it ends with this program.
fn refuse_emulators(file: &BenchFile, ids: &[u8]) -> Result<(), RunError> {
    let is_emulator = |id: &&u8| file.node(**id).is_some_and(|node| node.at == Where::Emulator);
    match ids.iter().find(is_emulator) {
        None => Ok(()),
        Some(id) => Err(RunError::bad_input(format!(
            "node {id} is an emulator, which keeps nothing once this program has ended: commission boards and processes"
        ))),
    }
}

/// Makes the nodes of `options.bench` blank at their next start.
///
/// # Errors
/// What happened, and which nodes have changed.
pub fn erase(options: &RunOptions) -> Result<Vec<Commissioned>, RunError> {
    let file = bench_file(options)?;
    let ids: Vec<_> = file.nodes.iter().map(|node| node.id).collect();
    let nodes = meet(file, &ids, options).and_then(Commissioning::erase);
    nodes.map_err(|failed| told(failed, "erased", "try again, a blank node can be erased, too"))
}

pub(super) fn bench_file(options: &RunOptions) -> Result<&BenchFile, RunError> {
    options.bench.as_ref().ok_or_else(|| RunError::defect("commissioning without a bench file"))
}

fn meet(file: &BenchFile, ids: &[u8], options: &RunOptions) -> Result<Commissioning, Failed> {
    let nodes = attach(file, ids, &options.emulator());
    nodes.and_then(|nodes| Commissioning::new(nodes, file.patience())).map_err(Failed::Before)
}

/// An error with what it leaves behind. `done` is what was to be done to each node, `advice` what to try
/// where only some were.
fn told(failed: Failed, done: &str, advice: &str) -> RunError {
    match failed {
        Failed::Before(error) => {
            RunError::of_nodes(error).and(format_args!("nothing was {done}: every node has what it had"))
        }
        Failed::After(error, known) => {
            RunError::of_nodes(error).and(format_args!("{}; {advice}", in_groups(&known, done)))
        }
    }
}

fn in_groups(known: &Known, done: &str) -> String {
    let groups = [(done, &known.done), ("not known", &known.unsure), ("unchanged", &known.unchanged)];
    let groups = groups.iter().filter(|(_, nodes)| !nodes.is_empty());
    groups.map(|(name, nodes)| format!("{name}: {}", list(nodes))).collect::<Vec<_>>().join("; ")
}

pub(super) fn list(ids: &[u8]) -> String {
    ids.iter().map(u8::to_string).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hub::HubError;

    fn last_line(known: Known) -> String {
        let failed = Failed::After(HubError::NotCommitted { node: 2 }, Box::new(known));
        told(failed, "committed", "look").message.lines().last().unwrap().to_owned()
    }

    #[test]
    fn every_node_is_named_with_what_is_known_of_it() {
        let known = Known { done: vec![1], unsure: vec![2], unchanged: vec![3, 4] };
        assert_eq!(last_line(known), "committed: 1; not known: 2; unchanged: 3, 4; look");
    }

    #[test]
    fn a_group_without_nodes_is_not_named() {
        let known = Known { unsure: vec![2], ..Known::default() };
        assert_eq!(last_line(known), "not known: 2; look");
    }
}
