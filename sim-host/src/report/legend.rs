//! A legend beside the plot, where it can cover nothing.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::PlotError;
use super::style::{INK, at, font};

/// A line of the legend.
pub(super) struct Entry {
    pub(super) label: String,
    pub(super) style: ShapeStyle,
    pub(super) stroke: Stroke,
}

/// How a line is broken.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Stroke {
    Solid,
    Dashed,
    Dotted,
}

impl Stroke {
    /// Length of a mark and of the space after it, in pixels; `None` for a whole line.
    pub(super) fn pattern(self) -> Option<(u32, u32)> {
        match self {
            Self::Solid => None,
            Self::Dashed => Some((7, 4)),
            Self::Dotted => Some((2, 3)),
        }
    }
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
        let (mark, space) = entry.stroke.pattern().unwrap_or((28, 0));
        for from in (4..32).step_by((mark + space) as usize) {
            let to = (from + mark as i32).min(32);
            let mark = PathElement::new(vec![at(from, y), at(to, y)], entry.style);
            area.draw(&mark).map_err(PlotError::new)?;
        }
        let text = Text::new(entry.label.clone(), at(40, y - 9), font(16).color(&INK));
        area.draw(&text).map_err(PlotError::new)?;
    }
    Ok(())
}
