//! The panel of one node: its diffusive term against its funnel, and the ratio of the two below, which shows
//! how near the boundary the node is however narrow the funnel has become.
//!
//! A funnel that stays within a factor of [`LINEAR`] is drawn as a band `+-psi`; one that shrinks further is
//! drawn as `psi` and `|nu|` on a logarithmic axis, where the band would be a line along 0. Both are the true
//! term and the scenario's funnel. What the node believes is drawn thin, where it is another.

use std::ops::Range;

use plotters::chart::MeshStyle;
use plotters::coord::ranged1d::Ranged;
use plotters::coord::{CoordTranslate, Shift};
use plotters::prelude::*;
use plotters::style::text_anchor::VPos;

use super::clip::{self, clip};
use super::curve::Curve;
use super::legend::Stroke;
use super::notes;
use super::style::{BOUNDARY, BREACH, FAINT, INK, INSIDE, at, font, line, px};
use super::thin::{Piece, thin};
use super::trace::{Drawn, Node};
use super::{PlotError, axis, marks};

/// Widest to narrowest funnel up to which a linear axis shows both.
const LINEAR: f64 = 30.0;
/// A cell of the sheet, in pixels.
pub(super) const CELL: (u32, u32) = (440, 356);
/// The right end of its plots, in pixels.
const RIGHT: i32 = CELL.0 as i32 - 14;
/// Height of the ratio panel, in pixels.
const RATIO: u32 = 130;
/// A term so many times as wide as its funnel is still shown; else the axis ends at [`CUT`] times.
const SHOWN: f64 = 10.0;
const CUT: f64 = 3.0;
/// Ratios that are farther apart are drawn both.
const VISIBLE: f64 = 0.05;
/// Terms that differ by less than this part of the funnel are not.
const NEAR: f64 = 0.02;
/// Decades below the widest funnel that a logarithmic axis shows at most.
const DEEPEST: f64 = 1e-16;

/// What is drawn of one node.
pub(super) struct Panel<'a> {
    trace: &'a Drawn,
    node: &'a Node,
    span: Range<f64>,
    colour: RGBColor,
    scale: Scale,
    /// What the node believes, where it differs visibly from what is true; NaN elsewhere.
    own_nu: Vec<f64>,
    own_psi: Vec<f64>,
}

/// What a legend of several panels has to know of one.
pub(super) struct Features {
    pub(super) id: usize,
    pub(super) has_breach: bool,
    pub(super) has_own_nu: bool,
    pub(super) has_own_psi: bool,
}

/// The vertical axis.
enum Scale {
    Band(Range<f64>),
    Decades(Range<f64>),
}

impl<'a> Panel<'a> {
    pub(super) fn new(trace: &'a Drawn, node: &'a Node, colour: RGBColor) -> Self {
        let scale = Scale::of(node);
        // Beside a funnel, values near zero are the same, however many decades are between them.
        let differ = |k: usize, own: f64, truth: f64| {
            let size = (own - truth).abs();
            scale.apart(own, truth) && size >= NEAR * node.psi.get(k).copied().unwrap_or(0.0)
        };
        let shown = |own: &[f64], truth: &[f64]| -> Vec<f64> {
            let apart = where_apart(own, truth, differ);
            // What a stop or an absence hides is no reason for a line in the legend.
            trace.points(node, &apart).into_iter().map(|p| p.1).collect()
        };
        let (own_nu, own_psi) = (shown(&node.own_nu, &node.nu), shown(&node.own_psi, &node.psi));
        Self { trace, node, span: trace.span.clone(), colour, scale, own_nu, own_psi }
    }

    /// What the legend has to know of it.
    pub(super) fn features(&self) -> Features {
        let any = |values: &[f64]| values.iter().any(|v| !v.is_nan());
        Features {
            id: self.node.id,
            has_breach: self.has_breach(),
            has_own_nu: any(&self.own_nu),
            has_own_psi: any(&self.own_psi),
        }
    }

    fn has_breach(&self) -> bool {
        self.node.worst().0.breaches > 0
    }

