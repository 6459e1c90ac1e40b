//! The steepest slope of a field that is known by its values alone.

use crate::extremes::largest;

/// The largest row sum of `|df/dx|` (1/s) that is found for states of `n` components up to `size` (state
/// units) and times up to `end` (s), at so many points, spread evenly (Weyl's sequence). `slope` is
/// `df_row / dx_column` at a time and a state.
pub(super) fn steepest(
    n: usize,
    size: f64,
    end: f64,
    slope: impl Fn(usize, usize, f64, &[f64]) -> f64,
) -> f64 {
    const POINTS: usize = 256;
    /// Steps whose multiples fill the unit interval evenly: roots of primes.
    const STEPS: [f64; 9] = [
        0.414_213_562,
        0.732_050_808,
        0.236_067_977,
        0.645_751_311,
        0.316_624_79,
        0.605_551_275,
        0.123_105_626,
        0.358_898_944,
        0.795_831_523,
    ];
    let at = |point: usize, axis: usize| (point as f64 * STEPS[axis]).fract();
    let row_sum =
        |row: usize, t: f64, x: &[f64]| (0..n).map(|column| slope(row, column, t, x).abs()).sum::<f64>();
    let points = (0..POINTS).map(|point| {
        let x: Vec<_> = (0..n).map(|axis| size * (2.0 * at(point, axis) - 1.0)).collect();
        let t = end * at(point, 8);
        largest(0.0, (0..n).map(|row| row_sum(row, t, &x)))
    });
    largest(0.0, points)
}
