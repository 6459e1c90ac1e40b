//! Every run as a row of a table that sorts.

use super::super::figures::short;
use super::super::page::{mark, wide};
use super::table::{Table, number};
use crate::printable::printable;
use maud::{Markup, html};

/// Figures with a column.
const FIGURES: usize = 8;
/// Runs that are shown: of more, a page would take long to open.
const RUNS: usize = 5000;

/// The table: failures first, then by their numbers.
pub(super) fn runs(table: &Table) -> Markup {
    let axes: Vec<usize> = table.axes().into_iter().map(|(at, _)| at).collect();
    let figures: Vec<usize> = table.figures().into_iter().take(FIGURES).collect();
    let mut rows: Vec<&Vec<String>> = table.rows.iter().collect();
    // Stable: otherwise as in the file.
    rows.sort_by_key(|row| table.passes(row));
    html! {
        p { "A click on the name of a column sorts by it, a second one the other way round." }
        @if rows.len() > RUNS { p { "The first " (RUNS) " of " (rows.len()) " runs, those that did not pass before the others; all are in runs.csv." } }
        (wide("All runs", html! {
            table.sorts {
                caption { "All runs, with the first figures that differ" }
                thead { tr {
                    th scope="col" { "run" }
                    @for &at in &axes { th scope="col" { (printable(&table.names[at])) } }
                    th.n scope="col" { "seed" } th scope="col" { "verdict" }
                    @for &at in &figures { th.n scope="col" { (printable(&table.names[at])) } }
                } }
                tbody { @for row in rows.iter().take(RUNS) { tr {
                    th scope="row" { (printable(table.cell(row, "run"))) }
                    @for &at in &axes {
                        @match number(&row[at]) {
                            Some(value) => td data-v=(value) { (printable(&row[at])) },
                            None => td { (printable(&row[at])) },
                        }
                    }
                    td.n { (printable(table.cell(row, "seed"))) }
                    td { (mark(table.passes(row), &printable(table.cell(row, "verdict")))) }
                    @for &at in &figures { (figure(&row[at])) }
                } } }
            }
        }))
    }
}

/// As many digits as people read, and all of them to sort by.
fn figure(cell: &str) -> Markup {
    html! {
        @match number(cell) {
            Some(value) => td.n data-v=(value) { (short(value)) },
            None => td.n data-v="" { (printable(cell)) },
        }
    }
}
