//! Both runs in one picture.

use super::table::Table;
use crate::plot::{Overlay, PlotError};

/// The states `x_1..` of both, those of A as broad light lines and those of B as thin dark ones on top, as
/// SVG text: where they agree, each thin line runs in the middle of a broad one.
///
/// # Errors
/// [`PlotError`] if one of them has no times, or no states.
pub fn overlay_svg(title: &str, a: &Table, b: &Table) -> Result<String, PlotError> {
    let curves = |table: &Table| -> Vec<Vec<(f64, f64)>> {
        let states = table.names().iter().filter(|name| name.starts_with("x_"));
        let curve = |name: &String| {
            let values = table.column(name).unwrap_or_default();
            table.times().iter().copied().zip(values.iter().copied()).collect()
        };
        states.map(curve).collect()
    };
    Overlay { title: title.to_owned(), below: curves(a), above: curves(b) }.svg()
}
