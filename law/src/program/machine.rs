//! The machine that runs a checked program.

use super::{Operation, STACK};
use crate::math::Real;

/// Values that a program sees beside the state.
pub trait Surroundings<F> {
    /// Time, s.
    fn time(&self) -> F;

    /// The value of a sinusoid of the field.
    fn wave(&self, index: usize) -> F;

    /// The value of an input from outside.
    fn input(&self, index: usize) -> F;
}

/// The value that `operations`, those of one component of a checked program, leave for the state `x`. It is
/// bounded by their number and never fails: what is not checked gives some number, or one that is none.
///
/// ```
/// use funnelnet_law::program::{Operation::*, Surroundings, run};
/// struct Noon;
/// impl Surroundings<f64> for Noon {
///     fn time(&self) -> f64 { 12.0 }
///     fn wave(&self, _: usize) -> f64 { 0.0 }
///     fn input(&self, _: usize) -> f64 { 0.0 }
/// }
/// // x^2 - t
/// assert_eq!(run(&[State(0), Duplicate, Multiply, Time, Subtract], &[], &[5.0], &Noon), 13.0);
/// ```
#[inline]
pub fn run<F: Real>(
    operations: &[Operation],
    constants: &[F],
    x: &[F],
    surroundings: &impl Surroundings<F>,
) -> F {
    // What is on top is kept beside the stack.
    let (mut stack, mut top) = (Stack { values: [F::ZERO; STACK], depth: 0 }, F::ZERO);
    for &operation in operations {
        top = match operation {
            Operation::Constant(index) => stack.push(top, at(constants, index)),
            Operation::State(index) => stack.push(top, at(x, index)),
            Operation::Wave(index) => stack.push(top, surroundings.wave(index.into())),
            Operation::Input(index) => stack.push(top, surroundings.input(index.into())),
            Operation::Time => stack.push(top, surroundings.time()),
            Operation::Duplicate => stack.push(top, top),
            Operation::Next => top,
            Operation::Negate => -top,
            Operation::Add => stack.pop() + top,
            Operation::Subtract => stack.pop() - top,
            Operation::Multiply => stack.pop() * top,
            Operation::Divide => stack.pop() / top,
            Operation::Power => stack.pop().pow(top),
            Operation::Minimum => smaller(stack.pop(), top),
            Operation::Maximum => -smaller(-stack.pop(), -top),
            Operation::Absolute => top.abs(),
            Operation::Sine => top.sin(),
            Operation::Cosine => top.cos(),
            Operation::Tangent => top.tan(),
            Operation::Exponential => top.exp(),
            Operation::Logarithm => top.ln(),
            Operation::SquareRoot => top.sqrt(),
            Operation::HyperbolicTangent => top.tanh(),
            Operation::Sign => sign(top),
            Operation::Step => step(top),
        };
    }
    top
}

/// What is below the top. Its depth wraps, so that no index is out of range.
struct Stack<F> {
    values: [F; STACK],
    depth: usize,
}

impl<F: Real> Stack<F> {
    /// Puts `top` there, and gives `next`.
    #[inline]
    fn push(&mut self, top: F, next: F) -> F {
        self.values[self.depth % STACK] = top;
        self.depth = self.depth.wrapping_add(1);
        next
    }

    #[inline]
    fn pop(&mut self) -> F {
        self.depth = self.depth.wrapping_sub(1);
        self.values[self.depth % STACK]
    }
}

#[inline]
fn at<F: Real>(values: &[F], index: u8) -> F {
    values.get(usize::from(index)).copied().unwrap_or(F::ZERO)
}

/// The smaller of two; not a number where one is not ([`Real::min`] drops it).
fn smaller<F: Real>(a: F, b: F) -> F {
    if a < b {
        a
    } else if a >= b {
        b
    } else {
        a + b
    }
}

/// Not a number of what is none.
fn sign<F: Real>(x: F) -> F {
    if x > F::ZERO {
        F::ONE
    } else if x < F::ZERO {
        -F::ONE
    } else {
        // Zero, or what is not a number; its derivative is that of a constant.
        x * F::ZERO
    }
}

