//! The report of a sweep: its failures first, then its figures over what was swept, then every run.

mod all;
mod groups;
mod map;
mod statistics;
mod table;

use super::folder::Folder;
use super::page::{Page, section, wide};
use crate::printable::printable;
use maud::{Markup, html};
pub(super) use table::Table;

/// Failures that are shown.
const FAILURES: usize = 200;
/// Figures that get a picture or a map.
const PICTURES: usize = 4;

/// The page of a sweep.
///
/// # Errors
/// A file cannot be read, in words.
pub(super) fn page(folder: &Folder, table: &Table) -> Result<Page, String> {
    let failed = failed(table).len();
    let title = folder
        .text(crate::run::names::SCENARIO)?
        .and_then(|text| title(&text))
        .unwrap_or("A sweep".to_owned());
    let word = if failed == 0 { "passed".to_owned() } else { format!("{failed} failed") };
    let body = html! {
        h1 { "Sweep: " (printable(&title)) }
        (banner(table, failed))
        (swept(table))
        @if failed > 0 { (section("failures", "Runs that did not pass", failures(table))) }
        (section("figures", "Figures over what was swept", map::pictures(table, PICTURES)))
        (section("statistics", "All figures", statistics::statistics(table)))
        (section("runs", "All runs", all::runs(table)))
    };
    Ok(Page { title: format!("Sweep, {word}: {title}"), body, sorts: true })
}

/// What came of it, in a few words.
pub(super) fn told(table: &Table) -> String {
    let missing = if table.missing.is_empty() { "" } else { "; shards are missing" };
    format!("{} runs, {} did not pass{missing}", table.rows.len(), failed(table).len())
}

/// The title in the text of a scenario.
fn title(scenario: &str) -> Option<String> {
    let line =
        scenario.lines().find_map(|line| line.strip_prefix("title")?.trim_start().strip_prefix('='))?;
    let quote = line.trim().chars().next().filter(|quote| ['"', '\''].contains(quote))?;
    let title = line.trim().trim_start_matches(quote);
    Some(title.split_once(quote)?.0.to_owned()).filter(|title| !title.is_empty())
}

fn failed(table: &Table) -> Vec<&Vec<String>> {
    table.rows.iter().filter(|row| !table.passes(row)).collect()
}

fn banner(table: &Table, failed: usize) -> Markup {
    let runs = table.rows.len();
    let missing: Vec<String> = table.missing.iter().map(u32::to_string).collect();
    html! {
        @if failed == 0 && runs > 0 {
            p.verdict.good { strong { span aria-hidden="true" { "\u{2714}" } " Passed" } " All " (runs) " runs passed." }
        } @else if runs == 0 {
            p.verdict.bad { strong { span aria-hidden="true" { "?" } " Empty" } " The table has no runs." }
        } @else {
            p.verdict.bad {
                strong { span aria-hidden="true" { "\u{2718}" } " " (failed) " failed" } " of " (runs) " runs. They stand first below."
            }
        }
        @if !missing.is_empty() {
            p.verdict.bad {
                strong { span aria-hidden="true" { "\u{25D0}" } " Not whole" } " Shards " (missing.join(", ")) " are not there."
            }
        }
    }
}

/// The parameters with their values.
fn swept(table: &Table) -> Markup {
    let axes = table.axes();
    let told = |values: &[String]| match values.len() {
        0..=12 => values.join(", "),
        many => format!("{many} values from {} to {}", values[0], values[many - 1]),
    };
    html! {
        @if axes.is_empty() { p { "Nothing was swept but seeds." } } @else {
            table.pairs {
                caption { "What was swept" }
                tbody { @for (at, values) in &axes { tr {
                    th scope="row" { (printable(&table.names[*at])) } td { (printable(&told(values))) }
                } } }
            }
        }
    }
}

fn failures(table: &Table) -> Markup {
    let failed = failed(table);
    let axes = table.axes();
    html! {
        @if failed.len() > FAILURES { p { "The first " (FAILURES) " of " (failed.len()) "." } }
        (wide("Runs that did not pass", html! {
            table {
                caption { "Runs that did not pass" }
                thead { tr {
                    th scope="col" { "run" } th scope="col" { "verdict" } th scope="col" { "why" }
                    @for (at, _) in &axes { th scope="col" { (printable(&table.names[*at])) } }
                    th.n scope="col" { "seed" }
                } }
                tbody { @for row in failed.iter().take(FAILURES) { tr {
                    th scope="row" { (printable(table.cell(row, "run"))) }
                    td { (super::page::mark(false, &printable(table.cell(row, "verdict")))) }
                    td { (printable(table.cell(row, "why"))) }
                    @for (at, _) in &axes { td { (printable(&row[*at])) } }
                    td.n { (printable(table.cell(row, "seed"))) }
                } } }
            }
        }))
    }
}
