//! From a tree to the program that a node runs.

use super::ExpressionError;
use super::syntax::{Binary, Function, Kind, Term};
use crate::scenario::Sine;
use funnelnet_law::program::{MAX_CONSTANTS, Operation};
use funnelnet_node::params::{LARGEST_PHASE, LARGEST_RATE};
use funnelnet_protocol::config::MAX_SINES;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Integer exponents up to this are multiplications.
const LARGEST_EXPONENT: f64 = 64.0;

/// What programs of all components share.
#[derive(Default)]
pub(super) struct Compiler {
    pub operations: Vec<Operation>,
    pub constants: Vec<f64>,
    pub waves: Vec<Sine>,
}

impl Compiler {
    /// Appends what computes `term`.
    pub fn term(&mut self, term: &Term) -> Result<(), ExpressionError> {
        if let Some(value) = constant(term) {
            return self.constant(value, term.at);
        }
        match &term.kind {
            // A constant.
            Kind::Number(number) => self.constant(*number, term.at)?,
            Kind::Time => self.operations.push(Operation::Time),
            Kind::State(component) => self.operations.push(Operation::State(*component)),
            Kind::Input(input) => self.operations.push(Operation::Input(*input)),
            Kind::Negate(inner) => self.unary(inner, Operation::Negate)?,
            Kind::Binary(Binary::Power, base, exponent) => self.power(base, exponent)?,
            Kind::Binary(operator, left, right) => {
                self.term(left)?;
                self.term(right)?;
                self.operations.push(match operator {
                    Binary::Add => Operation::Add,
                    Binary::Subtract => Operation::Subtract,
                    Binary::Multiply => Operation::Multiply,
                    Binary::Divide | Binary::Power => Operation::Divide,
                });
            }
            Kind::Call(function, arguments) => self.call(*function, arguments, term.at)?,
        }
        Ok(())
    }

    fn unary(&mut self, inner: &Term, operation: Operation) -> Result<(), ExpressionError> {
        self.term(inner)?;
        self.operations.push(operation);
        Ok(())
    }

    fn call(&mut self, function: Function, arguments: &[Term], at: usize) -> Result<(), ExpressionError> {
        let operation = match (function, arguments) {
            (Function::Pow, [base, exponent]) => return self.power(base, exponent),
            (Function::Clamp, [value, low, high]) => {
                self.term(value)?;
                self.term(low)?;
                self.operations.push(Operation::Maximum);
                return self.unary(high, Operation::Minimum);
            }
            (Function::Sin | Function::Cos | Function::Tan, [angle]) => {
                if let Some((phase, frequency)) = linear(angle) {
                    return self.turning(function, frequency, phase, at);
                }
                match function {
                    Function::Sin => Operation::Sine,
                    Function::Cos => Operation::Cosine,
                    _ => Operation::Tangent,
                }
            }
            (Function::Abs, _) => Operation::Absolute,
            (Function::Min, _) => Operation::Minimum,
            (Function::Max, _) => Operation::Maximum,
            (Function::Exp, _) => Operation::Exponential,
            (Function::Ln, _) => Operation::Logarithm,
            (Function::Sqrt, _) => Operation::SquareRoot,
            (Function::Tanh, _) => Operation::HyperbolicTangent,
            (Function::Sign, _) => Operation::Sign,
            (Function::Step, _) => Operation::Step,
            _ => return Err(ExpressionError::new(at, "has another number of arguments".to_owned())),
        };
        arguments.iter().try_for_each(|argument| self.term(argument))?;
        self.operations.push(operation);
        Ok(())
    }

    /// An integer exponent multiplies, so that the base may be negative.
    fn power(&mut self, base: &Term, exponent: &Term) -> Result<(), ExpressionError> {
        let whole = constant(exponent).filter(|n| n.fract() == 0.0 && n.abs() <= LARGEST_EXPONENT);
        let Some(n) = whole else {
            self.term(base)?;
            return self.unary(exponent, Operation::Power);
        };
        if n <= 0.0 {
            self.constant(1.0, exponent.at)?;
        }
        if n != 0.0 {
            self.term(base)?;
            self.multiplied(n.abs() as u32);
        }
        if n < 0.0 {
            self.operations.push(Operation::Divide);
        }
        Ok(())
    }

