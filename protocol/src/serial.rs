//! Serial frames: `COBS(kind, source, body, crc16) 0x00`, for both planes (protocol/README.md, "Serial").

use crate::can::function;
use crate::can::{
    command, command_number, exactly, finite, severity, severity_number, source, target_number,
};
use crate::message::{Component, FaultCode, Message, NodeId, Target, TickStamp};
use crate::refusal::Refusal;
use crate::service::Body;
use crc::{CRC_16_IBM_3740, Crc, Table};
use heapless::Vec;

/// Kinds of the real-time plane are `REAL_TIME | function`.
pub const REAL_TIME: u8 = 0x10;
/// Source of frames that come from the host.
pub const HOST: u8 = 0;
/// Longest body, bytes: a [`crate::NodeConfig`] with everything in it.
pub const MAX_BODY: usize = 1400;
/// Longest frame before COBS: kind, source, body, CRC.
pub const MAX_RAW: usize = 2 + MAX_BODY + 2;
/// Longest frame on the wire, final zero included.
pub const MAX_FRAME: usize = cobs::max_encoding_length(MAX_RAW) + 1;
/// Longest frame of the real-time plane on the wire, final zero included.
pub const MAX_REAL_TIME_FRAME: usize = 12;

/// CRC-16/CCITT-FALSE, which the catalogue calls IBM-3740; sent big-endian.
static CRC: Crc<u16, Table<1>> = Crc::<u16, Table<1>>::new(&CRC_16_IBM_3740);

/// A decoded serial frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Frame<'a> {
    /// Real-time plane.
    RealTime(Message),
    /// Service plane; [`crate::service::Body::decode`] reads the body, which only the receiver's role tells
    /// how.
    Service {
        /// Kind of the body.
        kind: u8,
        /// Sender; 0 is the host or a blank node.
        source: u8,
        /// Body, not decoded yet.
        body: &'a [u8],
    },
}

/// Encodes a frame of the real-time plane, final zero included.
pub fn encode(message: &Message) -> Vec<u8, MAX_REAL_TIME_FRAME> {
    let mut raw: Vec<u8, MAX_REAL_TIME_FRAME> = Vec::new();
    let (kind, source) = head(message);
    push(&mut raw, &[kind, source]);
    match *message {
        Message::Ctrl { target, command, arg, at_tick } => {
            push(&mut raw, &[target_number(target), command_number(command), arg]);
            push(&mut raw, &at_tick.to_le_bytes());
        }
        Message::Sync { previous_tick, phase_us, .. } => {
            let [t0, t1, t2, _] = previous_tick.value().to_le_bytes();
            push(&mut raw, &[t0, t1, t2]);
            push(&mut raw, &phase_us.to_le_bytes());
        }
        Message::Fault { code, severity, arg, tick, .. } => {
            push(&mut raw, &[code.0, severity_number(severity)]);
            push(&mut raw, &arg.to_le_bytes());
            push(&mut raw, &low16(tick));
        }
        Message::State { tick, x, .. } => {
            push(&mut raw, &low16(tick));
            push(&mut raw, &x.to_le_bytes());
        }
        Message::Edge { neighbour, weight, .. } => {
            push(&mut raw, &[neighbour.get()]);
            push(&mut raw, &weight.to_le_bytes());
        }
    }
    let crc = CRC.checksum(&raw);
    push(&mut raw, &crc.to_be_bytes());
    let mut frame = Vec::new();
    let _ = frame.resize(MAX_REAL_TIME_FRAME, 0);
    finish(&raw, &mut frame);
    frame
}

/// Encodes a frame of the service plane into `out`, final zero included; its length, or `None` where it does
/// not fit. [`MAX_FRAME`] bytes always suffice. `scratch` holds the frame before COBS, [`MAX_RAW`] bytes.
pub fn encode_service(service: &impl Body, source: u8, scratch: &mut [u8], out: &mut [u8]) -> Option<usize> {
    let (head, body) = scratch.split_at_mut_checked(2)?;
    head.copy_from_slice(&[service.kind(), source]);
    let end = 2 + service.encode(body)?;
    let crc = CRC.checksum(scratch.get(..end)?);
    scratch.get_mut(end..end + 2)?.copy_from_slice(&crc.to_be_bytes());
    let raw = scratch.get(..end + 2)?;
    if out.len() < cobs::max_encoding_length(raw.len()) + 1 {
        return None;
    }
    let length = cobs::try_encode(raw, out).ok()?;
    *out.get_mut(length)? = 0;
    Some(length + 1)
}