    pub(super) fn draw<DB: DrawingBackend>(&self, cell: &DrawingArea<DB, Shift>) -> Result<(), PlotError> {
        let (above, below) = cell.split_vertically(px(CELL.1 - RATIO));
        let caption = format!("{}: {}", self.node.label, notes::largest(self.node));
        above.draw(&Text::new(caption, at(76, 10), font(16).color(&INK))).map_err(PlotError::new)?;
        let ink = if self.has_breach() { BREACH } else { INK };
        let notes = Text::new(notes::notes(self.trace, self.node), at(76, 30), font(13).color(&ink));
        above.draw(&notes).map_err(PlotError::new)?;
        match &self.scale {
            Scale::Band(heights) => self.band(&above, heights)?,
            Scale::Decades(heights) => self.decades(&above, heights)?,
        }
        self.ratio(&below)
    }

    /// All values that are drawn. A funnel that begins infinite is no value that has been cut.
    fn drawn(&self) -> impl Iterator<Item = f64> {
        let all = [&self.node.nu, &self.own_nu, &self.own_psi].into_iter().flat_map(|v| self.points(v));
        all.map(|p| p.1).chain(self.node.psi.iter().copied().filter(|psi| psi.is_finite()))
    }

    fn points(&self, values: &[f64]) -> Vec<(f64, f64)> {
        self.trace.points(self.node, values)
    }

