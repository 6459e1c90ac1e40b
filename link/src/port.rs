//! The CAN port of a node as one state machine: frames that wait, what was received, the controller's error
//! state. Sans-IO: a driver, or a simulator, tells it what the controller has done, and does to the
//! controller what it answers.

use crate::bus::{Bus, BusState, Change, Step};
use crate::format::Format;
use crate::tx_queue::{Put, TxQueue};
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;

/// Period of the looks at the controller's error state, ns: drivers wake nobody when it changes.
pub const LOOK_EVERY_NS: u64 = 10_000_000;

const NS_PER_MS: u64 = 1_000_000;

/// A request to the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Drop the frames that it has taken and not sent, but one that is being sent.
    Cancel,
    /// Begin the recovery from bus-off.
    Restart,
}

/// Something for the node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Heard {
    /// A message, or the reason for refusing a frame.
    Message(Result<Message, Refusal>),
    /// A change of the error state.
    Change(Change),
}

/// A node's port to a CAN bus with frames of the format `F`.
#[derive(Debug)]
pub struct CanPort<F: Format> {
    format: F,
    waiting: TxQueue<F::Frame>,
    bus: Bus,
    /// Time of the next look at the error state, ns.
    look_at: u64,
    change: Option<Change>,
    refused: Option<Refusal>,
    errors: u32,
}

impl<F: Format> Default for CanPort<F> {
    fn default() -> Self {
        Self::new()
    }
}

impl<F: Format> CanPort<F> {
    /// A port on a controller that has just been started; its error state is due to be looked at.
    pub fn new() -> Self {
        Self {
            format: F::default(),
            waiting: TxQueue::new(),
            bus: Bus::new(),
            look_at: 0,
            change: None,
            refused: None,
            errors: 0,
        }
    }

    /// Takes a message to send. Of two frames with the same identifier that wait, the later one stays.
    #[must_use]
    pub fn send(&mut self, message: &Message) -> Option<Request> {
        let [first, second] = self.format.pack(message).map(|frame| frame.and_then(|frame| self.put(frame)));
        first.or(second)
    }

    /// Ends a burst of messages: a frame that was collected waits to be sent.
    #[must_use]
    pub fn flush(&mut self) -> Option<Request> {
        let frame = self.format.flush()?;
        self.put(frame)
    }

    /// The frame for the controller; none while it is off the bus. It waits until it is
    /// [taken](Self::on_taken).
    pub fn next_frame(&self) -> Option<&F::Frame> {
        self.waiting.next().filter(|_| self.bus.is_on())
    }

    /// Takes note that the controller has taken the [next frame](Self::next_frame).
    pub fn on_taken(&mut self) {
        self.waiting.taken();
    }

    /// Takes a received data frame with an 11-bit identifier. What was not [heard](Self::hear) of the one
    /// before is lost.
    pub fn on_frame(&mut self, id: u16, data: &[u8]) {
        self.format.receive(id, data);
    }

    /// Takes note of a received frame that is refused unread.
    pub fn on_refused(&mut self, reason: Refusal) {
        self.refused = Some(reason);
    }

    /// Counts an error on the bus.
    pub fn on_error(&mut self) {
        self.errors = self.errors.saturating_add(1);
    }

    /// Time at which the controller's error state is to be [read](Self::on_state) next, ns.
    pub fn look_at(&self) -> u64 {
        self.look_at
    }

    /// Takes a reading of the controller's error state at `now` (ns, never going back).
    #[must_use]
    pub fn on_state(&mut self, state: BusState, now: u64) -> Option<Request> {
        self.look_at = now + LOOK_EVERY_NS;
        match self.bus.observe(state, now / NS_PER_MS) {
            Step::Report(change) => {
                self.change = change.or(self.change);
                None
            }
            Step::Silence(change) => {
                self.silence();
                self.change = Some(change);
                // What the controller holds is as old as what has waited.
                Some(Request::Cancel)
            }
            Step::Restart => Some(Request::Restart),
        }
    }

    /// The next thing for the node, if there is one.
    pub fn hear(&mut self) -> Option<Heard> {
        if let Some(change) = self.change.take() {
            return Some(Heard::Change(change));
        }
        if let Some(reason) = self.refused.take() {
            return Some(Heard::Message(Err(reason)));
        }
        self.format.unpack().map(Heard::Message)
    }

    /// Error state as last reported.
    pub fn state(&self) -> BusState {
        self.bus.state()
    }

    /// Number of times that the controller went off the bus, saturating.
    pub fn offs(&self) -> u16 {
        self.bus.offs()
    }

    /// Number of errors on the bus, saturating.
    pub fn errors(&self) -> u32 {
        self.errors
    }

    fn put(&mut self, frame: F::Frame) -> Option<Request> {
        // A frame that has waited for so long that its successor is here: those that the controller holds are
        // older still.
        (self.waiting.put(frame) == Put::Replaced).then_some(Request::Cancel)
    }

    /// States of before a recovery are old: ticks on CAN have eight bits, or sixteen, so one might pass for a
    /// new one.
    fn silence(&mut self) {
        self.waiting.clear();
        drop(self.format.flush());
    }
}
