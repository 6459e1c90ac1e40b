//! A vector field written as an expression: `-x + 3*tanh(x) + 2*sin(0.5*t)`.
//!
//! `token` and `syntax` are its words and what they say, `parse` reads it, and `compile` makes the program of
//! it that nodes run (`funnelnet_law::program`). Everything else here runs that same program in f64, and in
//! dual numbers for derivatives.

mod compile;
mod dual;
mod parse;
mod syntax;
#[cfg(test)]
mod tests;
mod token;

use super::Sine;
use super::inputs::Series;
use super::steepest::steepest;
use compile::Compiler;
use dual::Dual;
use funnelnet_law::math::Real;
use funnelnet_law::program::{
    BadProgram, MAX_OPERATIONS, Operation, Part, Program, STACK, Surroundings, run,
};
use parse::Names;
use std::fmt;
use std::sync::Arc;

/// Characters of an expression: a program has room for far less.
const LONGEST: usize = 2_000;

/// What is wrong with an expression, and where in its text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExpressionError {
    /// Column, in characters from 1.
    pub column: usize,
    /// What was found, and what would be right.
    pub message: String,
}

impl ExpressionError {
    fn new(column: usize, message: String) -> Self {
        Self { column, message }
    }
}

impl fmt::Display for ExpressionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "column {}: {}", self.column, self.message)
    }
}

impl std::error::Error for ExpressionError {}

/// A vector field as an expression for each component of the state.
#[derive(Clone, Debug, PartialEq)]
pub struct Expression {
    /// As written, by component.
    pub text: Vec<String>,
    /// What nodes run; with the numbers of the text, in f64.
    pub program: Program<f64>,
    /// Sinusoids that the program reads, each of amplitude one.
    pub waves: Vec<Sine>,
    /// Inputs from outside that it may name, by index.
    pub inputs: Arc<[Series]>,
    /// The operations of each component.
    components: Vec<Vec<Operation>>,
    /// See [`Expression::steepness`].
    steepness: f64,
}

impl Expression {
    /// Reads and compiles the expressions of all components of a state; `inputs` may be named in them.
    ///
    /// # Errors
    /// The component that is wrong, by index, and what is wrong with it.
    pub fn new(text: &[&str], inputs: Arc<[Series]>) -> Result<Self, (usize, ExpressionError)> {
        let names: Vec<_> = inputs.iter().map(|series| series.name.clone()).collect();
        let names = Names { components: text.len(), inputs: &names };
        let mut compiler = Compiler::default();
        let mut components = Vec::new();
        for (index, text) in text.iter().enumerate() {
            let begins = compiler.operations.len();
            let term = parsed(text, names).map_err(|error| (index, error))?;
            compiler.term(&term).map_err(|error| (index, error))?;
            components.push(compiler.operations.split_off(begins));
        }
        let operations = components.join(&Operation::Next);
        if operations.len() > MAX_OPERATIONS {
            let (index, _) = longest(&components);
            let message = format!(
                "comes to {} operations over all components, the most of them here; a node takes at most {MAX_OPERATIONS}",
                operations.len()
            );
            return Err((index, ExpressionError::new(1, message)));
        }
        let program = Program::new(operations, compiler.constants);
        let checked = program.check(text.len(), compiler.waves.len(), names.inputs.len());
        checked.map_err(|bad| refused(&bad, &components))?;
        Ok(Self {
            text: text.iter().map(|&text| text.to_owned()).collect(),
            program,
            waves: compiler.waves,
            inputs,
            components,
            steepness: f64::NAN,
        })
    }

    /// The same, with its steepest slope looked for in states up to `size` (state units) and times up to
    /// `end` (s).
    #[must_use]
    pub fn explored(mut self, size: f64, end: f64) -> Self {
        let slope = |row: usize, column: usize, t: f64, x: &[f64]| self.slope_of(row, column, t, x);
        self.steepness = steepest(self.components.len(), size, end, slope);
        self
    }

    /// The largest row sum of `|df/dx|` (1/s) that was found where the nodes may come to; there may be a
    /// larger one elsewhere.
    #[must_use]
    pub fn steepness(&self) -> f64 {
        self.steepness
    }

    /// One component of `f(t, x)` (state units / s).
    #[must_use]
    pub fn component(&self, component: usize, t: f64, x: &[f64]) -> f64 {
        self.run(component, &self.program.constants, x, t)
    }

