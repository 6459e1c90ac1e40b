//! All states over time, the emergent trajectory and the blended dynamics.

use plotters::coord::Shift;
use plotters::prelude::*;
use std::ops::Range;

use super::legend::{self, Entry, Stroke};
use super::style::{CROWD, FAINT, INK, NODES, at, colour, font, line, px, shrink};
use super::thin::thin;
use super::trace::Trace;
use super::{PlotError, axis};

const SIZE: (u32, u32) = (1000, 520);
/// Width of the legend, in pixels.
const LEGEND: u32 = 130;

/// The states `x_i` with the emergent trajectory `xi` dotted and the blended dynamics dashed in black on top, as in the paper's
/// figure, as SVG text. Up to twelve curves get a colour each; of more, each component of a vector does, and scalar states are
/// drawn alike. What of the blended dynamics is far from all states is left out.
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
    span: Range<f64>,
) -> Result<(), PlotError> {
    let heights = heights(trace);
    let mut chart = ChartBuilder::on(area)
        .margin_left(px(6))
        .margin_top(px(44))
        .margin_right(px(16))
        .margin_bottom(px(8))
        .x_label_area_size(px(46))
        .y_label_area_size(px(70))
        .build_cartesian_2d(span, heights.clone())
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
    for (_, components, stroke) in predictions(trace) {
        let (mark, space) = stroke.pattern().unwrap_or((1, 0));
        for values in components {
            let mut points = thin(&trace.t, |k| values[k]);
            points.retain(|(_, value)| heights.contains(value));
            let series = DashedLineSeries::new(points, px(mark), px(space), line(BLACK, 2));
            chart.draw_series(series).map_err(PlotError::new)?;
        }
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

/// The range of the vertical axis: all of the states and of `xi`, and of the blended dynamics what is not farther from those than
/// a quarter of their own range. An average that outliers drag far away would leave no room for the states.
fn heights(trace: &Trace) -> Range<f64> {
    let states = trace.nodes.iter().flat_map(|n| n.x.iter()).chain(trace.xi.iter().flatten()).copied();
    let inner = axis::padded(states.clone());
    let room = 0.25 * (inner.end - inner.start);
    let near = inner.start - room..inner.end + room;
    axis::padded(states.chain(trace.blended.iter().flatten().copied().filter(|value| near.contains(value))))
}

/// What is predicted, where it is known anywhere: its name, its values over time by component, and how it is drawn.
fn predictions(trace: &Trace) -> impl Iterator<Item = (&'static str, &Vec<Vec<f64>>, Stroke)> {
    let all = [("blended", &trace.blended, Stroke::Dashed), ("emergent \u{3BE}", &trace.xi, Stroke::Dotted)];
    all.into_iter().filter(|(_, values, _)| values.iter().flatten().any(|v| v.is_finite()))
}

fn entries(trace: &Trace) -> Vec<Entry> {
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
        heights(&trace)
    }

    #[test]
    fn an_average_far_away_takes_no_room_from_the_states() {
        assert!(heights_with(1.3).contains(&1.3));
        assert_eq!(heights_with(-85.0), heights_with(0.0));
        assert!(heights_with(0.0).contains(&1.0));
    }
}
