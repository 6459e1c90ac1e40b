//! All states over time, the emergent trajectory and the blended dynamics.

use plotters::coord::{CoordTranslate, Shift};
use plotters::prelude::*;
use plotters::style::text_anchor::VPos;
use std::ops::Range;

use super::clip::{self, clip};
use super::curve::Curve;
use super::legend::{self, Entry, Stroke};
use super::style::{CROWD, FAINT, INK, NODES, at, colour, font, line, px, shrink};
use super::thin::thin;
use super::trace::{Drawn, Node, Trace};
use super::{PlotError, axis, marks, text};

const SIZE: (u32, u32) = (1000, 520);
/// Width of the legend, in pixels.
const LEGEND: u32 = 130;
/// The part of the height that a line of text takes.
const LINE: f64 = 0.04;
/// Stops and absences that are named in the picture; of more, how many.
const NAMED: usize = 8;

/// The states `x_i` with the emergent trajectory `xi` dotted and the blended dynamics dashed in black on top, as in the paper's
/// figure, as SVG text. Up to twelve curves get a colour each; of more, each component of a vector does, and scalar states are
/// drawn alike. A curve ends where its node stops or is away. What of the blended dynamics is far from all states is left out.
///
/// # Errors
/// [`PlotError`] if the trace has rows at fewer than two times.
pub fn states_svg(trace: &Trace) -> Result<String, PlotError> {
    let trace = &trace.drawn()?;
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (px(SIZE.0), px(SIZE.1))).into_drawing_area();
        root.fill(&WHITE).map_err(PlotError::new)?;
        let title = text::fit(&trace.title, 20, SIZE.0 - 92);
        root.draw(&Text::new(title, at(76, 14), font(20).color(&INK))).map_err(PlotError::new)?;
        let (left, right) = root.split_horizontally(px(SIZE.0 - LEGEND));
        picture(&left, trace)?;
        legend::column(&right.margin(px(42), 0, 0, 0), &entries(trace))?;
        root.present().map_err(PlotError::new)?;
    }
    Ok(shrink(&svg, SIZE))
}

fn picture<DB: DrawingBackend>(area: &DrawingArea<DB, Shift>, trace: &Drawn) -> Result<(), PlotError> {
    let span = &trace.span;
    let curves: Vec<Vec<(f64, f64)>> = trace.nodes.iter().map(|node| trace.states(node)).collect();
    let heights = heights(trace, &curves);
    let mut chart = ChartBuilder::on(area)
        .margin_left(px(6))
        .margin_top(px(44))
        .margin_right(px(16))
        .margin_bottom(px(8))
        .x_label_area_size(px(46))
        .y_label_area_size(px(70))
        .build_cartesian_2d(span.clone(), heights.clone())
        .map_err(PlotError::new)?;
    let state = if trace.has_unit() { trace.axis("state") } else { trace.axis("state x") };
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(line(FAINT, 1))
        .axis_style(line(INK, 1))
        .set_all_tick_mark_size(px(5))
        .label_style(font(15).color(&INK))
        .axis_desc_style(font(17).color(&INK))
        .x_desc("time t in s")
        .y_desc(state)
        .x_label_formatter(&axis::label)
        .y_label_formatter(&axis::label)
        .draw()
        .map_err(PlotError::new)?;
    mark(&mut chart, trace, span, &heights)?;
    for (k, (node, points)) in trace.nodes.iter().zip(&curves).enumerate() {
        let style = line(ink(trace, k, node), if trace.nodes.len() <= NODES { 2 } else { 1 });
        Curve::solid(clip(thin(points), &heights), style).draw(&mut chart)?;
    }
    for (k, node) in trace.nodes.iter().enumerate() {
        if let Some((t, x)) = trace.stop(node) {
            let at = (t.clamp(span.start, span.end), x.clamp(heights.start, heights.end));
            marks::cross(&mut chart, at, ink(trace, k, node))?;
        }
    }
    for (_, components, stroke) in predictions(trace) {
        for values in components {
            let pieces = clip(thin(values), &heights);
            Curve { pieces, style: line(BLACK, 2), stroke }.draw(&mut chart)?;
        }
    }
    let right = (SIZE.0 - LEGEND) as i32 - 16;
    clip::say(area, (right, 44), clip::words(curves.iter().flatten().map(|p| p.1), &heights))
}

/// Draws and names stops and absences, in the order in which they began.
fn mark<DB, CT>(
    chart: &mut ChartContext<'_, DB, CT>,
    trace: &Drawn,
    span: &Range<f64>,
    heights: &Range<f64>,
) -> Result<(), PlotError>
where
    DB: DrawingBackend,
    CT: CoordTranslate<From = (f64, f64)>,
{
    let mut all: Vec<&marks::Mark> = trace.marks.iter().collect();
    all.sort_by(|a, b| a.from.total_cmp(&b.from));
    let more = all.len().saturating_sub(NAMED);
    for (n, mark) in all.iter().enumerate() {
        let first = trace.nodes.iter().enumerate().find(|(_, node)| node.id == mark.id);
        let colour = first.map_or(INK, |(k, node)| ink(trace, k, node));
        mark.draw(chart, (span, heights), colour)?;
        // Below the line that says what is cut.
        let y = heights.end - (heights.end - heights.start) * LINE * (n as f64 + 1.0);
        let words = match n {
            n if n < NAMED => format!("node {} {}", mark.id, mark.kind.word()),
            n if n == NAMED => format!("and {more} more"),
            _ => continue,
        };
        marks::label(chart, span, (mark.from, y), VPos::Top, words)?;
    }
    Ok(())
}