    /// `df_row / dx_column` (1/s).
    #[must_use]
    pub fn slope_of(&self, row: usize, column: usize, t: f64, x: &[f64]) -> f64 {
        let along = |(index, &x): (usize, &f64)| Dual { value: x, slope: f64::from(index == column) };
        let x: Vec<_> = x.iter().enumerate().map(along).collect();
        self.derivative(row, &x, Dual::constant(t))
    }

    /// The partial derivative of one component by time (state units / s^2).
    #[must_use]
    pub fn rate_of(&self, component: usize, t: f64, x: &[f64]) -> f64 {
        let x: Vec<_> = x.iter().map(|&x| Dual::constant(x)).collect();
        self.derivative(component, &x, Dual { value: t, slope: 1.0 })
    }

    fn derivative(&self, component: usize, x: &[Dual], t: Dual) -> f64 {
        let constants: Vec<_> = self.program.constants.iter().map(|&value| Dual::constant(value)).collect();
        self.run(component, &constants, x, t).slope
    }

    fn run<F: Number>(&self, component: usize, constants: &[F], x: &[F], t: F) -> F {
        let operations = self.components.get(component).map_or(&[][..], Vec::as_slice);
        run(operations, constants, x, &At { t, expression: self })
    }
}

/// Whether a function is called so.
pub(super) fn is_function(name: &str) -> bool {
    syntax::FUNCTIONS.iter().any(|entry| entry.0 == name)
}

fn parsed(text: &str, names: Names<'_>) -> Result<syntax::Term, ExpressionError> {
    if text.chars().count() > LONGEST {
        return Err(ExpressionError::new(1, format!("is longer than {LONGEST} characters")));
    }
    parse::parse(text, names)
}

/// Index and length of the longest.
fn longest(components: &[Vec<Operation>]) -> (usize, usize) {
    let lengths = components.iter().map(Vec::len).enumerate();
    lengths.max_by_key(|(index, length)| (*length, usize::MAX - index)).unwrap_or((0, 0))
}

/// What the compiler makes can only need too much of the stack.
fn refused(bad: &BadProgram, components: &[Vec<Operation>]) -> (usize, ExpressionError) {
    let mut end = 0;
    let holds = |component: &Vec<Operation>| {
        end += component.len() + 1;
        bad.at < end
    };
    let index = components.iter().position(holds).unwrap_or(0);
    let message = match bad.part {
        Part::Stack => format!(
            "needs more than the {STACK} values that a node keeps at a time; write what is deepest in brackets first, as (a*b) + c for c + (a*b)"
        ),
        _ => format!("cannot be compiled: {bad}"),
    };
    (index, ExpressionError::new(1, message))
}

/// f64, or a dual number of it.
trait Number: Real {
    /// The sine of an angle (rad).
    fn wave(self, frequency: f64, phase: f64, amplitude: f64) -> Self;
    /// What a series is at this time.
    fn of(self, series: &Series) -> Self;
}

impl Number for f64 {
    fn wave(self, frequency: f64, phase: f64, amplitude: f64) -> Self {
        amplitude * funnelnet_law::math::sin(frequency * self + phase)
    }

    fn of(self, series: &Series) -> Self {
        series.at(self)
    }
}

impl Number for Dual {
    fn wave(self, frequency: f64, phase: f64, amplitude: f64) -> Self {
        let [frequency, phase, amplitude] = [frequency, phase, amplitude].map(Self::constant);
        amplitude * Real::sin(frequency * self + phase)
    }

    fn of(self, series: &Series) -> Self {
        Self { value: series.at(self.value), slope: self.slope * series.slope(self.value) }
    }
}

/// What a program sees in continuous time.
struct At<'a, F> {
    t: F,
    expression: &'a Expression,
}

impl<F: Number> Surroundings<F> for At<'_, F> {
    fn time(&self) -> F {
        self.t
    }

    fn wave(&self, index: usize) -> F {
        let wave = self.expression.waves.get(index);
        wave.map_or(F::ZERO, |wave| self.t.wave(wave.frequency, wave.phase, wave.amplitude))
    }

    fn input(&self, index: usize) -> F {
        self.expression.inputs.get(index).map_or(F::ZERO, |series| self.t.of(series))
    }
}
