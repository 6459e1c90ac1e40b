//! Classic CAN frames of the real-time plane, plain form (authentication off): 11-bit id `fn << 7 | node`.
//!
//! Byte tables: protocol/README.md, "Real-time plane". A plain frame is shorter than the authenticated one of
//! the same kind (8 bytes), so a receiver tells them apart by length and never by trust.

use crate::message::{Command, Component, FaultCode, Message, NodeId, Severity, Target, TickStamp};
use crate::refusal::Refusal;

/// Longest data field of a plain frame, bytes.
pub const MAX_DATA: usize = 5;

/// Function codes: the upper four bits of the id, and the priority.
pub mod function {
    /// CTRL.
    pub const CTRL: u8 = 0;
    /// SYNC.
    pub const SYNC: u8 = 1;
    /// FAULT.
    pub const FAULT: u8 = 2;
    /// STATE, component 0; component `k` is `STATE + k`.
    pub const STATE: u8 = 3;
    /// STATE, component 7.
    pub const STATE_LAST: u8 = 10;
    /// STATE_FD, in frames of CAN FD only ([`crate::can_fd`]).
    pub const STATE_FD: u8 = 11;
    /// EDGE.
    pub const EDGE: u8 = 12;
}

/// A classic CAN data frame with an 11-bit id.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CanFrame {
    id: u16,
    length: u8,
    data: [u8; MAX_DATA],
}

impl CanFrame {
    /// A frame of these bytes; none where they are more than a plain frame has. Of the identifier the low 11
    /// bits count.
    pub fn new(id: u16, bytes: &[u8]) -> Option<Self> {
        let mut data = [0; MAX_DATA];
        data.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(Self { id: id & 0x7FF, length: bytes.len() as u8, data })
    }

    /// The 11-bit identifier.
    pub fn id(&self) -> u16 {
        self.id
    }

    /// The data field.
    pub fn data(&self) -> &[u8] {
        self.data.get(..usize::from(self.length)).unwrap_or(&self.data)
    }
}

/// Encodes `message` in its plain form.
#[inline]
pub fn encode(message: &Message) -> CanFrame {
    match *message {
        Message::Ctrl { target, command, arg, at_tick } => {
            let [low, high] = at_tick.to_le_bytes();
            frame(function::CTRL, target_number(target), 4, [command_number(command), arg, low, high, 0])
        }
        Message::Sync { source, previous_tick, phase_us } => {
            let [t0, t1, t2, _] = previous_tick.value().to_le_bytes();
            let [p0, p1] = phase_us.to_le_bytes();
            frame(function::SYNC, source.map_or(0, NodeId::get), 5, [t0, t1, t2, p0, p1])
        }
        Message::Fault { source, code, severity, arg, tick } => {
            let [a0, a1] = arg.to_le_bytes();
            let [tick8, ..] = tick.value().to_le_bytes();
            frame(function::FAULT, source.get(), 5, [code.0, severity_number(severity), a0, a1, tick8])
        }
        Message::State { source, component, tick, x } => {
            let [x0, x1, x2, x3] = x.to_le_bytes();
            let [tick8, ..] = tick.value().to_le_bytes();
            frame(function::STATE + component.get(), source.get(), 5, [x0, x1, x2, x3, tick8])
        }
        Message::Edge { source, neighbour, weight } => {
            let [w0, w1, w2, w3] = weight.to_le_bytes();
            frame(function::EDGE, source.get(), 5, [neighbour.get(), w0, w1, w2, w3])
        }
    }
}

/// Decodes a plain frame. Any id (its low 11 bits count) and any data give a message or a reason.
///
/// # Errors
/// `Kind`, `Length`, `Value` (a field that this version does not define) or `NotFinite`.
#[inline]
pub fn decode(id: u16, data: &[u8]) -> Result<Message, Refusal> {
    let function = ((id >> 7) & 0xF) as u8;
    let node = (id & 0x7F) as u8;
    match function {
        function::CTRL => {
            let &[command, arg, low, high] = exactly(data)?;
            let target = target(node);
            Ok(Message::Ctrl {
                target,
                command: self::command(command)?,
                arg,
                at_tick: u16::from_le_bytes([low, high]),
            })
        }
        function::SYNC => {
            let &[t0, t1, t2, p0, p1] = exactly(data)?;
            Ok(Message::Sync {
                source: NodeId::new(node),
                previous_tick: TickStamp::low(u32::from_le_bytes([t0, t1, t2, 0]), 24),
                phase_us: u16::from_le_bytes([p0, p1]),
            })
        }
        function::FAULT => {
            let &[code, severity, a0, a1, tick] = exactly(data)?;
            Ok(Message::Fault {
                source: source(node)?,
                code: FaultCode(code),
                severity: self::severity(severity)?,
                arg: u16::from_le_bytes([a0, a1]),
                tick: TickStamp::low(u32::from(tick), 8),
            })
        }
        function::STATE..=function::STATE_LAST => {
            let &[x0, x1, x2, x3, tick] = exactly(data)?;
            Ok(Message::State {
                source: source(node)?,
                component: Component::new(function - function::STATE).ok_or(Refusal::Kind)?,
                tick: TickStamp::low(u32::from(tick), 8),
                x: finite(f32::from_le_bytes([x0, x1, x2, x3]))?,
            })
        }
        function::EDGE => {
            let &[neighbour, w0, w1, w2, w3] = exactly(data)?;
            Ok(Message::Edge {
                source: source(node)?,
                neighbour: source(neighbour)?,
                weight: finite(f32::from_le_bytes([w0, w1, w2, w3]))?,
            })
        }
        _ => Err(Refusal::Kind),
    }
}

fn frame(function: u8, node: u8, length: u8, data: [u8; MAX_DATA]) -> CanFrame {
    CanFrame { id: u16::from(function) << 7 | u16::from(node), length, data }
}

pub(crate) fn exactly<const N: usize>(data: &[u8]) -> Result<&[u8; N], Refusal> {
    data.try_into().map_err(|_| Refusal::Length)
}

pub(crate) fn finite(x: f32) -> Result<f32, Refusal> {
    if x.is_finite() { Ok(x) } else { Err(Refusal::NotFinite) }
}

pub(crate) fn source(node: u8) -> Result<NodeId, Refusal> {
    NodeId::new(node).ok_or(Refusal::Value)
}

pub(crate) fn target(node: u8) -> Target {
    NodeId::new(node).map_or(Target::All, Target::Node)
}

pub(crate) fn target_number(target: Target) -> u8 {
    match target {
        Target::All => 0,
        Target::Node(node) => node.get(),
    }
}

pub(crate) fn command(number: u8) -> Result<Command, Refusal> {
    match number {
        1 => Ok(Command::Start),
        2 => Ok(Command::Stop),
        3 => Ok(Command::Commit),
        _ => Err(Refusal::Value),
    }
}

pub(crate) fn command_number(command: Command) -> u8 {
    match command {
        Command::Start => 1,
        Command::Stop => 2,
        Command::Commit => 3,
    }
}

pub(crate) fn severity(number: u8) -> Result<Severity, Refusal> {
    match number {
        0 => Ok(Severity::Notice),
        1 => Ok(Severity::Warning),
        2 => Ok(Severity::Stopped),
        _ => Err(Refusal::Value),
    }
}

pub(crate) fn severity_number(severity: Severity) -> u8 {
    match severity {
        Severity::Notice => 0,
        Severity::Warning => 1,
        Severity::Stopped => 2,
    }
}
