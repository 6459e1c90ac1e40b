//! `run` of a network without a bus: quantiles over time, and columns of the nodes that are asked for.

use crate::errors;
use crate::rows::{Reached, array};
use crate::run::wanted;
use crate::trouble::Trouble;
use crate::work::watched;
use funnelnet_sim::large::Network;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sim_host::record::Summary;
use sim_host::run::{
    Claim, LargeOptions, LargeRows, RunError, RunOptions, execute_large_with, known_nodes, quantile_names,
};
use sim_host::scenario::LargeScenario;

/// What is asked of such a run.
pub struct Asked {
    /// Ids of nodes that get columns.
    pub nodes: Vec<usize>,
    pub threads: Option<usize>,
    pub options: RunOptions,
    pub command: String,
    pub progress: Option<Py<PyAny>>,
}

/// Runs it: its summary as JSON, and its columns.
pub fn run<'py>(
    py: Python<'py>,
    scenario: &LargeScenario,
    asked: Asked,
    trouble: &Trouble,
) -> PyResult<(String, Bound<'py, PyDict>)> {
    let Asked { mut nodes, threads, options, command, progress } = asked;
    nodes.sort_unstable();
    nodes.dedup();
    known_nodes(scenario, &nodes, "nodes").map_err(|error| errors::of_run(py, &error))?;
    let (reached, end) = (Reached::default(), scenario.time.end_s());
    let mut columns = Columns { reached: reached.clone(), ..Columns::default() };
    let look = move |py: Python<'_>| match &progress {
        Some(progress) => progress.call1(py, (reached.get(), end)).map(drop),
        None => Ok(()),
    };
    let large = LargeOptions { nodes: nodes.clone(), threads };
    let work = || executed(scenario, &options, &large, &command, &mut columns);
    let summary = watched(py, trouble, look, work)?.map_err(|error| errors::of_run(py, &error))?;
    Ok((summary.to_json(), columns.into_dict(py, &nodes)?))
}

fn executed(
    scenario: &LargeScenario,
    options: &RunOptions,
    large: &LargeOptions,
    command: &str,
    columns: &mut Columns,
) -> Result<Summary, RunError> {
    let wanted = wanted(&scenario.path, options, command);
    Claim::take(&wanted)?.guard(|claim| execute_large_with(claim, scenario, options, large, columns))
}

/// Columns of a run, each in one piece.
#[derive(Default)]
struct Columns {
    reached: Reached,
    t: Vec<f64>,
    /// As `quantile_names` has them.
    quantiles: Vec<Vec<f64>>,
    /// `x`, `nu`, `psi`, `u` of the nodes that are asked for.
    of_nodes: [Vec<f64>; 4],
}

impl LargeRows for Columns {
    fn reached(&mut self, t: f64) {
        self.reached.set(t);
    }

    fn row(&mut self, network: &Network<'_>, _: u64) -> Result<(), RunError> {
        let row = network.row();
        self.t.push(row.t);
        let values = row.x.iter().chain(&row.ratio).chain(&row.input).map(|&value| f64::from(value));
        let values = [row.mean].into_iter().chain(values);
        self.quantiles.resize_with(quantile_names().len(), Vec::new);
        self.quantiles.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
        for seen in network.watched() {
            let values = [seen.x, seen.nu, seen.psi, seen.u].map(f64::from);
            self.of_nodes.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
        }
        Ok(())
    }
}

impl Columns {
    /// A dict: `t`, `quantiles` by name, the ids in `nodes`, and their columns, (time, node).
    fn into_dict<'py>(self, py: Python<'py>, nodes: &[usize]) -> PyResult<Bound<'py, PyDict>> {
        let (dict, quantiles) = (PyDict::new(py), PyDict::new(py));
        let rows = self.t.len();
        dict.set_item("t", array(py, self.t, &[rows])?)?;
        for (name, values) in quantile_names().into_iter().zip(self.quantiles) {
            quantiles.set_item(name, array(py, values, &[rows])?)?;
        }
        dict.set_item("quantiles", quantiles)?;
        dict.set_item("nodes", nodes)?;
        for (name, values) in ["x", "nu", "psi", "u"].into_iter().zip(self.of_nodes) {
            dict.set_item(name, array(py, values, &[rows, nodes.len()])?)?;
        }
        Ok(dict)
    }
}
