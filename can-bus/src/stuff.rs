//! Counting the stuff bits of ISO 11898-1 by tables: after five equal bits comes one of the other level,
//! which counts in the next run.

/// Last bit and how many of it there were, 1 to 4 of either level: 0 to 3 dominant, 4 to 7 recessive.
type State = u8;

/// Effect of bits on a state.
#[derive(Clone, Copy)]
struct Effect {
    state: State,
    /// Stuff bits within and after them.
    stuffed: u8,
    /// Whether the last of them comes after all bits.
    at_end: bool,
}

/// Bytes of what is given as a number.
const BYTES: usize = 16;

/// Effects of whole bytes, by state and byte, packed: the state in the low bits, then whether a stuff bit is
/// at the end, then their number.
const BYTE: [[u8; 256]; 8] = {
    let mut table = [[0; 256]; 8];
    let mut state = 0;
    while state < 8 {
        let mut byte = 0;
        while byte < 256 {
            let Effect { state: next, stuffed, at_end } = after(state as u8, byte as u8, 8);
            table[state][byte] = next | (at_end as u8) << AT_END | stuffed << STUFFED;
            byte += 1;
        }
        state += 1;
    }
    table
};
/// Bits of the state in a packed effect, and where the others are.
const STATE: u8 = 7;
const AT_END: u32 = 3;
const STUFFED: u32 = 4;

/// The effect of the last `bits` bits of a byte.
const fn after(state: State, byte: u8, bits: u32) -> Effect {
    let mut all = Effect { state, stuffed: 0, at_end: false };
    let mut at = bits;
    while at > 0 {
        at -= 1;
        let one = after_bit(all.state, byte >> at & 1 == 1);
        all = Effect { state: one.state, stuffed: all.stuffed + one.stuffed, at_end: one.at_end };
    }
    all
}

const fn after_bit(state: State, bit: bool) -> Effect {
    let (level, run) = (state >= 4, state % 4);
    let first = if bit { 4 } else { 0 };
    if level != bit {
        Effect { state: first, stuffed: 0, at_end: false }
    } else if run < 3 {
        Effect { state: state + 1, stuffed: 0, at_end: false }
    } else {
        Effect { state: 4 - first, stuffed: 1, at_end: true }
    }
}

/// Counts stuff bits from the start of frame on.
#[derive(Clone, Copy)]
pub(crate) struct Stuffing {
    state: State,
    count: u32,
    at_end: bool,
}

impl Stuffing {
    /// One dominant bit, the start of frame, has been sent.
    pub(crate) const fn after_start() -> Self {
        Self { state: 0, count: 0, at_end: false }
    }

    fn add(&mut self, effect: Effect) {
        self.state = effect.state;
        self.count += u32::from(effect.stuffed);
        self.at_end = effect.at_end;
    }

    /// Takes the next 8 bits.
    pub(crate) fn byte(&mut self, byte: u8) {
        let effect = BYTE[usize::from(self.state & STATE)][usize::from(byte)];
        self.state = effect & STATE;
        self.count += u32::from(effect >> STUFFED);
        self.at_end = effect >> AT_END & 1 == 1;
    }

    /// Takes the next `length` bits, the last ones of `bits`.
    pub(crate) fn bits(&mut self, bits: u128, length: u32) {
        let odd = length % 8;
        if odd > 0 {
            self.add(after(self.state, (bits >> (length - odd)) as u8, odd));
        }
        let whole = length as usize / 8;
        bits.to_be_bytes()[BYTES - whole..].iter().for_each(|&byte| self.byte(byte));
    }

    /// Stuff bits so far, one right after the last bit included.
    pub(crate) fn count(self) -> u32 {
        self.count
    }

    /// Stuff bits between the bits so far. CAN FD has a fixed stuff bit where one would come after the last.
    pub(crate) fn count_between(self) -> u32 {
        self.count - u32::from(self.at_end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(bits: &str) -> (u32, u32) {
        let value = u128::from_str_radix(bits, 2).unwrap();
        let mut stuffing = Stuffing::after_start();
        stuffing.bits(value, bits.len() as u32);
        (stuffing.count(), stuffing.count_between())
    }

    #[test]
    fn a_stuff_bit_counts_in_the_next_run() {
        // Start of frame and four zeros; the stuffed one and four ones; and so on.
        assert_eq!(count("000"), (0, 0));
        assert_eq!(count("0000"), (1, 0));
        assert_eq!(count("00001111"), (2, 1));
        assert_eq!(count("000011110000"), (3, 2));
        assert_eq!(count("00000"), (1, 1));
        assert_eq!(count("11111"), (1, 0));
        assert_eq!(count("1111011111"), (1, 0));
    }
}
