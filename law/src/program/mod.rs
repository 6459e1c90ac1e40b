//! Vector fields that are written as expressions: `-x + 3*tanh(x) + 2*sin(0.5*t)` as a program for a small
//! stack machine.
//!
//! A [`Program`] is what travels: one byte for each [`Operation`], and the constants that it names.
//! [`Program::check`] says whether it can run, once; running it ([`run`]) is then bounded, has a stack of
//! fixed depth and cannot fail. It is written for any [`Real`](crate::math::Real), so that the same program
//! gives f32 on a node, f64 in a reference, and derivatives where the number is a dual one.

mod check;
mod machine;
mod operation;

pub use check::{BadProgram, Part};
pub use machine::{Surroundings, run};
pub use operation::Operation;

use crate::collect::collect;
use heapless::Vec;

/// Most operations of a program, over all components of a state.
pub const MAX_OPERATIONS: usize = 64;
/// Most constants of a program.
pub const MAX_CONSTANTS: usize = 32;
/// Most inputs from outside that a program can name.
pub const MAX_INPUTS: usize = 8;
/// Values that the stack holds at the same time.
pub const STACK: usize = 16;

/// A vector field as a program, one component after the other; empty where there is none.
///
/// ```
/// use funnelnet_law::program::{Operation, Program};
/// // x squared.
/// let program = Program::<f32>::new([Operation::State(0), Operation::Duplicate, Operation::Multiply], []);
/// assert_eq!(program.check(1, 0, 0), Ok(()));
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Program<F> {
    /// Operations as they travel, [`Operation::to_byte`].
    pub code: Vec<u8, MAX_OPERATIONS>,
    /// Constants that [`Operation::Constant`] names.
    pub constants: Vec<F, MAX_CONSTANTS>,
}

impl<F> Program<F> {
    /// Empty program.
    #[must_use]
    pub const fn none() -> Self {
        Self { code: Vec::new(), constants: Vec::new() }
    }

    /// Program of these operations and constants; those beyond its capacity are left out.
    #[must_use]
    pub fn new(
        operations: impl IntoIterator<Item = Operation>,
        constants: impl IntoIterator<Item = F>,
    ) -> Self {
        let code = operations.into_iter().map(Operation::to_byte);
        Self { code: collect(code), constants: collect(constants) }
    }

    /// Whether the program is empty.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.code.is_empty()
    }

    /// Operations of the program; bytes that stand for none are left out.
    pub fn operations(&self) -> impl Iterator<Item = Operation> {
        self.code.iter().filter_map(|&byte| Operation::of_byte(byte))
    }
}
