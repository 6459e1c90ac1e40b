//! What can go wrong with a plant, at work and when it is set up.

use core::fmt;

/// Why a plant could not be measured or driven.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Failure {
    /// The converter of this component gave no value.
    Source {
        /// Component of the state.
        component: u8,
    },
    /// The converter of this component gave a value that its sensor cannot mean: a broken wire or a short
    /// circuit, for example.
    OutOfRange {
        /// Component of the state.
        component: u8,
        /// What it gave.
        counts: i32,
        /// Least valid value.
        low: i32,
        /// Largest valid value.
        high: i32,
    },
    /// The pin or converter that drives this component refused.
    Sink {
        /// Component of the state.
        component: u8,
    },
    /// There are not as many values as actuators.
    Components,
}

/// What a failure says, for `core::write` and `defmt::write` alike.
macro_rules! say {
    ($($write:ident)::+, $f:expr, $failure:expr) => {
        match *$failure {
            Failure::Source { component } => $($write)::+!($f, "component {}: the converter gives no value", component),
            Failure::OutOfRange { component, counts, low, high } => $($write)::+!(
                $f, "component {}: {} counts, valid are {} to {}", component, counts, low, high
            ),
            Failure::Sink { component } => $($write)::+!($f, "component {}: the actuator refuses", component),
            Failure::Components => $($write)::+!($f, "not as many values as components"),
        }
    };
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        say!(core::write, f, self)
    }
}

#[cfg(feature = "defmt")]
impl defmt::Format for Failure {
    fn format(&self, f: defmt::Formatter<'_>) {
        say!(defmt::write, f, self);
    }
}

/// A scale of a sensor or an actuator that cannot be.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BadScale {
    /// Which value, as in `ActuatorScale::per_input`.
    pub field: &'static str,
    /// What was found.
    pub found: f32,
    /// What is allowed.
    pub allowed: &'static str,
}

impl fmt::Display for BadScale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} = {}: allowed is {}", self.field, self.found, self.allowed)
    }
}

impl core::error::Error for BadScale {}

/// `found`, if it is `sound`.
pub(crate) fn check(
    field: &'static str,
    found: f32,
    sound: bool,
    allowed: &'static str,
) -> Result<(), BadScale> {
    if sound { Ok(()) } else { Err(BadScale { field, found, allowed }) }
}
