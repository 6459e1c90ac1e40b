//! A session behind a line: any frames at any times. No panic, and a bounded number of outputs at one time.
#![no_main]

use funnelnet_node::{Output, Session};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::serial::Frame;
use funnelnet_protocol::service::{Identity, StoreError};
use funnelnet_protocol::can;
use libfuzzer_sys::fuzz_target;

/// More outputs at one time than a session can have.
const MOST_OUTPUTS: usize = 4_000;

fuzz_target!(|script: Vec<(u8, u16, Vec<u8>, u32)>| {
    let mut session: Session = Session::new(Identity::default());
    let mut now = 0;
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
        now += u64::from(later);
    }
});

/// Does what a storage would do: now and then it fails.
fn answer(session: &mut Session, output: &Output, chance: u16) {
    if *output == Output::Keep && session.task().is_some() {
        session.performed(if chance % 3 == 0 { Err(StoreError::Failed) } else { Ok(u32::from(chance)) });
    }
}