/// The colour of the curves of `node`, the `k`-th.
fn ink(trace: &Drawn, k: usize, node: &Node) -> RGBColor {
    match Colours::of(trace) {
        Colours::Curve => colour(k),
        Colours::Component => colour(node.component),
        Colours::One => CROWD,
    }
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
    fn of(trace: &Drawn) -> Self {
        match (trace.nodes.len() <= NODES, trace.components()) {
            (true, _) => Self::Curve,
            (false, 1) => Self::One,
            (false, _) => Self::Component,
        }
    }
}

/// The range of the vertical axis: all of the states and of `xi`, and of the blended dynamics what is not farther from those than
/// a quarter of their own range. An average that outliers drag far away would leave no room for the states, and neither would a node
/// that diverges: the scale is that of the initial states, of `xi` and of the funnels.
fn heights(trace: &Drawn, curves: &[Vec<(f64, f64)>]) -> Range<f64> {
    let xi = || trace.xi.iter().flatten().map(|p| p.1);
    let mut values: Vec<f64> = curves.iter().flatten().map(|p| p.1).chain(xi()).collect();
    let start = curves.iter().filter_map(|curve| curve.iter().map(|p| p.1).find(|x| x.is_finite()));
    let mut natural: Vec<f64> = start.chain(xi().filter(|xi| xi.is_finite())).collect();
    let low = natural.iter().copied().fold(f64::INFINITY, f64::min);
    let widths = trace.nodes.iter().filter_map(|node| node.psi.last()).filter(|psi| psi.is_finite());
    let width = widths.fold(0.0, |most: f64, &psi| most.max(psi));
    natural.extend([low - width, low + width].into_iter().filter(|v| v.is_finite()));
    let inner = axis::robust(&values, natural.into_iter());
    let room = 0.25 * (inner.end - inner.start);
    let near = inner.start - room..inner.end + room;
    values.retain(|value| inner.contains(value));
    values.extend(trace.blended.iter().flatten().map(|p| p.1).filter(|value| near.contains(value)));
    // Where values are cut, up to the cut.
    let whole = axis::padded(values.into_iter());
    whole.start.min(inner.start)..whole.end.max(inner.end)
}

/// What is predicted, where it is known anywhere: its name, its values over time by component, and how it is drawn.
fn predictions(trace: &Drawn) -> impl Iterator<Item = (&'static str, &Vec<Vec<(f64, f64)>>, Stroke)> {
    let all = [("blended", &trace.blended, Stroke::Dashed), ("emergent \u{3BE}", &trace.xi, Stroke::Dotted)];
    all.into_iter().filter(|(_, values, _)| values.iter().flatten().any(|p| p.1.is_finite()))
}

fn entries(trace: &Drawn) -> Vec<Entry> {
    let components = trace.components();
    let count = trace.nodes.len() / components;
    let entry = |label: String, style| Entry { label, style, stroke: Stroke::Solid };
    let mut entries: Vec<Entry> = match Colours::of(trace) {
        Colours::Curve => {
            trace.nodes.iter().enumerate().map(|(k, n)| entry(n.label.clone(), line(colour(k), 2))).collect()
        }
        Colours::Component => {
            (0..components).map(|c| entry(format!("x{c} of {count}"), line(colour(c), 1))).collect()
        }
        Colours::One => vec![entry(format!("{count} nodes"), line(CROWD, 1))],
    };
    let black =
        |(name, _, stroke): (&str, _, _)| Entry { label: name.to_owned(), style: line(BLACK, 2), stroke };
    entries.extend(predictions(trace).map(black));
    entries.extend(marks::entries(trace.marks.iter()));
    entries
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Row;

    /// Of a trace with states from -1 to 1 and blended dynamics from 0 to `end`.
    fn heights_with(end: f64) -> Range<f64> {
        let mut trace = Trace::new("");
        for (t, blended) in [(0.0, 0.0), (1.0, end)] {
            trace.push(&Row { t, x: vec![-1.0, 1.0], blended: vec![blended], ..Row::default() });
        }
        let trace = trace.drawn().unwrap();
        let curves: Vec<_> = trace.nodes.iter().map(|node| trace.states(node)).collect();
        heights(&trace, &curves)
    }

    #[test]
    fn an_average_far_away_takes_no_room_from_the_states() {
        assert!(heights_with(1.3).contains(&1.3));
        assert_eq!(heights_with(-85.0), heights_with(0.0));
        assert!(heights_with(0.0).contains(&1.0));
    }
}