    /// Raises what is on top to an exponent of at least one.
    fn multiplied(&mut self, n: u32) {
        if n == 1 {
            return;
        }
        if n.is_multiple_of(2) {
            self.operations.extend([Operation::Duplicate, Operation::Multiply]);
            self.multiplied(n / 2);
        } else {
            self.operations.push(Operation::Duplicate);
            self.multiplied(n - 1);
            self.operations.push(Operation::Multiply);
        }
    }

    /// A function of an angle that time turns evenly: by the integer phase of a sinusoid, which loses nothing
    /// in long runs.
    fn turning(
        &mut self,
        function: Function,
        frequency: f64,
        phase: f64,
        at: usize,
    ) -> Result<(), ExpressionError> {
        if frequency.abs() > LARGEST_RATE || phase.abs() > LARGEST_PHASE {
            let message = format!(
                "turns by {frequency} rad/s from {phase} rad: allowed are {LARGEST_RATE} rad/s and {LARGEST_PHASE} rad"
            );
            return Err(ExpressionError::new(at, message));
        }
        let quarter = |phase: f64| (phase + FRAC_PI_2) % TAU;
        match function {
            Function::Sin => self.wave(frequency, phase, at),
            Function::Cos => self.wave(frequency, quarter(phase), at),
            _ => {
                self.wave(frequency, phase, at)?;
                self.wave(frequency, quarter(phase), at)?;
                self.operations.push(Operation::Divide);
                Ok(())
            }
        }
    }

    fn wave(&mut self, frequency: f64, phase: f64, at: usize) -> Result<(), ExpressionError> {
        let wave = Sine { component: 0, amplitude: 1.0, frequency, phase };
        let index = self.waves.iter().position(|other| *other == wave).unwrap_or(self.waves.len());
        if index == self.waves.len() {
            self.waves.push(wave);
        }
        if index >= MAX_SINES {
            let message = format!(
                "a node takes at most {MAX_SINES} different sines and cosines of t, over all components"
            );
            return Err(ExpressionError::new(at, message));
        }
        self.operations.push(Operation::Wave(index as u8));
        Ok(())
    }

    fn constant(&mut self, value: f64, at: usize) -> Result<(), ExpressionError> {
        if !(value as f32).is_finite() {
            let message = format!("comes to {value}: a number must be finite in single precision");
            return Err(ExpressionError::new(at, message));
        }
        let same = |other: &f64| other.to_bits() == value.to_bits();
        let index = self.constants.iter().position(same).unwrap_or(self.constants.len());
        if index == self.constants.len() {
            self.constants.push(value);
        }
        if index >= MAX_CONSTANTS {
            let message =
                format!("a node takes at most {MAX_CONSTANTS} different numbers, over all components");
            return Err(ExpressionError::new(at, message));
        }
        self.operations.push(Operation::Constant(index as u8));
        Ok(())
    }
}

/// The value of what depends on nothing.
pub(super) fn constant(term: &Term) -> Option<f64> {
    match &term.kind {
        Kind::Number(number) => Some(*number),
        Kind::Time | Kind::State(_) | Kind::Input(_) => None,
        Kind::Negate(inner) => constant(inner).map(|value| -value),
        Kind::Binary(operator, left, right) => Some(operator.of(constant(left)?, constant(right)?)),
        Kind::Call(function, arguments) => {
            let values: Option<Vec<_>> = arguments.iter().map(constant).collect();
            Some(function.of(&values?))
        }
    }
}

/// `(a, b)` of what is `a + b t`, with b other than zero.
fn linear(term: &Term) -> Option<(f64, f64)> {
    linear_or_constant(term).filter(|(_, b)| *b != 0.0)
}

fn linear_or_constant(term: &Term) -> Option<(f64, f64)> {
    if let Some(value) = constant(term) {
        return Some((value, 0.0));
    }
    match &term.kind {
        Kind::Time => Some((0.0, 1.0)),
        Kind::Negate(inner) => linear_or_constant(inner).map(|(a, b)| (-a, -b)),
        Kind::Binary(operator, left, right) => {
            let ((a, b), (c, d)) = (linear_or_constant(left)?, linear_or_constant(right)?);
            match operator {
                Binary::Add => Some((a + c, b + d)),
                Binary::Subtract => Some((a - c, b - d)),
                Binary::Multiply if d == 0.0 => Some((a * c, b * c)),
                Binary::Multiply if b == 0.0 => Some((a * c, a * d)),
                Binary::Divide if d == 0.0 => Some((a / c, b / c)),
                _ => None,
            }
        }
        _ => None,
    }
}
