//! Funnels by tick number, f32 and f64.

use funnel_core::Real;
use funnel_core::funnel::Funnel;
use funnel_core::law::node_wise::THETA;
use funnel_protocol::config::{FunnelConfig, FunnelShape};

const TICK: f64 = 1e-3;

fn funnel(shape: FunnelShape) -> Funnel<f64> {
    Funnel::new(&FunnelConfig { factor: 2.0, shape }, TICK, THETA)
}

/// Both widths at tick `k` are those of `width(t)`.
fn is(funnel: &Funnel<f64>, k: u32, width: impl Fn(f64) -> f64) {
    let widths = funnel.widths(k);
    let t = f64::from(k) * TICK;
    for (found, exact) in [(widths.now, width(t)), (widths.ahead, width(t + THETA * TICK))] {
        assert!((found - exact).abs() <= 1e-12 * exact.abs(), "k = {k}: {found} for {exact}");
    }
}

#[test]
fn each_kind_is_its_formula() {
    let exponential = funnel(FunnelShape::Exponential { start: 40.0, end: 2.0, rate: 1.0 });
    let constant = funnel(FunnelShape::Constant { width: 3.0 });
    let reciprocal = funnel(FunnelShape::ReciprocalTime { scale: 0.5 });
    let finite = funnel(FunnelShape::FiniteTime { start: 10.0, at_ns: 2_000_000_000, power: 1.5 });
    for k in [1, 2, 10, 999, 1500] {
        is(&exponential, k, |t| 2.0 * (38.0 * funnel_core::math::exp(-t) + 2.0));
        is(&constant, k, |_| 6.0);
        is(&reciprocal, k, |t| 1.0 / t);
        is(&finite, k, |t| 20.0 * funnel_core::math::pow(1.0 - t / 2.0, 1.5));
    }
}

#[test]
fn the_ends_are_defined() {
    let reciprocal = funnel(FunnelShape::ReciprocalTime { scale: 0.5 });
    assert_eq!(reciprocal.widths(0).now, f64::WIDEST);
    assert!((reciprocal.widths(0).ahead - 2000.0).abs() < 1e-9);
    let finite = funnel(FunnelShape::FiniteTime { start: 10.0, at_ns: 2_000_000_000, power: 1.0 });
    assert!((finite.widths(0).now - 20.0).abs() < 1e-12);
    assert_eq!(finite.widths(2000).now, 0.0);
    assert_eq!(finite.widths(u32::MAX).ahead, 0.0);
}