    fn band<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        heights: &Range<f64>,
    ) -> Result<(), PlotError> {
        let mut chart = builder(area, 0)
            .build_cartesian_2d(self.span.clone(), heights.clone())
            .map_err(PlotError::new)?;
        self.inside(&mut chart, &self.node.psi, heights, |psi| -psi)?;
        mesh(&mut chart.configure_mesh(), &self.trace.axis("\u{3BD}"), 7)
            .x_label_formatter(&|_| String::new())
            .y_label_formatter(&axis::labels(heights))
            .draw()
            .map_err(PlotError::new)?;
        let whole = |y: f64| y;
        self.marks(&mut chart, heights)?;
        for sign in [1.0, -1.0] {
            let own: Vec<f64> = self.own_psi.iter().map(|psi| sign * psi).collect();
            self.curve(&own, heights, whole, line(INK, 1), Stroke::Dashed).draw(&mut chart)?;
            let psi: Vec<(f64, f64)> = self.all(&self.node.psi).map(|(t, psi)| (t, sign * psi)).collect();
            Curve::solid(clip(thin(&psi), heights), edge()).draw(&mut chart)?;
        }
        self.terms(&mut chart, heights, whole)?;
        clip::say(area, (RIGHT, 50), clip::words(self.drawn(), heights))
    }

    fn decades<DB: DrawingBackend>(
        &self,
        area: &DrawingArea<DB, Shift>,
        heights: &Range<f64>,
    ) -> Result<(), PlotError> {
        let mut chart = builder(area, 0)
            .build_cartesian_2d(self.span.clone(), heights.clone().log_scale())
            .map_err(PlotError::new)?;
        let bottom = heights.start;
        // |nu| passes through 0. What is below the axis lies on it; what is not known stays so.
        let raised = |y: f64| if y.abs() < bottom { bottom } else { y.abs() };
        self.inside(&mut chart, &self.node.psi, heights, |_| bottom)?;
        mesh(&mut chart.configure_mesh(), &self.trace.axis("|\u{3BD}|"), 6)
            .x_label_formatter(&|_| String::new())
            .y_label_formatter(&axis::decade)
            .draw()
            .map_err(PlotError::new)?;
        self.marks(&mut chart, heights)?;
        self.curve(&self.own_psi, heights, raised, line(INK, 1), Stroke::Dashed).draw(&mut chart)?;
        let psi: Vec<(f64, f64)> = self.all(&self.node.psi).map(|(t, psi)| (t, raised(psi))).collect();
        Curve::solid(clip(thin(&psi), heights), edge()).draw(&mut chart)?;
        self.terms(&mut chart, heights, raised)?;
        clip::say(area, (RIGHT, 50), clip::words(self.drawn().map(f64::abs).map(|y| y.max(bottom)), heights))
    }

    fn ratio<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>) -> Result<(), PlotError> {
        let ratios = &self.node.ratio;
        let own = where_apart(&self.node.own_ratio, ratios, |_, a, b| (a - b).abs() > VISIBLE);
        let shown = || [ratios, &own].into_iter().flat_map(|v| self.points(v)).map(|p| p.1);
        let most = shown().filter(|v| !v.is_nan()).fold(1.0, |most: f64, v| most.max(v.abs()));
        let reach = 1.1 * if most <= SHOWN { most } else { CUT };
        let heights = -reach..reach;
        let mut chart = builder(area, 40)
            .build_cartesian_2d(self.span.clone(), heights.clone())
            .map_err(PlotError::new)?;
        let ones = vec![1.0; self.node.t.len()];
        self.inside(&mut chart, &ones, &heights, |one| -one)?;
        mesh(&mut chart.configure_mesh(), "\u{3BD}/\u{3C8}", 3)
            .x_desc("time t in s")
            .x_label_formatter(&axis::label)
            .y_label_formatter(&axis::label)
            .draw()
            .map_err(PlotError::new)?;
        for mark in self.trace.marks_of(self.node.id) {
            mark.draw(&mut chart, (&self.span, &heights), INK)?;
        }
        for edge_at in [1.0, -1.0] {
            let flat = vec![(self.span.start, edge_at), (self.span.end, edge_at)];
            Curve::solid(vec![flat], edge()).draw(&mut chart)?;
        }
        let whole = |y: f64| y;
        self.curve(&own, &heights, whole, line(INK, 1), Stroke::Solid).draw(&mut chart)?;
        self.curve(ratios, &heights, whole, line(self.colour, 2), Stroke::Solid).draw(&mut chart)?;
        self.curve(&self.outside(ratios), &heights, whole, line(BREACH, 3), Stroke::Solid)
            .draw(&mut chart)?;
        self.rug(ratios, heights.start).draw(&mut chart)?;
        clip::say(area, (RIGHT, 6), clip::words(shown(), &heights))
    }

    /// The true term, what the node believes of it, and where it is outside.
    fn terms<DB, CT>(
        &self,
        chart: &mut ChartContext<'_, DB, CT>,
        heights: &Range<f64>,
        map: impl Fn(f64) -> f64 + Copy,
    ) -> Result<(), PlotError>
    where
        DB: DrawingBackend,
        CT: CoordTranslate<From = (f64, f64)>,
    {
        let nu = &self.node.nu;
        self.curve(&self.own_nu, heights, map, line(INK, 1), Stroke::Solid).draw(chart)?;
        self.curve(nu, heights, map, line(self.colour, 2), Stroke::Solid).draw(chart)?;
        self.curve(&self.outside(nu), heights, map, line(BREACH, 3), Stroke::Solid).draw(chart)
    }

    /// Those of `values` at whose rows the node is outside; NaN elsewhere.
    fn outside(&self, values: &[f64]) -> Vec<f64> {
        let at = |(&v, ratio): (&f64, &f64)| if ratio.abs() < 1.0 { f64::NAN } else { v };
        values.iter().zip(&self.node.ratio).map(at).collect()
    }

    /// Where the node is outside, along the lower edge: to be seen, too, where the term is cut, or after a
    /// stop.
    fn rug(&self, ratios: &[f64], bottom: f64) -> Curve {
        let at = |ratio: f64| if ratio.abs() >= 1.0 { bottom } else { f64::NAN };
        let points: Vec<(f64, f64)> = self.all(ratios).map(|(t, ratio)| (t, at(ratio))).collect();
        Curve::solid(thin(&points), line(BREACH, 5))
    }

    fn curve(
        &self,
        values: &[f64],
        heights: &Range<f64>,
        map: impl Fn(f64) -> f64,
        style: ShapeStyle,
        stroke: Stroke,
    ) -> Curve {
        let points: Vec<(f64, f64)> = self.points(values).into_iter().map(|(t, y)| (t, map(y))).collect();
        Curve { pieces: clip(thin(&points), heights), style, stroke }
    }

    /// The points of a curve that goes on whatever the node does.
    fn all<'v>(&'v self, values: &'v [f64]) -> impl Iterator<Item = (f64, f64)> + 'v {
        self.node.t.iter().copied().zip(values.iter().copied())
    }

    /// Shades what is between `psi` and what `lower` makes of it.
    fn inside<DB, CT>(
        &self,
        chart: &mut ChartContext<'_, DB, CT>,
        psi: &[f64],
        heights: &Range<f64>,
        lower: impl Fn(f64) -> f64,
    ) -> Result<(), PlotError>
    where
        DB: DrawingBackend,
        CT: CoordTranslate<From = (f64, f64)>,
    {
        let within = |y: f64| y.clamp(heights.start, heights.end);
        for upper in thin(&self.all(psi).collect::<Vec<_>>()) {
            let back = upper.iter().rev().map(|&(t, y)| (t, within(lower(y))));
            let outline: Piece = upper.iter().map(|&(t, y)| (t, within(y))).chain(back).collect();
            chart.draw_series([Polygon::new(outline, INSIDE.filled())]).map_err(PlotError::new)?;
        }
        Ok(())
    }

    fn marks<DB, CT>(
        &self,
        chart: &mut ChartContext<'_, DB, CT>,
        heights: &Range<f64>,
    ) -> Result<(), PlotError>
    where
        DB: DrawingBackend,
        CT: CoordTranslate<From = (f64, f64)>,
    {
        for mark in self.trace.marks_of(self.node.id) {
            mark.draw(chart, (&self.span, heights), INK)?;
            let foot = (mark.from, heights.start);
            marks::label(chart, &self.span, foot, VPos::Bottom, mark.kind.word().to_owned())?;
        }
        Ok(())
    }
}

