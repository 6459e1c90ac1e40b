//! All states over time with the emergent trajectory and the blended dynamics; and all inputs.

use plotters::coord::{CoordTranslate, Shift};
use plotters::prelude::*;
use plotters::style::text_anchor::VPos;
use std::ops::Range;

use super::clip::{self, clip};
use super::curve::Curve;
use super::legend::{self, Entry, Stroke};
use super::style::{CROWD, FAINT, INK, NODES, at, colour, font, line, px, shrink};
use super::thin::thin;
use super::trace::{Drawn, Node, Trace, Wanted};
use super::{PlotError, axis, marks, text};

const WIDTH: u32 = 1000;
/// Height of the title, in pixels.
const TITLE: u32 = 44;
/// Height of the plot of scalar states, and of each component of vectors, in pixels.
const SCALAR: u32 = 476;
const COMPONENT: u32 = 300;
/// Width of the legend, in pixels.
const LEGEND: u32 = 130;
/// The height that a line of text takes, in pixels.
const LINE: u32 = 20;
/// Stops and absences that are named in the picture; of more, how many.
const NAMED: usize = 8;

/// What is drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Quantity {
    States,
    Inputs,
}

/// The states `x_i` with the emergent trajectory `xi` dotted and the blended dynamics dashed in black on top,
/// as in the paper's figure, as SVG text. Each component has an axis of its own. Up to twelve nodes get a
/// colour each; of more, all are drawn alike. A curve ends where its node stops or is away. What of the
/// blended dynamics is far from all states is left out.
///
/// # Errors
/// [`PlotError`] if the trace has rows at fewer than two times.
pub fn states_svg(trace: &Trace) -> Result<String, PlotError> {
    svg(trace, Quantity::States)
}

/// The inputs `u_i` that the nodes apply, as SVG text; axes, colours and ends as those of the states.
///
/// # Errors
/// [`PlotError`] if the trace has rows at fewer than two times.
pub fn inputs_svg(trace: &Trace) -> Result<String, PlotError> {
    svg(trace, Quantity::Inputs)
}

fn svg(trace: &Trace, what: Quantity) -> Result<String, PlotError> {
    let wanted = if what == Quantity::States { Wanted::States } else { Wanted::Inputs };
    let trace = &trace.drawn(wanted)?;
    let components = trace.components();
    let height = if components == 1 { SCALAR } else { COMPONENT };
    let size = (WIDTH, TITLE + height * components as u32);
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (px(size.0), px(size.1))).into_drawing_area();
        root.fill(&WHITE).map_err(PlotError::new)?;
        let title = text::fit(&trace.title, 20, WIDTH - 92);
        root.draw(&Text::new(title, at(76, 14), font(20).color(&INK))).map_err(PlotError::new)?;
        let (_, below) = root.split_vertically(px(TITLE));
        let (left, right) = below.split_horizontally(px(WIDTH - LEGEND));
        for (component, area) in left.split_evenly((components, 1)).iter().enumerate() {
            Plot { trace, what, component, height }.draw(area)?;
        }
        legend::column(&right, &entries(trace, what))?;
        root.present().map_err(PlotError::new)?;
    }
    Ok(shrink(svg, size))
}

/// The plot of one component.
struct Plot<'a> {
    trace: &'a Drawn,
    what: Quantity,
    component: usize,
    /// In pixels.
    height: u32,
}

/// A curve with the node that it is of.
type OfNode<'a> = (&'a Node, Vec<(f64, f64)>);

