//! Thinning a curve without losing its peaks, nor its gaps.

use funnelnet_law::math;

/// At most this many points a curve without gaps.
pub(super) const POINTS: usize = 2000;
/// Columns of the picture, of each of which the lowest and the highest point stay; the ends of a curve stay,
/// too.
const COLUMNS: usize = POINTS / 2 - 1;

/// Points that are joined by a line, in order of time.
pub(super) type Piece = Vec<(f64, f64)>;

/// The known points of a curve in pieces, a new one after every gap (NaN). Of many points, those that bound
/// the curve in each column of the picture are kept, in order, so that a single spike survives; the ends of
/// every piece stay.
pub(super) fn thin(points: &[(f64, f64)]) -> Vec<Piece> {
    let pieces: Vec<&[(f64, f64)]> = points.split(|p| p.1.is_nan()).filter(|p| !p.is_empty()).collect();
    if points.len() <= POINTS {
        return pieces.into_iter().map(<[_]>::to_vec).collect();
    }
    let (first, last) = (points[0].0, points[points.len() - 1].0);
    let column = |p: &(f64, f64)| math::floor((p.0 - first) / (last - first) * COLUMNS as f64) as usize;
    let alike = |a: &(f64, f64), b: &(f64, f64)| column(a) == column(b);
    if pieces.len() > COLUMNS / 4 {
        // More gaps than can be seen: a stroke for each column, joined to no other.
        let strokes = points.chunk_by(alike).map(|part| bounds(part).collect::<Piece>());
        return strokes.filter(|stroke| !stroke.is_empty()).collect();
    }
    pieces.into_iter().map(|piece| ends_and(piece, piece.chunk_by(alike).flat_map(bounds))).collect()
}

/// The lowest and the highest known point, in order of time; one where they are the same.
fn bounds(part: &[(f64, f64)]) -> impl Iterator<Item = (f64, f64)> {
    let known = || part.iter().filter(|p| !p.1.is_nan());
    let low = known().min_by(|a, b| a.1.total_cmp(&b.1)).copied();
    let high = known().rev().max_by(|a, b| a.1.total_cmp(&b.1)).copied();
    let (low, high) = if low.map(|p| p.0) <= high.map(|p| p.0) { (low, high) } else { (high, low) };
    low.into_iter().chain(high.filter(|&high| Some(high) != low))
}

/// `kept`, between the ends of `piece`.
fn ends_and(piece: &[(f64, f64)], kept: impl Iterator<Item = (f64, f64)>) -> Piece {
    let mut all: Piece =
        piece.first().copied().into_iter().chain(kept).chain(piece.last().copied()).collect();
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(rows: usize, y: impl Fn(usize) -> f64) -> Vec<(f64, f64)> {
        (0..rows).map(|k| (k as f64, y(k))).collect()
    }

    #[test]
    fn a_spike_survives_and_the_count_holds() {
        let ripple = |k: usize| if k == 7_777 { 9.0 } else { 0.001 * (k % 3) as f64 };
        let thinned = thin(&curve(20_001, ripple));
        let [piece] = thinned.as_slice() else { panic!("one piece") };
        assert!(piece.len() <= POINTS + 2, "{}", piece.len());
        assert!(piece.contains(&(7_777.0, 9.0)));
        assert_eq!((piece[0].0, piece[piece.len() - 1].0), (0.0, 20_000.0));
        assert!(piece.is_sorted_by(|a, b| a.0 < b.0));
    }

    #[test]
    fn a_spike_in_either_direction_survives_wherever_it_is() {
        for at in (1..30_000).step_by(997) {
            for spike in [-5.0, 5.0, f64::INFINITY] {
                let thinned = thin(&curve(30_000, |k| if k == at { spike } else { math::sin(k as f64) }));
                assert!(thinned.iter().flatten().any(|&p| p == (at as f64, spike)), "{spike} at {at}");
            }
        }
    }

    #[test]
    fn gaps_break_the_curve_and_a_single_point_between_them_stays() {
        let with_gaps = |k: usize| if k == 1 || k == 3 { f64::NAN } else { k as f64 };
        let pieces = thin(&curve(6, with_gaps));
        assert_eq!(pieces, [vec![(0.0, 0.0)], vec![(2.0, 2.0)], vec![(4.0, 4.0), (5.0, 5.0)]]);
    }

    #[test]
    fn gaps_of_a_long_curve_keep_their_ends() {
        let gap = |k: usize| if (5_001..9_003).contains(&k) && k != 7_000 { f64::NAN } else { 1.0 };
        let pieces = thin(&curve(20_000, gap));
        let ends = |piece: &Piece| (piece[0].0, piece[piece.len() - 1].0);
        let ends: Vec<_> = pieces.iter().map(ends).collect();
        assert_eq!(ends, [(0.0, 5_000.0), (7_000.0, 7_000.0), (9_003.0, 19_999.0)]);
    }

    #[test]
    fn a_curve_of_nothing_but_gaps_keeps_its_bounds_and_bridges_none() {
        let every_other = |k: usize| if k.is_multiple_of(2) { f64::NAN } else { (k % 10) as f64 };
        let pieces = thin(&curve(40_000, every_other));
        assert!(pieces.len() <= COLUMNS + 1 && pieces.iter().all(|piece| piece.len() <= 2));
        assert!(pieces.iter().all(|piece| piece.iter().any(|p| p.1 == 9.0)), "the highest of each column");
    }
}
