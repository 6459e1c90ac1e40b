//! `coupling.damping`, the `c` of (**): what is written of it, once the graph is known (law.md 4).

use super::graph::Graph;
use super::model::NodeSpec;
use super::reader::{Log, Range, number};
use super::tree::{Item, Value};
use super::{Diagnostic, Problem};
use funnelnet_law::Coupling;
use funnelnet_law::law::node_wise::C;
use funnelnet_law::range::DAMPING;

/// `c` over the largest eigenvalue that it has to be above.
const MARGIN: f64 = 1.1;
/// No eigenvalue of `D^-1 L` is larger, on any graph.
const LARGEST: f64 = 2.0;
/// What is said where the eigenvalues of the graph are not known.
const UNKNOWN: &str = "must be at least 2 in a program without the feature `spectrum` of funnelnet-sim, which finds the eigenvalues of the graph";
/// What rounding may take of a limit.
const ROUNDED: f64 = 1e-9;

/// Gives each node its damping; `written` is what stands for it, by index.
pub(super) fn resolve(
    nodes: &mut [NodeSpec],
    written: &[Option<&Item>],
    graph: &Graph,
    coupling: Coupling<f64>,
    log: &Log,
) {
    if written.iter().all(Option::is_none) {
        return;
    }
    // Each edge has one of its own: of an edge, and of its neighbours' edges, nothing sharper is known than
    // 2.
    let lambda_max = if coupling == Coupling::EdgeWise { Some(2.0) } else { largest_eigenvalue(graph) };
    for (node, item) in nodes.iter_mut().zip(written) {
        match item.map_or(Ok(C), |item| read(item, lambda_max)) {
            Ok(damping) => node.damping = damping,
            Err(diagnostic) => log.report(diagnostic),
        }
    }
}

/// That of `D^-1 L`, which a program without the feature `spectrum` does not know.
#[cfg(feature = "spectrum")]
fn largest_eigenvalue(graph: &Graph) -> Option<f64> {
    Some(graph.normalised_lambda_max())
}

#[cfg(not(feature = "spectrum"))]
fn largest_eigenvalue(_: &Graph) -> Option<f64> {
    None
}

fn read(item: &Item, lambda_max: Option<f64>) -> Result<f64, Box<Diagnostic>> {
    let (low, high) = DAMPING;
    let range = Range::between(low, high, "1");
    match &item.value {
        Value::Text(text) if text == "graph" => match lambda_max {
            Some(lambda_max) => Ok((MARGIN * lambda_max).clamp(low, C)),
            None => Err(item.diagnostic(Problem::Value, UNKNOWN.to_owned())),
        },
        Value::Integer(_) | Value::Float(_) => {
            let damping = number(item, range)?;
            let Some(lambda_max) = lambda_max.or((damping >= LARGEST).then_some(LARGEST)) else {
                return Err(item.diagnostic(Problem::Value, UNKNOWN.to_owned()));
            };
            if damping < lambda_max * (1.0 - ROUNDED) {
                let allowed = format!(
                    "must be at least {lambda_max:.4} on this graph, the largest eigenvalue of D^-1 L: below it states run away"
                );
                return Err(item.diagnostic(Problem::Value, allowed));
            }
            Ok(damping)
        }
        _ => Err(range.mismatch(item, ", or \"graph\"")),
    }
}
