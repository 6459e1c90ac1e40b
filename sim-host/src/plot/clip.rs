//! What of a curve is inside the axes. It leaves them where it crosses the edge, and nothing is drawn along
//! the edge.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::style::{BREACH, at, font};
use super::thin::Piece;
use super::{PlotError, text};

/// Size of the font of what is said.
const SIZE: u32 = 14;

/// Stands for an infinite value: large enough, and differences of two stay finite.
const FAR: f64 = 1e300;

/// The parts of `pieces` with values inside `range`.
pub(super) fn clip(pieces: Vec<Piece>, range: &Range<f64>) -> Vec<Piece> {
    let inside = |p: &(f64, f64)| (range.start..=range.end).contains(&p.1);
    let mut clipped = Vec::new();
    for piece in pieces {
        let mut open: Piece = piece.first().filter(|p| inside(p)).copied().into_iter().collect();
        for pair in piece.windows(2) {
            let &[a, b] = pair else { continue };
            match (inside(&a), inside(&b)) {
                (true, true) => open.push(b),
                (true, false) => {
                    open.push(crossing(a, b, edge(b, range)));
                    clipped.push(std::mem::take(&mut open));
                }
                (false, true) => open = vec![crossing(a, b, edge(a, range)), b],
                (false, false) if edge(a, range) != edge(b, range) => {
                    clipped.push([a, b].map(|p| crossing(a, b, edge(p, range))).to_vec());
                }
                (false, false) => {}
            }
        }
        clipped.push(open);
    }
    clipped.retain(|piece| !piece.is_empty());
    clipped
}

/// The edge beyond which `p` is.
fn edge(p: (f64, f64), range: &Range<f64>) -> f64 {
    if p.1 > range.end { range.end } else { range.start }
}

/// Where the line from `a` to `b` has the value `at`.
fn crossing(a: (f64, f64), b: (f64, f64), at: f64) -> (f64, f64) {
    let (from, to) = (a.1.clamp(-FAR, FAR), b.1.clamp(-FAR, FAR));
    let share = ((at - from) / (to - from)).clamp(0.0, 1.0);
    (a.0 + share * (b.0 - a.0), at)
}

/// The value of the largest size that is not inside `range`, in words for the picture.
pub(super) fn words(values: impl Iterator<Item = f64>, range: &Range<f64>) -> Option<String> {
    let outside = values.filter(|v| !v.is_nan() && !(range.start..=range.end).contains(v));
    let most = outside.map(f64::abs).max_by(f64::total_cmp)?;
    Some(if most.is_finite() {
        format!("clipped: values up to {}", short(most))
    } else {
        "clipped: values up to infinity".to_owned()
    })
}

/// Writes `words`, where there are some, into the upper right corner of a plot with its corner `(x, y)`
/// there, in pixels, over what is drawn.
pub(super) fn say<DB: DrawingBackend>(
    area: &DrawingArea<DB, Shift>,
    (x, y): (i32, i32),
    words: Option<String>,
) -> Result<(), PlotError> {
    let Some(words) = words else { return Ok(()) };
    let left = x - text::width(&words, SIZE) as i32 - 12;
    let ground = Rectangle::new([at(left, y + 1), at(x - 1, y + 20)], WHITE.mix(0.85).filled());
    area.draw(&ground).map_err(PlotError::new)?;
    let style = TextStyle::from(font(SIZE)).color(&BREACH).pos(Pos::new(HPos::Right, VPos::Top));
    area.draw(&Text::new(words, at(x - 6, y + 4), style)).map_err(PlotError::new)
}

/// Two digits, as `8e8` or `120`.
fn short(value: f64) -> String {
    crate::number_format::significant(value, 2).replace(".0e", "e").replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_ends_where_it_crosses_the_edge_and_begins_again_where_it_comes_back() {
        let spike = vec![(0.0, 0.0), (1.0, 4.0), (2.0, 0.0), (3.0, -4.0), (4.0, 4.0)];
        let expected = [
            vec![(0.0, 0.0), (0.5, 2.0)],
            vec![(1.5, 2.0), (2.0, 0.0), (2.5, -2.0)],
            vec![(3.25, -2.0), (3.75, 2.0)],
        ];
        assert_eq!(clip(vec![spike], &(-2.0..2.0)), expected);
    }

    #[test]
    fn a_curve_that_begins_infinite_comes_in_from_above() {
        let clipped = clip(vec![vec![(0.0, f64::INFINITY), (1.0, 1.0), (2.0, 0.5)]], &(0.0..2.0));
        let [piece] = clipped.as_slice() else { panic!("{clipped:?}") };
        assert_eq!(piece[0].1, 2.0);
        assert!((piece[0].0 - 1.0).abs() < 1e-9, "{piece:?}");
    }

    #[test]
    fn what_is_cut_is_said() {
        let said = |values: &[f64]| words(values.iter().copied(), &(-1.0..1.0));
        assert_eq!(said(&[0.5, f64::NAN]), None);
        assert_eq!(said(&[0.5, -8e8, 3.0]).unwrap(), "clipped: values up to 8e8");
        assert_eq!(said(&[f64::NEG_INFINITY]).unwrap(), "clipped: values up to infinity");
    }
}
