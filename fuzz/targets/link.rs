//! The machines of a link, told anything in any order: a CAN port in both formats by its driver, the receiver
//! of a serial line by noise, and nodes that pass on what lines bring. No panic; what a port sends another
//! one reads; what is passed on dies.
#![no_main]

use funnelnet_link::port::LOOK_EVERY_NS;
use funnelnet_link::{BusState, CanPort, Classic, Fd, Format, Forwarder, Frame, Heard};
use funnelnet_protocol::can;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::serial::{self, Deframer};
use libfuzzer_sys::fuzz_target;

/// More than one received frame, and what happened beside it, can mean.
const MOST_HEARD: usize = 20;
/// Longer than a port waits for anything.
const LONG_NS: u64 = 60_000_000_000;
/// Lines of each node in a full network of four.
const PEERS: usize = 3;

fuzz_target!(|input: &[u8]| {
    let Some((&what, rest)) = input.split_first() else { return };
    let mut script = Script(rest);
    match what % 4 {
        0 => can_port::<Classic>(&mut script),
        1 => can_port::<Fd>(&mut script),
        2 => line(&mut script),
        _ => network(&mut script),
    }
});

/// Bytes that say what happens.
struct Script<'a>(&'a [u8]);

impl<'a> Script<'a> {
    fn byte(&mut self) -> Option<u8> {
        let (&first, rest) = self.0.split_first()?;
        self.0 = rest;
        Some(first)
    }

    fn bytes(&mut self, most: usize) -> &'a [u8] {
        let length = usize::from(self.byte().unwrap_or(0)).min(most).min(self.0.len());
        let (bytes, rest) = self.0.split_at(length);
        self.0 = rest;
        bytes
    }

    fn id(&mut self) -> u16 {
        u16::from_le_bytes([self.byte().unwrap_or(0), self.byte().unwrap_or(0)])
    }

    /// A message, if the bytes are those of one.
    fn message(&mut self) -> Option<Message> {
        let (id, data) = (self.id(), self.bytes(8));
        can::decode(id, data).ok()
    }
}

/// What a driver may tell a port, and what it may ask of it.
fn can_port<F: Format>(script: &mut Script<'_>) {
    let (mut port, mut other) = (CanPort::<F>::new(), CanPort::<F>::new());
    let (mut now, mut offs) = (0, 0);
    while let Some(event) = script.byte() {
        match event % 8 {
            0 | 1 => drop(script.message().map(|message| port.send(&message))),
            2 => drop(port.flush()),
            3 => {
                if let Some(frame) = port.next_frame() {
                    other.on_frame(frame.id(), frame.data());
                    while let Some(heard) = other.hear() {
                        assert!(matches!(heard, Heard::Message(Ok(_))), "{heard:?}");
                    }
                    port.on_taken();
                }
            }
            4 => port.on_frame(script.id(), script.bytes(64)),
            5 => port.on_refused(Refusal::Crc),
            6 => port.on_error(),
            _ => {
                now += u64::from(script.byte().unwrap_or(0)) * LOOK_EVERY_NS;
                let state = [BusState::Active, BusState::Passive, BusState::Off][usize::from(event / 8) % 3];
                let _ = port.on_state(state, now);
                assert_eq!(port.look_at(), now + LOOK_EVERY_NS);
            }
        }
        assert!(
            port.state() != BusState::Off || port.next_frame().is_none(),
            "nothing goes to a controller that is off"
        );
        assert!(port.offs() >= offs);
        offs = port.offs();
        // The node listens now and then.
        if event & 0x80 != 0 {
            let heard = std::iter::from_fn(|| port.hear()).take(MOST_HEARD).count();
            assert!(heard < MOST_HEARD);
        }
    }
    // On a controller that comes back and stays it sends what it is given, once it has waited and restarted.
    for _ in 0..4 {
        now += LONG_NS;
        let _ = port.on_state(BusState::Active, now);
    }
    assert_eq!(port.state(), BusState::Active);
    while port.next_frame().is_some() {
        port.on_taken();
    }
}

/// After any noise and a zero a whole frame is read.
fn line(script: &mut Script<'_>) {
    let message = script.message();
    let mut receiver: Deframer = Deframer::new();
    for &byte in script.0 {
        let _ = receiver.push(byte);
    }
    let _ = receiver.push(0);
    let Some(message) = message else { return };
    let mut read = None;
    for &byte in serial::encode(&message).iter() {
        if let Some(frame) = receiver.push(byte) {
            read = Some(frame.is_ok());
        }
    }
    // A value that is not a number does not come through a decoder, and is not sent by an encoder's user.
    assert_eq!(read, Some(true), "{message:?}");
}

/// Four nodes, each with a line to every other one: what one is told goes round, and dies.
fn network(script: &mut Script<'_>) {
    let mut nodes: [Forwarder<PEERS>; PEERS + 1] = Default::default();
    let mut now = 0;
    while let Some(event) = script.byte() {
        let at = usize::from(event) % nodes.len();
        let Some(message) = script.message() else {
            now += u64::from(event);
            continue;
        };
        if event & 0x80 != 0 {
            nodes[at].send(&message, now);
        } else {
            // From the host.
            let _ = nodes[at].hear(0, &message, now);
        }
        if event & 0x40 != 0 {
            settle(&mut nodes, now);
        }
    }
    settle(&mut nodes, now);
}

/// Carries everything from node to node until nothing moves.
fn settle(nodes: &mut [Forwarder<PEERS>; PEERS + 1], now: u64) {
    let mut carried = 0;
    loop {
        let before = carried;
        for from in 0..nodes.len() {
            while nodes[from].take(0).is_some() {}
            for line in 1..=PEERS {
                while let Some(message) = nodes[from].take(line) {
                    carried += 1;
                    // Every command, fault and other frame that a node can hold, once over each line in each
                    // direction, twice over.
                    assert!(carried < 10_000, "a frame goes round for ever");
                    let to = (from + line) % nodes.len();
                    let back = nodes.len() - line;
                    let _ = nodes[to].hear(back, &message, now);
                }
            }
        }
        if carried == before {
            return;
        }
    }
}
