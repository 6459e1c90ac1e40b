//! A legend beside the plot or above it, where it can cover nothing.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::PlotError;
use super::style::{BOUNDARY, INK, INSIDE, at, font, line, px};
use super::text;

/// A line of the legend.
pub(super) struct Entry {
    pub(super) label: String,
    pub(super) style: ShapeStyle,
    pub(super) stroke: Stroke,
}

/// What stands before a label.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Stroke {
    Solid,
    Dashed,
    Dotted,
    /// The inside of a funnel between its boundaries.
    Band,
    /// An area without boundaries, of the colour of the style.
    Area,
    /// The end of a curve.
    Cross,
    /// A time without curves.
    Shade,
    /// Marks along the lower edge.
    Rug,
}

impl Stroke {
    /// Length of a mark and of the space after it, in pixels; `None` for a whole line.
    pub(super) fn pattern(self) -> Option<(u32, u32)> {
        match self {
            Self::Dashed => Some((7, 4)),
            Self::Dotted => Some((2, 3)),
            Self::Solid | Self::Band | Self::Area | Self::Cross | Self::Shade | Self::Rug => None,
        }
    }
}

/// Distance between the lines, in pixels.
const LINE: i32 = 22;
/// Where a label begins, in pixels after its sample.
const LABEL: i32 = 40;
/// Size of the font of a legend above a plot.
const ROW: u32 = 15;

/// Draws `entries` from the top of `area`.
pub(super) fn column<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    entries: &[Entry],
) -> Result<(), PlotError> {
    entries.iter().enumerate().try_for_each(|(k, entry)| entry.draw(area, (0, 12 + LINE * k as i32), 16))
}

/// Where each of `entries` goes in lines of `width` pixels, in pixels, and how many lines that takes.
pub(super) fn rows(entries: &[Entry], width: u32) -> (Vec<(i32, i32)>, u32) {
    let (mut x, mut y) = (0, 0);
    let place = |entry: &Entry| {
        let wide = LABEL + text::width(&entry.label, ROW) as i32 + 16;
        if x > 0 && x + wide > width as i32 {
            (x, y) = (0, y + LINE);
        }
        x += wide;
        (x - wide, y)
    };
    let places = entries.iter().map(place).collect();
    (places, (y / LINE) as u32 + 1)
}

/// Draws `entries` at `places` as [`rows`] gives them, from `from` on.
pub(super) fn row<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    from: (i32, i32),
    entries: &[Entry],
    places: &[(i32, i32)],
) -> Result<(), PlotError> {
    let mut all = entries.iter().zip(places);
    all.try_for_each(|(entry, (x, y))| entry.draw(area, (from.0 + x, from.1 + y), ROW))
}

/// The height of so many lines, in pixels.
pub(super) fn height(lines: u32) -> u32 {
    lines * LINE as u32
}

impl Entry {
    fn draw<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        (x, y): (i32, i32),
        size: u32,
    ) -> Result<(), PlotError> {
        self.sample(area, (x, y))?;
        let text = Text::new(self.label.clone(), at(x + LABEL, y - 9), font(size).color(&INK));
        area.draw(&text).map_err(PlotError::new)
    }

    fn sample<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        (x, y): (i32, i32),
    ) -> Result<(), PlotError> {
        let corners = [at(x + 4, y - 7), at(x + 32, y + 7)];
        let path =
            |from, to, style| area.draw(&PathElement::new(vec![from, to], style)).map_err(PlotError::new);
        match self.stroke {
            Stroke::Cross => {
                path(at(x + 18, y - 8), at(x + 18, y + 8), self.style)?;
                area.draw(&Cross::new(at(x + 18, y), px(5), line(INK, 2))).map_err(PlotError::new)
            }
            Stroke::Rug => [6, 10, 18, 20, 29]
                .into_iter()
                .try_for_each(|along| path(at(x + along, y - 2), at(x + along, y + 7), self.style)),
            Stroke::Shade => {
                area.draw(&Rectangle::new(corners, INK.mix(0.12).filled())).map_err(PlotError::new)?;
                path(at(x + 4, y - 7), at(x + 4, y + 7), self.style)
            }
            Stroke::Band => {
                area.draw(&Rectangle::new(corners, INSIDE.filled())).map_err(PlotError::new)?;
                path(at(x + 4, y - 7), at(x + 32, y - 7), line(BOUNDARY, 1))?;
                path(at(x + 4, y + 7), at(x + 32, y + 7), line(BOUNDARY, 1))
            }
            Stroke::Area => {
                let area_of = Rectangle::new(corners, self.style.color.filled());
                area.draw(&area_of).map_err(PlotError::new)
            }
            Stroke::Solid | Stroke::Dashed | Stroke::Dotted => {
                let (mark, space) = self.stroke.pattern().unwrap_or((28, 0));
                let dashes = (4..32).step_by((mark + space) as usize);
                dashes
                    .map(|from| (from, (from + mark as i32).min(32)))
                    .try_for_each(|(from, to)| path(at(x + from, y), at(x + to, y), self.style))
            }
        }
    }
}
