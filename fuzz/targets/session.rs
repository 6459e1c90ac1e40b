//! A session behind a line: any frames at any times. No panic, and a bounded number of outputs at one time.
#![no_main]

use funnelnet_node::{Output, Session};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::can;
use funnelnet_protocol::message::{Command, Message, Target};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::serial::Frame;
use funnelnet_protocol::service::{Body, Identity, Request, StoreError};
use libfuzzer_sys::fuzz_target;

/// More outputs at one time than a session can have.
const MOST_OUTPUTS: usize = 4_000;

fuzz_target!(|input: (bool, Vec<(u8, u16, Vec<u8>, u32)>)| {
    let (configured, script) = input;
    let mut session: Session = Session::new(Identity::default());
    let mut now = 0;
    if configured {
        configure(&mut session);
    }
    for (what, kind, bytes, later) in script {
        match what % 8 {
            0..=3 => session.on_frame(Ok(Frame::Service { kind: kind as u8, source: 0, body: &bytes }), now),
            4 | 5 => {
                if let Ok(message) = can::decode(kind, &bytes) {
                    session.on_frame(Ok(Frame::RealTime(message)), now);
                }
            }
            6 => session.on_frame(Err(Refusal::Crc), now),
            _ => session.sample_failed(),
        }
        let mut outputs = 0;
        while let Some(output) = session.poll(now) {
            outputs += 1;
            assert!(outputs < MOST_OUTPUTS);
            answer(&mut session, &output, kind);
        }
        now += after(later);
    }
});

/// Mostly within a few ticks, now and then some sixty of them; seconds, in which a node runs thousands, are
/// rare, since they are slow.
fn after(later: u32) -> u64 {
    match later {
        _ if later.is_multiple_of(4096) => later.into(),
        _ if later.is_multiple_of(64) => u64::from(later / 64),
        _ => u64::from(later % 3_000_000),
    }
}

/// Makes a node of it that runs.
fn configure(session: &mut Session) {
    let config = NodeConfig::builder(1, 1_000_000).edge(2, 1.0).edge(3, 1.0).telemetry_every(1).build();
    let request = Request::Configure(config.expect("room for two edges"));
    let mut body = [0; 1024];
    let length = request.encode(&mut body).expect("a small configuration has room");
    session.on_frame(Ok(Frame::Service { kind: request.kind(), source: 0, body: &body[..length] }), 0);
    let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
    session.on_frame(Ok(Frame::RealTime(start)), 0);
}

/// Does what a storage would do: now and then it fails.
fn answer(session: &mut Session, output: &Output, chance: u16) {
    if *output == Output::StorageRequest && session.task().is_some() {
        session.performed(if chance % 3 == 0 { Err(StoreError::Failed) } else { Ok(u32::from(chance)) });
    }
}
