//! The pictures of a run, each with what it shows in words and as a table.

use super::digest::{Digest, Sample};
use super::figures::{known, number, short};
use super::folder::Folder;
use super::page::{folded, wide};
use super::picture;
use maud::{Markup, PreEscaped, html};
use serde_json::Value;

/// Nodes that get a column each in a table of states.
const COLUMNS: usize = 12;

/// A picture of a folder.
pub(super) struct Picture {
    pub(super) file: &'static str,
    pub(super) id: &'static str,
    pub(super) words: String,
    pub(super) table: Markup,
}

/// States, funnels, inputs, and spread beside its bound.
pub(super) fn pictures(folder: &Folder, summary: &Value, digest: &Digest) -> Result<Markup, String> {
    let all = [
        Picture {
            file: "states.svg",
            id: "states-words",
            words: states(digest, summary),
            table: state_table(digest),
        },
        Picture {
            file: "funnels.svg",
            id: "funnels-words",
            words: funnels(digest, summary),
            table: over_time(
                digest,
                "Largest |\u{3BD}|/\u{3C8} of all nodes over time",
                "largest |\u{3BD}|/\u{3C8}",
                |row| row.ratio,
            ),
        },
        Picture {
            file: "inputs.svg",
            id: "inputs-words",
            words: inputs(digest, summary),
            table: over_time(digest, "Largest |u| of all nodes over time", "largest |u|", |row| row.input),
        },
        Picture {
            file: "agreement.svg",
            id: "agreement-words",
            words: agreement(summary),
            table: over_time(digest, "Largest distance of two nodes over time", "spread", |row| row.spread),
        },
    ];
    all.into_iter().map(|picture| figure(folder, picture)).collect::<Result<Vec<_>, _>>().map(|figures| {
        html! { @for figure in &figures { (figure) } }
    })
}

/// With its words, and the table folded.
///
/// # Errors
/// The file cannot be read, in words.
pub(super) fn figure(folder: &Folder, Picture { file, id, words, table }: Picture) -> Result<Markup, String> {
    let svg = match folder.text(file)? {
        Some(svg) => picture::inline(&svg, id),
        None => Err("is not in the folder".to_owned()),
    };
    Ok(html! {
        figure {
            @match &svg {
                Ok(svg) => (wide(file, html! { (PreEscaped(svg)) })),
                Err(why) => p.note { "No picture: " (file) " " (why) "." },
            }
            figcaption id=(id) { (words) }
            (folded("The same in numbers", false, table))
        }
    })
}

/// A picture made just now, with its words.
pub(super) fn drawn(svg: &str, id: &str, label: &str, words: &str) -> Markup {
    html! {
        figure {
            @match picture::inline(svg, id) {
                Ok(svg) => (wide(label, html! { (PreEscaped(svg)) })),
                Err(why) => p.note { "No picture: " (why) "." },
            }
            figcaption id=(id) { (words) }
        }
    }
}

fn span(digest: &Digest) -> String {
    format!("from {} to {} s", short(digest.span.0), short(digest.span.1))
}

fn states(digest: &Digest, summary: &Value) -> String {
    let range = |sample: Option<&Sample>| {
        let range = sample.and_then(Digest::range);
        range.map_or("are not known".to_owned(), |range| {
            format!("lie between {} and {}", short(range.start), short(range.end))
        })
    };
    let mut words = format!(
        "States {}: at the begin they {}, at the end they {}.",
        span(digest),
        range(digest.samples.first()),
        range(digest.samples.last())
    );
    if digest.samples.last().is_some_and(|row| !row.xi.is_nan()) {
        words += &format!(
            " The emergent trajectory (dotted) ends at {}; the farthest node is {} from it.",
            known(summary, "emergent.xi_final"),
            known(summary, "emergent.final_error")
        );
    }
    words + " Solid lines are nodes, the dashed one is the blended dynamics."
}

fn funnels(digest: &Digest, summary: &Value) -> String {
    let nearest = digest.nearest().map_or(String::new(), |node| {
        format!(
            " Of the recorded rows the nearest is that of node {} at t = {} s, with {}.",
            node.name,
            short(node.ratio_at),
            short(node.ratio)
        )
    });
    format!(
        "Diffusive terms inside their funnels. The largest |\u{3BD}|/\u{3C8} of all ticks is {}; {} node-ticks are outside.{nearest} \
         A ratio of 1 is the boundary.",
        known(summary, "funnel.max_ratio"),
        known(summary, "funnel.breaches")
    )
}

fn inputs(digest: &Digest, summary: &Value) -> String {
    let strongest = digest.strongest().map_or(String::new(), |node| {
        format!(
            " Of the recorded rows the largest is that of node {}, with {}.",
            node.name,
            short(node.input)
        )
    });
    format!(
        "Coupling inputs {}. The largest |u| of all ticks is {}.{strongest}",
        span(digest),
        known(summary, "max_input")
    )
}

fn agreement(summary: &Value) -> String {
    let share = match (number(summary, "sync.final_spread"), number(summary, "sync.bound")) {
        (Some(spread), Some(bound)) if bound > 0.0 => {
            format!(", which is {} % of it", short(100.0 * spread / bound))
        }
        _ => String::new(),
    };
    format!(
        "Spread of the states against its bound 2 \u{221A}N \u{3C8} / \u{3BB}\u{2082}. At the end the bound is {} and the spread {}{share}; the largest spread of all ticks is {}.",
        known(summary, "sync.bound"),
        known(summary, "sync.final_spread"),
        known(summary, "sync.max_spread")
    )
}

/// States of each node, or of more nodes than a table holds their range.
fn state_table(digest: &Digest) -> Markup {
    let few = digest.nodes.len() <= COLUMNS;
    wide(
        "States over time",
        html! {
            table {
                caption { "States over time, state units" }
                thead { tr {
                    th.n scope="col" { "t, s" }
                    @if few {
                        @for node in &digest.nodes { th.n scope="col" { "node " (node.name) } }
                    } @else {
                        th.n scope="col" { "lowest" } th.n scope="col" { "highest" }
                    }
                    th.n scope="col" { "emergent \u{3BE}" }
                } }
                tbody { @for row in &digest.samples { tr {
                    th.n scope="row" { (short(row.t)) }
                    @if few {
                        @for x in &row.x { td.n { (short(*x)) } }
                    } @else {
                        @let range = Digest::range(row).unwrap_or(f64::NAN..f64::NAN);
                        td.n { (short(range.start)) } td.n { (short(range.end)) }
                    }
                    td.n { (short(row.xi)) }
                } } }
            }
        },
    )
}

fn over_time(digest: &Digest, caption: &str, name: &str, value: impl Fn(&Sample) -> f64) -> Markup {
    html! {
        table {
            caption { (caption) }
            thead { tr { th.n scope="col" { "t, s" } th.n scope="col" { (name) } } }
            tbody { @for row in &digest.samples { tr { th.n scope="row" { (short(row.t)) } td.n { (short(value(row))) } } } }
        }
    }
}
