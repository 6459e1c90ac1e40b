//! What an expression says, as a tree.

/// A part of an expression, and the column of its first word, of an operator that of its sign.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Term {
    pub at: usize,
    pub kind: Kind,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Kind {
    Number(f64),
    Time,
    /// A component of the state.
    State(u8),
    /// An input from outside, by its index.
    Input(u8),
    Negate(Box<Term>),
    Binary(Binary, Box<Term>, Box<Term>),
    Call(Function, Vec<Term>),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
}

/// A function of the grammar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Function {
    Abs,
    Min,
    Max,
    Clamp,
    Sin,
    Cos,
    Tan,
    Exp,
    Ln,
    Sqrt,
    Tanh,
    Pow,
    Sign,
    Step,
}

/// Each with its name and the number of its arguments.
pub(super) const FUNCTIONS: [(&str, Function, usize); 14] = [
    ("abs", Function::Abs, 1),
    ("min", Function::Min, 2),
    ("max", Function::Max, 2),
    ("clamp", Function::Clamp, 3),
    ("sin", Function::Sin, 1),
    ("cos", Function::Cos, 1),
    ("tan", Function::Tan, 1),
    ("exp", Function::Exp, 1),
    ("ln", Function::Ln, 1),
    ("sqrt", Function::Sqrt, 1),
    ("tanh", Function::Tanh, 1),
    ("pow", Function::Pow, 2),
    ("sign", Function::Sign, 1),
    ("step", Function::Step, 1),
];

impl Function {
    /// Its value.
    pub fn of(self, arguments: &[f64]) -> f64 {
        use funnelnet_law::math::{self, Real};
        let [a, b, c] = [0, 1, 2].map(|index| arguments.get(index).copied().unwrap_or(f64::NAN));
        match self {
            Self::Abs => a.abs(),
            Self::Min if a.is_nan() || b.is_nan() => f64::NAN,
            Self::Min => {
                if a < b {
                    a
                } else {
                    b
                }
            }
            Self::Max => -Self::Min.of(&[-a, -b]),
            Self::Clamp => Self::Min.of(&[Self::Max.of(&[a, b]), c]),
            Self::Sin => math::sin(a),
            Self::Cos => math::cos(a),
            Self::Tan => Real::tan(a),
            Self::Exp => math::exp(a),
            Self::Ln => math::ln(a),
            Self::Sqrt => a.sqrt(),
            Self::Tanh => Real::tanh(a),
            Self::Pow => math::pow(a, b),
            Self::Sign => {
                if a == 0.0 || a.is_nan() {
                    a
                } else {
                    a.signum()
                }
            }
            Self::Step => {
                if a.is_nan() {
                    a
                } else {
                    f64::from(a >= 0.0)
                }
            }
        }
    }
}

impl Binary {
    /// Its value.
    pub fn of(self, a: f64, b: f64) -> f64 {
        match self {
            Self::Add => a + b,
            Self::Subtract => a - b,
            Self::Multiply => a * b,
            Self::Divide => a / b,
            Self::Power => funnelnet_law::math::pow(a, b),
        }
    }
}