/// Decodes one frame, given without its final zero; `frame` is used as scratch space.
///
/// # Errors
/// `Cobs`, `Length`, `Crc`, `Kind`, `Value` or `NotFinite`, checked in this order.
pub fn decode(frame: &mut [u8]) -> Result<Frame<'_>, Refusal> {
    let length = decode_cobs(frame).ok_or(Refusal::Cobs)?;
    let raw = frame.get(..length).ok_or(Refusal::Cobs)?;
    let (content, crc) = raw.split_last_chunk::<2>().ok_or(Refusal::Length)?;
    let &[kind, source, ref body @ ..] = content else { return Err(Refusal::Length) };
    if CRC.checksum(content) != u16::from_be_bytes(*crc) {
        return Err(Refusal::Crc);
    }
    if kind & 0xF0 == REAL_TIME {
        decode_real_time(kind & 0x0F, source, body).map(Frame::RealTime)
    } else {
        Ok(Frame::Service { kind, source, body })
    }
}

/// Undoes COBS up to the first zero or the end, in place; gives the length, or `None` for what is not COBS.
///
/// `cobs::decode_in_place` without the index checks that the compiler cannot remove from it
/// (`./ci.sh panics`).
fn decode_cobs(frame: &mut [u8]) -> Option<usize> {
    let end = frame.iter().position(|&byte| byte == 0).unwrap_or(frame.len());
    if frame.is_empty() {
        return None;
    }
    let (mut from, mut to) = (0, 0);
    while from < end {
        let code = *frame.get(from)?;
        let next = from + usize::from(code);
        if next > end {
            return None;
        }
        for at in from + 1..next {
            *frame.get_mut(to)? = *frame.get(at)?;
            to += 1;
        }
        from = next;
        if code != u8::MAX && from < end {
            *frame.get_mut(to)? = 0;
            to += 1;
        }
    }
    Some(to)
}

fn decode_real_time(function: u8, from: u8, body: &[u8]) -> Result<Message, Refusal> {
    match function {
        function::CTRL => {
            let &[to, number, arg, low, high] = exactly(body)?;
            if from != HOST {
                return Err(Refusal::Value);
            }
            let at_tick = u16::from_le_bytes([low, high]);
            let target = if to == 0 { Target::All } else { Target::Node(source(to)?) };
            Ok(Message::Ctrl { target, command: command(number)?, arg, at_tick })
        }
        function::SYNC => {
            let &[t0, t1, t2, p0, p1] = exactly(body)?;
            Ok(Message::Sync {
                source: if from == HOST { None } else { Some(source(from)?) },
                previous_tick: TickStamp::low(u32::from_le_bytes([t0, t1, t2, 0]), 24),
                phase_us: u16::from_le_bytes([p0, p1]),
            })
        }
        function::FAULT => {
            let &[code, how_bad, a0, a1, t0, t1] = exactly(body)?;
            Ok(Message::Fault {
                source: source(from)?,
                code: FaultCode(code),
                severity: severity(how_bad)?,
                arg: u16::from_le_bytes([a0, a1]),
                tick: TickStamp::low(u32::from_le_bytes([t0, t1, 0, 0]), 16),
            })
        }
        function::STATE..=function::STATE_LAST => {
            let &[t0, t1, x0, x1, x2, x3] = exactly(body)?;
            Ok(Message::State {
                source: source(from)?,
                component: Component::new(function - function::STATE).ok_or(Refusal::Kind)?,
                tick: TickStamp::low(u32::from_le_bytes([t0, t1, 0, 0]), 16),
                x: finite(f32::from_le_bytes([x0, x1, x2, x3]))?,
            })
        }
        function::EDGE => {
            let &[neighbour, w0, w1, w2, w3] = exactly(body)?;
            Ok(Message::Edge {
                source: source(from)?,
                neighbour: source(neighbour)?,
                weight: finite(f32::from_le_bytes([w0, w1, w2, w3]))?,
            })
        }
        _ => Err(Refusal::Kind),
    }
}

