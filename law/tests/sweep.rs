//! The gains in f32 against f64: every input there is, or a stride through them.
//!
//! Distances are in f32 numbers between the result and the f64 one rounded to f32 (ulps). The f64 gains are
//! the truth here; `assumption.rs` and `law.rs` judge those by themselves.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_law::gain::{Gain, GainFunction};
use funnelnet_law::range::{LARGEST, LARGEST_WEIGHT, SHORTEST_TICK_NS, SMALLEST};
use std::ops::Range;

/// A prime, so that every pattern of low bits turns up in every binade: 8 million numbers in a binade, 1,600
/// of them.
const STRIDE: u32 = 5003;
/// Samples of the fast variant of the sweep of (*), per gain.
const SOLUTIONS: u64 = 300_000;
/// Bits of infinity and of one: the positive numbers below.
const ALL: u32 = 0x7F80_0000;
const BELOW_ONE: u32 = 0x3F80_0000;
const SCALES: [f32; 5] = [1e-9, 1e-3, 1.0, 40.0, 1e9];

/// A gain in both precisions, with the same scale to the last bit.
#[derive(Clone, Copy, Debug)]
struct Pair {
    single: Gain<f32>,
    double: Gain<f64>,
}

fn reciprocal(scale: f32) -> Pair {
    let double = Gain::Reciprocal { scale: f64::from(scale) };
    Pair { single: Gain::Reciprocal { scale }, double }
}

fn logarithmic(scale: f32) -> Pair {
    let double = Gain::Logarithmic { scale: f64::from(scale) };
    Pair { single: Gain::Logarithmic { scale }, double }
}

fn locally_linear(bound: f32) -> Pair {
    let double = Gain::LocallyLinear { bound: f64::from(bound) };
    Pair { single: Gain::LocallyLinear { bound }, double }
}

/// The largest of something, and the input that it was seen at.
#[derive(Clone, Copy, Debug, Default)]
struct Worst {
    value: f64,
    at: f32,
}

impl Worst {
    fn note(&mut self, value: f64, at: f32) {
        if value > self.value || value.is_nan() {
            *self = Self { value, at };
        }
    }

    fn merge(self, other: Self) -> Self {
        if other.value <= self.value { self } else { other }
    }
}

/// What a sweep has seen. Ulps, but for `back_u`.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    /// `inverse` against f64.
    inverse: Worst,
    /// How far `inverse` falls from one input to the next.
    inverse_falls: Worst,
    /// 1 minus the true value where `inverse` is exactly 1, in units of 2^-24, half an ulp below 1.
    early: Worst,
    /// `inverse_slope` against f64, as long as it is above 1e-12 of the one at zero.
    slope: Worst,
    /// How far `inverse_slope` grows.
    slope_grows: Worst,
    /// `apply` against f64.
    apply: Worst,
    /// How far `apply` falls.
    apply_falls: Worst,
    /// `inverse(apply(s))` against `s`.
    back_s: Worst,
    /// `apply(inverse(u))` against `u`, relative, in f32 epsilons times the condition `s mu'(s) / mu(s)`.
    back_u: Worst,
}

impl Seen {
    fn merge(self, other: Self) -> Self {
        Self {
            inverse: self.inverse.merge(other.inverse),
            inverse_falls: self.inverse_falls.merge(other.inverse_falls),
            early: self.early.merge(other.early),
            slope: self.slope.merge(other.slope),
            slope_grows: self.slope_grows.merge(other.slope_grows),
            apply: self.apply.merge(other.apply),
            apply_falls: self.apply_falls.merge(other.apply_falls),
            back_s: self.back_s.merge(other.back_s),
            back_u: self.back_u.merge(other.back_u),
        }
    }
}

/// How many f32 numbers `x` lies above `y`, both positive or zero.
fn above(x: f32, y: f32) -> f64 {
    match x.is_nan() || y.is_nan() {
        true => f64::INFINITY,
        false => f64::from(x.to_bits()) - f64::from(y.to_bits()),
    }
}

fn ulps(found: f32, exact: f64) -> f64 {
    above(found, exact as f32).abs()
}

