//! The report of two runs side by side, of what `diff` finds.

use super::figures::{known, short, shown};
use super::page::{Page, folded, mark, section, wide};
use super::pictures;
use super::provenance::provenance;
use super::run::{Run, glance};
use crate::compare::{Apart, Comparison, Recorded, compare, overlay_svg};
use crate::printable::printable;
use maud::{Markup, html};
use serde_json::Value;

/// Columns and figures that are shown.
const SHOWN: usize = 200;
/// Most rows of a table that is open on a screen.
const OPEN: usize = 30;

/// Two runs, and how they differ.
pub(super) struct Pair {
    runs: [Run; 2],
    recorded: [Recorded; 2],
    found: Comparison,
}

impl Pair {
    /// Compares two folders of runs.
    ///
    /// # Errors
    /// One of them cannot be read, in words.
    pub(super) fn read(runs: [Run; 2]) -> Result<Self, String> {
        let read = |run: &Run| Recorded::read(&run.folder.path);
        let recorded = [read(&runs[0])?, read(&runs[1])?];
        let found = compare(&recorded[0], &recorded[1]);
        Ok(Self { runs, recorded, found })
    }

    /// What was found, in a few words.
    pub(super) fn told(&self) -> &'static str {
        if self.found.equal { "equal" } else { "different" }
    }

    /// The page.
    ///
    /// # Errors
    /// A file cannot be read, in words.
    pub(super) fn page(&self) -> Result<Page, String> {
        let [a, b] = &self.runs;
        let title = if a.title() == b.title() { a.title() } else { format!("{} / {}", a.title(), b.title()) };
        let body = html! {
            h1 { "A beside B: " (title) }
            (self.banner())
            (section("glance", "Side by side", self.beside()))
            (section("pictures", "States", self.picture()))
            (section("apart", "Where the trajectories differ", self.apart()))
            (section("figures", "Where the summaries differ", self.figures()))
            (section("provenance-a", "Provenance of A", provenance(&a.folder, &a.summary)?))
            (section("provenance-b", "Provenance of B", provenance(&b.folder, &b.summary)?))
        };
        Ok(Page { title: format!("A and B are {}: {title}", self.told()), body, sorts: false })
    }

    fn banner(&self) -> Markup {
        let Comparison { equal, rows, columns, first, .. } = &self.found;
        let first = first.as_ref().map(ToString::to_string);
        html! {
            @if *equal {
                p.verdict.good {
                    strong { span aria-hidden="true" { "=" } " Equal" } " to the bit: " (rows) " rows of " (columns) " columns"
                    @if self.found.summaries { ", and every figure of the summaries" } "."
                }
            } @else {
                p.verdict.differs {
                    strong { span aria-hidden="true" { "\u{2260}" } " Different" }
                    @match first {
                        Some(first) => { " The first value that differs: " (first) "." }
                        None => { " No value of the " (rows) " rows and " (columns) " columns that both have differs." }
                    }
                }
            }
        }
    }

    /// The first figures of both.
    fn beside(&self) -> Markup {
        let [a, b] = &self.runs;
        let named = |run: &Run| -> Vec<(&'static str, String)> {
            let mut rows =
                vec![("verdict", run.verdict().word().to_owned()), ("seed", known(&run.summary, "seed"))];
            rows.extend(glance(&run.summary).into_iter().filter(|(name, _)| *name != "bus load"));
            rows
        };
        let (left, right) = (named(a), named(b));
        wide(
            "A beside B",
            html! {
                table {
                    caption { "First figures of both runs; the same to the digits shown, or not" }
                    thead { tr { th scope="col" { "figure" } th.n scope="col" { "A" } th.n scope="col" { "B" } th scope="col" { "the same" } } }
                    tbody { @for ((name, a), (_, b)) in left.iter().zip(&right) { tr {
                        th scope="row" { (name) } td.n { (a) } td.n { (b) }
                        td { @if a == b { "yes" } @else { strong { "no" } } }
                    } } }
                }
            },
        )
    }

    fn picture(&self) -> Markup {
        let [a, b] = &self.recorded;
        match overlay_svg("States of A and B", &a.table, &b.table) {
            Ok(svg) => pictures::drawn(
                &svg,
                "overlay-words",
                "States of A and B",
                "States of both runs: those of A as broad light lines, those of B as thin dark ones on top. Where both agree, each thin line runs in the middle of a broad one; the tables below say where they do not.",
            ),
            Err(why) => html! { p.note { "No picture: " (printable(&why.to_string())) "." } },
        }
    }

    fn apart(&self) -> Markup {
        let Comparison { apart, lengths: [a, b], only_in, .. } = &self.found;
        html! {
            @if a != b { p { "A has " (a) " rows, B has " (b) "." } }
            @for (name, columns) in ["A", "B"].iter().zip(only_in) {
                @if !columns.is_empty() { p { "Columns only in " (name) ": " (printable(&columns.join(", "))) "." } }
            }
            @if apart.is_empty() { p { (mark(true, "no column differs")) } } @else {
                p { (apart.len()) " of " (self.found.columns) " columns differ" @if apart.len() > SHOWN { "; the first " (SHOWN) " of them" } "." }
                (folded("Columns, the farthest apart first", apart.len() <= OPEN, columns(apart)))
            }
        }
    }

    fn figures(&self) -> Markup {
        let figures = &self.found.figures;
        let value = |value: &Option<Value>| value.as_ref().map_or("not there".to_owned(), shown);
        html! {
            @match self.found.only_summary {
                Some(name) => p { "Only " (name) " has a summary." },
                None if !self.found.summaries => p { "Neither has a summary." },
                None if figures.is_empty() => p { (mark(true, "no figure differs")) },
                None => (folded(&format!("{} figures", figures.len()), figures.len() <= OPEN, wide("Figures", html! {
                    table {
                        caption { "Figures that differ, but for times of the machine, commands and versions" }
                        thead { tr { th scope="col" { "figure" } th.n scope="col" { "A" } th.n scope="col" { "B" } } }
                        tbody { @for figure in figures.iter().take(SHOWN) { tr {
                            th scope="row" { (printable(&figure.key)) } td.n { (value(&figure.a)) } td.n { (value(&figure.b)) }
                        } } }
                    }
                }))),
            }
        }
    }
}

fn columns(apart: &[Apart]) -> Markup {
    let or = |value: Option<f64>, word: &str| value.map_or(word.to_owned(), short);
    wide(
        "Columns that differ",
        html! {
            table {
                caption { "Columns that differ" }
                thead { tr {
                    th scope="col" { "column" } th.n scope="col" { "largest distance" } th.n scope="col" { "at t, s" } th.n scope="col" { "rows" }
                } }
                tbody { @for apart in apart.iter().take(SHOWN) { tr {
                    th scope="row" { (printable(&apart.column)) }
                    td.n { (or(apart.distance, "known in one only")) } td.n { (or(apart.t, "")) } td.n { (apart.rows) }
                } } }
            }
        },
    )
}
