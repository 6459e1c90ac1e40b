//! Frames of the real-time plane in the format of CAN FD, plain form: all components of a state in one frame,
//! STATE_FD; everything else with its classic payload.
//!
//! Byte table: protocol/README.md, "Real-time plane on CAN FD". The core speaks of one component at a time;
//! [`States`] is what a link collects them in.

use crate::can::{self, finite, function};
use crate::message::{Component, Message, NodeId, TickStamp};
use crate::refusal::Refusal;
use heapless::Vec;

/// Longest data field of a plain frame, bytes: eight components.
pub const MAX_DATA: usize = 48;
/// Most components of a state.
const COMPONENTS: usize = Component::COUNT as usize;
/// Bytes before the components: header, reserved, tick.
const HEAD: usize = 4;
/// Bits of the header that hold the number of components, less one. The others are 0 in the plain form.
const COUNT_BITS: u8 = 0x07;

/// A data frame in the format of CAN FD with an 11-bit id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FdFrame {
    id: u16,
    length: u8,
    data: [u8; MAX_DATA],
}

impl FdFrame {
    /// The 11-bit identifier.
    pub fn id(&self) -> u16 {
        self.id
    }

    /// The data field; CAN FD has frames of this length.
    pub fn data(&self) -> &[u8] {
        self.data.get(..usize::from(self.length)).unwrap_or(&self.data)
    }
}

/// The state of a node at a tick, its first components or all of them: at least one, in order from 0.
#[derive(Clone, Debug, PartialEq)]
pub struct States {
    source: NodeId,
    tick: TickStamp,
    x: Vec<f32, COMPONENTS>,
}

impl States {
    /// Of one component, the first (state units).
    pub fn new(source: NodeId, tick: TickStamp, x: f32) -> Self {
        let mut states = Self { source, tick, x: Vec::new() };
        // There is room for one.
        let _ = states.x.push(x);
        states
    }

    /// Adds a message that says the next component of the same state; `false`, and unchanged, where it says
    /// anything else.
    pub fn add(&mut self, message: &Message) -> bool {
        match *message {
            Message::State { source, component, tick, x } => {
                let follows = usize::from(component.get()) == self.x.len();
                source == self.source && tick == self.tick && follows && self.x.push(x).is_ok()
            }
            _ => false,
        }
    }

    /// The message of component `index`, if it has it.
    pub fn message(&self, index: usize) -> Option<Message> {
        let component = Component::new(u8::try_from(index).ok()?)?;
        Some(Message::State { source: self.source, component, tick: self.tick, x: *self.x.get(index)? })
    }
}

/// What a frame says.
#[derive(Clone, Debug, PartialEq)]
pub enum Content {
    /// STATE_FD.
    States(States),
    /// Anything else.
    Message(Message),
}

/// Encodes a state: STATE_FD.
pub fn encode_states(states: &States) -> FdFrame {
    let id = u16::from(function::STATE_FD) << 7 | u16::from(states.source.get());
    let mut data = [0; MAX_DATA];
    let [t0, t1, ..] = states.tick.value().to_le_bytes();
    let count = states.x.len() as u8;
    let head = [count.saturating_sub(1), 0, t0, t1];
    let values = states.x.iter().flat_map(|x| x.to_le_bytes());
    data.iter_mut().zip(head.into_iter().chain(values)).for_each(|(to, from)| *to = from);
    FdFrame { id, length: length_for(states.x.len()) as u8, data }
}

/// Encodes a message that is no state with its classic payload; a STATE of the first component gives a
/// STATE_FD of one component. Another component alone is none of this format: it gives the classic frame,
/// which receivers refuse (`Kind`); [`States::add`] collects them.
pub fn encode(message: &Message) -> FdFrame {
    if let Message::State { source, component: Component::FIRST, tick, x } = *message {
        return encode_states(&States::new(source, tick, x));
    }
    let classic = can::encode(message);
    let mut data = [0; MAX_DATA];
    data.iter_mut().zip(classic.data()).for_each(|(to, from)| *to = *from);
    FdFrame { id: classic.id(), length: classic.data().len() as u8, data }
}

/// Decodes a plain frame. Any id (its low 11 bits count) and any data give what it says or a reason.
///
/// # Errors
/// As for [`can::decode`]. `Kind` for a STATE of the classic format: its eight bits of tick take a node that
/// was silent for 256 ticks for a fresh one, so a bus does not mix them.
pub fn decode(id: u16, data: &[u8]) -> Result<Content, Refusal> {
    match ((id >> 7) & 0xF) as u8 {
        function::STATE_FD => decode_states((id & 0x7F) as u8, data).map(Content::States),
        function::STATE..=function::STATE_LAST => Err(Refusal::Kind),
        _ => can::decode(id, data).map(Content::Message),
    }
}

fn decode_states(node: u8, data: &[u8]) -> Result<States, Refusal> {
    let &[header, reserved, t0, t1, ref rest @ ..] = data else { return Err(Refusal::Length) };
    if header & !COUNT_BITS != 0 || reserved != 0 {
        return Err(Refusal::Value);
    }
    let count = usize::from(header) + 1;
    if data.len() != length_for(count) {
        return Err(Refusal::Length);
    }
    let (values, _) = rest.as_chunks::<4>();
    let mut x = Vec::new();
    for &value in values.iter().take(count) {
        // There is room for all that a header can count.
        let _ = x.push(finite(f32::from_le_bytes(value))?);
    }
    if rest.iter().skip(4 * count).any(|&pad| pad != 0) {
        return Err(Refusal::Value);
    }
    let tick = TickStamp::low(u32::from(u16::from_le_bytes([t0, t1])), 16);
    Ok(States { source: can::source(node)?, tick, x })
}

/// Bytes of the data field for so many components: the next length that CAN FD has (ISO 11898-1).
const fn length_for(count: usize) -> usize {
    match HEAD + 4 * count {
        ..=8 => 8,
        9..=12 => 12,
        13..=16 => 16,
        17..=20 => 20,
        21..=24 => 24,
        25..=32 => 32,
        _ => MAX_DATA,
    }
}