impl Scale {
    /// An axis on which the funnel can be seen, and a term that is outside of it up to some ten times its
    /// width.
    fn of(node: &Node) -> Self {
        let positive = node.psi.iter().copied().filter(|p| p.is_finite() && *p > 0.0);
        let (low, high) = positive.fold((f64::INFINITY, 0.0f64), |(l, h), p| (l.min(p), h.max(p)));
        let others = node.nu.iter().chain(&node.own_nu).chain(&node.own_psi).map(|v| v.abs());
        let most = others.filter(|v| v.is_finite()).fold(0.0, f64::max);
        if high / low > LINEAR {
            // Two decades below the funnel are enough to see how small a term is.
            let bottom = (low / 100.0).max(high * DEEPEST);
            let top = if most <= SHOWN * SHOWN * high { most.max(high) } else { SHOWN * high };
            return Self::Decades(bottom..2.0 * top);
        }
        let reach = if high == 0.0 || most <= SHOWN * high { most.max(high) } else { CUT * high };
        Self::Band(axis::padded([-reach, reach].into_iter()))
    }

    /// Whether two values are farther apart than the width of a line.
    fn apart(&self, a: f64, b: f64) -> bool {
        match self {
            Self::Band(range) => {
                let within = |y: f64| y.clamp(range.start, range.end);
                (within(a) - within(b)).abs() > 0.01 * (range.end - range.start)
            }
            Self::Decades(range) => {
                let within = |y: f64| y.abs().clamp(range.start, range.end);
                let share = within(a) / within(b);
                !(0.8..1.25).contains(&share)
            }
        }
    }
}

/// Those of `own` that are visibly not `truth`, or that stand where it is not known, and a row on both sides
/// of them; NaN elsewhere.
fn where_apart(own: &[f64], truth: &[f64], apart: impl Fn(usize, f64, f64) -> bool) -> Vec<f64> {
    let differs: Vec<bool> = own
        .iter()
        .zip(truth)
        .enumerate()
        .map(|(k, (&own, &truth))| !own.is_nan() && (truth.is_nan() || apart(k, own, truth)))
        .collect();
    let near = |k: usize| differs[k.saturating_sub(1)..differs.len().min(k + 2)].iter().any(|&d| d);
    own.iter().take(differs.len()).enumerate().map(|(k, &v)| if near(k) { v } else { f64::NAN }).collect()
}

fn edge() -> ShapeStyle {
    line(BOUNDARY, 1)
}

fn builder<'a, 'b, DB: DrawingBackend>(
    area: &'a DrawingArea<DB, Shift>,
    x_labels: u32,
) -> ChartBuilder<'a, 'b, DB> {
    let mut builder = ChartBuilder::on(area);
    builder.margin_top(px(if x_labels == 0 { 50 } else { 6 })).margin_right(px(14)).margin_left(px(8));
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
