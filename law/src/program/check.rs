//! Whether a program can run.

use core::fmt;

use super::{MAX_CONSTANTS, MAX_OPERATIONS, Operation, Program, STACK};
use crate::math::Real;

/// Part of a program that is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Part {
    /// A byte that is no operation.
    Operation,
    /// The index of a constant.
    Constant,
    /// The value of a constant.
    Value,
    /// The index of a component of the state.
    State,
    /// The index of a sinusoid.
    Wave,
    /// The index of an input.
    Input,
    /// Values on the stack.
    Stack,
    /// Number of components.
    Components,
}

/// Why a program cannot run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BadProgram {
    /// Part that is wrong.
    pub part: Part,
    /// Index of the operation, or of the constant.
    pub at: usize,
    /// Value that was found.
    pub found: f64,
    /// Smallest allowed value.
    pub low: f64,
    /// Largest allowed value; below the smallest one where there is none at all.
    pub high: f64,
}

impl fmt::Display for BadProgram {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { part, at, found, low, high } = self;
        write!(f, "{part:?} of operation {at} = {found}: allowed are {low} to {high}")
    }
}

impl core::error::Error for BadProgram {}

impl<F: Real> Program<F> {
    /// Checks that the program gives `components` values, and names only the first `waves` sinusoids and
    /// `inputs` inputs.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn check(&self, components: usize, waves: usize, inputs: usize) -> Result<(), BadProgram> {
        for (at, constant) in self.constants.iter().enumerate() {
            within(Part::Value, at, constant.to_f64(), -f64::from(f32::MAX), f64::from(f32::MAX))?;
        }
        let mut depth = 0;
        let mut given = 1;
        for (at, &byte) in self.code.iter().enumerate() {
            let largest = f64::from(Operation::LARGEST_BYTE);
            let bad = BadProgram { part: Part::Operation, at, found: byte.into(), low: 0.0, high: largest };
            let operation = Operation::of_byte(byte).ok_or(bad)?;
            let index =
                |part, index: u8, count: usize| within(part, at, f64::from(index), 0.0, count as f64 - 1.0);
            match operation {
                Operation::Constant(constant) => index(Part::Constant, constant, self.constants.len())?,
                Operation::State(component) => index(Part::State, component, components)?,
                Operation::Wave(wave) => index(Part::Wave, wave, waves)?,
                Operation::Input(input) => index(Part::Input, input, inputs)?,
                // Nothing may be left below the value of a component.
                Operation::Next => {
                    within(Part::Stack, at, depth as f64, 1.0, 1.0)?;
                    given += 1;
                }
                _ => {}
            }
            let (takes, leaves) = operation.arity();
            within(Part::Stack, at, depth as f64, takes as f64, STACK as f64)?;
            depth = depth - takes + leaves;
            within(Part::Stack, at, depth as f64, 0.0, STACK as f64)?;
        }
        let last = self.code.len();
        within(Part::Stack, last, depth as f64, 1.0, 1.0)?;
        within(Part::Components, last, f64::from(given), components as f64, components as f64)
    }
}

fn within(part: Part, at: usize, found: f64, low: f64, high: f64) -> Result<(), BadProgram> {
    // Written so that NaN is outside.
    if found >= low && found <= high { Ok(()) } else { Err(BadProgram { part, at, found, low, high }) }
}

const _: () = assert!(MAX_OPERATIONS <= u8::MAX as usize && MAX_CONSTANTS <= 32 && STACK.is_power_of_two());
