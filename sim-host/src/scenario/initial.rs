//! The theorem's condition on the start: every diffusive term inside its funnel.

use super::diagnostic::{Diagnostic, Diagnostics, Problem};
use super::model::{FunnelSpec, NodeSpec, Scenario};
use super::tree::Place;
use crate::figure::figure;
use funnel_core::math;

/// `|nu_i| / psi_i` at t = 0, by index. The guarantee needs every one below 1 (the paper's Theorem 1).
#[must_use]
pub fn initial_ratios(scenario: &Scenario) -> Vec<f64> {
    let terms = scenario.graph.diffusive_terms(&scenario.initial_states());
    terms.iter().zip(&scenario.nodes).map(|(nu, node)| nu.abs() / node.funnel.width(0.0)).collect()
}

/// Refuses nodes that start on or outside their funnel; `places` says where each node's state was given.
pub(super) fn check(scenario: &Scenario, places: &[Place]) -> Result<(), Diagnostics> {
    let ratios = initial_ratios(scenario);
    let outside = scenario.nodes.iter().zip(ratios).zip(places).filter(|((_, ratio), _)| *ratio >= 1.0);
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
        figure(nu, 6),
        figure(width, 6),
        figure(nu - width, 4),
        figure(ratio, 6)
    );
    let mut diagnostic = place.diagnostic(Problem::Whole, &key, allowed);
    let factor = round_up(1.05 * ratio * node.funnel.factor());
    diagnostic.hint = Some(match node.funnel {
        FunnelSpec::Exponential { factor: own, .. } | FunnelSpec::FiniteTime { factor: own, .. } => {
            format!("funnel start = {} (or factor = {factor}) would do", round_up(1.05 * nu / own))
        }
        FunnelSpec::Constant { factor: own, .. } => {
            format!("funnel width = {} (or factor = {factor}) would do", round_up(1.05 * nu / own))
        }
        FunnelSpec::ReciprocalTime { .. } => format!("factor = {factor} would do"),
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
