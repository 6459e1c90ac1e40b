//! Drawing the pieces of a curve.

use plotters::coord::CoordTranslate;
use plotters::prelude::*;

use super::PlotError;
use super::legend::Stroke;
use super::style::px;
use super::thin::Piece;

/// Dashes of one curve at most: each is an element of the picture.
const DASHES: u32 = 4000;

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
                let longer = longer(length(chart, &piece), mark + space);
                let dashes = DashedLineSeries::new(piece, px(mark) * longer, px(space) * longer, self.style);
                chart.draw_series(dashes).map_err(PlotError::new)?;
            } else {
                chart.draw_series([PathElement::new(piece, self.style)]).map_err(PlotError::new)?;
            }
        }
        Ok(())
    }
}

/// The length of a line, in units of the drawing.
fn length<DB, CT>(chart: &ChartContext<'_, DB, CT>, piece: &Piece) -> f64
where
    DB: DrawingBackend,
    CT: CoordTranslate<From = (f64, f64)>,
{
    let at = |point: &(f64, f64)| chart.plotting_area().map_coordinate(point);
    let step = |pair: &[(f64, f64)]| {
        let [(x, y), (to_x, to_y)] = [at(&pair[0]), at(&pair[1])];
        f64::from(to_x - x).abs().max(f64::from(to_y - y).abs())
    };
    piece.windows(2).map(step).sum()
}

/// How many times as long as usual the dashes of a line of this `length` are, for a pattern of so many
/// pixels: a curve that goes up and down in every column has no end of short ones.
fn longer(length: f64, pattern: u32) -> u32 {
    let usual = length / f64::from(px(pattern));
    (usual / f64::from(DASHES)) as u32 + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_curve_has_longer_dashes_and_not_more_of_them() {
        assert_eq!([0.0, 1e4, 9.9e4, 2e5].map(|length| longer(length, 5)), [1, 1, 1, 3]);
        for length in [1e5, 1e7, 1e9] {
            assert!(length / f64::from(px(5) * longer(length, 5)) <= f64::from(DASHES));
        }
    }
}
