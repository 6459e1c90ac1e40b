//! All states over time, and the emergent trajectory.

use plotters::coord::Shift;
use plotters::prelude::*;

use super::legend::{self, Entry};
use super::style::{CROWD, FAINT, INK, NODES, at, colour, font, line, px, shrink};
use super::thin::thin;
use super::trace::Trace;
use super::{PlotError, axis};

const SIZE: (u32, u32) = (1000, 520);
/// Width of the legend, in pixels.
const LEGEND: u32 = 130;

/// The states `x_i` with the emergent trajectory `xi` dashed in black on top, as SVG text. Up to twelve
/// curves get a colour each; of more, each component of a vector does, and scalar states are drawn alike.
///
/// # Errors
/// [`PlotError`] if the trace has rows at fewer than two times.
pub fn states_svg(trace: &Trace) -> Result<String, PlotError> {
    let (first, last) = trace.span()?;
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (px(SIZE.0), px(SIZE.1))).into_drawing_area();
        root.fill(&WHITE).map_err(PlotError::new)?;
        let (left, right) = root.split_horizontally(px(SIZE.0 - LEGEND));
        let title = Text::new(trace.title.clone(), at(76, 14), font(20).color(&INK));
        left.draw(&title).map_err(PlotError::new)?;
        curves(&left, trace, first..last)?;
        legend::draw(&right.margin(px(42), 0, 0, 0), &entries(trace))?;
        root.present().map_err(PlotError::new)?;
    }
    Ok(shrink(&svg, SIZE))
}

fn curves<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    trace: &Trace,
    span: std::ops::Range<f64>,
) -> Result<(), PlotError> {
    let values = trace.nodes.iter().flat_map(|n| n.x.iter()).chain(trace.xi.iter().flatten()).copied();
    let mut chart = ChartBuilder::on(area)
        .margin_left(px(6))
        .margin_top(px(44))
        .margin_right(px(16))
        .margin_bottom(px(8))
        .x_label_area_size(px(46))
        .y_label_area_size(px(70))
        .build_cartesian_2d(span, axis::padded(values))
        .map_err(PlotError::new)?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(line(FAINT, 1))
        .axis_style(line(INK, 1))
        .set_all_tick_mark_size(px(5))
        .label_style(font(15).color(&INK))
        .axis_desc_style(font(17).color(&INK))
        .x_desc("time t in s")
        .y_desc("state x in state units")
        .x_label_formatter(&axis::label)
        .y_label_formatter(&axis::label)
        .draw()
        .map_err(PlotError::new)?;
    for (k, node) in trace.nodes.iter().enumerate() {
        let style = match Colours::of(trace) {
            Colours::Curve => line(colour(k), 2),
            Colours::Component => line(colour(node.component), 1),
            Colours::One => line(CROWD, 1),
        };
        let points = thin(&trace.t, |k| node.x[k]);
        chart.draw_series(LineSeries::new(points, style)).map_err(PlotError::new)?;
    }
    for xi in &trace.xi {
        let points = thin(&trace.t, |k| xi[k]);
        let dashes = DashedLineSeries::new(points, px(7), px(4), line(BLACK, 2));
        chart.draw_series(dashes).map_err(PlotError::new)?;
    }
    Ok(())
}

/// What has a colour of its own.
enum Colours {
    /// Every component of every node: few enough.
    Curve,
    /// Every component, for all nodes.
    Component,
    /// Nothing.
    One,
}

impl Colours {
    fn of(trace: &Trace) -> Self {
        match (trace.nodes.len() <= NODES, trace.components()) {
            (true, _) => Self::Curve,
            (false, 1) => Self::One,
            (false, _) => Self::Component,
        }
    }
}

fn entries(trace: &Trace) -> Vec<Entry> {
    let components = trace.components();
    let count = trace.nodes.len() / components;
    let entry = |label: String, style| Entry { label, style, dashed: false };
    let mut entries: Vec<Entry> = match Colours::of(trace) {
        Colours::Curve => {
            trace.nodes.iter().enumerate().map(|(k, n)| entry(n.label.clone(), line(colour(k), 2))).collect()
        }
        Colours::Component => {
            (0..components).map(|c| entry(format!("x{c} of {count}"), line(colour(c), 1))).collect()
        }
        Colours::One => vec![entry(format!("{count} nodes"), line(CROWD, 1))],
    };
    if trace.has_xi() {
        entries.push(Entry { label: "emergent \u{3BE}".into(), style: line(BLACK, 2), dashed: true });
    }
    entries
}
