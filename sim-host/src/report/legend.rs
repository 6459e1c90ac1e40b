//! A legend beside the plot, where it can cover nothing.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::PlotError;
use super::style::{INK, at, font};

/// A line of the legend.
pub(super) struct Entry {
    pub(super) label: String,
    pub(super) style: ShapeStyle,
    pub(super) dashed: bool,
}

/// Distance between the lines, in pixels.
const LINE: i32 = 22;

/// Draws `entries` from the top of `area`.
pub(super) fn draw<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    entries: &[Entry],
) -> Result<(), PlotError> {
    for (k, entry) in entries.iter().enumerate() {
        let y = 12 + LINE * k as i32;
        let dashes: &[(i32, i32)] = if entry.dashed { &[(4, 11), (15, 22), (26, 32)] } else { &[(4, 32)] };
        for &(from, to) in dashes {
            let mark = PathElement::new(vec![at(from, y), at(to, y)], entry.style);
            area.draw(&mark).map_err(PlotError::new)?;
        }
        let text = Text::new(entry.label.clone(), at(40, y - 9), font(16).color(&INK));
        area.draw(&text).map_err(PlotError::new)?;
    }
    Ok(())
}
