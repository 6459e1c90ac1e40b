//! Fields that are programs: one evaluation, and each operation in one.

use core::hint::black_box;

use funnelnet_law::program::Operation::{self, *};
use funnelnet_law::{PreparedField, Program, VectorField};
use funnelnet_protocol::config::{Field, Sine};

use crate::law::TICK;
use crate::meter::{INPUTS, Table, spread};

/// Each with the program that has it once; the cost of `x` is in all of them.
const OPERATIONS: [(&str, &[Operation]); 22] = [
    ("`x`", &[State(0)]),
    ("`-x`", &[State(0), Negate]),
    ("`x + 3`", &[State(0), Constant(0), Add]),
    ("`x - 3`", &[State(0), Constant(0), Subtract]),
    ("`x*3`", &[State(0), Constant(0), Multiply]),
    ("`x/3`", &[State(0), Constant(0), Divide]),
    ("`x^2`", &[State(0), Duplicate, Multiply]),
    ("`abs(x)^0.5`", &[State(0), Absolute, Constant(1), Power]),
    ("`min(x, 3)`", &[State(0), Constant(0), Minimum]),
    ("`max(x, 3)`", &[State(0), Constant(0), Maximum]),
    ("`abs(x)`", &[State(0), Absolute]),
    ("`sin(x)`", &[State(0), Sine]),
    ("`cos(x)`", &[State(0), Cosine]),
    ("`tan(x)`", &[State(0), Tangent]),
    ("`exp(x)`", &[State(0), Exponential]),
    ("`ln(abs(x))`", &[State(0), Absolute, Logarithm]),
    ("`sqrt(abs(x))`", &[State(0), Absolute, SquareRoot]),
    ("`tanh(x)`", &[State(0), HyperbolicTangent]),
    ("`sign(x)`", &[State(0), Sign]),
    ("`step(x)`", &[State(0), Step]),
    ("`t`", &[Time]),
    ("`sin(0.5*t)`", &[Wave(0)]),
];

/// `-x + 3*tanh(x) + 2*sin(0.5*t)`.
const EXAMPLE: [Operation; 11] = [
    State(0),
    Negate,
    Constant(0),
    State(0),
    HyperbolicTangent,
    Multiply,
    Add,
    Constant(2),
    Wave(0),
    Multiply,
    Add,
];

fn field(operations: &[Operation]) -> PreparedField<f32> {
    let sine = Sine { component: 0, amplitude: 1.0, frequency: 0.5, phase: 0.0 };
    let program = Program::new(operations.iter().copied(), [3.0, 0.5, 2.0]);
    black_box(PreparedField::new(&Field::scalar(0.0, 0.0, [sine]), &program, TICK))
}

#[inline(never)]
fn evaluate(field: &PreparedField<f32>, half_ticks: u64, x: f32) -> f32 {
    field.at(half_ticks, x)
}

/// One evaluation of each; a midpoint step has two.
pub fn evaluations(table: &Table) {
    let states = spread(-4.0, 4.0);
    let inputs: [(u64, f32); INPUTS] = core::array::from_fn(|i| (i as u64 * 997, states[i]));
    let example = field(&EXAMPLE);
    let what = "one evaluation of the program; a step has two";
    table.limited("`-x + 3*tanh(x) + 2*sin(0.5*t)`", 1200, what, &inputs, |(k, x)| evaluate(&example, k, x));
    for (name, operations) in OPERATIONS {
        let field = field(operations);
        table.row(name, "one evaluation", &inputs, |(k, x)| evaluate(&field, k, x));
    }
}
