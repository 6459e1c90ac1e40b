//! What a controller does on the bus in each bit (ISO 11898-1): idle, in a frame, in an error or overload
//! frame, off.

use crate::counters::{Counters, Mode};
use crate::frame::Frame;
use crate::length::INTERMISSION;
use crate::reader::{ErrorKind, Read, Reader};
use crate::wire::{DOMINANT, Field, Pace, RECESSIVE, Wire};

/// Bits of a flag.
const FLAG: u32 = 6;
/// Bits of the delimiter of an error or overload frame.
const DELIMITER: u32 = 8;
/// Bits for which a passive sender lets others go first.
const SUSPENSION: u32 = 8;
/// Dominant bits after a flag that count as one more error.
const STUCK: u32 = 8;
/// Recessive bits in a row, and how often they must come, before a controller that was off takes part again.
const RECOVERY_RUN: u64 = 11;
const RECOVERY_TIMES: u64 = 128;

/// Bits of an error for its sender, and for a receiver that was the first to see it.
const HEAVY: u16 = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Idle,
    Frame,
    /// A flag of dominant bits, this many so far.
    Flag {
        bits: u32,
        overload: bool,
    },
    /// A flag of recessive bits: it ends with six equal ones on the bus.
    PassiveFlag {
        run: u32,
        last: bool,
    },
    /// After a flag, for the others to end theirs.
    Wait {
        dominant: u32,
        overload: bool,
    },
    Delimiter {
        bits: u32,
    },
    Intermission {
        bits: u32,
    },
    Suspended {
        bits: u32,
    },
    Off,
    /// Recessive bits in this run, and runs of eleven so far.
    Recovering {
        run: u64,
        times: u64,
    },
}

/// What a bit has led to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Happening {
    LostArbitration,
    Error { kind: ErrorKind, field: Field, sender: bool },
    Received(Frame),
    Sent,
    Overload,
}

#[derive(Clone, Debug)]
struct Sending {
    wire: Wire,
    at: usize,
}

#[derive(Clone, Debug)]
pub(crate) struct Participant {
    state: State,
    pub(crate) counters: Counters,
    reader: Reader,
    sending: Option<Sending>,
    /// It has sent, or sends, the frame that this is about.
    sender: bool,
    /// A passive sender was not acknowledged: that counts only if it sees a dominant bit in its flag.
    unacknowledged: bool,
    /// It takes part again without having been off: its counters stay.
    keeps_counters: bool,
}

impl Participant {
    pub(crate) fn new() -> Self {
        Self {
            state: State::Idle,
            counters: Counters::default(),
            reader: Reader::new(),
            sending: None,
            sender: false,
            unacknowledged: false,
            keeps_counters: false,
        }
    }

    pub(crate) fn mode(&self) -> Mode {
        match self.state {
            State::Off | State::Recovering { .. } => Mode::Off,
            _ => self.counters.mode(),
        }
    }

    /// Whether it would begin a frame with the next bit.
    pub(crate) fn may_begin(&self) -> bool {
        self.state == State::Idle
    }

    /// Whether a start of frame of another is one for it too: in the last bit of the intermission it is.
    pub(crate) fn may_join(&self) -> bool {
        matches!(self.state, State::Idle | State::Intermission { bits: 2 })
    }

    /// Whether the bus is nothing but recessive as far as it knows.
    pub(crate) fn is_quiet(&self) -> bool {
        matches!(self.state, State::Idle | State::Off | State::Recovering { .. })
    }

    /// Whether it takes part in what happens on the bus.
    pub(crate) fn is_busy(&self) -> bool {
        !self.is_quiet() && !matches!(self.state, State::Suspended { .. })
    }

    pub(crate) fn is_sending(&self) -> bool {
        self.sending.is_some()
    }

    /// How long its next bit lasts, if it decides that: a flag is sent at the nominal rate, a frame as its
    /// sender does.
    pub(crate) fn pace(&self) -> Option<Pace> {
        match (self.state, &self.sending) {
            (State::Flag { .. }, _) => Some(Pace::Nominal),
            (State::Frame, Some(sending)) => sending.wire.bit(sending.at).map(|bit| bit.pace),
            _ => None,
        }
    }

    pub(crate) fn marks_error(&self) -> bool {
        matches!(self.state, State::Flag { .. })
    }

    /// Begins to send with the start of frame.
    pub(crate) fn begin(&mut self, frame: &Frame, passive: bool) {
        let wire = Wire::of(frame, passive);
        self.start(Some(Sending { wire, at: 0 }));
    }

    /// Begins to recover from bus-off; whether it was off, and did not recover already.
    pub(crate) fn restart(&mut self) -> bool {
        let off = self.state == State::Off;
        if off {
            self.state = State::Recovering { run: 0, times: 0 };
        }
        off
    }

    /// Loses its power: whatever it does, it ends.
    pub(crate) fn switch_off(&mut self) {
        *self = Self { state: State::Off, ..Self::new() };
    }