/// `inverse`, `inverse_slope` and the way back from them, at the numbers with `bits`.
fn sweep_inputs(gain: Pair, bits: Range<u32>, stride: u32) -> Seen {
    let mut seen = Seen::default();
    let steepest = gain.double.inverse_slope(0.0);
    let before = f32::from_bits(bits.start.saturating_sub(stride));
    let (mut s_before, mut slope_before) = (gain.single.inverse(before), gain.single.inverse_slope(before));
    for u in bits.step_by(stride as usize).map(f32::from_bits) {
        let (s, slope) = (gain.single.inverse(u), gain.single.inverse_slope(u));
        let (exact, exact_slope) =
            (gain.double.inverse(f64::from(u)), gain.double.inverse_slope(f64::from(u)));
        assert!((0.0..=1.0).contains(&s), "{gain:?}: mu^-1({u:e}) = {s:e}");
        assert!(slope >= 0.0 && slope.is_finite(), "{gain:?}: slope {slope:e} at {u:e}");
        let odd = gain.single.inverse(-u).to_bits() == (-s).to_bits();
        let even = gain.single.inverse_slope(-u).to_bits() == slope.to_bits();
        assert!(odd && even, "{gain:?}: not odd at {u:e}");
        seen.inverse.note(ulps(s, exact), u);
        if exact_slope >= 1e-12 * steepest {
            seen.slope.note(ulps(slope, exact_slope), u);
        }
        seen.inverse_falls.note(above(s_before, s).max(0.0), u);
        seen.slope_grows.note(above(slope, slope_before).max(0.0), u);
        if s == 1.0 {
            seen.early.note((1.0 - exact) * 16_777_216.0, u);
        } else if s >= f32::MIN_POSITIVE {
            let condition = exact / (f64::from(u) * exact_slope);
            let back = f64::from(gain.single.apply(s)) / f64::from(u) - 1.0;
            seen.back_u.note(back.abs() / (condition * f64::from(f32::EPSILON)), u);
        }
        (s_before, slope_before) = (s, slope);
    }
    seen
}

/// `apply` and the way back, at the numbers with `bits`, all below one.
fn sweep_ratios(gain: Pair, bits: Range<u32>, stride: u32) -> Seen {
    let mut seen = Seen::default();
    let mut u_before = gain.single.apply(f32::from_bits(bits.start.saturating_sub(stride)));
    for s in bits.step_by(stride as usize).map(f32::from_bits) {
        let u = gain.single.apply(s);
        assert!(u >= 0.0 && u.is_finite(), "{gain:?}: mu({s:e}) = {u:e}");
        assert!(gain.single.apply(-s).to_bits() == (-u).to_bits(), "{gain:?}: not odd at {s:e}");
        seen.apply.note(ulps(u, gain.double.apply(f64::from(s))), s);
        seen.apply_falls.note(above(u_before, u).max(0.0), s);
        if u >= f32::MIN_POSITIVE {
            seen.back_s.note(ulps(gain.single.inverse(u), f64::from(s)), s);
        }
        u_before = u;
    }
    seen
}

/// Shares `jobs` among the cores; the results in any order, since merging does not depend on it.
fn on_all_cores<J: Copy + Sync, R: Send>(jobs: &[J], work: impl Fn(J) -> R + Sync) -> Vec<R> {
    let next = std::sync::atomic::AtomicUsize::new(0);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        let run = || {
            let take = || next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
            std::iter::from_fn(|| jobs.get(take())).map(|job| work(*job)).collect::<Vec<_>>()
        };
        let threads: Vec<_> = (0..cores).map(|_| scope.spawn(run)).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    })
}

/// Every `stride`th positive number, and its negative, through the functions of one argument.
fn sweep(gain: Pair, stride: u32) -> Seen {
    const PARTS: u32 = 64;
    let jobs: Vec<u32> = (0..PARTS).collect();
    let part = |part: u32| {
        let share = |end: u32| (end / PARTS * part)..(end / PARTS * (part + 1));
        sweep_inputs(gain, share(ALL), stride).merge(sweep_ratios(gain, share(BELOW_ONE), stride))
    };
    on_all_cores(&jobs, part).into_iter().fold(Seen::default(), Seen::merge)
}

