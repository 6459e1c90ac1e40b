//! The theorem's condition on the start: every diffusive term inside its funnel.

use super::diagnostic::{Diagnostic, Diagnostics, Problem};
use super::graph::Graph;
use super::model::{NodeSpec, Scenario};
use super::tree::Place;
use crate::extremes::{larger, largest};
use crate::number_format::significant;
use funnelnet_law::Coupling;
use funnelnet_law::funnel::Shape;
use funnelnet_law::math;

/// `|nu| / psi` at t = 0, by index and then by component; with edge-wise coupling that of each node's worst
/// edge. The guarantee needs every one below 1 (the paper's Theorem 1).
#[must_use]
pub fn initial_ratios(scenario: &Scenario) -> Vec<f64> {
    let count = scenario.components();
    let terms = initial_terms(scenario);
    let widths = scenario.nodes.iter().flat_map(|node| std::iter::repeat_n(node.funnel.width(0.0), count));
    terms.iter().zip(widths).map(|(nu, psi)| nu.abs() / psi).collect()
}

/// The diffusive terms at t = 0, by index and then by component; with edge-wise coupling the largest of an
/// edge.
fn initial_terms(scenario: &Scenario) -> Vec<f64> {
    let count = scenario.components();
    let mut terms = vec![0.0f64; scenario.nodes.len() * count];
    let graph = graph_at_the_start(scenario);
    for component in 0..count {
        let states: Vec<f64> = scenario.nodes.iter().map(|node| node.state[component]).collect();
        let found = match scenario.coupling {
            Coupling::EdgeWise => largest_edge_terms(&graph, &states),
            _ => graph.diffusive_terms(&states),
        };
        found.into_iter().enumerate().for_each(|(index, term)| terms[index * count + component] = term);
    }
    terms
}

/// The graph without the edges of nodes that join later.
fn graph_at_the_start(scenario: &Scenario) -> Graph {
    let course = scenario.course();
    let absent: Vec<bool> = (0..scenario.graph.nodes).map(|node| course.begins_absent(node)).collect();
    let edges = scenario.graph.edges.iter().filter(|edge| !absent[edge.a] && !absent[edge.b]);
    Graph { nodes: scenario.graph.nodes, edges: edges.copied().collect() }
}

/// The largest `alpha_ij |x_i - x_j|` at each node.
fn largest_edge_terms(graph: &Graph, states: &[f64]) -> Vec<f64> {
    let mut terms = vec![0.0f64; graph.nodes];
    for edge in &graph.edges {
        let term = edge.weight * (states[edge.b] - states[edge.a]).abs();
        terms[edge.a] = larger(terms[edge.a], term);
        terms[edge.b] = larger(terms[edge.b], term);
    }
    terms
}

/// Refuses nodes that start on or outside their funnel; `places` says where each node's state was given. A
/// coupling that promises nothing may start anywhere.
pub(super) fn check(scenario: &Scenario, places: &[Place]) -> Result<(), Diagnostics> {
    if !scenario.coupling.keeps_funnels() {
        return Ok(());
    }
    let ratios = initial_ratios(scenario);
    let worst = |ratios: &[f64]| largest(0.0, ratios.iter().copied());
    let worst: Vec<_> = ratios.chunks_exact(scenario.components()).map(worst).collect();
    // Written so that NaN is outside.
    let inside = |ratio: f64| ratio < 1.0;
    // A node that joins later has no edge at the start, and a term of zero.
    let outside = scenario.nodes.iter().zip(worst).zip(places).filter(|((_, ratio), _)| !inside(*ratio));
    let found: Vec<_> = outside.map(|((node, ratio), place)| explain(node, ratio, place)).collect();
    if found.is_empty() { Ok(()) } else { Err(Diagnostics(found)) }
}

fn explain(node: &NodeSpec, ratio: f64, place: &Place) -> Diagnostic {
    let width = node.funnel.width(0.0);
    let nu = ratio * width;
    let key = format!("node {}", node.id);
    let allowed = format!(
        "starts outside its funnel: |nu| = {} at t = 0 must be below psi(0) = {}, and is {} too \
         much (ratio {})",
        significant(nu, 6),
        significant(width, 6),
        significant(nu - width, 4),
        significant(ratio, 6)
    );
    let mut diagnostic = place.diagnostic(Problem::Whole, &key, allowed);
    let factor = round_up(1.05 * ratio * node.funnel.factor);
    let own = node.funnel.factor;
    diagnostic.hint = Some(match node.funnel.shape {
        Shape::Exponential { .. } | Shape::FiniteTime { .. } | Shape::Schedule { .. } => {
            format!("funnel start = {} (or factor = {factor}) would do", round_up(1.05 * nu / own))
        }
        Shape::Constant { .. } => {
            format!("funnel width = {} (or factor = {factor}) would do", round_up(1.05 * nu / own))
        }
        Shape::ReciprocalTime { .. } => format!("factor = {factor} would do"),
    });
    *diagnostic
}

/// Up to two significant digits, never down.
fn round_up(value: f64) -> f64 {
    let unit = math::exp10(math::log10(value).floor() - 1.0);
    let rounded = (value / unit).ceil() * unit;
    // Parsing what three digits print as takes off the binary dust of the multiplication.
    format!("{rounded:.3e}").parse().unwrap_or(rounded)
}

#[cfg(test)]
mod tests {
    use super::round_up;

    #[test]
    fn suggestions_are_round_and_enough() {
        for (value, expected) in [(47.3, 48.0), (0.0123, 0.013), (1201.0, 1300.0), (5.0, 5.0), (0.99, 0.99)] {
            assert_eq!(round_up(value), expected);
        }
    }
}
