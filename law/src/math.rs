//! Elementary functions. The only file that calls `libm`: the same bits on a host and on a Cortex-M;
//! `std` floats differ between machines (clippy.toml refuses them).
//!
//! The one function of our own is the f32 sine of a phase in turns: `libm::sinf` computes in f64, which an
//! M4F does in software (docs/notes/2026-11-23-first-light.md has the counts).

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A floating-point type that the law is written in: f32 on a node, f64 for reference.
pub trait Real:
    Copy
    + PartialOrd
    + Default
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + 'static
{
    /// Zero.
    const ZERO: Self;
    /// One.
    const ONE: Self;
    /// Two.
    const TWO: Self;
    /// One half.
    const HALF: Self;
    /// Relative distance of neighbouring numbers.
    const EPSILON: Self;
    /// Widest funnel: infinite for every purpose, and no product with it overflows.
    const WIDEST: Self;
    /// Smallest width that a funnel ever has, far below any resolution, so that ratios stay defined.
    const TINY: Self;

    /// From single precision, exactly.
    fn from_f32(x: f32) -> Self;
    /// From double precision, rounded.
    fn from_f64(x: f64) -> Self;
    /// From an integer, rounded.
    fn from_u32(x: u32) -> Self;
    /// From an integer, rounded.
    fn from_i32(x: i32) -> Self;
    /// From an integer, rounded.
    fn from_u64(x: u64) -> Self;
    /// To single precision, rounded.
    fn to_f32(self) -> f32;
    /// To double precision, exactly.
    fn to_f64(self) -> f64;
    /// Absolute value.
    fn abs(self) -> Self;
    /// The larger; the other one where one is NaN.
    fn max(self, other: Self) -> Self;
    /// The smaller; the other one where one is NaN.
    fn min(self, other: Self) -> Self;
    /// This magnitude with the sign of `sign`.
    fn copysign(self, sign: Self) -> Self;
    /// Whether neither NaN nor infinite.
    fn is_finite(self) -> bool;
    /// Square root.
    fn sqrt(self) -> Self;
    /// `e^x`.
    fn exp(self) -> Self;
    /// `e^x - 1`, exact near zero.
    fn exp_m1(self) -> Self;
    /// `ln(1 + x)`, exact near zero.
    fn ln_1p(self) -> Self;
    /// `self^exponent` for `self >= 0`.
    fn pow(self, exponent: Self) -> Self;
    /// Sine of a phase counted in 2^-64 turns.
    fn sin_turns(turns: u64) -> Self;
    /// Sine of an angle in radians.
    fn sin(self) -> Self;
    /// Cosine of an angle in radians.
    fn cos(self) -> Self;
    /// Tangent of an angle in radians.
    fn tan(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// Hyperbolic tangent.
    fn tanh(self) -> Self;
}

/// Larger of two numbers; NaN if one of them is NaN, so that every comparison with it fails ([`Real::max`]
/// drops NaN).
///
/// ```
/// use funnelnet_law::math::larger;
/// // Not a number stays: a maximum that drops it would pass a test that it should fail.
/// assert!(larger(1.0, f64::NAN).is_nan());
/// ```
#[inline]
#[must_use]
pub fn larger<F: Real>(a: F, b: F) -> F {
    // Only a NaN differs from itself.
    #[allow(clippy::eq_op)]
    let b_counts = a <= b || b != b;
    if b_counts { b } else { a }
}

macro_rules! real {
    ($t:ident, $sqrt:path, $exp:path, $expm1:path, $log1p:path, $pow:path, $sin_turns:path, $sin:path, $cos:path, $tan:path,
        $ln:path, $tanh:path) => {
        impl Real for $t {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const TWO: Self = 2.0;
            const HALF: Self = 0.5;
            const EPSILON: Self = $t::EPSILON;
            const WIDEST: Self = 1e18;
            const TINY: Self = 1e-30;

            #[inline]
            fn from_f32(x: f32) -> Self {
                x as Self
            }
            #[inline]
            fn from_f64(x: f64) -> Self {
                x as Self
            }
            #[inline]
            fn from_u32(x: u32) -> Self {
                x as Self
            }
            #[inline]
            fn from_i32(x: i32) -> Self {
                x as Self
            }
            #[inline]
            fn from_u64(x: u64) -> Self {
                x as Self
            }
            #[inline]
            fn to_f32(self) -> f32 {
                self as f32
            }
            #[inline]
            fn to_f64(self) -> f64 {
                self as f64
            }
            #[inline]
            fn abs(self) -> Self {
                $t::abs(self)
            }
            #[inline]
            fn max(self, other: Self) -> Self {
                $t::max(self, other)
            }
            #[inline]
            fn min(self, other: Self) -> Self {
                $t::min(self, other)
            }
            #[inline]
            fn copysign(self, sign: Self) -> Self {
                $t::copysign(self, sign)
            }
            #[inline]
            fn is_finite(self) -> bool {
                $t::is_finite(self)
            }
            #[inline]
            fn sqrt(self) -> Self {
                $sqrt(self)
            }
            #[inline]
            fn exp(self) -> Self {
                $exp(self)
            }
            #[inline]
            fn exp_m1(self) -> Self {
                $expm1(self)
            }
            #[inline]
            fn ln_1p(self) -> Self {
                $log1p(self)
            }
            #[inline]
            fn pow(self, exponent: Self) -> Self {
                $pow(self, exponent)
            }
            #[inline]
            fn sin_turns(turns: u64) -> Self {
                $sin_turns(turns)
            }
            #[inline]
            fn sin(self) -> Self {
                $sin(self)
            }
            #[inline]
            fn cos(self) -> Self {
                $cos(self)
            }
            #[inline]
            fn tan(self) -> Self {
                $tan(self)
            }
            #[inline]
            fn ln(self) -> Self {
                $ln(self)
            }
            #[inline]
            fn tanh(self) -> Self {
                $tanh(self)
            }
        }
    };
}

// IEEE 754 rounds a square root correctly, so there is one.
#[cfg(feature = "std")]
use core::primitive::{f32 as root_f32, f64 as root_f64};
#[cfg(not(feature = "std"))]
mod root_f32 {
    pub use libm::sqrtf as sqrt;
}
#[cfg(not(feature = "std"))]
mod root_f64 {
    pub use libm::sqrt;
}

real!(
    f32,
    root_f32::sqrt,
    libm::expf,
    libm::expm1f,
    libm::log1pf,
    libm::powf,
    sin_turns_f32,
    sin_f32,
    cos_f32,
    tan_f32,
    libm::logf,
    libm::tanhf
);
real!(
    f64,
    root_f64::sqrt,
    libm::exp,
    libm::expm1,
    libm::log1p,
    libm::pow,
    sin_turns_f64,
    libm::sin,
    libm::cos,
    libm::tan,
    libm::log,
    libm::tanh
);

/// Sine of an angle in radians, for continuous-time references.
#[must_use]
pub fn sin(x: f64) -> f64 {
    libm::sin(x)
}

/// Cosine of an angle in radians, for continuous-time references.
#[must_use]
pub fn cos(x: f64) -> f64 {
    libm::cos(x)
}

/// `e^x`, for continuous-time references and random graphs.
#[must_use]
pub fn exp(x: f64) -> f64 {
    libm::exp(x)
}

/// `e^x - 1`, exact near zero, for continuous-time forecasts.
#[must_use]
pub fn exp_m1(x: f64) -> f64 {
    libm::expm1(x)
}

/// `ln(1 + x)`, exact near zero, for continuous-time references.
#[must_use]
pub fn ln_1p(x: f64) -> f64 {
    libm::log1p(x)
}

/// Natural logarithm, for continuous-time references and random graphs.
#[must_use]
pub fn ln(x: f64) -> f64 {
    libm::log(x)
}

/// `x^y`, for continuous-time references.
#[must_use]
pub fn pow(x: f64, y: f64) -> f64 {
    libm::pow(x, y)
}

/// `10^x`, for plots and reports.
#[must_use]
pub fn exp10(x: f64) -> f64 {
    libm::exp10(x)
}

/// Logarithm to the base 10, for plots and reports.
#[must_use]
pub fn log10(x: f64) -> f64 {
    libm::log10(x)
}

/// Next integer below, for plots and reports.
#[must_use]
pub fn floor(x: f64) -> f64 {
    libm::floor(x)
}

/// An angle in radians as a phase in 2^-64 turns, modulo one turn; its resolution is that of f64 in turns.
///
/// ```
/// use funnelnet_law::math::turns_from_radians;
/// assert_eq!(turns_from_radians(std::f64::consts::PI), 1 << 63);
/// ```
#[must_use]
pub fn turns_from_radians(angle: f64) -> u64 {
    let turns = angle / core::f64::consts::TAU;
    let fraction = turns - libm::floor(turns);
    // Two halves, since f64 to u64 saturates at 2^64 and the product is exact in either half.
    let scaled = fraction * 4_294_967_296.0;
    let high = libm::floor(scaled);
    let low = (scaled - high) * 4_294_967_296.0;
    ((high as u64) << 32).wrapping_add(low as u64)
}

fn sin_turns_f64(turns: u64) -> f64 {
    const RADIANS: f64 = core::f64::consts::TAU / 18_446_744_073_709_551_616.0;
    libm::sin((turns as i64) as f64 * RADIANS)
}

/// Quadrant by integer, then the polynomials of the Cephes library (S. Moshier, `sinf.c`), within 1.5 ulp of
/// 1.
fn sin_turns_f32(turns: u64) -> f32 {
    const RADIANS: f32 = core::f32::consts::FRAC_PI_2 / 1_073_741_824.0;
    let phase = (turns >> 32) as u32;
    let quadrant = phase.wrapping_add(1 << 29) >> 30;
    // Signed distance to the centre of the quadrant, within an eighth of a turn.
    let angle = phase.wrapping_sub(quadrant << 30) as i32 as f32 * RADIANS;
    let magnitude = if quadrant & 1 == 0 { sin_near_zero(angle) } else { cos_near_zero(angle) };
    if quadrant & 2 == 0 { magnitude } else { -magnitude }
}

/// Within an eighth of a turn.
fn sin_near_zero(angle: f32) -> f32 {
    let square = angle * angle;
    ((-1.951_529_6e-4 * square + 8.332_161e-3) * square - 1.666_665_5e-1) * square * angle + angle
}

/// Within an eighth of a turn.
fn cos_near_zero(angle: f32) -> f32 {
    let square = angle * angle;
    ((2.443_315_7e-5 * square - 1.388_731_6e-3) * square + 4.166_664_6e-2) * square * square - 0.5 * square
        + 1.0
}

/// A quarter of a turn.
const QUARTER: u64 = 1 << 62;

fn sin_f32(x: f32) -> f32 {
    if x.abs() <= core::f32::consts::FRAC_PI_4 { sin_near_zero(x) } else { of_turns(x, 0) }
}

fn cos_f32(x: f32) -> f32 {
    if x.abs() <= core::f32::consts::FRAC_PI_4 { cos_near_zero(x) } else { of_turns(x, QUARTER) }
}

fn tan_f32(x: f32) -> f32 {
    sin_f32(x) / cos_f32(x)
}

/// Sine of an angle in radians and a phase; not a number where the angle is not finite.
fn of_turns(x: f32, phase: u64) -> f32 {
    if !x.is_finite() {
        return f32::NAN;
    }
    sin_turns_f32(turns_of_f32(x).wrapping_add(phase))
}

/// An angle of an eighth of a turn or more as a phase in 2^-64 turns, modulo one turn, by integers and within
/// 2^-40 turns: of `m 2^k / tau` the bits of `1 / tau` before the window make whole turns (M. H. Payne, R. N.
/// Hanek, SIGNUM 18(1), 1983). `libm::sinf` does it in f64.
fn turns_of_f32(x: f32) -> u64 {
    /// `1 / tau`, 256 bits behind the point.
    const INVERSE: [u64; 4] =
        [0x28BE_60DB_9391_054A, 0x7F09_D5F4_7D4D_3770, 0x36D8_A566_4F10_E410, 0x7F94_58EA_F7AE_F158];
    let bits = x.to_bits();
    let mantissa = u64::from(bits & 0x007F_FFFF | 0x0080_0000);
    let exponent = (bits >> 23 & 0xFF) as i32 - 150;
    let window = match u32::try_from(exponent) {
        Ok(by) => {
            let word = |index: u32| INVERSE.get(index as usize).copied().unwrap_or(0);
            let (first, shift) = (by / 64, by % 64);
            // Two shifts, since one by 64 is none.
            word(first) << shift | word(first + 1) >> 1 >> (63 - shift)
        }
        Err(_) => INVERSE[0] >> exponent.unsigned_abs().min(63),
    };
    let turns = mantissa.wrapping_mul(window);
    if bits >> 31 == 0 { turns } else { turns.wrapping_neg() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_of_turns_is_the_sine() {
        let mut worst = 0.0_f64;
        for step in 0..200_000_u64 {
            let turns = step.wrapping_mul(0x0001_5A4B_3C2D_1E0F_u64 * 7);
            let exact = sin_turns_f64(turns & 0xFFFF_FFFF_0000_0000);
            worst = worst.max((f64::from(sin_turns_f32(turns)) - exact).abs());
        }
        assert!(worst < 1.5 * f64::from(f32::EPSILON), "{worst:e}");
        assert!(worst > 0.0);
    }

    #[test]
    fn sine_cosine_and_tangent_of_angles_are_those_of_f64() {
        let (mut worst, mut worst_tan) = (0.0_f64, 0.0_f64);
        // Every 997th f32 there is: small, ordinary, huge, both signs.
        for bits in (0..=u32::MAX).step_by(997) {
            let x = f32::from_bits(bits);
            if !x.is_finite() {
                assert!(sin_f32(x).is_nan() && cos_f32(x).is_nan() && tan_f32(x).is_nan());
                continue;
            }
            let (sin, cos) = (libm::sin(x.into()), libm::cos(x.into()));
            let off = (f64::from(sin_f32(x)) - sin).abs().max((f64::from(cos_f32(x)) - cos).abs());
            worst = worst.max(off);
            if cos.abs() > 0.1 {
                worst_tan = worst_tan.max((f64::from(tan_f32(x)) - sin / cos).abs());
            }
        }
        let ulp = f64::from(f32::EPSILON);
        assert!(worst < 1.5 * ulp && worst_tan < 150.0 * ulp, "{worst:e} {worst_tan:e}");
        assert!((sin_f32(1e-20) - 1e-20).abs() < 1e-27, "small angles keep their digits");
    }

    #[test]
    fn radians_become_turns() {
        assert_eq!(turns_from_radians(core::f64::consts::PI), 1 << 63);
        assert_eq!(turns_from_radians(0.0), 0);
        assert_eq!(turns_from_radians(-core::f64::consts::FRAC_PI_2), 3 << 62);
        assert!((sin_turns_f64(turns_from_radians(123.456)) - sin(123.456)).abs() < 1e-14);
        assert!((sin_turns_f64(turns_from_radians(-0.1)) - sin(-0.1)).abs() < 1e-15);
    }
}
