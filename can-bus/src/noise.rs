//! Disturbed bits: which ones, and who reads them wrong.

use std::fmt;

/// Who reads a disturbed bit as its opposite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeenBy {
    /// Everybody.
    All,
    /// One controller.
    One(usize),
}

/// A disturbed bit. Bits count while the bus is busy: from a start of frame to the end of the intermission.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hit {
    /// Bits before it, since the last one.
    pub after: u64,
    /// Who reads it as its opposite.
    pub seen_by: SeenBy,
}

/// A bit of the frame that begins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Strike {
    /// Who reads it as its opposite.
    pub seen_by: SeenBy,
    /// Its place among the bits from the start of frame to the end of the checksum: that part of 2^32 of them.
    pub place: u32,
}

/// A source of disturbed bits.
pub trait Noise {
    /// The next one; none is not asked again.
    fn next(&mut self) -> Option<Hit>;

    /// Whether the bit that [next](Self::next) has said is disturbed indeed, now that it is on the bus at `at` (ns): asked once for each,
    /// for noise that comes and goes.
    fn is_real(&mut self, _at: u64) -> bool {
        true
    }

    /// A bit of the frame that `sender` begins at `at` (ns). A bit before it that [next](Self::next) has said comes first, and this one never.
    fn strike(&mut self, _at: u64, _sender: usize) -> Option<Strike> {
        None
    }
}

/// No bit is disturbed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Quiet;

impl Noise for Quiet {
    fn next(&mut self) -> Option<Hit> {
        None
    }
}

impl<F: FnMut() -> Option<Hit>> Noise for F {
    fn next(&mut self) -> Option<Hit> {
        self()
    }
}

/// Parts of a rate of bit errors.
const BILLION: u32 = 1_000_000_000;

/// A reason for refusing a rate of bit errors: it is not below one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoiseError(pub u32);

impl fmt::Display for NoiseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "bit errors {} in a billion bits: not between 0 and {}", self.0, BILLION - 1)
    }
}

impl std::error::Error for NoiseError {}

/// Independent bit errors: each bit is disturbed with the same probability. Integers only, so the same random numbers give the same errors on
/// every machine.
#[derive(Clone, Debug)]
pub struct BitErrors<R> {
    /// Probability that no bit of 2^k is disturbed, as a fraction of 2^64.
    clean: Vec<u64>,
    /// Controllers of which one reads an error; none if all read each.
    local: Option<u64>,
    random: R,
}

/// Gaps up to 2^40 bits: 12 days at 1 Mbit/s.
const LARGEST_POWER: usize = 40;

impl<R: FnMut() -> u64> BitErrors<R> {
    /// Errors that all controllers read, so many in a billion bits. `random` gives independent numbers of 64 random bits.
    ///
    /// # Errors
    ///
    /// There are as many errors as bits, or more.
    pub fn on_the_bus(per_billion: u32, random: R) -> Result<Self, NoiseError> {
        if per_billion >= BILLION {
            return Err(NoiseError(per_billion));
        }
        let one = (u128::from(BILLION - per_billion) << 64) / u128::from(BILLION);
        let one = u64::try_from(one).unwrap_or(u64::MAX);
        let clean = std::iter::successors(Some(one), |&half| Some(product(half, half))).take(LARGEST_POWER);
        Ok(Self { clean: clean.collect(), local: None, random })
    }

    /// Errors that one of so many controllers reads, each with the same probability.
    ///
    /// # Errors
    ///
    /// There are as many errors as bits, or more.
    pub fn at_one_of(controllers: usize, per_billion: u32, random: R) -> Result<Self, NoiseError> {
        let noise = Self::on_the_bus(per_billion, random)?;
        Ok(Self { local: Some(controllers.max(1) as u64), ..noise })
    }

    /// Number of bits before the next error: the largest one with a probability of no error above a random number.
    fn gap(&mut self) -> u64 {
        let random = (self.random)();
        let (mut gap, mut clean) = (0, u64::MAX);
        for (power, &factor) in self.clean.iter().enumerate().rev() {
            let longer = product(clean, factor);
            if longer > random {
                (gap, clean) = (gap + (1 << power), longer);
            }
        }
        gap
    }
}

fn product(a: u64, b: u64) -> u64 {
    ((u128::from(a) * u128::from(b)) >> 64) as u64
}

impl<R: FnMut() -> u64> Noise for BitErrors<R> {
    fn next(&mut self) -> Option<Hit> {
        if self.clean.first() == Some(&u64::MAX) {
            return None;
        }
        let after = self.gap();
        let seen_by = match self.local {
            Some(controllers) => SeenBy::One(((self.random)() % controllers) as usize),
            None => SeenBy::All,
        };
        Some(Hit { after, seen_by })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// SplitMix64.
    fn random(mut state: u64) -> impl FnMut() -> u64 {
        move || {
            state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let z = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            z ^ (z >> 31)
        }
    }

    /// Gaps are geometric: mean (1 - p) / p, and none of zero bits with probability p.
    #[test]
    fn gaps_are_those_of_independent_bits() {
        for per_billion in [100_000_000, 1_000_000, 10_000] {
            let mut noise = BitErrors::on_the_bus(per_billion, random(7)).unwrap();
            let gaps: Vec<u64> = (0..100_000).filter_map(|_| noise.next()).map(|hit| hit.after).collect();
            let p = f64::from(per_billion) / 1e9;
            let mean = gaps.iter().map(|&gap| gap as f64).sum::<f64>() / gaps.len() as f64;
            // The standard deviation of the mean is 1/316 of it.
            assert!((mean * p / (1.0 - p) - 1.0).abs() < 0.015, "{per_billion}: {mean}");
            let none = gaps.iter().filter(|&&gap| gap == 0).count() as f64 / gaps.len() as f64;
            assert!((none - p).abs() < 0.003, "{per_billion}: {none}");
            let long = (1.0 / p) as u64;
            let above = gaps.iter().filter(|&&gap| gap >= long).count() as f64 / gaps.len() as f64;
            let expected = (0..long).fold(1.0, |clean, _| clean * (1.0 - p));
            assert!((above - expected).abs() < 0.005, "{per_billion}: {above} {expected}");
        }
    }

    #[test]
    fn no_errors_are_none_and_all_are_refused() {
        assert_eq!(BitErrors::on_the_bus(0, random(1)).unwrap().next(), None);
        let error = BitErrors::on_the_bus(1_000_000_000, random(1)).map(|_| ()).unwrap_err();
        assert_eq!(error.to_string(), "bit errors 1000000000 in a billion bits: not between 0 and 999999999");
    }
}