/// Bounds on what a sweep may see; the rest is common to all gains.
struct Limits {
    inverse: f64,
    slope: f64,
    apply: f64,
    back_s: f64,
}

fn assert_within(gain: Pair, stride: u32, limits: &Limits) {
    let seen = sweep(gain, stride);
    let bounds = [
        ("inverse", seen.inverse, limits.inverse),
        ("inverse falls", seen.inverse_falls, 1.0),
        ("1 before its time", seen.early, 0.500_001),
        ("inverse_slope", seen.slope, limits.slope),
        ("inverse_slope grows", seen.slope_grows, limits.slope),
        ("apply", seen.apply, limits.apply),
        ("apply falls", seen.apply_falls, limits.apply),
        ("inverse(apply(s))", seen.back_s, limits.back_s),
        ("apply(inverse(u))", seen.back_u, 2.5),
    ];
    for (name, worst, bound) in bounds {
        let Worst { value, at } = worst;
        println!("{:?}: {name}: {value}, at {at:e}", gain.single);
        assert!(value <= bound, "{:?}: {name}: {value} above {bound}, at {at:e}", gain.single);
    }
}

const OF_RECIPROCAL: Limits = Limits { inverse: 1.0, slope: 4.0, apply: 2.0, back_s: 3.0 };
/// The slope `exp(-u / scale)` has the rounding error of `u / scale` times that.
const OF_LOGARITHMIC: Limits = Limits { inverse: 2.0, slope: 32.0, apply: 2.0, back_s: 3.0 };
const OF_LOCALLY_LINEAR: Limits = Limits { inverse: 2.0, slope: 16.0, apply: 4.0, back_s: 3.0 };

#[test]
fn every_binade_of_every_function_is_near_double_precision() {
    for scale in SCALES {
        assert_within(reciprocal(scale), STRIDE, &OF_RECIPROCAL);
        assert_within(logarithmic(scale), STRIDE, &OF_LOGARITHMIC);
        assert_within(locally_linear(scale), STRIDE, &OF_LOCALLY_LINEAR);
    }
}

#[test]
#[ignore = "minutes: ./ci.sh sweep"]
fn every_number_of_every_function_is_near_double_precision() {
    assert_within(reciprocal(0.7), 1, &OF_RECIPROCAL);
    assert_within(logarithmic(0.7), 1, &OF_LOGARITHMIC);
    assert_within(locally_linear(0.7), 1, &OF_LOCALLY_LINEAR);
    assert_within(locally_linear(1e-3), 1, &OF_LOCALLY_LINEAR);
}

/// Uniform draws: SplitMix64 (Steele, Lea and Flood, 2014).
struct Draws(u64);

impl Draws {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in the logarithm; either end one time in sixteen.
    fn decades(&mut self, low: f64, high: f64) -> f64 {
        let share = ((self.uniform() * 18.0 - 1.0) / 16.0).clamp(0.0, 1.0);
        low * funnelnet_law::math::pow(high / low, share)
    }
}

/// `[scale, psi, b, r]` anywhere in what `params.rs` allows: widths from 1e-15 (below that, squares of the
/// closed form underflow, a million times below the smallest scale that a configuration can have) to
/// `WIDEST`, the constants `theta <= 1` and `c <= 2.5`, and an `r` of up to four times what the degree and
/// the largest state can make.
fn any_law(draws: &mut Draws) -> [f32; 4] {
    let scale = draws.decades(SMALLEST, LARGEST);
    let psi = draws.decades(1e-15, 1e18);
    let degree = draws.decades(SMALLEST, LARGEST_WEIGHT);
    let tick = draws.decades(f64::from(SHORTEST_TICK_NS) * 1e-9, f64::from(u32::MAX) * 1e-9);
    let r = match draws.uniform() < 0.5 {
        true => draws.decades(1e-15, 4.0 * degree * LARGEST),
        // Near the boundary of the funnel.
        false => {
            (psi * (1.0 + draws.decades(1e-8, 1.0) - draws.decades(1e-8, 1.0))).min(4.0 * degree * LARGEST)
        }
    };
    [scale, psi, 2.5 * tick * degree, r].map(|x| x as f32)
}

