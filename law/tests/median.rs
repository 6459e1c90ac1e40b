//! The paper's distributed median (Section "Finding median agent", last example): `x_i' = f_i* - x_i + u_i`
//! with median gains and a funnel that shrinks to nothing ends at the `h*` of the emergent dynamics, whatever
//! the outliers say.
//!
//! The law alone in f64, driven with an exact exchange: what is left are the tick and the rounding. law.md 4
//! has the figures.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_law::emergent::{Agent, field};
use funnelnet_law::field::{VectorField, midpoint_step};
use funnelnet_law::funnel::SampledFunnel;
use funnelnet_law::funnel::{Funnel, Shape};
use funnelnet_law::gain::{Median, Reciprocal};
use funnelnet_law::law::node_wise::{Memory, NodeWise, THETA};

/// Seconds of a run: `psi` ends at 20 e^-30 = 1.9e-12.
const DURATION: f64 = 60.0;
/// Width of the median gain, state units / s.
const ETA: f64 = 0.02;

/// `f(x) = target - x`.
#[derive(Clone, Copy)]
struct Towards {
    target: f64,
}

impl VectorField<f64> for Towards {
    fn at(&self, _: u64, x: f64) -> f64 {
        self.target - x
    }
}

/// A ring, and a chord from every third agent across it; unit weights.
fn ring_with_chords(n: usize) -> Vec<Vec<usize>> {
    let mut neighbours = vec![Vec::new(); n];
    let mut join = |i: usize, j: usize| {
        if i != j && !neighbours[i].contains(&j) {
            neighbours[i].push(j);
            neighbours[j].push(i);
        }
    };
    for i in 0..n {
        join(i, (i + 1) % n);
        if i % 3 == 0 {
            join(i, (i + n / 2) % n);
        }
    }
    neighbours
}

/// `eps` of the median gain, below the `2 / (N + 1)` of the paper's lemma for equal funnels.
fn gain(n: usize) -> Reciprocal<f64> {
    Median { eta: ETA, eps: 0.9 * 2.0 / (n as f64 + 1.0) }.reciprocal()
}

/// The states after [`DURATION`] at ticks of `tick` (s), from states spread over [-1, 1].
fn run(values: &[f64], tick: f64) -> Vec<f64> {
    let (n, neighbours) = (values.len(), ring_with_chords(values.len()));
    let laws: Vec<_> = neighbours.iter().map(|of| NodeWise::new(gain(n), tick, of.len() as f64)).collect();
    let shape = Shape::Exponential { start: 20.0, end: 0.0, rate: 0.5 };
    let funnel = SampledFunnel::new(&Funnel { shape, factor: 1.0 }, tick, THETA);
    let mut memories = vec![Memory::default(); n];
    let mut x: Vec<f64> = (0..n).map(|i| 2.0 * i as f64 / n as f64 - 1.0).collect();
    let (mut dx, mut carry) = (vec![0.0; n], vec![0.0; n]);
    for k in 0..(DURATION / tick) as u32 {
        let diffusive = |i: usize, of: &[f64]| neighbours[i].iter().map(|&j| of[j] - of[i]).sum::<f64>();
        let step = |i: usize| {
            laws[i].step(&mut memories[i], diffusive(i, &x), diffusive(i, &dx), funnel.widths(k)).u
        };
        let inputs: Vec<f64> = (0..n).map(step).collect();
        for (i, u) in inputs.into_iter().enumerate() {
            let before = x[i];
            midpoint_step(&Towards { target: values[i] }, tick, u64::from(k), &mut x[i], &mut carry[i], u);
            dx[i] = x[i] - before;
        }
    }
    x
}

/// The exact `h*`: the emergent field of the values, for equal funnels.
fn exact(values: &[f64]) -> f64 {
    let gain = gain(values.len());
    let agents: Vec<_> = values.iter().map(|&f| Agent { psi: 1.0, f, gain }).collect();
    field(&agents, 0.0)
}

fn true_median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[values.len() / 2]
}

/// Largest distance of a state to `h`; NaN is the largest.
fn error(x: &[f64], h: f64) -> f64 {
    x.iter().map(|x| (x - h).abs()).max_by(f64::total_cmp).unwrap()
}

/// Values in [0, 1], and two of every five an outlier: one, two or three decades away, on either side.
fn values_with_outliers(n: usize) -> Vec<f64> {
    let golden = |i: usize| (i as f64 * 0.618_033_988_749_894_8).fract();
    let far = |i: usize| [10.0, -100.0, 1000.0][i / 5 % 3] * (1.0 + golden(i));
    (0..n).map(|i| if i % 5 < 2 { far(i) } else { golden(i) }).collect()
}

#[test]
fn the_median_is_found_to_six_digits_at_10_ms() {
    for n in [5, 11, 51] {
        let values = values_with_outliers(n);
        let outliers = values.iter().filter(|value| value.abs() >= 10.0).count();
        assert!(outliers * 5 >= 2 * n && outliers * 2 < n, "{outliers} of {n}");
        let h = exact(&values);
        let found = error(&run(&values, 0.01), h);
        assert!(found < 2e-6, "{n} agents: {found:e} from {h}");
    }
}

#[test]
fn ten_times_the_ticks_find_it_a_hundred_times_better() {
    let values = values_with_outliers(11);
    let h = exact(&values);
    let (coarse, fine) = (error(&run(&values, 0.01), h), error(&run(&values, 0.001), h));
    assert!(fine < 2e-8 && coarse / fine > 80.0 && coarse / fine < 120.0, "{coarse:e} and {fine:e}");
}

/// Values in [0, 1]; five of those above 0.6 are about `far` instead, so that the median stays where it is.
fn with_five_at(far: f64) -> Vec<f64> {
    let value = |i: usize| (i as f64 * 0.618_033_988_749_894_8).fract();
    let mut values: Vec<f64> = (0..51).map(value).collect();
    let mut left = 5;
    for (i, value) in values.iter_mut().enumerate() {
        if i % 7 < 2 && *value > 0.6 && left > 0 {
            *value = far * (1.0 + 0.01 * i as f64);
            left -= 1;
        }
    }
    assert_eq!(left, 0);
    values
}

#[test]
fn how_far_away_outliers_are_does_not_matter() {
    let (mild, wild) = (with_five_at(1.0), with_five_at(1000.0));
    let (before, after) = (run(&mild, 0.01), run(&wild, 0.01));
    let off = error(&after, true_median(&wild));
    assert!(off < ETA + 1e-3, "{off} from the median {}", true_median(&wild));
    let moved = (0..51).map(|i| (before[i] - after[i]).abs()).max_by(f64::total_cmp).unwrap();
    assert!(moved < ETA, "moved by {moved}");
    // The mean, which the same network without these gains would tend to, goes along with them.
    let mean = |values: &[f64]| values.iter().sum::<f64>() / 51.0;
    assert!(mean(&wild) - mean(&mild) > 90.0);
}