    /// Gets its power: it takes part once it has seen eleven recessive bits in a row.
    pub(crate) fn switch_on(&mut self) {
        *self = Self { state: State::Recovering { run: 0, times: RECOVERY_TIMES - 1 }, ..Self::new() };
    }

    /// Comes to be alone on a wire that is recessive.
    pub(crate) fn unplug(&mut self) {
        if !matches!(self.state, State::Off | State::Recovering { .. }) {
            (self.state, self.sending) = (State::Idle, None);
        }
    }

    /// Comes back to a wire with others: it takes part once it has seen eleven recessive bits in a row. One that is off stays off.
    pub(crate) fn plug(&mut self) {
        match &mut self.state {
            State::Off => {}
            State::Recovering { run, .. } => *run = 0,
            state => {
                *state = State::Recovering { run: 0, times: RECOVERY_TIMES - 1 };
                (self.sending, self.keeps_counters) = (None, true);
            }
        }
    }

    pub(crate) fn is_recovering(&self) -> bool {
        matches!(self.state, State::Recovering { .. })
    }

    /// Recessive bits until a controller that recovers takes part again.
    pub(crate) fn bits_to_recovery(&self) -> Option<u64> {
        match self.state {
            State::Recovering { run, times } => Some(RECOVERY_RUN * (RECOVERY_TIMES - times) - run),
            _ => None,
        }
    }

    /// Takes `bits` recessive bits at once; only a controller that recovers counts them.
    pub(crate) fn pass_recessive(&mut self, bits: u64) {
        if let State::Recovering { run, times } = &mut self.state {
            *times += (*run + bits) / RECOVERY_RUN;
            *run = (*run + bits) % RECOVERY_RUN;
            if *times >= RECOVERY_TIMES {
                self.state = State::Idle;
                if !std::mem::take(&mut self.keeps_counters) {
                    self.counters = Counters::default();
                }
            }
        }
    }

    /// Takes a dominant bit; only a controller that recovers minds it.
    pub(crate) fn pass_dominant(&mut self) {
        if let State::Recovering { run, .. } = &mut self.state {
            *run = 0;
        }
    }

    /// The level that it drives in the next bit.
    pub(crate) fn drives(&self) -> bool {
        match (self.state, &self.sending) {
            (State::Flag { .. }, _) => DOMINANT,
            (State::Frame, Some(sending)) => sending.wire.bit(sending.at).map_or(RECESSIVE, |bit| bit.level),
            (State::Frame, None) if self.reader.acknowledges() => DOMINANT,
            _ => RECESSIVE,
        }
    }

    /// Takes the level that it reads in a bit.
    pub(crate) fn sample(&mut self, bit: bool) -> Option<Happening> {
        match self.state {
            State::Frame => self.in_frame(bit),
            State::Flag { bits, overload } => self.in_flag(bit, bits, overload),
            State::PassiveFlag { run, last } => self.in_passive_flag(bit, run, last),
            State::Wait { dominant, overload } => self.in_wait(bit, dominant, overload),
            State::Delimiter { bits } => self.in_delimiter(bit, bits),
            State::Intermission { bits } => self.in_intermission(bit, bits),
            State::Idle | State::Suspended { .. } if bit == DOMINANT => self.start(None),
            State::Suspended { bits } if bits + 1 < SUSPENSION => {
                self.go(State::Suspended { bits: bits + 1 })
            }
            State::Idle | State::Suspended { .. } => self.go(State::Idle),
            State::Off => None,
            State::Recovering { .. } => {
                if bit == RECESSIVE {
                    self.pass_recessive(1);
                } else {
                    self.pass_dominant();
                }
                None
            }
        }
    }

    fn go(&mut self, state: State) -> Option<Happening> {
        self.state = state;
        None
    }

    fn start(&mut self, sending: Option<Sending>) -> Option<Happening> {
        self.sender = sending.is_some();
        // A sender takes its own start of frame as any other bit.
        self.reader = Reader::new();
        self.sending = sending;
        self.go(State::Frame)
    }

    fn in_frame(&mut self, bit: bool) -> Option<Happening> {
        let Some(sending) = &mut self.sending else { return self.in_received_frame(bit) };
        let Some(sent) = sending.wire.bit(sending.at) else { return self.go(State::Idle) };
        let first = sending.at == 0;
        sending.at += 1;
        let ended = sending.at == sending.wire.len();
        let field = sent.field;
        match (sent.level == bit, field) {
            (true, Field::Acknowledgement) => return self.fail(ErrorKind::Acknowledgement, field),
            (true, _) | (false, Field::Acknowledgement) => {}
            (false, Field::Arbitration) if bit == DOMINANT && !sent.stuffed => {
                (self.sending, self.sender) = (None, false);
                // It goes on as a receiver.
                return self.in_received_frame(bit).or(Some(Happening::LostArbitration));
            }
            (false, Field::Arbitration) if bit == DOMINANT => return self.fail(ErrorKind::Stuff, field),
            (false, Field::End | Field::AcknowledgementDelimiter | Field::ChecksumDelimiter) => {
                return self.fail(ErrorKind::Form, field);
            }
            (false, _) => return self.fail(ErrorKind::Bit, field),
        }
        if ended {
            self.sending = None;
            self.counters.sent();
            self.state = State::Intermission { bits: 0 };
            return Some(Happening::Sent);
        }
        // It reads what it sends, so that it can go on as a receiver.
        if !first {
            let _read = self.reader.push(bit);
        }
        None
    }

