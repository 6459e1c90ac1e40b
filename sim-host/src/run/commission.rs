//! Commissioning of a bench: what its nodes keep for ever after, and in which words this program says so.

use super::error::RunError;
use super::options::RunOptions;
use crate::bench::{BenchFile, Clock, attach};
use crate::configure::{Drive, node_configs};
use crate::hub::{Commissioned, Commissioning, Failed};
use crate::scenario::Scenario;
use funnel_protocol::config::TickSource;

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
    let configs =
        node_configs(scenario, Drive { tick_source, telemetry_every: 0 }).map_err(RunError::bad_input)?;
    let ids: Vec<_> = configs.iter().map(|config| config.id).collect();
    meet(file, &ids, options)?.commission(&configs).map_err(|failed| told(failed, "committed"))
}

/// Makes the nodes of `options.bench` blank at their next start.
///
/// # Errors
/// What happened, and which nodes have changed.
pub fn erase(options: &RunOptions) -> Result<Vec<Commissioned>, RunError> {
    let file = bench_file(options)?;
    let ids: Vec<_> = file.nodes.iter().map(|node| node.id).collect();
    meet(file, &ids, options)?.erase().map_err(|failed| told(failed, "erased"))
}

fn bench_file(options: &RunOptions) -> Result<&BenchFile, RunError> {
    options.bench.as_ref().ok_or_else(|| RunError::defect("commissioning without a bench file"))
}

fn meet(file: &BenchFile, ids: &[u8], options: &RunOptions) -> Result<Commissioning, RunError> {
    let nodes =
        attach(file, ids, &options.emulator()).and_then(|nodes| Commissioning::new(nodes, file.patience()));
    nodes.map_err(|error| told(Failed::Before(error), "committed"))
}

/// An error with what it leaves behind.
fn told(failed: Failed, done: &str) -> RunError {
    match failed {
        Failed::Before(error) => {
            RunError::of_nodes(error).and(format_args!("nothing was {done}: every node has what it had"))
        }
        Failed::After { error, done: nodes } => {
            let ids: Vec<_> = nodes.iter().map(u8::to_string).collect();
            RunError::of_nodes(error)
                .and(format_args!("{done}: node {}, and no other; try again", ids.join(", ")))
        }
    }
}