/// Not a number of what is none.
fn step<F: Real>(x: F) -> F {
    if x >= F::ZERO {
        F::ONE
    } else if x < F::ZERO {
        F::ZERO
    } else {
        x
    }
}

#[cfg(test)]
mod tests {
    use super::super::Program;
    use super::*;
    use crate::program::BadProgram;
    use crate::program::Part;
    use Operation::*;

    struct Outside;

    impl Surroundings<f64> for Outside {
        fn time(&self) -> f64 {
            2.0
        }
        fn wave(&self, index: usize) -> f64 {
            10.0 + index as f64
        }
        fn input(&self, index: usize) -> f64 {
            20.0 + index as f64
        }
    }

    fn of(operations: &[Operation]) -> f64 {
        run(operations, &[3.0, -0.5], &[5.0, -7.0], &Outside)
    }

    #[test]
    fn operands_come_in_the_order_in_which_they_were_pushed() {
        assert_eq!(of(&[State(0), Constant(0), Subtract]), 2.0);
        assert_eq!(of(&[State(0), Constant(1), Divide]), -10.0);
        assert_eq!(of(&[Constant(0), Time, Power]), 9.0);
        assert_eq!(of(&[State(1), Wave(1), Input(2), Add, Multiply]), -7.0 * 33.0);
        assert_eq!(of(&[State(1), Duplicate, Multiply]), 49.0);
        assert_eq!((of(&[State(0), State(1), Minimum]), of(&[State(0), State(1), Maximum])), (-7.0, 5.0));
    }

    #[test]
    fn what_is_not_a_number_stays_none() {
        let nothing = [Constant(1), SquareRoot];
        for with in [&[Constant(0), Minimum][..], &[Constant(0), Maximum], &[Sign], &[Step], &[Absolute]] {
            assert!(of(&[&nothing, with].concat()).is_nan(), "{with:?}");
            let turned = [&[Constant(0)][..], &nothing, &with[with.len() - 1..]].concat();
            assert!(of(&turned).is_nan(), "{turned:?}");
        }
        assert_eq!((of(&[Constant(1), Sign]), of(&[Constant(1), Step])), (-1.0, 0.0));
    }

    #[test]
    fn what_cannot_run_is_named() {
        let check = |operations: &[Operation], components| {
            Program::<f32>::new(operations.iter().copied(), [1.0]).check(components, 1, 0)
        };
        let bad = |part, at, found, low, high| Err(BadProgram { part, at, found, low, high });
        assert_eq!(check(&[State(0), Next, Wave(0)], 2), Ok(()));
        assert_eq!(check(&[State(1)], 1), bad(Part::State, 0, 1.0, 0.0, 0.0));
        assert_eq!(check(&[State(0), Constant(1), Add], 1), bad(Part::Constant, 1, 1.0, 0.0, 0.0));
        assert_eq!(check(&[Wave(3)], 1), bad(Part::Wave, 0, 3.0, 0.0, 0.0));
        assert_eq!(check(&[Input(0)], 1), bad(Part::Input, 0, 0.0, 0.0, -1.0));
        assert_eq!(check(&[State(0), Add], 1), bad(Part::Stack, 1, 1.0, 2.0, 16.0));
        assert_eq!(check(&[State(0), State(0)], 1), bad(Part::Stack, 2, 2.0, 1.0, 1.0));
        assert_eq!(check(&[State(0), State(0), Next, Time], 2), bad(Part::Stack, 2, 2.0, 1.0, 1.0));
        assert_eq!(check(&[State(0), Next, Time], 1), bad(Part::Components, 3, 2.0, 1.0, 1.0));
        assert_eq!(check(&[State(0); 17], 1), bad(Part::Stack, 16, 17.0, 0.0, 16.0));
        let mut program = Program::<f32>::new([State(0)], [f32::INFINITY]);
        let largest = f64::from(f32::MAX);
        assert_eq!(program.check(1, 0, 0), bad(Part::Value, 0, f64::INFINITY, -largest, largest));
        program = Program::new([State(0)], []);
        program.code.push(0x3F).unwrap();
        assert_eq!(program.check(1, 0, 0), bad(Part::Operation, 1, 63.0, 0.0, 95.0));
    }
}
