//! Each figure over all runs.

use super::super::figures::short;
use super::super::page::wide;
use super::table::{Table, number};
use crate::printable::printable;
use maud::{Markup, html};

/// Figures that are shown.
const SHOWN: usize = 40;

/// Numbers of a set of runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Numbers {
    pub(super) count: usize,
    pub(super) low: f64,
    pub(super) mean: f64,
    pub(super) median: f64,
    pub(super) high: f64,
}

impl Numbers {
    /// Of those that are known; `None` where none is.
    pub(super) fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.filter(|value| !value.is_nan()).collect();
        values.sort_by(f64::total_cmp);
        let (count, low, high) = (values.len(), *values.first()?, *values.last()?);
        let middle = [values[(count - 1) / 2], values[count / 2]];
        let mean = values.iter().sum::<f64>() / count as f64;
        Some(Self { count, low, mean, median: 0.5 * (middle[0] + middle[1]), high })
    }
}

/// The values of a column.
pub(super) fn values<'a>(
    rows: impl Iterator<Item = &'a Vec<String>>,
    at: usize,
) -> impl Iterator<Item = f64> {
    rows.filter_map(move |row| number(&row[at]))
}

/// A row for each figure that differs from run to run.
pub(super) fn statistics(table: &Table) -> Markup {
    let figures = table.figures();
    html! {
        @if figures.is_empty() { p { "No figure differs from run to run." } }
        @if figures.len() > SHOWN { p { "The first " (SHOWN) " of " (figures.len()) " figures that differ from run to run." } }
        (wide("Figures", html! {
            table {
                caption { "Figures that differ from run to run" }
                thead { tr {
                    th scope="col" { "figure" } th.n scope="col" { "runs" } th.n scope="col" { "least" } th.n scope="col" { "median" }
                    th.n scope="col" { "mean" } th.n scope="col" { "most" }
                } }
                tbody { @for &at in figures.iter().take(SHOWN) {
                    @if let Some(numbers) = Numbers::of(values(table.rows.iter(), at)) { tr {
                        th scope="row" { (printable(&table.names[at])) } td.n { (numbers.count) }
                        @for value in [numbers.low, numbers.median, numbers.mean, numbers.high] { td.n { (short(value)) } }
                    } }
                } }
            }
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_runs_leave_out_what_is_not_known() {
        let numbers = Numbers::of([3.0, 1.0, f64::NAN, 8.0, 2.0].into_iter()).unwrap();
        assert_eq!(numbers, Numbers { count: 4, low: 1.0, mean: 3.5, median: 2.5, high: 8.0 });
        assert_eq!(Numbers::of([f64::NAN].into_iter()), None);
    }
}
