//! Every node inside its funnel: small multiples.
//!
//! Each node gets its diffusive term against its funnel, and the ratio of the two below, which shows how
//! near the boundary the node is however narrow the funnel has become. A funnel that stays within a factor
//! of [`LINEAR`] is drawn as a band `+-psi`; one that shrinks further is drawn as `psi` and `|nu|` on a
//! logarithmic axis, where the band would be a line along 0.

use std::ops::Range;

use plotters::chart::MeshStyle;
use plotters::coord::Shift;
use plotters::coord::ranged1d::Ranged;
use plotters::prelude::*;

use super::style::{BOUNDARY, FAINT, INK, INSIDE, NODES, at, colour, font, line, px, shrink};
use super::thin::thin;
use super::trace::{Node, Trace};
use super::{PlotError, axis};

/// Widest to narrowest funnel up to which a linear axis shows both.
const LINEAR: f64 = 30.0;
/// A cell of the sheet, in pixels.
const CELL: (u32, u32) = (440, 340);
/// Height of the heading, in pixels.
const HEAD: u32 = 62;
/// Height of the ratio panel, in pixels.
const RATIO: u32 = 130;

/// `nu_i` inside its funnel for each node, as SVG text; of more than twelve nodes the twelve that came
/// nearest to the boundary.
///
/// # Errors
/// [`PlotError`] if the trace has rows at fewer than two times.
pub fn funnels_svg(trace: &Trace) -> Result<String, PlotError> {
    let (first, last) = trace.span()?;
    let shown = shown(&trace.nodes);
    let columns = shown.len().clamp(1, 3);
    let rows = shown.len().div_ceil(columns);
    let size = (CELL.0 * columns as u32, HEAD + CELL.1 * rows as u32);
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (px(size.0), px(size.1))).into_drawing_area();
        root.fill(&WHITE).map_err(PlotError::new)?;
        let (head, body) = root.split_vertically(px(HEAD));
        heading(&head, trace, shown.len())?;
        for (k, (cell, node)) in body.split_evenly((rows, columns)).iter().zip(&shown).enumerate() {
            let sheet = Sheet { t: &trace.t, node, span: first..last, colour: colour(k) };
            let (above, below) = cell.split_vertically(px(CELL.1 - RATIO));
            sheet.against_funnel(&above)?;
            sheet.ratio(&below)?;
        }
        root.present().map_err(PlotError::new)?;
    }
    Ok(shrink(&svg, size))
}

/// The nodes to show, by id.
fn shown(nodes: &[Node]) -> Vec<&Node> {
    let mut shown: Vec<&Node> = nodes.iter().collect();
    shown.sort_by(|a, b| b.worst.total_cmp(&a.worst));
    shown.truncate(NODES);
    shown.sort_by_key(|n| (n.id, n.component));
    shown
}

fn heading<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    trace: &Trace,
    shown: usize,
) -> Result<(), PlotError> {
    let all = trace.nodes.len();
    let kind = if trace.components() == 1 { "nodes" } else { "components of nodes" };
    let which = match all - shown {
        0 => String::new(),
        _ => format!("the {shown} of {all} {kind} nearest to the boundary; "),
    };
    let what = format!(
        "{which}coloured: diffusive term \u{3BD}, shaded: inside the funnel \u{3C8}, grey: its boundary"
    );
    let title = Text::new(trace.title.clone(), at(16, 12), font(20).color(&INK));
    area.draw(&title).map_err(PlotError::new)?;
    area.draw(&Text::new(what, at(16, 38), font(15).color(&INK))).map_err(PlotError::new)
}

/// One node's cell.
struct Sheet<'a> {
    t: &'a [f64],
    node: &'a Node,
    span: Range<f64>,
    colour: RGBColor,
}

