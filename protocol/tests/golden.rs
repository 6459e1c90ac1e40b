//! Golden vectors: the bytes of every released wire version, in both directions.
#![allow(clippy::unwrap_used, clippy::panic)]

use funnelnet_protocol::can_fd::{self, Content, States};
use funnelnet_protocol::message::{
    Command, Component, FaultCode, Message, NodeId, Severity, Target, TickStamp,
};
use funnelnet_protocol::serial::{Deframer, Frame};
use funnelnet_protocol::{can, serial};

const VECTORS: &str = include_str!("vectors/v1.txt");

fn id(number: u8) -> NodeId {
    NodeId::new(number).unwrap()
}

fn state(node: u8, component: u8, tick: u32, x: f32) -> Message {
    Message::State {
        source: id(node),
        component: Component::new(component).unwrap(),
        tick: TickStamp::full(tick),
        x,
    }
}

/// The message that a line of the vector file names.
fn message(what: &str) -> Message {
    match what.split_whitespace().collect::<Vec<_>>().as_slice() {
        ["state", "id5", "k0", "tick1000", "x1.5"] => state(5, 0, 1000, 1.5),
        ["state", "id5", "k1", "tick1000", "x-0.25"] => state(5, 1, 1000, -0.25),
        ["state", "id127", "k0", "tick0xFFFFFF00", "x0"] => state(127, 0, 0xFFFF_FF00, 0.0),
        ["sync", "host", "previous999", "phase0"] => {
            Message::Sync { source: None, previous_tick: TickStamp::full(999), phase_us: 0 }
        }
        ["sync", "id7", "previous0xFFFFFF", "phase500"] => {
            Message::Sync { source: Some(id(7)), previous_tick: TickStamp::full(u32::MAX), phase_us: 500 }
        }
        ["start", "all"] => {
            Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 }
        }
        ["stop", "id9", "at513"] => {
            Message::Ctrl { target: Target::Node(id(9)), command: Command::Stop, arg: 0, at_tick: 513 }
        }
        ["commit", "all", "tick1000"] => {
            Message::Ctrl { target: Target::All, command: Command::Commit, arg: 0, at_tick: 1000 }
        }
        ["edge", "id5", "id6", "weight1.5"] => Message::Edge { source: id(5), neighbour: id(6), weight: 1.5 },
        ["fault", ..] => Message::Fault {
            source: id(5),
            code: FaultCode::DUPLICATE_ID,
            severity: Severity::Stopped,
            arg: 5,
            tick: TickStamp::full(1000),
        },
        other => panic!("no such vector: {other:?}"),
    }
}

/// What a decoder can know of `message`: its tick has only `bits` bits left.
fn truncated(message: Message, bits: u8) -> Message {
    let low = |tick: TickStamp| TickStamp::low(tick.value(), bits);
    match message {
        Message::State { source, component, tick, x } => {
            Message::State { source, component, tick: low(tick), x }
        }
        Message::Fault { source, code, severity, arg, tick } => {
            Message::Fault { source, code, severity, arg, tick: low(tick) }
        }
        Message::Sync { source, previous_tick, phase_us } => {
            Message::Sync { source, previous_tick: TickStamp::low(previous_tick.value(), 24), phase_us }
        }
        Message::Ctrl { .. } | Message::Edge { .. } => message,
    }
}

fn hex(text: &str) -> Vec<u16> {
    text.split_whitespace().map(|byte| u16::from_str_radix(byte, 16).unwrap()).collect()
}

#[test]
fn every_vector_encodes_and_decodes() {
    let mut seen = 0;
    for line in VECTORS.lines().filter(|line| !line.starts_with('#')) {
        let (head, bytes) = line.split_once('|').unwrap();
        let (link, what) = head.split_once(' ').unwrap();
        let bytes = hex(bytes);
        match link {
            "can" => check_can(what, &bytes),
            "fd" => check_fd(what, &bytes),
            "serial" => check_serial(what, &bytes),
            other => panic!("unknown link {other}"),
        }
        seen += 1;
    }
    assert_eq!(seen, 17);
}

fn check_can(what: &str, bytes: &[u16]) {
    let data: Vec<u8> = bytes[1..].iter().map(|&byte| byte as u8).collect();
    let frame = can::encode(&message(what));
    assert_eq!((frame.id(), frame.data()), (bytes[0], data.as_slice()), "{what}");
    assert_eq!(can::decode(frame.id(), frame.data()), Ok(truncated(message(what), 8)), "{what}");
}

/// The state that a line of the vector file names, with so many bits of its tick.
fn states(what: &str, bits: u8) -> States {
    let words: Vec<_> = what.split_whitespace().collect();
    let (node, tick, values) = match words[1..] {
        ["id5", "tick1000", "x1.5"] => (5, 1000, vec![1.5]),
        ["id127", "tick0xFFFFFF00", "x1,-0.25,0"] => (127, 0xFFFF_FF00, vec![1.0, -0.25, 0.0]),
        ["id1", "tick7", "x1,1,1,1,1,1"] => (1, 7, vec![1.0; 6]),
        ref other => panic!("no such vector: {other:?}"),
    };
    let mut states = States::new(id(node), TickStamp::low(tick, bits), values[0]);
    for (component, &x) in (1..).zip(&values[1..]) {
        let Message::State { source, component, x, .. } = state(node, component, tick, x) else {
            unreachable!()
        };
        assert!(states.add(&Message::State { source, component, tick: TickStamp::low(tick, bits), x }));
    }
    states
}

fn check_fd(what: &str, bytes: &[u16]) {
    let data: Vec<u8> = bytes[1..].iter().map(|&byte| byte as u8).collect();
    let (frame, content) = match what.trim_start().starts_with("states") {
        true => (can_fd::encode_states(&states(what, 32)), Content::States(states(what, 16))),
        false => (can_fd::encode(&message(what)), Content::Message(message(what))),
    };
    assert_eq!((frame.id(), frame.data()), (bytes[0], data.as_slice()), "{what}");
    assert_eq!(can_fd::decode(frame.id(), frame.data()), Ok(content), "{what}");
}

fn check_serial(what: &str, bytes: &[u16]) {
    let bytes: Vec<u8> = bytes.iter().map(|&byte| byte as u8).collect();
    assert_eq!(serial::encode(&message(what)).as_slice(), bytes, "{what}");
    let mut deframer: Deframer = Deframer::new();
    let (last, rest) = bytes.split_last().unwrap();
    assert!(rest.iter().all(|&byte| deframer.push(byte).is_none()), "{what}");
    assert_eq!(deframer.push(*last), Some(Ok(Frame::RealTime(truncated(message(what), 16)))), "{what}");
}
