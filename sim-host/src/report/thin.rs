//! Thinning a curve without losing its peaks.

/// At most this many points a curve.
pub(super) const POINTS: usize = 2000;

/// The finite points of a curve, thinned to at most [`POINTS`]: of each stretch the first lowest and
/// highest, in order, so that a single spike survives. Both ends stay.
pub(super) fn thin(t: &[f64], y: impl Fn(usize) -> f64) -> Vec<(f64, f64)> {
    let finite: Vec<(f64, f64)> =
        t.iter().enumerate().map(|(k, &t)| (t, y(k))).filter(|p| p.1.is_finite()).collect();
    if finite.len() <= POINTS {
        return finite;
    }
    let inner = &finite[1..finite.len() - 1];
    let stretch = inner.len().div_ceil((POINTS - 2) / 2);
    let mut thinned = vec![finite[0]];
    for part in inner.chunks(stretch) {
        let by = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let (low, high) = (part.iter().min_by(by), part.iter().max_by(by));
        let mut pair: Vec<_> = low.into_iter().chain(high).copied().collect();
        pair.sort_by(|a, b| a.0.total_cmp(&b.0));
        pair.dedup();
        thinned.extend(pair);
    }
    thinned.extend(finite.last());
    thinned
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spike_survives_and_the_count_holds() {
        let t: Vec<f64> = (0..20_001).map(f64::from).collect();
        let thinned = thin(&t, |k| if k == 7_777 { 9.0 } else { 0.001 * (k % 3) as f64 });
        assert!(thinned.len() <= POINTS);
        assert!(thinned.contains(&(7_777.0, 9.0)));
        assert_eq!((thinned[0].0, thinned[thinned.len() - 1].0), (0.0, 20_000.0));
        assert!(thinned.is_sorted_by(|a, b| a.0 < b.0));
    }

    #[test]
    fn gaps_are_left_out() {
        assert_eq!(thin(&[0.0, 1.0, 2.0], |k| [1.0, f64::NAN, 3.0][k]), [(0.0, 1.0), (2.0, 3.0)]);
    }
}
