//! Numbers that carry a derivative along (forward mode, W. K. Clifford's dual numbers): the program that
//! gives `f` gives its slope as well.

use funnelnet_law::math::Real;
use std::cmp::Ordering;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A value and its derivative by one variable. Compared by the value.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Dual {
    pub value: f64,
    pub slope: f64,
}

impl Dual {
    /// What does not depend on the variable.
    pub const fn constant(value: f64) -> Self {
        Self { value, slope: 0.0 }
    }

    /// `f(self)`, with `f'` there.
    fn by(self, value: f64, derivative: f64) -> Self {
        // What does not move has no slope, however steep the function is there: 0 times infinity is no
        // number.
        let slope = if self.slope == 0.0 { 0.0 } else { derivative * self.slope };
        Self { value, slope }
    }
}

impl PartialEq for Dual {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl PartialOrd for Dual {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, slope: self.slope + other.slope }
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, slope: self.slope - other.slope }
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self { value: self.value * other.value, slope: self.slope * other.value + self.value * other.slope }
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Self { value, slope: (self.slope - value * other.slope) / other.value }
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, slope: -self.slope }
    }
}

impl AddAssign for Dual {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Real for Dual {
    const ZERO: Self = Self::constant(0.0);
    const ONE: Self = Self::constant(1.0);
    const TWO: Self = Self::constant(2.0);
    const HALF: Self = Self::constant(0.5);
    const EPSILON: Self = Self::constant(f64::EPSILON);
    const WIDEST: Self = Self::constant(<f64 as Real>::WIDEST);
    const TINY: Self = Self::constant(<f64 as Real>::TINY);

    fn from_f32(x: f32) -> Self {
        Self::constant(x.into())
    }
    fn from_f64(x: f64) -> Self {
        Self::constant(x)
    }
    fn from_u32(x: u32) -> Self {
        Self::constant(x.into())
    }
    fn from_i32(x: i32) -> Self {
        Self::constant(x.into())
    }
    fn from_u64(x: u64) -> Self {
        Self::constant(x as f64)
    }
    fn to_f32(self) -> f32 {
        self.value as f32
    }
    fn to_f64(self) -> f64 {
        self.value
    }
    fn abs(self) -> Self {
        if self.value < 0.0 { -self } else { self }
    }
    fn max(self, other: Self) -> Self {
        if self.value >= other.value || other.value.is_nan() { self } else { other }
    }
    fn min(self, other: Self) -> Self {
        if self.value <= other.value || other.value.is_nan() { self } else { other }
    }
    fn copysign(self, sign: Self) -> Self {
        if self.value.is_sign_negative() == sign.value.is_sign_negative() { self } else { -self }
    }
    fn is_finite(self) -> bool {
        self.value.is_finite()
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.by(root, 0.5 / root)
    }
    fn exp(self) -> Self {
        let exp = Real::exp(self.value);
        self.by(exp, exp)
    }
    fn exp_m1(self) -> Self {
        self.by(Real::exp_m1(self.value), Real::exp(self.value))
    }
    fn ln_1p(self) -> Self {
        self.by(Real::ln_1p(self.value), 1.0 / (1.0 + self.value))
    }
    fn pow(self, exponent: Self) -> Self {
        let power = Real::pow(self.value, exponent.value);
        let by_base = self.by(power, exponent.value * Real::pow(self.value, exponent.value - 1.0));
        let by_exponent = exponent.by(power, power * Real::ln(self.value));
        // What does not change has no part in it, where its factor is no number either: a base of 0.
        let part = |changes: bool, slope: f64| if changes { slope } else { 0.0 };
        let slope = part(self.slope != 0.0, by_base.slope) + part(power != 0.0, by_exponent.slope);
        Self { value: power, slope }
    }
    fn sin_turns(turns: u64) -> Self {
        Self::constant(<f64 as Real>::sin_turns(turns))
    }
    fn sin(self) -> Self {
        self.by(Real::sin(self.value), Real::cos(self.value))
    }
    fn cos(self) -> Self {
        self.by(Real::cos(self.value), -Real::sin(self.value))
    }
    fn tan(self) -> Self {
        let tan = Real::tan(self.value);
        self.by(tan, 1.0 + tan * tan)
    }
    fn ln(self) -> Self {
        self.by(Real::ln(self.value), 1.0 / self.value)
    }
    fn tanh(self) -> Self {
        let tanh = Real::tanh(self.value);
        self.by(tanh, 1.0 - tanh * tanh)
    }
}
