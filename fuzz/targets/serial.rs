//! Bytes of a line: nothing panics, each frame's message survives a line, and a frame after noise is found.
#![no_main]

use funnelnet_protocol::message::{Command, Message, Target};
use funnelnet_protocol::serial::{self, Deframer, Frame};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let mut deframer: Deframer = Deframer::new();
    for &byte in bytes {
        if let Some(Ok(Frame::RealTime(message))) = deframer.push(byte) {
            check(&message);
        }
    }
    // A zero ends whatever the noise was; then a good frame is heard.
    let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
    deframer.push(0);
    let heard = serial::encode(&start)
        .iter()
        .filter_map(|&byte| deframer.push(byte).map(|frame| frame.is_ok()))
        .collect::<Vec<_>>();
    assert!(heard.contains(&true), "{heard:?}");
});

fn check(message: &Message) {
    let mut deframer: Deframer = Deframer::new();
    let frame = serial::encode(message);
    let found = frame.iter().any(|&byte| match deframer.push(byte) {
        // NaN is not equal to itself; its bytes are.
        Some(Ok(Frame::RealTime(again))) => serial::encode(&again) == frame,
        _ => false,
    });
    assert!(found, "{message:?}");
}
