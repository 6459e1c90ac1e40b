//! Where a node stops or is away, nothing is known of it, or nothing changes any more, and the picture says
//! so. It also says when links are cut.

use std::ops::Range;

use plotters::coord::CoordTranslate;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::PlotError;
use super::legend::{Entry, Stroke};
use super::style::{INK, at, font, line, px};

/// Why a node's curves end, or move apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// The node stopped by itself; its state stays.
    Stopped,
    /// The node was away, and nothing is known of it.
    Away,
    /// An event has cut links of the network, which is no node's own.
    Cut,
    /// Another event of this kind goes on, which takes no curve away.
    Event(&'static str),
}

impl Kind {
    /// The word in the picture and in the legend.
    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Stopped => "stopped",
            Self::Away => "away",
            Self::Cut => "links cut",
            Self::Event(kind) => kind,
        }
    }
}

/// A time without curves, or with links that are cut.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Mark {
    /// Id of the node; 0 for the network.
    pub(super) id: usize,
    pub(super) from: f64,
    /// To the end where there is none.
    pub(super) to: Option<f64>,
    pub(super) kind: Kind,
}

impl Mark {
    /// Whether curves of the node are left out at `t`. What a node stopped with is still its state at that
    /// tick.
    pub(super) fn hides(&self, t: f64) -> bool {
        match self.kind {
            Kind::Stopped => t > self.from,
            Kind::Cut | Kind::Event(_) => false,
            Kind::Away => t >= self.from && self.to.is_none_or(|to| t < to),
        }
    }

    /// Whose it is, and the word: `node 3 away`.
    pub(super) fn label(&self) -> String {
        match self.id {
            0 => self.kind.word().to_owned(),
            id => format!("node {id} {}", self.kind.word()),
        }
    }

    /// As words: `stopped at 1.2 s`.
    pub(super) fn words(&self) -> String {
        let time = |t: f64| crate::number_format::significant(t, 4);
        match (self.kind, self.to) {
            (Kind::Stopped, _) => format!("stopped at {} s", time(self.from)),
            (kind, None) => format!("{} from {} s on", kind.word(), time(self.from)),
            (kind, Some(to)) if to <= self.from => format!("{} at {} s", kind.word(), time(self.from)),
            (kind, Some(to)) => format!("{} from {} s to {} s", kind.word(), time(self.from), time(to)),
        }
    }

    /// A line across the picture; for what lasts, the time of it is shaded, up to the end of `span`.
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
        if self.kind != Kind::Stopped {
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
    let mut kinds =
        vec![(Kind::Stopped, Stroke::Cross), (Kind::Away, Stroke::Shade), (Kind::Cut, Stroke::Shade)];
    for mark in marks.clone() {
        if matches!(mark.kind, Kind::Event(_)) && !kinds.contains(&(mark.kind, Stroke::Shade)) {
            kinds.push((mark.kind, Stroke::Shade));
        }
    }
    let any = move |kind| marks.clone().any(|mark| mark.kind == kind);
    let entry =
        |(kind, stroke): (Kind, Stroke)| Entry { label: kind.word().to_owned(), style: line(INK, 1), stroke };
    kinds.into_iter().filter(move |&(kind, _)| any(kind)).map(entry)
}
