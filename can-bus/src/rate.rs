//! Bit rates, and where in a bit its level is read.

use std::fmt;

const NS_PER_S: u32 = 1_000_000_000;
/// Slowest and fastest rate, bit/s.
const SLOWEST: u32 = 10_000;
const FASTEST: u32 = 8_000_000;
const PER_MILLE: u32 = 1000;

/// A rate whose bits have whole nanoseconds, as does the part of a bit before its sample point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitRate {
    /// Length of a bit, ns.
    bit_ns: u32,
    /// From the beginning of a bit to its sample point, ns.
    sample_ns: u32,
}

/// A reason for refusing a bit rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RateError {
    /// Too slow or too fast, bit/s.
    Range(u32),
    /// A bit has no whole number of nanoseconds.
    Bit {
        /// The rate, bit/s.
        rate: u32,
        /// The nearest one that has, bit/s.
        nearest: u32,
    },
    /// The sample point is outside of a bit, or not at a whole nanosecond.
    Sample {
        /// Sample point, per mille of a bit.
        per_mille: u32,
        /// Length of a bit, ns.
        bit_ns: u32,
    },
    /// The data of CAN FD are slower than the rest.
    Slower {
        /// Rate of the data, bit/s.
        data: u32,
        /// Nominal rate, bit/s.
        nominal: u32,
    },
}

impl fmt::Display for RateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Range(rate) => write!(f, "bit rate {rate} bit/s: not between {SLOWEST} and {FASTEST}"),
            Self::Bit { rate, nearest } => write!(
                f,
                "bit rate {rate} bit/s: a bit has no whole number of nanoseconds; the nearest rate that has is {nearest}"
            ),
            Self::Sample { per_mille, bit_ns } => write!(
                f,
                "sample point {per_mille} per mille of a bit of {bit_ns} ns: not between 1 and 999, or not at a whole nanosecond"
            ),
            Self::Slower { data, nominal } => write!(
                f,
                "bit rate of the data {data} bit/s: not between the nominal rate, {nominal}, and {FASTEST}"
            ),
        }
    }
}

impl std::error::Error for RateError {}

impl BitRate {
    /// A rate (bit/s) with its sample point (per mille of a bit).
    ///
    /// # Errors
    ///
    /// The rate is out of range, or a bit or its part before the sample point has no whole number of
    /// nanoseconds.
    pub fn new(rate: u32, sample_per_mille: u32) -> Result<Self, RateError> {
        if !(SLOWEST..=FASTEST).contains(&rate) {
            return Err(RateError::Range(rate));
        }
        if !NS_PER_S.is_multiple_of(rate) {
            return Err(RateError::Bit { rate, nearest: nearest(rate) });
        }
        let bit_ns = NS_PER_S / rate;
        let sample = u64::from(bit_ns) * u64::from(sample_per_mille);
        let whole = sample.is_multiple_of(u64::from(PER_MILLE));
        if !(1..PER_MILLE).contains(&sample_per_mille) || !whole {
            return Err(RateError::Sample { per_mille: sample_per_mille, bit_ns });
        }
        Ok(Self {
            bit_ns,
            sample_ns: bit_ns / PER_MILLE * sample_per_mille
                + bit_ns % PER_MILLE * sample_per_mille / PER_MILLE,
        })
    }

    /// Rate, bit/s.
    pub fn per_second(self) -> u32 {
        NS_PER_S / self.bit_ns
    }

    /// Length of a bit, ns.
    pub fn bit_ns(self) -> u64 {
        u64::from(self.bit_ns)
    }

    /// From the beginning of a bit to its sample point, ns.
    pub fn sample_ns(self) -> u64 {
        u64::from(self.sample_ns)
    }
}

/// The nearest rate within the range whose bits have whole nanoseconds; of two, the slower one.
fn nearest(rate: u32) -> u32 {
    let whole = |rate: &u32| (SLOWEST..=FASTEST).contains(rate) && NS_PER_S.is_multiple_of(*rate);
    (0..FASTEST).flat_map(|by| [rate.saturating_sub(by), rate + by]).find(whole).unwrap_or(SLOWEST)
}

/// Bit rates of a bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    nominal: BitRate,
    data: BitRate,
}

impl Timing {
    /// One rate for everything.
    pub fn classic(rate: BitRate) -> Self {
        Self { nominal: rate, data: rate }
    }

    /// CAN FD: a nominal rate, and one for the data of frames that switch.
    ///
    /// # Errors
    ///
    /// The data are slower.
    pub fn fd(nominal: BitRate, data: BitRate) -> Result<Self, RateError> {
        if data.per_second() < nominal.per_second() {
            return Err(RateError::Slower { data: data.per_second(), nominal: nominal.per_second() });
        }
        Ok(Self { nominal, data })
    }

    /// Nominal rate.
    pub fn nominal(self) -> BitRate {
        self.nominal
    }

    /// Rate of the data of frames that switch.
    pub fn data(self) -> BitRate {
        self.data
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_usual_rates_have_whole_nanoseconds() {
        for (rate, per_mille, bit_ns, sample_ns) in [
            (1_000_000, 875, 1000, 875),
            (500_000, 875, 2000, 1750),
            (250_000, 875, 4000, 3500),
            (125_000, 875, 8000, 7000),
            (2_000_000, 800, 500, 400),
            (5_000_000, 750, 200, 150),
            (10_000, 875, 100_000, 87_500),
        ] {
            let rate = BitRate::new(rate, per_mille).unwrap();
            assert_eq!((rate.bit_ns(), rate.sample_ns()), (bit_ns, sample_ns));
        }
    }

    #[test]
    fn others_are_refused_with_the_nearest() {
        let message = |rate, sample| BitRate::new(rate, sample).unwrap_err().to_string();
        assert_eq!(
            message(83_333, 875),
            "bit rate 83333 bit/s: a bit has no whole number of nanoseconds; the nearest rate that has is 80000"
        );
        assert!(message(7_999_999, 875).ends_with("is 8000000"));
        assert_eq!(message(9_999, 875), "bit rate 9999 bit/s: not between 10000 and 8000000");
        assert!(message(8_000_001, 875).starts_with("bit rate 8000001 bit/s: not between"));
        for sample in [0, 1000, u32::MAX] {
            assert!(message(500_000, sample).starts_with(&format!("sample point {sample} per mille")));
        }
        // 200 ns: steps of 5 per mille.
        assert!(BitRate::new(5_000_000, 751).is_err());
        let rate = |rate| BitRate::new(rate, 800).unwrap();
        let slower = Timing::fd(rate(1_000_000), rate(500_000)).unwrap_err();
        assert_eq!(
            slower.to_string(),
            "bit rate of the data 500000 bit/s: not between the nominal rate, 1000000, and 8000000"
        );
    }
}
