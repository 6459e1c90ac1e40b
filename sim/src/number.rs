//! Numbers as text: the shortest that reads back as the same number.

use std::io::{self, Write};

/// What a recorded number was before it became an `f64`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Precision {
    /// An `f32`, as on a node: `0.1f32` prints as `0.1`, not as `0.10000000149011612`.
    Single,
    /// An `f64`, as in the reference.
    Double,
}

impl Precision {
    /// Writes `value` so that it reads back as the same number of this precision, with an exponent where the
    /// plain form would be long.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write(self, out: &mut dyn Write, value: f64) -> io::Result<()> {
        match self {
            Precision::Single => write!(out, "{:?}", value as f32),
            Precision::Double => write!(out, "{value:?}"),
        }
    }
}

/// The `f64` with the same shortest text as `value`: for JSON, where `0.955f32` should read `0.955`.
pub fn shortest(value: f32) -> f64 {
    format!("{value:?}").parse().unwrap_or(f64::from(value))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(precision: Precision, value: f64) -> String {
        let mut out = Vec::new();
        precision.write(&mut out, value).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn numbers_are_short_and_read_back() {
        assert_eq!(text(Precision::Single, f64::from(0.1f32)), "0.1");
        assert_eq!(text(Precision::Double, f64::from(0.1f32)), "0.10000000149011612");
        assert_eq!(text(Precision::Double, 1.2e-297), "1.2e-297");
        assert_eq!(text(Precision::Single, f64::NAN), "NaN");
        assert_eq!(shortest(0.955), 0.955);
        for bits in (1u32..0x7f80_0000).step_by(7_654_321) {
            let value = f32::from_bits(bits);
            assert_eq!(text(Precision::Single, f64::from(value)).parse::<f32>().unwrap(), value);
        }
    }
}
