//! Quantiles over all nodes at one tick.

/// Shares of the nodes whose states are at or below a quantile.
pub const QUANTILES: [f64; 7] = [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0];

/// One tick. Each quantile is a value that some node has (nearest rank).
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Time, s.
    pub t: f64,
    /// Mean of the states, state units.
    pub mean: f64,
    /// Of the states, by [`QUANTILES`], state units.
    pub x: [f32; 7],
    /// Median, 95 % and largest of the true `|nu| / psi`, as the run is judged by it.
    pub ratio: [f32; 3],
    /// Median and largest of `|u|`, state units / s.
    pub input: [f32; 2],
}

impl Row {
    pub(super) fn of(
        t: f64,
        x: impl Iterator<Item = f32>,
        ratios: impl Iterator<Item = f32>,
        inputs: impl Iterator<Item = f32>,
    ) -> Self {
        let mut x: Vec<f32> = x.collect();
        let mean = x.iter().map(|&x| f64::from(x)).sum::<f64>() / x.len() as f64;
        let mut ratios: Vec<f32> = ratios.collect();
        let mut inputs: Vec<f32> = inputs.map(f32::abs).collect();
        Self {
            t,
            mean,
            x: quantiles(&mut x, QUANTILES),
            ratio: quantiles(&mut ratios, [0.5, 0.95, 1.0]),
            input: quantiles(&mut inputs, [0.5, 1.0]),
        }
    }
}

/// The values of these ranks; not a number where there are none.
fn quantiles<const N: usize>(values: &mut [f32], shares: [f64; N]) -> [f32; N] {
    shares.map(|share| {
        // The rank of a share is the smallest that leaves at least so many at or below it.
        let rank = ((share * values.len() as f64).ceil() as usize).max(1) - 1;
        if rank >= values.len() {
            return f32::NAN;
        }
        *values.select_nth_unstable_by(rank, f32::total_cmp).1
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_of_their_rank() {
        let mut values: Vec<f32> = (1..=100u8).rev().map(f32::from).collect();
        assert_eq!(quantiles(&mut values, QUANTILES), [1.0, 5.0, 25.0, 50.0, 75.0, 95.0, 100.0]);
        assert_eq!(quantiles(&mut [7.0], [0.0, 0.5, 1.0]), [7.0; 3]);
        assert!(quantiles(&mut [], [0.5])[0].is_nan());
    }
}