/// What a sweep of (*) has seen, and `[scale, psi, b, r]` where.
#[derive(Clone, Copy, Debug, Default)]
struct Solved {
    /// `|psi mu^-1(u) + b u - r| / |r|` in f64, in f32 epsilons.
    residual: (f64, [f32; 4]),
    /// `|s - mu^-1(u)|` in f64, in f32 epsilons of `s`.
    ratio: (f64, [f32; 4]),
    /// How far `s` falls where `r` grows by 0.1 %, in f32 epsilons of `s`.
    ratio_falls: (f64, [f32; 4]),
}

fn worse(old: (f64, [f32; 4]), new: (f64, [f32; 4])) -> (f64, [f32; 4]) {
    if new.0 <= old.0 { old } else { new }
}

impl Solved {
    fn merge(self, other: Self) -> Self {
        Self {
            residual: worse(self.residual, other.residual),
            ratio: worse(self.ratio, other.ratio),
            ratio_falls: worse(self.ratio_falls, other.ratio_falls),
        }
    }
}

fn solve_one(pair: fn(f32) -> Pair, at: [f32; 4]) -> Solved {
    let [scale, psi, b, r] = at;
    let gain = pair(scale);
    let found = gain.single.solve(psi, b, r);
    let bounded = found.u.is_finite() && (0.0..=1.0).contains(&found.s);
    assert!(bounded, "{at:?}: {found:?}");
    let mirrored = gain.single.solve(psi, b, -r);
    assert!(mirrored.u.to_bits() == (-found.u).to_bits() && mirrored.s == -found.s, "{at:?}: not odd");
    let more = gain.single.solve(psi, b, r * 1.001);
    // Below the normal numbers there are no 1.001ths.
    let normal = found.u.min(found.s) >= f32::MIN_POSITIVE;
    let grows = if normal { more.u > found.u } else { more.u >= found.u };
    assert!(grows, "{at:?}: {found:?}, but {more:?} for more");
    if !normal {
        return Solved::default();
    }
    let [u, s] = [found.u, found.s].map(f64::from);
    let exact = gain.double.inverse(u);
    let residual = (f64::from(psi) * exact + f64::from(b) * u - f64::from(r)).abs() / f64::from(r);
    let epsilons = |error: f64| (error / f64::from(f32::EPSILON), at);
    Solved {
        residual: epsilons(residual),
        ratio: epsilons((s - exact).abs() / exact),
        ratio_falls: epsilons((1.0 - f64::from(more.s) / s).max(0.0)),
    }
}

fn solve_many(pair: fn(f32) -> Pair, count: u64) -> Solved {
    let part = |seed: u64| {
        let mut draws = Draws(seed);
        (0..count / 64).fold(Solved::default(), |seen, _| seen.merge(solve_one(pair, any_law(&mut draws))))
    };
    let seeds: Vec<u64> = (1..=64).map(|seed| seed << 32).collect();
    on_all_cores(&seeds, part).into_iter().fold(Solved::default(), Solved::merge)
}

/// Bounds in f32 epsilons: residual, ratio, fall of the ratio.
fn assert_solves(pair: fn(f32) -> Pair, count: u64, limits: [f64; 3]) {
    let seen = solve_many(pair, count);
    let names = ["residual", "s against mu^-1(u)", "s falls"];
    for ((name, (value, at)), limit) in
        names.iter().zip([seen.residual, seen.ratio, seen.ratio_falls]).zip(limits)
    {
        let gain = pair(1.0).single;
        assert!(value <= limit, "{gain:?}: {name}: {value} above {limit}, at [scale, psi, b, r] = {at:?}");
    }
}

fn every_gain_solves(count: u64) {
    assert_solves(reciprocal, count, [4.0, 4.0, 4.0]);
    assert_solves(logarithmic, count, [3.0, 2.0, 1.0]);
    assert_solves(locally_linear, count, [16.0, 2.0, 1.0]);
}

#[test]
fn the_law_is_solved_wherever_a_configuration_may_be() {
    every_gain_solves(SOLUTIONS);
}

#[test]
#[ignore = "a minute: ./ci.sh sweep"]
fn the_law_is_solved_wherever_a_configuration_may_be_at_length() {
    every_gain_solves(SOLUTIONS * 100);
}
