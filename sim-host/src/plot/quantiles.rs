//! The states of a network of any size over time: bands that hold a half and nine tenths of the nodes, all of them
//! between two lines, and their median.

use funnelnet_sim::large::Row;
use plotters::prelude::*;

use super::clip::clip;
use super::curve::Curve;
use super::legend::{self, Entry, Stroke};
use super::style::{BOUNDARY, CROWD, FAINT, INK, INSIDE, at, colour, font, line, px, shrink};
use super::thin::thin;
use super::{PlotError, axis, text};

const SIZE: (u32, u32) = (1000, 460);
/// Width of the legend, in pixels.
const LEGEND: u32 = 150;

/// Quantiles of the states over time, as SVG text.
///
/// # Errors
/// [`PlotError`] if there are fewer than two rows.
pub fn quantiles_svg(title: &str, unit: Option<&str>, rows: &[Row]) -> Result<String, PlotError> {
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
        return Err(PlotError::new("it needs two rows or more"));
    };
    if first.t >= last.t {
        return Err(PlotError::new("it needs two rows or more"));
    }
    let of = |place: usize| {
        let value = |row: &Row| row.x.get(place).copied().map_or(f64::NAN, f64::from);
        rows.iter().map(|row| (row.t, value(row))).collect::<Vec<_>>()
    };
    let heights = axis::padded(of(0).iter().chain(&of(6)).map(|point| point.1));
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (px(SIZE.0), px(SIZE.1))).into_drawing_area();
        root.fill(&WHITE).map_err(PlotError::new)?;
        let title = text::fit(&text::plain(title), 20, SIZE.0 - 92);
        root.draw(&Text::new(title, at(76, 14), font(20).color(&INK))).map_err(PlotError::new)?;
        let (left, right) = root.split_horizontally(px(SIZE.0 - LEGEND));
        let mut chart = ChartBuilder::on(&left)
            .margin_left(px(6))
            .margin_top(px(44))
            .margin_right(px(16))
            .margin_bottom(px(8))
            .x_label_area_size(px(46))
            .y_label_area_size(px(80))
            .build_cartesian_2d(first.t..last.t, heights.clone())
            .map_err(PlotError::new)?;
        for (low, high, fill) in [(1, 5, INSIDE), (2, 4, CROWD)] {
            let outline: Vec<_> = of(high).into_iter().chain(of(low).into_iter().rev()).collect();
            chart.draw_series([Polygon::new(outline, fill.filled())]).map_err(PlotError::new)?;
        }
        let unit = unit.map_or(String::new(), |unit| format!(" in {}", text::plain(unit)));
        chart
            .configure_mesh()
            .light_line_style(TRANSPARENT)
            .bold_line_style(line(FAINT, 1))
            .axis_style(line(INK, 1))
            .set_all_tick_mark_size(px(5))
            .label_style(font(15).color(&INK))
            .axis_desc_style(font(17).color(&INK))
            .x_desc("time t in s")
            .y_desc(format!("states{unit}"))
            .x_label_formatter(&axis::label)
            .y_label_formatter(&axis::labels(&heights))
            .draw()
            .map_err(PlotError::new)?;
        for (place, style, stroke) in curves() {
            Curve { pieces: clip(thin(&of(place)), &heights), style, stroke }.draw(&mut chart)?;
        }
        let entry = |label: &str, style, stroke| Entry { label: label.to_owned(), style, stroke };
        let entries = [
            entry("median", line(colour(1), 2), Stroke::Solid),
            entry("a half", line(CROWD, 1), Stroke::Area),
            entry("nine tenths", line(BOUNDARY, 1), Stroke::Band),
            entry("all", line(BOUNDARY, 1), Stroke::Dashed),
        ];
        legend::column(&right.margin(px(42), 0, 0, 0), &entries)?;
        root.present().map_err(PlotError::new)?;
    }
    Ok(shrink(svg, SIZE))
}

/// Place, style and stroke of each line.
fn curves() -> [(usize, ShapeStyle, Stroke); 5] {
    [
        (0, line(BOUNDARY, 1), Stroke::Dashed),
        (6, line(BOUNDARY, 1), Stroke::Dashed),
        (1, line(BOUNDARY, 1), Stroke::Solid),
        (5, line(BOUNDARY, 1), Stroke::Solid),
        (3, line(colour(1), 2), Stroke::Solid),
    ]
}
