//! A figure of many runs over one parameter: its middle as a line, its range as a band.

use plotters::prelude::*;

use super::curve::Curve;
use super::legend::{self, Entry, Stroke};
use super::style::{BOUNDARY, FAINT, INK, INSIDE, at, colour, font, line, px, shrink};
use super::{PlotError, axis, text};

const SIZE: (u32, u32) = (1000, 420);
/// Width of the legend, in pixels.
const LEGEND: u32 = 150;

/// What came of the runs with one value of the parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// The value of the parameter.
    pub at: f64,
    /// The smallest figure.
    pub low: f64,
    /// The mean.
    pub mean: f64,
    /// The largest.
    pub high: f64,
}

/// A figure over a parameter.
pub struct Lines {
    /// What the picture is called.
    pub title: String,
    /// Name of the parameter.
    pub parameter: String,
    /// Name of the figure.
    pub figure: String,
    /// By ascending values; what is not finite is left out.
    pub spots: Vec<Spot>,
}

impl Lines {
    /// Draws it, as SVG text.
    ///
    /// # Errors
    /// [`PlotError`] if there are fewer than two values of the parameter.
    pub fn svg(&self) -> Result<String, PlotError> {
        let finite = |spot: &&Spot| [spot.at, spot.low, spot.mean, spot.high].iter().all(|v| v.is_finite());
        let spots: Vec<Spot> = self.spots.iter().filter(finite).copied().collect();
        let (Some(first), Some(last)) = (spots.first(), spots.last()) else { return Err(few()) };
        if first.at >= last.at {
            return Err(few());
        }
        let of =
            |value: fn(&Spot) -> f64| spots.iter().map(|spot| (spot.at, value(spot))).collect::<Vec<_>>();
        let (low, mean, high) = (of(|spot| spot.low), of(|spot| spot.mean), of(|spot| spot.high));
        let heights = axis::padded(low.iter().chain(&high).map(|point| point.1));
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
                .y_label_area_size(px(80))
                .build_cartesian_2d(first.at..last.at, heights.clone())
                .map_err(PlotError::new)?;
            let band = high.iter().chain(low.iter().rev()).copied().collect::<Vec<_>>();
            chart.draw_series([Polygon::new(band, INSIDE.filled())]).map_err(PlotError::new)?;
            chart
                .configure_mesh()
                .light_line_style(TRANSPARENT)
                .bold_line_style(line(FAINT, 1))
                .axis_style(line(INK, 1))
                .set_all_tick_mark_size(px(5))
                .label_style(font(15).color(&INK))
                .axis_desc_style(font(17).color(&INK))
                .x_desc(text::fit(&text::plain(&self.parameter), 17, SIZE.0 - 300))
                .y_desc(text::fit(&text::plain(&self.figure), 17, SIZE.1 - 100))
                .x_label_formatter(&axis::labels(&(first.at..last.at)))
                .y_label_formatter(&axis::labels(&heights))
                .draw()
                .map_err(PlotError::new)?;
            for edge in [low, high] {
                Curve::solid(vec![edge], line(BOUNDARY, 1)).draw(&mut chart)?;
            }
            let style = line(colour(0), 2);
            let dots = mean.iter().map(|&point| Circle::new(point, px(4), colour(0).filled()));
            chart.draw_series(dots).map_err(PlotError::new)?;
            Curve::solid(vec![mean], style).draw(&mut chart)?;
            let entry = |label: &str, style, stroke| Entry { label: label.to_owned(), style, stroke };
            let entries = [
                entry("mean", style, Stroke::Solid),
                entry("least to most", line(BOUNDARY, 1), Stroke::Band),
            ];
            legend::column(&right.margin(px(42), 0, 0, 0), &entries)?;
            root.present().map_err(PlotError::new)?;
        }
        Ok(shrink(svg, SIZE))
    }
}

fn few() -> PlotError {
    PlotError::new("it needs two values of the parameter or more")
}
