//! How far apart the nodes are, beside the bound that the funnels give, and how far from the emergent
//! trajectory: on a logarithmic axis, where a narrow funnel can be seen.

use funnelnet_law::math;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::VPos;
use std::ops::Range;

use super::clip::{self, clip};
use super::curve::Curve;
use super::legend::{self, Entry, Stroke};
use super::style::{BOUNDARY, FAINT, INK, at, colour, font, line, px, shrink};
use super::thin::thin;
use super::trace::{Drawn, Trace, Wanted};
use super::{PlotError, axis, marks, text};

const SIZE: (u32, u32) = (1000, 460);
/// Width of the legend, in pixels.
const LEGEND: u32 = 150;
/// Decades below the largest value that the axis shows at most: f32 has seven digits.
const DEEPEST: f64 = 1e-9;
/// A bound that begins so many times as wide as all that is measured is cut.
const FAR: f64 = 1e3;
/// The height that a line of text takes, in pixels.
const LINE: u32 = 20;
/// Marks that are named; of more, only the lines.
const NAMED: usize = 8;

/// The spread of the states with its bound, and the distance of the farthest node to the emergent trajectory,
/// over time, as SVG text.
///
/// # Errors
/// [`PlotError`] if the trace has rows at fewer than two times.
pub fn agreement_svg(trace: &Trace) -> Result<String, PlotError> {
    let trace = &trace.drawn(Wanted::Together)?;
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (px(SIZE.0), px(SIZE.1))).into_drawing_area();
        root.fill(&WHITE).map_err(PlotError::new)?;
        let title = text::fit(&trace.title, 20, SIZE.0 - 92);
        root.draw(&Text::new(title, at(76, 12), font(20).color(&INK))).map_err(PlotError::new)?;
        let axis = Axis::of(trace);
        let caption = Text::new(caption(trace, &axis), at(76, 38), font(14).color(&INK));
        root.draw(&caption).map_err(PlotError::new)?;
        let (left, right) = root.split_horizontally(px(SIZE.0 - LEGEND));
        picture(&left, trace, &axis)?;
        legend::column(&right.margin(px(62), 0, 0, 0), &entries(trace))?;
        root.present().map_err(PlotError::new)?;
    }
    Ok(shrink(svg, SIZE))
}

/// The vertical axis.
struct Axis {
    heights: Range<f64>,
    /// Some value is 0, or so small that it lies on the lower edge.
    has_less: bool,
}

impl Axis {
    /// All that is measured, and of the bound what is not too far above it.
    fn of(trace: &Drawn) -> Self {
        let measured = || trace.spread.iter().chain(&trace.error).map(|p| p.1);
        let bound = || trace.bound.iter().map(|p| p.1);
        let positive = |v: &f64| v.is_finite() && *v > 0.0;
        let most = measured().filter(positive).fold(0.0, f64::max);
        let room = if most > 0.0 { FAR * most } else { f64::INFINITY };
        let top = bound().filter(positive).filter(|&v| v <= room).fold(most, f64::max);
        let top = if top > 0.0 { top } else { 1.0 };
        let low = measured().chain(bound()).filter(positive).fold(top, f64::min);
        let bottom = 0.5 * low.max(top * DEEPEST);
        let has_less = measured().chain(bound()).any(|v| v < bottom);
        Self { heights: bottom..2.0 * top, has_less }
    }

    /// What is below the axis lies on its edge; what is not known stays so.
    fn raised(&self, points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let bottom = self.heights.start;
        points.iter().map(|&(t, y)| (t, if y < bottom { bottom } else { y })).collect()
    }
}

/// What the picture cannot show, in words.
fn caption(trace: &Drawn, axis: &Axis) -> String {
    let mut words = Vec::new();
    if let Some((largest, last)) = trace.of_all_ticks {
        let value = |value: f64| if value.is_nan() { "not known".to_owned() } else { axis::label(&value) };
        words.push(format!("largest spread of all ticks {}, at the end {}", value(largest), value(last)));
    }
    if trace.bound.first().is_some_and(|p| p.1.is_infinite()) {
        words.push("the bound begins infinite".to_owned());
    }
    if axis.has_less {
        words.push("0 and what is below the axis lies on its lower edge".to_owned());
    }
    words.join("; ")
}

fn picture<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    trace: &Drawn,
    axis: &Axis,
) -> Result<(), PlotError> {
    let Axis { heights, .. } = axis;
    let mut chart = ChartBuilder::on(area)
        .margin_left(px(6))
        .margin_top(px(64))
        .margin_right(px(16))
        .margin_bottom(px(8))
        .x_label_area_size(px(46))
        .y_label_area_size(px(70))
        .build_cartesian_2d(trace.span.clone(), heights.clone().log_scale())
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
        .y_desc(trace.axis("distance"))
        .x_label_formatter(&axis::label)
        .y_label_formatter(&axis::decade)
        .draw()
        .map_err(PlotError::new)?;
    for (n, mark) in trace.marks.iter().enumerate() {
        mark.draw(&mut chart, (&trace.span, heights), INK)?;
        if n < NAMED {
            // One below the other: marks at the same time would cover each other.
            let share = 1.0 - f64::from(LINE * (n as u32 + 1)) / f64::from(SIZE.1);
            let y = heights.start * math::pow(heights.end / heights.start, share);
            marks::label(&mut chart, &trace.span, (mark.from, y), VPos::Top, mark.label())?;
        }
    }
    trace.losses.draw(&mut chart, heights.start)?;
    for (points, style, stroke) in curves(trace) {
        let pieces = clip(thin(&axis.raised(points)), heights);
        Curve { pieces, style, stroke }.draw(&mut chart)?;
    }
    let right = (SIZE.0 - LEGEND) as i32 - 16;
    let measured = trace.spread.iter().chain(&trace.error).map(|p| p.1.max(heights.start));
    // A bound that begins infinite is no value that has been cut.
    let bound = trace.bound.iter().map(|p| p.1).filter(|v| v.is_finite()).map(|v| v.max(heights.start));
    clip::say(area, (right, 64), clip::words(measured.chain(bound), heights))
}

/// Points, style and stroke of each curve.
type Drawing<'a> = (&'a Vec<(f64, f64)>, ShapeStyle, Stroke);

fn curves(trace: &Drawn) -> [Drawing<'_>; 3] {
    [
        (&trace.bound, line(BOUNDARY, 2), Stroke::Solid),
        (&trace.spread, line(colour(0), 2), Stroke::Solid),
        (&trace.error, line(BLACK, 2), Stroke::Dotted),
    ]
}

/// Of what is known anywhere.
fn entries(trace: &Drawn) -> Vec<Entry> {
    let names = ["bound", "spread", "to \u{3BE}"];
    let known = |points: &[(f64, f64)]| points.iter().any(|p| !p.1.is_nan());
    let entry = |((points, style, stroke), name): (Drawing<'_>, &str)| {
        known(points).then(|| Entry { label: name.to_owned(), style, stroke })
    };
    let curves = curves(trace).into_iter().zip(names).filter_map(entry);
    curves.chain(marks::entries(trace.marks.iter())).chain(trace.losses.entry()).collect()
}
