//! Two runs of one network in one picture.

use plotters::prelude::*;
use std::ops::Range;

use super::clip::clip;
use super::curve::Curve;
use super::legend::{self, Entry, Stroke};
use super::style::{BREACH, CROWD, FAINT, INK, at, font, line, px, shrink};
use super::thin::thin;
use super::{PlotError, axis, text};

const SIZE: (u32, u32) = (1000, 520);
/// Width of the legend, in pixels.
const LEGEND: u32 = 100;

/// Curves of two runs, as `(t, value)` with t in s.
pub struct Overlay {
    /// What the picture is called.
    pub title: String,
    /// Those of A: broad and light.
    pub below: Vec<Vec<(f64, f64)>>,
    /// Those of B: thin and dark, on top.
    pub above: Vec<Vec<(f64, f64)>>,
}

impl Overlay {
    /// Draws it, as SVG text.
    ///
    /// # Errors
    /// [`PlotError`] if there are no curves, or points at fewer than two times.
    pub fn svg(&self) -> Result<String, PlotError> {
        let span = self.span()?;
        let heights = axis::padded(self.points().map(|point| point.1).filter(|value| value.is_finite()));
        let mut svg = String::new();
        {
            let root = SVGBackend::with_string(&mut svg, (px(SIZE.0), px(SIZE.1))).into_drawing_area();
            root.fill(&WHITE).map_err(PlotError::new)?;
            let title = text::fit(&text::plain(&self.title), 20, SIZE.0 - 92);
            root.draw(&Text::new(title, at(76, 14), font(20).color(&INK))).map_err(PlotError::new)?;
            let (left, right) = root.split_horizontally(px(SIZE.0 - LEGEND));
            let mut chart = ChartBuilder::on(&left)
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
                .y_desc("state x")
                .x_label_formatter(&axis::label)
                .y_label_formatter(&axis::labels(&heights))
                .draw()
                .map_err(PlotError::new)?;
            for (curves, style) in [(&self.below, below()), (&self.above, above())] {
                for points in curves {
                    Curve::solid(clip(thin(points), &heights), style).draw(&mut chart)?;
                }
            }
            let entry = |label: &str, style| Entry { label: label.to_owned(), style, stroke: Stroke::Solid };
            legend::column(&right.margin(px(42), 0, 0, 0), &[entry("A", below()), entry("B", above())])?;
            root.present().map_err(PlotError::new)?;
        }
        Ok(shrink(svg, SIZE))
    }

    fn points(&self) -> impl Iterator<Item = &(f64, f64)> {
        self.below.iter().chain(&self.above).flatten()
    }

    fn span(&self) -> Result<Range<f64>, PlotError> {
        let times = || self.points().map(|point| point.0).filter(|t| t.is_finite());
        let (first, last) = (times().min_by(f64::total_cmp), times().max_by(f64::total_cmp));
        match (first, last) {
            (Some(first), Some(last)) if first < last => Ok(first..last),
            _ => Err(PlotError::new("there are no states at two times")),
        }
    }
}

fn below() -> ShapeStyle {
    line(CROWD, 5)
}

fn above() -> ShapeStyle {
    line(BREACH, 1)
}