impl Sheet<'_> {
    fn against_funnel<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>) -> Result<(), PlotError> {
        let positive = self.node.psi.iter().copied().filter(|p| p.is_finite() && *p > 0.0);
        let (low, high) = positive.fold((f64::INFINITY, 0.0f64), |(l, h), p| (l.min(p), h.max(p)));
        let caption = format!("{}   largest |\u{3BD}|/\u{3C8} = {:.3}", self.node.label, self.node.worst);
        let caption = Text::new(caption, at(76, 14), font(16).color(&INK));
        area.draw(&caption).map_err(PlotError::new)?;
        if high / low <= LINEAR { self.band(area) } else { self.decades(area, low, high) }
    }

    fn band<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>) -> Result<(), PlotError> {
        let values = self.node.psi.iter().flat_map(|&p| [p, -p]).chain(self.node.nu.iter().copied());
        let mut chart = builder(area, 0)
            .build_cartesian_2d(self.span.clone(), axis::padded(values))
            .map_err(PlotError::new)?;
        let upper = thin(self.t, |k| self.node.psi[k]);
        let lower = thin(self.t, |k| -self.node.psi[k]);
        chart.draw_series([band(&upper, &lower)]).map_err(PlotError::new)?;
        mesh(&mut chart.configure_mesh(), "\u{3BD} in state units", 7)
            .x_label_formatter(&|_| String::new())
            .y_label_formatter(&axis::label)
            .draw()
            .map_err(PlotError::new)?;
        let nu = thin(self.t, |k| self.node.nu[k]);
        for (points, style) in [(upper, edge()), (lower, edge()), (nu, line(self.colour, 2))] {
            chart.draw_series(LineSeries::new(points, style)).map_err(PlotError::new)?;
        }
        Ok(())
    }

    fn decades<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        low: f64,
        high: f64,
    ) -> Result<(), PlotError> {
        // |nu| passes through 0; two decades below the funnel are enough to see how small it is.
        let (bottom, top) = (low / 100.0, high * 2.0);
        let mut chart = builder(area, 0)
            .build_cartesian_2d(self.span.clone(), (bottom..top).log_scale())
            .map_err(PlotError::new)?;
        let psi = thin(self.t, |k| self.node.psi[k].max(bottom));
        let floor: Vec<(f64, f64)> = psi.iter().map(|p| (p.0, bottom)).collect();
        chart.draw_series([band(&psi, &floor)]).map_err(PlotError::new)?;
        mesh(&mut chart.configure_mesh(), "|\u{3BD}| in state units", 6)
            .x_label_formatter(&|_| String::new())
            .y_label_formatter(&axis::decade)
            .draw()
            .map_err(PlotError::new)?;
        let nu = thin(self.t, |k| self.node.nu[k].abs().max(bottom));
        for (points, style) in [(psi, edge()), (nu, line(self.colour, 2))] {
            chart.draw_series(LineSeries::new(points, style)).map_err(PlotError::new)?;
        }
        Ok(())
    }

    fn ratio<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>) -> Result<(), PlotError> {
        // A ratio that is not a number is in the caption; what is known is drawn.
        let worst = if self.node.worst.is_nan() { 1.0 } else { self.node.worst };
        let reach = worst.clamp(1.0, 1e6) * 1.1;
        let mut chart =
            builder(area, 40).build_cartesian_2d(self.span.clone(), -reach..reach).map_err(PlotError::new)?;
        let flat = |y: f64| vec![(self.span.start, y), (self.span.end, y)];
        chart.draw_series([band(&flat(1.0), &flat(-1.0))]).map_err(PlotError::new)?;
        mesh(&mut chart.configure_mesh(), "\u{3BD}/\u{3C8}", 3)
            .x_desc("time t in s")
            .x_label_formatter(&axis::label)
            .y_label_formatter(&axis::label)
            .draw()
            .map_err(PlotError::new)?;
        let ratio = thin(self.t, |k| self.node.nu[k] / self.node.psi[k]);
        for (points, style) in [(flat(1.0), edge()), (flat(-1.0), edge()), (ratio, line(self.colour, 2))] {
            chart.draw_series(LineSeries::new(points, style)).map_err(PlotError::new)?;
        }
        Ok(())
    }
}

fn edge() -> ShapeStyle {
    line(BOUNDARY, 1)
}

fn band(upper: &[(f64, f64)], lower: &[(f64, f64)]) -> Polygon<(f64, f64)> {
    let outline: Vec<(f64, f64)> = upper.iter().chain(lower.iter().rev()).copied().collect();
    Polygon::new(outline, INSIDE.filled())
}

fn builder<'a, 'b, DB: DrawingBackend>(
    area: &'a DrawingArea<DB, Shift>,
    x_labels: u32,
) -> ChartBuilder<'a, 'b, DB> {
    let mut builder = ChartBuilder::on(area);
    builder.margin_top(px(if x_labels == 0 { 38 } else { 6 })).margin_right(px(14)).margin_left(px(8));
    builder.y_label_area_size(px(66)).x_label_area_size(px(x_labels));
    builder
}

fn mesh<'m, 'a, 'b, X, Y, DB>(
    style: &'m mut MeshStyle<'a, 'b, X, Y, DB>,
    what: &str,
    y_labels: usize,
) -> &'m mut MeshStyle<'a, 'b, X, Y, DB>
where
    X: Ranged,
    Y: Ranged,
    DB: DrawingBackend,
{
    style
        .light_line_style(TRANSPARENT)
        .bold_line_style(line(FAINT, 1))
        .axis_style(line(INK, 1))
        .set_all_tick_mark_size(px(4))
        .label_style(font(13).color(&INK))
        .axis_desc_style(font(14).color(&INK))
        .y_desc(what)
        .x_labels(6)
        .y_labels(y_labels)
}