    fn in_received_frame(&mut self, bit: bool) -> Option<Happening> {
        let field = self.reader.field();
        match self.reader.push(bit) {
            Read::More => None,
            Read::Error(kind) => self.fail(kind, field),
            Read::Accepted => {
                self.counters.received();
                self.reader.frame().map(Happening::Received)
            }
            Read::Ended => self.go(State::Intermission { bits: 0 }),
            Read::Overload => self.overload(),
        }
    }

    fn overload(&mut self) -> Option<Happening> {
        self.state = State::Flag { bits: 0, overload: true };
        Some(Happening::Overload)
    }

    /// An error, which is counted and marked.
    fn fail(&mut self, kind: ErrorKind, field: Field) -> Option<Happening> {
        let (sender, before) = (self.sender, self.mode());
        self.unacknowledged = sender && kind == ErrorKind::Acknowledgement && before == Mode::Passive;
        // A sender that reads a dominant stuff bit in the arbitration may be right: another one has sent it.
        let excused = sender && kind == ErrorKind::Stuff;
        if !self.unacknowledged && !excused {
            self.counters.failed(sender, if sender { HEAVY } else { 1 });
        }
        self.sending = None;
        // The error that makes a controller passive is marked actively.
        self.state = match before {
            Mode::Active => State::Flag { bits: 0, overload: false },
            _ => State::PassiveFlag { run: 0, last: RECESSIVE },
        };
        self.leave_if_off();
        Some(Happening::Error { kind, field, sender })
    }

    fn failed_again(&mut self) {
        self.counters.failed(self.sender, HEAVY);
        self.leave_if_off();
    }

    fn leave_if_off(&mut self) {
        if self.counters.mode() == Mode::Off {
            self.state = State::Off;
        }
    }

    fn in_flag(&mut self, bit: bool, bits: u32, overload: bool) -> Option<Happening> {
        if bit == RECESSIVE {
            self.state = State::Flag { bits: 0, overload: false };
            self.failed_again();
            return Some(Happening::Error {
                kind: ErrorKind::Bit,
                field: Field::Between,
                sender: self.sender,
            });
        }
        let bits = bits + 1;
        self.go(if bits == FLAG {
            State::Wait { dominant: 0, overload }
        } else {
            State::Flag { bits, overload }
        })
    }

    fn in_passive_flag(&mut self, bit: bool, run: u32, last: bool) -> Option<Happening> {
        let run = if run > 0 && bit == last { run + 1 } else { 1 };
        self.state = if run == FLAG {
            State::Wait { dominant: 0, overload: false }
        } else {
            State::PassiveFlag { run, last: bit }
        };
        if bit == DOMINANT && std::mem::take(&mut self.unacknowledged) {
            self.failed_again();
        }
        None
    }

    fn in_wait(&mut self, bit: bool, dominant: u32, overload: bool) -> Option<Happening> {
        if bit == RECESSIVE {
            return self.go(State::Delimiter { bits: 1 });
        }
        let dominant = dominant + 1;
        self.state = State::Wait { dominant, overload };
        // Others have begun their flags later: this receiver was the first to see the error.
        let was_first = dominant == 1 && !overload && !self.sender;
        if was_first || dominant.is_multiple_of(STUCK) {
            self.failed_again();
        }
        None
    }

    fn in_delimiter(&mut self, bit: bool, bits: u32) -> Option<Happening> {
        match bit {
            RECESSIVE if bits + 1 == DELIMITER => self.go(State::Intermission { bits: 0 }),
            RECESSIVE => self.go(State::Delimiter { bits: bits + 1 }),
            DOMINANT if bits + 1 == DELIMITER => self.overload(),
            DOMINANT => self.fail(ErrorKind::Form, Field::Between),
        }
    }

    fn in_intermission(&mut self, bit: bool, bits: u32) -> Option<Happening> {
        let last = bits + 1 == INTERMISSION;
        match bit {
            DOMINANT if last => self.start(None),
            DOMINANT => self.overload(),
            RECESSIVE if !last => self.go(State::Intermission { bits: bits + 1 }),
            RECESSIVE if self.sender && self.mode() == Mode::Passive => self.go(State::Suspended { bits: 0 }),
            RECESSIVE => self.go(State::Idle),
        }
    }
}
