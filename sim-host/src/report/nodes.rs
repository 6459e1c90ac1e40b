//! Each node by itself: where it began and ended, how near its funnel it came, and the margin that theory leaves it.

use super::digest::Digest;
use super::figures::{list, short};
use super::page::{folded, wide};
use maud::{Markup, html};
use serde_json::Value;

/// Most rows of a table that is open on a screen.
const OPEN: usize = 20;

/// The table of all nodes, by id.
pub(super) fn nodes(digest: &Digest, summary: &Value) -> Markup {
    let steady = list(summary, "emergent.steady_ratio_max");
    // A prediction is there for each node; with vectors there is none.
    let margin = |at: usize| {
        let ratio = steady.get(at).and_then(Value::as_f64).filter(|_| steady.len() == digest.nodes.len());
        ratio.map_or(f64::NAN, |ratio| 1.0 - ratio.abs())
    };
    let least = (0..digest.nodes.len())
        .filter(|&at| !margin(at).is_nan())
        .min_by(|&a, &b| margin(a).total_cmp(&margin(b)));
    let table = wide(
        "Nodes",
        html! {
            table {
                caption { "Nodes. Ratio and input are the largest of the recorded rows" }
                thead { tr {
                    th scope="col" { "node" } th.n scope="col" { "first state" } th.n scope="col" { "last state" }
                    th.n scope="col" { "|\u{3BD}|/\u{3C8}" } th.n scope="col" { "at t, s" } th.n scope="col" { "|u|" }
                    th.n scope="col" { "predicted margin" }
                } }
                tbody { @for (at, node) in digest.nodes.iter().enumerate() { tr {
                    th scope="row" { (node.name) }
                    td.n { (short(node.first)) } td.n { (short(node.last)) }
                    td.n { (short(node.ratio)) @if node.ratio >= 1.0 { " outside" } }
                    td.n { (short(node.ratio_at)) } td.n { (short(node.input)) } td.n { (short(margin(at))) }
                } } }
            }
        },
    );
    html! {
        @if let Some(at) = least {
            p {
                "The smallest predicted margin is that of node " (digest.nodes[at].name) ": " (short(margin(at)))
                ". A margin is one minus the largest |\u{3BD}|/\u{3C8} that the emergent dynamics predict under a narrow funnel."
            }
        } @else {
            p { "No margins are predicted for this run." }
        }
        (folded(&format!("{} rows", digest.nodes.len()), digest.nodes.len() <= OPEN, table))
    }
}
