//! Drawing the pieces of a curve.

use plotters::coord::CoordTranslate;
use plotters::prelude::*;

use super::PlotError;
use super::legend::Stroke;
use super::style::px;
use super::thin::Piece;

/// A curve: its pieces, all inside the axes, and how it is drawn.
pub(super) struct Curve {
    pub(super) pieces: Vec<Piece>,
    pub(super) style: ShapeStyle,
    pub(super) stroke: Stroke,
}

impl Curve {
    pub(super) fn solid(pieces: Vec<Piece>, style: ShapeStyle) -> Self {
        Self { pieces, style, stroke: Stroke::Solid }
    }

    /// A piece of one point is a dot, since a line through one point cannot be seen.
    pub(super) fn draw<DB, CT>(self, chart: &mut ChartContext<'_, DB, CT>) -> Result<(), PlotError>
    where
        DB: DrawingBackend,
        CT: CoordTranslate<From = (f64, f64)>,
    {
        for piece in self.pieces {
            if let [point] = piece.as_slice() {
                let dot = Circle::new(*point, px(2), self.style.filled());
                chart.draw_series([dot]).map_err(PlotError::new)?;
            } else if let Some((mark, space)) = self.stroke.pattern() {
                let dashes = DashedLineSeries::new(piece, px(mark), px(space), self.style);
                chart.draw_series(dashes).map_err(PlotError::new)?;
            } else {
                chart.draw_series([PathElement::new(piece, self.style)]).map_err(PlotError::new)?;
            }
        }
        Ok(())
    }
}
