//! What a program is made of.

/// One operation of a program. It pushes a value, or takes its operands from the stack and leaves the result
/// there.
///
/// Append-only: the bytes travel, so that nothing is renumbered.
///
/// ```
/// use funnelnet_law::program::Operation;
/// assert_eq!(Operation::of_byte(Operation::State(1).to_byte()), Some(Operation::State(1)));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Operation {
    /// Pushes the constant with this index, 0 to 31.
    Constant(u8),
    /// Pushes this component of the state, 0 to 7.
    State(u8),
    /// Pushes the value of the sinusoid with this index, 0 to 7.
    Wave(u8),
    /// Pushes the input from outside with this index, 0 to 7.
    Input(u8),
    /// Pushes `t`, s.
    Time,
    /// Pushes the value on top once more.
    Duplicate,
    /// Ends a component: what is on top is its value, and the next one begins.
    Next,
    /// `-a`.
    Negate,
    /// `a + b`.
    Add,
    /// `a - b`.
    Subtract,
    /// `a b`.
    Multiply,
    /// `a / b`.
    Divide,
    /// `a^b`, of `a >= 0`.
    Power,
    /// The smaller of two; not a number where one is not.
    Minimum,
    /// The larger of two; not a number where one is not.
    Maximum,
    /// `|a|`.
    Absolute,
    /// Sine of an angle in radians.
    Sine,
    /// Cosine of an angle in radians.
    Cosine,
    /// Tangent of an angle in radians.
    Tangent,
    /// `e^a`.
    Exponential,
    /// Natural logarithm.
    Logarithm,
    /// Square root.
    SquareRoot,
    /// Hyperbolic tangent.
    HyperbolicTangent,
    /// -1 below zero, 0 at zero, 1 above.
    Sign,
    /// 0 below zero, else 1.
    Step,
}

/// Those without an index, in the order of their bytes.
const PLAIN: [Operation; 21] = [
    Operation::Time,
    Operation::Duplicate,
    Operation::Next,
    Operation::Negate,
    Operation::Add,
    Operation::Subtract,
    Operation::Multiply,
    Operation::Divide,
    Operation::Power,
    Operation::Minimum,
    Operation::Maximum,
    Operation::Absolute,
    Operation::Sine,
    Operation::Cosine,
    Operation::Tangent,
    Operation::Exponential,
    Operation::Logarithm,
    Operation::SquareRoot,
    Operation::HyperbolicTangent,
    Operation::Sign,
    Operation::Step,
];

/// First byte of states, of waves, of inputs and of constants; the index is added.
const STATE: u8 = 0x20;
const WAVE: u8 = 0x28;
const INPUT: u8 = 0x30;
const CONSTANT: u8 = 0x40;
/// The byte after the last constant.
const END: u8 = 0x60;

impl Operation {
    /// Largest byte that stands for an operation.
    pub const LARGEST_BYTE: u8 = END - 1;

    /// The byte that travels; an index too large for it is cut off.
    #[must_use]
    pub fn to_byte(self) -> u8 {
        match self {
            Self::State(index) => STATE | (index & 7),
            Self::Wave(index) => WAVE | (index & 7),
            Self::Input(index) => INPUT | (index & 7),
            Self::Constant(index) => CONSTANT | (index & 31),
            // The variants without an index are in the order of the table: a test says so.
            plain => PLAIN.iter().position(|&other| other == plain).unwrap_or(0) as u8,
        }
    }

    /// Operation of a byte; `None` for a byte that stands for none.
    #[must_use]
    pub fn of_byte(byte: u8) -> Option<Self> {
        Some(match byte {
            STATE..WAVE => Self::State(byte & 7),
            WAVE..INPUT => Self::Wave(byte & 7),
            INPUT..0x38 => Self::Input(byte & 7),
            CONSTANT..END => Self::Constant(byte & 31),
            _ => return PLAIN.get(usize::from(byte)).copied(),
        })
    }

    /// Numbers of values that it takes from the stack and leaves there.
    #[must_use]
    pub fn arity(self) -> (usize, usize) {
        match self {
            Self::Constant(_) | Self::State(_) | Self::Wave(_) | Self::Input(_) | Self::Time => (0, 1),
            Self::Duplicate => (1, 2),
            Self::Next => (1, 0),
            Self::Add
            | Self::Subtract
            | Self::Multiply
            | Self::Divide
            | Self::Power
            | Self::Minimum
            | Self::Maximum => (2, 1),
            _ => (1, 1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_is_one_operation_or_none() {
        let mut count = 0;
        for byte in 0..=u8::MAX {
            let Some(operation) = Operation::of_byte(byte) else { continue };
            assert_eq!(operation.to_byte(), byte);
            assert!(byte <= Operation::LARGEST_BYTE);
            count += 1;
        }
        assert_eq!(count, PLAIN.len() + 3 * 8 + 32);
    }
}
