//! Every node inside its funnel: small multiples, with a legend above them.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::legend::{self, Entry, Stroke};
use super::panel::{CELL, Features, Panel};
use super::style::{BREACH, INK, at, colour, font, line, px, shrink};
use super::trace::{Drawn, Trace, Wanted};
use super::{PlotError, marks, text};

/// Space at the left and right of the heading, in pixels.
const MARGIN: u32 = 16;
/// Height of the title, in pixels.
const TITLE: u32 = 36;
/// Height of the line that says which nodes are shown, in pixels.
const WHICH: u32 = 22;

/// The true diffusive term of each node inside the scenario's funnel, and what the node believes of both
/// where that differs, as SVG text; of more than twelve nodes the twelve that came nearest to the boundary.
///
/// # Errors
/// [`PlotError`] if the trace has rows at fewer than two times.
pub fn funnels_svg(trace: &Trace) -> Result<String, PlotError> {
    let (recorded, trace) = (trace, &trace.drawn(Wanted::Funnels)?);
    // One after the other, and again as they are drawn: all at once would take as much memory as all else.
    let nodes = || recorded.urgent().into_iter().filter_map(|index| recorded.node(index)).enumerate();
    let features: Vec<Features> =
        nodes().map(|(k, node)| Panel::new(trace, &node, colour(k)).features()).collect();
    let columns = features.len().clamp(1, 3);
    let rows = features.len().div_ceil(columns);
    let width = CELL.0 * columns as u32;
    let heading = Heading::new(trace, &features, width);
    let size = (width, heading.height() + CELL.1 * rows as u32);
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (px(size.0), px(size.1))).into_drawing_area();
        root.fill(&WHITE).map_err(PlotError::new)?;
        let (head, body) = root.split_vertically(px(heading.height()));
        heading.draw(&head)?;
        for (cell, (k, node)) in body.split_evenly((rows, columns)).iter().zip(nodes()) {
            Panel::new(trace, &node, colour(k)).draw(cell)?;
        }
        root.present().map_err(PlotError::new)?;
    }
    Ok(shrink(svg, size))
}

/// What stands above the panels.
struct Heading {
    title: String,
    which: Option<String>,
    entries: Vec<Entry>,
    places: Vec<(i32, i32)>,
    lines: u32,
}

impl Heading {
    fn new(trace: &Drawn, panels: &[Features], width: u32) -> Self {
        let room = width - 2 * MARGIN;
        let (all, shown) = (trace.nodes.len(), panels.len());
        let kind = if trace.components() == 1 { "nodes" } else { "components of nodes" };
        let which = (all > shown).then(|| format!("the {shown} of {all} {kind} nearest to the boundary"));
        let entries = entries(trace, panels);
        let (places, lines) = legend::rows(&entries, room);
        Self { title: text::fit(&trace.title, 20, room), which, entries, places, lines }
    }

    fn height(&self) -> u32 {
        TITLE + if self.which.is_some() { WHICH } else { 0 } + legend::height(self.lines) + 4
    }

    fn draw<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>) -> Result<(), PlotError> {
        let left = MARGIN as i32;
        let write = |text: &str, y, size| {
            area.draw(&Text::new(text.to_owned(), at(left, y), font(size).color(&INK)))
                .map_err(PlotError::new)
        };
        write(&self.title, 12, 20)?;
        let mut y = TITLE as i32;
        if let Some(which) = &self.which {
            write(which, y, 15)?;
            y += WHICH as i32;
        }
        legend::row(area, (left, y + 9), &self.entries, &self.places)
    }
}

/// The legend: what is in at least one of the panels.
fn entries(trace: &Drawn, panels: &[Features]) -> Vec<Entry> {
    let entry = |label: &str, style, stroke| Entry { label: label.to_owned(), style, stroke };
    let mut entries = vec![
        entry("\u{3BD}, true", line(colour(0), 2), Stroke::Solid),
        entry("inside \u{3C8} of the scenario", line(INK, 1), Stroke::Band),
    ];
    if panels.iter().any(|panel| panel.has_breach) {
        entries.push(entry("outside", line(BREACH, 3), Stroke::Solid));
    }
    if panels.iter().any(|panel| panel.has_own_nu) {
        entries.push(entry("\u{3BD} as the node believes", line(INK, 1), Stroke::Solid));
    }
    if panels.iter().any(|panel| panel.has_own_psi) {
        entries.push(entry("\u{3C8} as the node has it", line(INK, 1), Stroke::Dashed));
    }
    let marks = trace.marks.iter().filter(|mark| panels.iter().any(|panel| panel.id == mark.id));
    entries.extend(marks::entries(marks));
    entries
}
