//! Double-double arithmetic: an unevaluated sum of two f64, some 31 decimal digits (T. J. Dekker 1971, Y.
//! Hida et al. 2001).
//!
//! Enough to evaluate `H` and its closed forms far below the rounding of f64, and independent of what is
//! tested.

use core::cmp::Ordering;
use core::ops::{Add, Div, Mul, Neg, Sub};
use funnelnet_law::math;

/// `high + low`, with `low` at most half an ulp of `high`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Double {
    high: f64,
    low: f64,
}

/// `a + b` exactly.
fn two_sum(a: f64, b: f64) -> Double {
    let high = a + b;
    let part = high - a;
    Double { high, low: (a - (high - part)) + (b - part) }
}

/// The upper and the lower half of the significand.
fn halves(a: f64) -> (f64, f64) {
    let scaled = 134_217_729.0 * a;
    let upper = scaled - (scaled - a);
    (upper, a - upper)
}

/// `a * b` exactly, short of over- and underflow.
fn two_product(a: f64, b: f64) -> Double {
    let high = a * b;
    let ((a1, a2), (b1, b2)) = (halves(a), halves(b));
    Double { high, low: ((a1 * b1 - high) + a1 * b2 + a2 * b1) + a2 * b2 }
}

impl Double {
    pub const ZERO: Self = Self { high: 0.0, low: 0.0 };
    pub const ONE: Self = Self { high: 1.0, low: 0.0 };
    const LN_2: Self = Self { high: core::f64::consts::LN_2, low: 2.319_046_813_846_299_6e-17 };

    /// The nearest f64.
    pub fn nearest(self) -> f64 {
        self.high
    }

    /// Times a power of two, or any factor that rounds nothing.
    fn scale(self, factor: f64) -> Self {
        Self { high: self.high * factor, low: self.low * factor }
    }

    /// Half of it.
    pub fn half(self) -> Self {
        self.scale(0.5)
    }

    /// The square root of a number that is not negative.
    pub fn sqrt(self) -> Self {
        if self.high <= 0.0 {
            return Self::ZERO;
        }
        let root = Self::from(self.high.sqrt());
        root + (self - root * root) / (root + root)
    }

    /// `e^x`: zero where it would underflow.
    pub fn exp(self) -> Self {
        if self.high < -700.0 {
            return Self::ZERO;
        }
        let twos = (self.high / core::f64::consts::LN_2).round();
        let reduced = (self - Self::LN_2 * Self::from(twos)).scale(1.0 / 512.0);
        // e^r - 1 by its series, then doubled nine times: (1 + p)^2 - 1 = 2 p + p^2.
        let mut power =
            (1..=9).rev().fold(Self::ZERO, |sum, k| reduced / Self::from(f64::from(k)) * (Self::ONE + sum));
        for _ in 0..9 {
            power = power + power + power * power;
        }
        (Self::ONE + power).scale(math::pow(2.0, twos))
    }

    /// The natural logarithm of a number above zero.
    pub fn ln(self) -> Self {
        let mut y = Self::from(math::ln(self.high));
        for _ in 0..2 {
            y = y + self * (-y).exp() - Self::ONE;
        }
        y
    }
}

impl From<f64> for Double {
    fn from(high: f64) -> Self {
        Self { high, low: 0.0 }
    }
}

impl Add for Double {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        let (high, low) = (two_sum(self.high, other.high), two_sum(self.low, other.low));
        let first = two_sum(high.high, high.low + low.high);
        two_sum(first.high, first.low + low.low)
    }
}

impl Neg for Double {
    type Output = Self;
    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}

impl Sub for Double {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Double {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let product = two_product(self.high, other.high);
        two_sum(product.high, product.low + (self.high * other.low + self.low * other.high))
    }
}

impl Div for Double {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let first = self.high / other.high;
        let rest = self - other * Self::from(first);
        let second = rest.high / other.high;
        let third = (rest - other * Self::from(second)).high / other.high;
        two_sum(first, second) + Self::from(third)
    }
}

impl PartialOrd for Double {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        (*self - *other).high.partial_cmp(&0.0)
    }
}

impl core::iter::Sum for Double {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        terms.fold(Self::ZERO, Add::add)
    }
}

/// That the arithmetic has the digits which the other tests rest on.
#[test]
fn thirty_digits() {
    let third = Double::ONE / Double::from(3.0);
    assert!((third + third + third - Double::ONE).nearest().abs() < 1e-31);
    let two = Double::from(2.0);
    assert!((two.sqrt() * two.sqrt() - two).nearest().abs() < 1e-31);
    // e and pi to more digits than f64 has: e^1, and exp(ln x) = x.
    let e = Double { high: core::f64::consts::E, low: 1.445_646_891_729_250_2e-16 };
    assert!((Double::ONE.exp() - e).nearest().abs() < 1e-30);
    for x in [1e-9, 0.3, 1.0, 1.000_001, 77.0, 1e12] {
        let x = Double::from(x);
        assert!(((x.ln().exp() - x) / x).nearest().abs() < 1e-29);
    }
}
