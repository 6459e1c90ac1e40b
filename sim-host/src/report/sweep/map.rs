//! Figures over one parameter as lines, over two as a map whose cells say their numbers.

use super::super::figures::short;
use super::super::page::wide;
use super::super::pictures::drawn;
use super::groups::{Groups, MOST};
use super::statistics::Numbers;
use super::table::{Table, number};
use crate::plot::{Lines, Spot};
use crate::printable::printable;
use maud::{Markup, html};

/// Steps of shade.
const SHADES: f64 = 5.0;

/// The share of runs that pass, and the first figures that differ.
pub(super) fn pictures(table: &Table, most: usize) -> Markup {
    let axes = table.axes();
    let figures = table.figures();
    let figures: Vec<usize> = figures.into_iter().take(most).collect();
    match axes.as_slice() {
        [] => html! { p { "There is nothing to draw them over; the table below has their ranges." } },
        [axis] => html! {
            (over_one(table, axis, "share of runs that pass", 0, &|row| if table.passes(row) { 1.0 } else { 0.0 }))
            @for (n, &at) in figures.iter().enumerate() {
                (over_one(table, axis, &table.names[at], n + 1, &|row| number(&row[at]).unwrap_or(f64::NAN)))
            }
        },
        [first, second, more @ ..] => html! {
            @if !more.is_empty() {
                p {
                    "Maps are over the first two parameters. Each cell holds the runs with all values of "
                    (printable(&more.iter().map(|(at, _)| table.names[*at].as_str()).collect::<Vec<_>>().join(", "))) "."
                }
            }
            (over_two(table, first, second, "share of runs that pass", &|row| if table.passes(row) { 1.0 } else { 0.0 }))
            @for &at in &figures {
                (over_two(table, first, second, &format!("mean of {}", table.names[at]), &|row| number(&row[at]).unwrap_or(f64::NAN)))
            }
        },
    }
}

/// A column with its values.
type Axis = (usize, Vec<String>);
/// The figure of a row; NaN where it is not known.
type Figure<'a> = &'a dyn Fn(&Vec<String>) -> f64;

fn over_one(table: &Table, (axis, all): &Axis, name: &str, n: usize, figure: Figure<'_>) -> Markup {
    let groups = Groups::of(all);
    let mut values = vec![Vec::new(); groups.names.len()];
    for row in &table.rows {
        if let Some(group) = groups.place(&row[*axis]) {
            values[group].push(figure(row));
        }
    }
    let group = |(at, values): (usize, Vec<f64>)| Some((at, Numbers::of(values.into_iter())?));
    let rows: Vec<(usize, Numbers)> = values.into_iter().enumerate().filter_map(group).collect();
    let spot = |&(at, numbers): &(usize, Numbers)| {
        let (Numbers { low, mean, high, .. }, at) = (numbers, groups.centres[at]);
        (!at.is_nan()).then_some(Spot { at, low, mean, high })
    };
    let spots: Option<Vec<Spot>> = rows.iter().map(spot).collect();
    let parameter = table.names[*axis].as_str();
    let words = format!(
        "{} over {}: the mean as a line with a dot at each value or range of values, from the least to the most as a band. The table has the same in numbers.",
        printable(name),
        printable(parameter)
    );
    let picture = spots.and_then(|spots| {
        let lines =
            Lines { title: name.to_owned(), parameter: parameter.to_owned(), figure: name.to_owned(), spots };
        lines.svg().ok()
    });
    html! {
        @if let Some(svg) = &picture { (drawn(svg, &format!("lines-{n}"), name, &words)) }
        (wide(&format!("{name} in numbers"), html! {
            table {
                caption { (printable(name)) " over " (printable(parameter)) }
                thead { tr {
                    th.n scope="col" { (printable(parameter)) } th.n scope="col" { "runs" } th.n scope="col" { "least" }
                    th.n scope="col" { "mean" } th.n scope="col" { "most" }
                } }
                tbody { @for (at, numbers) in &rows { tr {
                    th.n scope="row" { (printable(&groups.names[*at])) } td.n { (numbers.count) }
                    @for value in [numbers.low, numbers.mean, numbers.high] { td.n { (short(value)) } }
                } } }
            }
        }))
    }
}

fn over_two(
    table: &Table,
    (down, rows): &Axis,
    (across, columns): &Axis,
    name: &str,
    figure: Figure<'_>,
) -> Markup {
    let (rows, columns) = (Groups::of(rows), Groups::of(columns));
    let (height, width) = (rows.names.len(), columns.names.len());
    if height > MOST || width > MOST {
        return html! { p.note { (printable(name)) ": a map of " (height) " by " (width) " values is too large to read." } };
    }
    let mut values = vec![vec![Vec::new(); width]; height];
    for run in &table.rows {
        if let (Some(row), Some(column)) = (rows.place(&run[*down]), columns.place(&run[*across])) {
            values[row][column].push(figure(run));
        }
    }
    let mean = |values: Vec<f64>| Numbers::of(values.into_iter()).map_or(f64::NAN, |numbers| numbers.mean);
    let cells: Vec<Vec<f64>> = values.into_iter().map(|row| row.into_iter().map(mean).collect()).collect();
    let Some(range) = Numbers::of(cells.iter().flatten().copied()) else { return html! {} };
    html! {
        (wide(name, html! {
            table.map {
                caption {
                    (printable(name)) ", from " (short(range.low)) " (lightest) to " (short(range.high)) " (darkest); rows are "
                    (printable(&table.names[*down])) ", columns " (printable(&table.names[*across]))
                }
                thead { tr {
                    th scope="col" { (printable(&table.names[*down])) " \\ " (printable(&table.names[*across])) }
                    @for column in &columns.names { th.n scope="col" { (printable(column)) } }
                } }
                tbody { @for (row, cells) in rows.names.iter().zip(&cells) { tr {
                    th scope="row" { (printable(row)) }
                    @for &value in cells {
                        td class={ "n shade-" (shade(value, &range)) } { @if value.is_nan() { "none" } @else { (short(value)) } }
                    }
                } } }
            }
        }))
    }
}

/// From 0 for the least to 4 for the most.
fn shade(value: f64, range: &Numbers) -> u32 {
    let share = (value - range.low) / (range.high - range.low);
    if share.is_finite() { (share * SHADES).clamp(0.0, SHADES - 1.0) as u32 } else { 0 }
}
