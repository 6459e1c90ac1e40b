//! Funnels by tick number, f32 and f64.

use funnelnet_law::Real;
use funnelnet_law::funnel::{Funnel, Normalised, Shape};
use funnelnet_law::funnel::{SampledFunnel, Widths};
use funnelnet_law::law::node_wise::THETA;

const TICK: f64 = 1e-3;

fn funnel(shape: Shape<f32>) -> SampledFunnel<f64> {
    SampledFunnel::new(&Funnel { factor: 2.0, shape }, TICK, THETA)
}

/// Both widths at tick `k` are those of `width(t)`.
fn is(funnel: &SampledFunnel<f64>, k: u32, width: impl Fn(f64) -> f64) {
    let widths = funnel.widths(k);
    let t = f64::from(k) * TICK;
    for (found, exact) in [(widths.now, width(t)), (widths.ahead, width(t + THETA * TICK))] {
        assert!((found - exact).abs() <= 1e-12 * exact.abs(), "k = {k}: {found} for {exact}");
    }
}

#[test]
fn each_kind_is_its_formula() {
    let exponential = funnel(Shape::Exponential { start: 40.0, end: 2.0, rate: 1.0 });
    let constant = funnel(Shape::Constant { width: 3.0 });
    let reciprocal = funnel(Shape::ReciprocalTime { scale: 0.5 });
    let finite = funnel(Shape::FiniteTime { start: 10.0, at_ns: 2_000_000_000, power: 1.5 });
    for k in [1, 2, 10, 999, 1500] {
        is(&exponential, k, |t| 2.0 * (38.0 * funnelnet_law::math::exp(-t) + 2.0));
        is(&constant, k, |_| 6.0);
        is(&reciprocal, k, |t| 1.0 / t);
        is(&finite, k, |t| 20.0 * funnelnet_law::math::pow(1.0 - t / 2.0, 1.5));
    }
}

#[test]
fn a_schedule_joins_what_lies_far_within_a_tick_or_has_closed() {
    let schedule = |at_ns, then| funnel(Shape::Schedule { start: 10.0, at_ns, eps: 0.5, then });
    let (wide, narrow) = (Normalised::Constant { width: 100.0 }, Normalised::Constant { width: 1e-6 });
    for (then, joined) in [(wide, 100.0), (narrow, 1e-6)] {
        for at_ns in [1, 1_000, 999_999] {
            let widths = schedule(at_ns, then).widths(0);
            assert!((widths.now - 20.0).abs() < 1e-12, "{at_ns} ns: {widths:?}");
            let past = f64::from(at_ns as u32) * 1e-9 < THETA * TICK;
            let least = if past { joined } else { 20.0f64.min(joined) };
            let most = if past { joined } else { 20.0f64.max(joined) };
            let slack = 1e-6 * joined;
            assert!(widths.ahead >= least - slack && widths.ahead <= most + slack, "{at_ns} ns: {widths:?}");
            assert!((schedule(at_ns, then).widths(1).now - joined).abs() < slack);
        }
    }
    let closed = schedule(1_000_000_000, Normalised::Exponential { start: 1.0, end: 0.0, rate: 1e4 });
    assert!((closed.widths(0).now - 20.0).abs() < 1e-12);
    assert!(closed.widths(500).now > 0.0 && closed.widths(500).now < 20.0);
    assert_eq!(closed.widths(1000).now, 0.0);
}

#[test]
fn the_ends_are_defined() {
    let reciprocal = funnel(Shape::ReciprocalTime { scale: 0.5 });
    assert_eq!(reciprocal.widths(0).now, f64::WIDEST);
    assert!((reciprocal.widths(0).ahead - 2000.0).abs() < 1e-9);
    let finite = funnel(Shape::FiniteTime { start: 10.0, at_ns: 2_000_000_000, power: 1.0 });
    assert!((finite.widths(0).now - 20.0).abs() < 1e-12);
    assert_eq!(finite.widths(2000).now, 0.0);
    assert_eq!(finite.widths(u32::MAX).ahead, 0.0);
}

/// In f32 the span of such a funnel is its end.
#[test]
fn a_funnel_that_widens_from_a_billionth_of_its_end_is_exact_from_its_start_on() {
    let (start, end, rate) = (1e-6f32, 1e3f32, 1.0f32);
    let exact = |t: f64| {
        let (start, end) = (f64::from(start), f64::from(end));
        start - (end - start) * funnelnet_law::math::exp_m1(-t)
    };
    let at_ns = 1_000_000;
    let then = Normalised::Exponential { start, end, rate };
    let schedule = Shape::Schedule { start: 1e-6, at_ns, eps: 1.0, then };
    for (shape, from) in [(Shape::Exponential { start, end, rate }, 0), (schedule, 1)] {
        let funnel: SampledFunnel<f32> = SampledFunnel::new(&Funnel { factor: 1.0, shape }, TICK, THETA);
        for k in [0, 1, 2, 10, 1_000, 100_000].into_iter().filter(|&k| k >= from) {
            let widths = funnel.widths(k);
            let t = f64::from(k) * TICK;
            for (found, exact) in [(widths.now, exact(t)), (widths.ahead, exact(t + THETA * TICK))] {
                let off = (f64::from(found) - exact).abs() / exact;
                assert!(off < 1e-6, "{shape:?} at {k}: {found} for {exact}");
            }
        }
    }
}

#[test]
fn both_ends_of_a_tick_are_floored_wherever_they_are_narrow() {
    let narrows = Widths { now: 3.0, ahead: 1.0 };
    let widens = Widths { now: 1.0, ahead: 3.0 };
    assert_eq!(narrows.floored(2.0), Widths { now: 3.0, ahead: 2.0 });
    assert_eq!(widens.floored(2.0), Widths { now: 2.0, ahead: 3.0 });
    assert!(narrows.clears(0.5) && !narrows.clears(2.0) && !widens.clears(2.0));
    assert!(narrows.floored(f64::NAN).now.is_nan(), "what is not a number stays one");
}
