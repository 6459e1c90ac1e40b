//! Where a node stops or is away: nothing is known of it there, or nothing changes any more, and the picture says so.

use std::ops::Range;

use plotters::coord::CoordTranslate;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::PlotError;
use super::legend::{Entry, Stroke};
use super::style::{INK, at, font, line, px};

/// Why a node's curves end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The node stopped by itself; its state stays.
    Stopped,
    /// The node was away, and nothing is known of it.
    Away,
}

impl Kind {
    /// The word in the picture and in the legend.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Stopped => "stopped",
            Self::Away => "away",
        }
    }
}

/// A time without curves.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Mark {
    /// Id of the node.
    pub(super) id: usize,
    pub(super) from: f64,
    /// To the end where there is none.
    pub(super) to: Option<f64>,
    pub(super) kind: Kind,
}

impl Mark {
    /// Whether curves of the node are left out at `t`. What a node stopped with is still its state at that tick.
    pub(super) fn hides(&self, t: f64) -> bool {
        match self.kind {
            Kind::Stopped => t > self.from,
            Kind::Away => t >= self.from && self.to.is_none_or(|to| t < to),
        }
    }

    /// As words: `stopped at 1.2 s`.
    pub(super) fn words(&self) -> String {
        let time = |t: f64| crate::figure::figure(t, 4);
        match (self.kind, self.to) {
            (Kind::Stopped, _) => format!("stopped at {} s", time(self.from)),
            (Kind::Away, None) => format!("away from {} s on", time(self.from)),
            (Kind::Away, Some(to)) => format!("away from {} s to {} s", time(self.from), time(to)),
        }
    }

    /// A line across the picture; for an absence the time of it is shaded, up to the end of `span`.
    pub(super) fn draw<DB, CT>(
        &self,
        chart: &mut ChartContext<'_, DB, CT>,
        (span, heights): (&Range<f64>, &Range<f64>),
        colour: RGBColor,
    ) -> Result<(), PlotError>
    where
        DB: DrawingBackend,
        CT: CoordTranslate<From = (f64, f64)>,
    {
        let from = self.from.clamp(span.start, span.end);
        if self.kind == Kind::Away {
            let to = self.to.unwrap_or(span.end).clamp(from, span.end);
            let shade = Rectangle::new([(from, heights.start), (to, heights.end)], colour.mix(0.12).filled());
            chart.draw_series([shade]).map_err(PlotError::new)?;
        }
        let across = PathElement::new(vec![(from, heights.start), (from, heights.end)], line(colour, 1));
        chart.draw_series([across]).map(|_| ()).map_err(PlotError::new)
    }
}

/// `words` beside the line at `t`, on the side that has more room, below or above the height `y`.
pub(super) fn label<DB, CT>(
    chart: &mut ChartContext<'_, DB, CT>,
    span: &Range<f64>,
    (t, y): (f64, f64),
    vertical: VPos,
    words: String,
) -> Result<(), PlotError>
where
    DB: DrawingBackend,
    CT: CoordTranslate<From = (f64, f64)>,
{
    let left = t > 0.5 * (span.start + span.end);
    let side = if left { HPos::Right } else { HPos::Left };
    let style = TextStyle::from(font(13)).color(&INK).pos(Pos::new(side, vertical));
    let t = t.clamp(span.start, span.end);
    let text = EmptyElement::at((t, y)) + Text::new(words, at(if left { -4 } else { 4 }, 2), style);
    chart.draw_series([text]).map(|_| ()).map_err(PlotError::new)
}

/// A cross where a curve ends.
pub(super) fn cross<DB, CT>(
    chart: &mut ChartContext<'_, DB, CT>,
    at: (f64, f64),
    colour: RGBColor,
) -> Result<(), PlotError>
where
    DB: DrawingBackend,
    CT: CoordTranslate<From = (f64, f64)>,
{
    chart.draw_series([Cross::new(at, px(5), line(colour, 2))]).map(|_| ()).map_err(PlotError::new)
}

/// What a legend says of `marks`.
pub(super) fn entries<'a>(marks: impl Iterator<Item = &'a Mark> + Clone) -> impl Iterator<Item = Entry> {
    let any = move |kind| marks.clone().any(|mark| mark.kind == kind);
    let kinds = [(Kind::Stopped, Stroke::Cross), (Kind::Away, Stroke::Shade)];
    let entry =
        |(kind, stroke): (Kind, Stroke)| Entry { label: kind.word().to_owned(), style: line(INK, 1), stroke };
    kinds.into_iter().filter(move |&(kind, _)| any(kind)).map(entry)
}