fn head(message: &Message) -> (u8, u8) {
    let (function, source) = match *message {
        Message::Ctrl { .. } => (function::CTRL, HOST),
        Message::Sync { source, .. } => (function::SYNC, source.map_or(HOST, NodeId::get)),
        Message::Fault { source, .. } => (function::FAULT, source.get()),
        Message::State { source, component, .. } => (function::STATE + component.get(), source.get()),
        Message::Edge { source, .. } => (function::EDGE, source.get()),
    };
    (REAL_TIME | function, source)
}

fn low16(tick: TickStamp) -> [u8; 2] {
    let [low, high, ..] = tick.value().to_le_bytes();
    [low, high]
}

/// Room is a tested constant ([`MAX_REAL_TIME_FRAME`]), so nothing is cut off here.
fn push(raw: &mut Vec<u8, MAX_REAL_TIME_FRAME>, bytes: &[u8]) {
    let _ = raw.extend_from_slice(bytes);
}

fn finish(raw: &[u8], frame: &mut Vec<u8, MAX_REAL_TIME_FRAME>) {
    let length = cobs::try_encode(raw, frame).unwrap_or(0);
    frame.truncate(length + 1);
    if let Some(last) = frame.last_mut() {
        *last = 0;
    }
}

/// Finds frames in a stream of bytes.
///
/// After an overflow everything up to the next zero is dropped, so that no tail of a frame is taken for a
/// frame.
#[derive(Debug)]
pub struct Deframer<const N: usize = MAX_FRAME> {
    buffer: Vec<u8, N>,
    overflow: bool,
    /// The buffer still holds the last frame, which was lent out.
    done: bool,
}

impl<const N: usize> Default for Deframer<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Deframer<N> {
    /// An empty one.
    pub const fn new() -> Self {
        Self { buffer: Vec::new(), overflow: false, done: false }
    }

    /// Takes one byte; gives a frame, or the reason for refusing one, when the byte ends it. Idle zeros are
    /// ignored.
    #[inline]
    pub fn push(&mut self, byte: u8) -> Option<Result<Frame<'_>, Refusal>> {
        if self.done {
            self.buffer.clear();
            self.done = false;
        }
        if byte != 0 {
            self.overflow |= self.buffer.push(byte).is_err();
            return None;
        }
        self.finish()
    }

    fn finish(&mut self) -> Option<Result<Frame<'_>, Refusal>> {
        self.done = true;
        if core::mem::take(&mut self.overflow) {
            return Some(Err(Refusal::Overflow));
        }
        if self.buffer.is_empty() { None } else { Some(decode(&mut self.buffer)) }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::decode_cobs;
    use proptest::prelude::*;
    use std::vec::Vec;

    proptest! {
        /// Small numbers make valid blocks likely; zeros end the frame early.
        #[test]
        fn cobs_is_undone_as_the_crate_does_it(
            bytes in prop::collection::vec(prop_oneof![4 => 0..6u8, 1 => any::<u8>()], 0..600),
            long in prop::collection::vec(1..=255u8, 0..600),
        ) {
            let mut coded = std::vec![0; cobs::max_encoding_length(long.len())];
            let length = cobs::encode(&long, &mut coded);
            coded.truncate(length);
            for bytes in [bytes, coded] {
                let (mut ours, mut theirs) = (bytes.clone(), bytes);
                let expected = cobs::decode_in_place(&mut theirs).ok().map(|length| Vec::from(&theirs[..length]));
                let found = decode_cobs(&mut ours).map(|length| Vec::from(&ours[..length]));
                prop_assert_eq!(found, expected);
            }
        }
    }
}