impl Plot<'_> {
    fn draw<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>) -> Result<(), PlotError> {
        let span = &self.trace.span;
        let curves: Vec<OfNode<'_>> = self.nodes().map(|node| (node, self.points(node))).collect();
        let heights = self.heights(&curves);
        let mut chart = ChartBuilder::on(area)
            .margin_left(px(6))
            .margin_right(px(16))
            .margin_bottom(px(8))
            .x_label_area_size(px(46))
            .y_label_area_size(px(70))
            .build_cartesian_2d(span.clone(), heights.clone())
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
            .y_desc(self.name())
            .x_label_formatter(&axis::label)
            .y_label_formatter(&axis::labels(&heights))
            .draw()
            .map_err(PlotError::new)?;
        self.mark(&mut chart, &heights)?;
        self.trace.losses.draw(&mut chart, heights.start)?;
        for (node, points) in &curves {
            let style = line(ink(self.trace, node), if has_colours(self.trace) { 2 } else { 1 });
            Curve::solid(clip(thin(points), &heights), style).draw(&mut chart)?;
        }
        self.crosses(&mut chart, &heights)?;
        for (_, points, stroke) in self.predictions() {
            let pieces = clip(thin(points), &heights);
            Curve { pieces, style: line(BLACK, 2), stroke }.draw(&mut chart)?;
        }
        let right = (WIDTH - LEGEND) as i32 - 16;
        clip::say(area, (right, 0), clip::words(curves.iter().flat_map(|c| &c.1).map(|p| p.1), &heights))
    }

    fn nodes(&self) -> impl Iterator<Item = &Node> {
        self.trace.nodes.iter().filter(|node| node.component == self.component)
    }

    fn points(&self, node: &Node) -> Vec<(f64, f64)> {
        match self.what {
            Quantity::States => self.trace.states(node),
            Quantity::Inputs => self.trace.inputs(node),
        }
    }

    /// What the vertical axis is called.
    fn name(&self) -> String {
        let letter = if self.what == Quantity::States { "x" } else { "u" };
        let symbol = match self.trace.components() {
            1 => letter.to_owned(),
            _ => format!("{letter}{}", self.component),
        };
        match self.what {
            Quantity::States if self.trace.has_unit() && self.trace.components() == 1 => {
                self.trace.axis("state")
            }
            Quantity::States => self.trace.axis(&format!("state {symbol}")),
            Quantity::Inputs => self.trace.axis_per_second(&format!("input {symbol}")),
        }
    }

    /// The predictions of this component; of inputs there are none.
    fn predictions(&self) -> impl Iterator<Item = (&'static str, &Vec<(f64, f64)>, Stroke)> {
        let are_drawn = self.what == Quantity::States;
        predictions(self.trace)
            .filter(move |_| are_drawn)
            .filter_map(|(name, components, stroke)| Some((name, components.get(self.component)?, stroke)))
    }

    /// A cross where the curve of a node ends.
    fn crosses<DB, CT>(
        &self,
        chart: &mut ChartContext<'_, DB, CT>,
        heights: &Range<f64>,
    ) -> Result<(), PlotError>
    where
        DB: DrawingBackend,
        CT: CoordTranslate<From = (f64, f64)>,
    {
        let span = &self.trace.span;
        for node in self.nodes() {
            let end = match self.what {
                Quantity::States => self.trace.stop(node),
                Quantity::Inputs => self.trace.last_input(node),
            };
            if let Some((t, y)) = end {
                let at = (t.clamp(span.start, span.end), y.clamp(heights.start, heights.end));
                marks::cross(chart, at, ink(self.trace, node))?;
            }
        }
        Ok(())
    }

    /// Draws and names stops, absences and cut links, in the order in which they began.
    fn mark<DB, CT>(
        &self,
        chart: &mut ChartContext<'_, DB, CT>,
        heights: &Range<f64>,
    ) -> Result<(), PlotError>
    where
        DB: DrawingBackend,
        CT: CoordTranslate<From = (f64, f64)>,
    {
        let span = &self.trace.span;
        let mut all: Vec<&marks::Mark> = self.trace.marks.iter().collect();
        all.sort_by(|a, b| a.from.total_cmp(&b.from));
        let more = all.len().saturating_sub(NAMED);
        let step = (heights.end - heights.start) * f64::from(LINE) / f64::from(self.height);
        for (n, mark) in all.iter().enumerate() {
            let first = self.nodes().find(|node| node.id == mark.id);
            mark.draw(chart, (span, heights), first.map_or(INK, |node| ink(self.trace, node)))?;
            // Below the line that says what is cut.
            let y = heights.end - step * (n as f64 + 1.0);
            let words = match n {
                n if n < NAMED => mark.label(),
                n if n == NAMED => format!("and {more} more"),
                _ => continue,
            };
            marks::label(chart, span, (mark.from, y), VPos::Top, words)?;
        }
        Ok(())
    }

    /// The range of the vertical axis.
    fn heights(&self, curves: &[OfNode<'_>]) -> Range<f64> {
        match self.what {
            Quantity::States => self.heights_of_states(curves),
            Quantity::Inputs => heights_of_inputs(curves),
        }
    }

    /// All of the states and of `xi`, and of the blended dynamics what is not farther from those than a
    /// quarter of their own range. An average that outliers drag far away would leave no room for the states,
    /// and neither would a node that diverges: the scale is that of the initial states, of `xi` and of the
    /// funnels.
    fn heights_of_states(&self, curves: &[OfNode<'_>]) -> Range<f64> {
        let of = |all: &[Vec<(f64, f64)>]| -> Vec<f64> {
            all.get(self.component).into_iter().flatten().map(|p| p.1).collect()
        };
        let (xi, blended) = (of(&self.trace.xi), of(&self.trace.blended));
        let mut values: Vec<f64> =
            curves.iter().flat_map(|c| &c.1).map(|p| p.1).chain(xi.iter().copied()).collect();
        let start = curves.iter().filter_map(|c| c.1.iter().map(|p| p.1).find(|x| x.is_finite()));
        let mut natural: Vec<f64> = start.chain(xi.iter().copied().filter(|xi| xi.is_finite())).collect();
        let low = natural.iter().copied().fold(f64::INFINITY, f64::min);
        let widths = self.nodes().filter_map(|node| node.psi.last()).filter(|psi| psi.is_finite());
        let width = widths.fold(0.0, |most: f64, &psi| most.max(psi));
        natural.extend([low - width, low + width].into_iter().filter(|v| v.is_finite()));
        let inner = axis::robust(&values, natural.into_iter());
        let room = 0.25 * (inner.end - inner.start);
        let near = inner.start - room..inner.end + room;
        values.retain(|value| inner.contains(value));
        values.extend(blended.into_iter().filter(|value| near.contains(value)));
        // Where values are cut, up to the cut.
        let whole = axis::padded(values.into_iter());
        whole.start.min(inner.start)..whole.end.max(inner.end)
    }
}

/// All inputs, and 0. Those of a start that is far away are cut: the scale is that of the middle one.
fn heights_of_inputs(curves: &[OfNode<'_>]) -> Range<f64> {
    let values: Vec<f64> = curves.iter().flat_map(|c| &c.1).map(|p| p.1).collect();
    let mut sizes: Vec<f64> = values.iter().map(|u| u.abs()).filter(|u| u.is_finite()).collect();
    sizes.sort_by(f64::total_cmp);
    let middle = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
    axis::robust(&values, [-middle, 0.0, middle].into_iter())
}

/// Whether each node has a colour of its own: few enough.
fn has_colours(trace: &Drawn) -> bool {
    trace.nodes.len() <= NODES * trace.components()
}

/// The colour of the curves of a node.
fn ink(trace: &Drawn, node: &Node) -> RGBColor {
    if has_colours(trace) { colour(node.id - 1) } else { CROWD }
}

/// A prediction: its name, its points by component, and how it is drawn.
type Predicted<'a> = (&'static str, &'a Vec<Vec<(f64, f64)>>, Stroke);

/// What is predicted, where it is known anywhere.
fn predictions(trace: &Drawn) -> impl Iterator<Item = Predicted<'_>> {
    let all = [("blended", &trace.blended, Stroke::Dashed), ("emergent \u{3BE}", &trace.xi, Stroke::Dotted)];
    all.into_iter().filter(|(_, points, _)| points.iter().flatten().any(|p| p.1.is_finite()))
}

fn entries(trace: &Drawn, what: Quantity) -> Vec<Entry> {
    let entry = |label: String, style| Entry { label, style, stroke: Stroke::Solid };
    let first = || trace.nodes.iter().filter(|node| node.component == 0);
    let mut entries: Vec<Entry> = match has_colours(trace) {
        true => first().map(|node| entry(format!("node {}", node.id), line(ink(trace, node), 2))).collect(),
        false => vec![entry(format!("{} nodes", first().count()), line(CROWD, 1))],
    };
    let black =
        |(name, _, stroke): Predicted<'_>| Entry { label: name.to_owned(), style: line(BLACK, 2), stroke };
    entries.extend(predictions(trace).filter(|_| what == Quantity::States).map(black));
    entries.extend(marks::entries(trace.marks.iter()));
    entries.extend(trace.losses.entry());
    entries
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::Row;

    fn heights(trace: &Drawn, what: Quantity) -> Range<f64> {
        let plot = Plot { trace, what, component: 0, height: SCALAR };
        let curves: Vec<OfNode<'_>> = plot.nodes().map(|node| (node, plot.points(node))).collect();
        plot.heights(&curves)
    }

    /// Of a trace with states from -1 to 1 and blended dynamics from 0 to `end`.
    fn heights_with(end: f64) -> Range<f64> {
        let mut trace = Trace::new("");
        for (t, blended) in [(0.0, 0.0), (1.0, end)] {
            trace.push(&Row { t, x: vec![-1.0, 1.0], blended: vec![blended], ..Row::default() });
        }
        heights(&trace.drawn(Wanted::States).unwrap(), Quantity::States)
    }

    #[test]
    fn an_average_far_away_takes_no_room_from_the_states() {
        assert!(heights_with(1.3).contains(&1.3));
        assert_eq!(heights_with(-85.0), heights_with(0.0));
        assert!(heights_with(0.0).contains(&1.0));
    }

    #[test]
    fn a_first_input_far_away_takes_no_room_from_the_others() {
        let mut trace = Trace::new("");
        for k in 0..100 {
            let u = if k == 0 { 1e6 } else { f64::from(k % 5) };
            trace.push(&Row { t: f64::from(k), x: vec![0.0], u: vec![u], ..Row::default() });
        }
        let heights = heights(&trace.drawn(Wanted::Inputs).unwrap(), Quantity::Inputs);
        assert!(heights.contains(&4.0) && heights.contains(&0.0) && heights.end < 20.0, "{heights:?}");
    }
}
