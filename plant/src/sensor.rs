//! From the counts of a converter to a state in SI units.

use crate::failure::{BadScale, Failure, check};
use core::ops::RangeInclusive;

/// A converter that gives raw counts. embedded-hal 1.0 has no trait for one, and every HAL its own type: a
/// line or two adapt it.
pub trait Source {
    /// What the converter says when it fails.
    type Error;

    /// The value now, counts. It blocks for no longer than a conversion.
    ///
    /// # Errors
    /// Whatever the converter says.
    fn counts(&mut self) -> Result<i32, Self::Error>;
}

/// `x = zero + per_count counts`, and which counts can be meant.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorScale {
    /// State at 0 counts, state units.
    pub zero: f32,
    /// State units per count.
    pub per_count: f32,
    /// Counts outside are a fault of the sensor: leave room at both ends, where broken wires and short
    /// circuits show.
    pub valid: RangeInclusive<i32>,
}

/// One component of the state, measured.
#[derive(Debug)]
pub struct Sensor<S> {
    source: S,
    scale: SensorScale,
}

impl<S: Source> Sensor<S> {
    /// A sensor that reads `source`.
    ///
    /// # Errors
    /// A scale that is not finite or without slope, or no valid counts at all.
    pub fn new(source: S, scale: SensorScale) -> Result<Self, BadScale> {
        let SensorScale { zero, per_count, ref valid } = scale;
        check("SensorScale::zero", zero, zero.is_finite(), "a finite number")?;
        let sloped = per_count.is_finite() && per_count != 0.0;
        check("SensorScale::per_count", per_count, sloped, "a finite number other than 0")?;
        let least = *valid.start() as f32;
        check("SensorScale::valid", least, valid.start() < valid.end(), "from a lesser to a larger number")?;
        Ok(Self { source, scale })
    }

    /// The state now, state units; `component` says whose it is, should it fail.
    pub(crate) fn read(&mut self, component: u8) -> Result<f32, Failure> {
        let counts = self.source.counts().map_err(|_| Failure::Source { component })?;
        let SensorScale { zero, per_count, valid } = &self.scale;
        if valid.contains(&counts) {
            Ok(zero + per_count * counts as f32)
        } else {
            Err(Failure::OutOfRange { component, counts, low: *valid.start(), high: *valid.end() })
        }
    }
}
