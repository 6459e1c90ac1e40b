//! A node behind a serial line, in memory: what the firmware does with its link, without a board.

use funnelnet_node::{Observation, Output, Session};
use funnelnet_protocol::serial::{self, Deframer, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Body, Identity, Reply, StoreError};
use funnelnet_protocol::{Refusal, WIRE_VERSION};
use std::collections::VecDeque;

/// Ticks of which a board keeps what its node saw.
const KEPT: usize = 100;

/// One end of a serial line: bytes in, session, frames out.
pub struct Board {
    session: Session,
    deframer: Deframer,
    /// What its node saw at the last ticks that it told of.
    seen: VecDeque<Vec<Observation<f32>>>,
}

impl Board {
    /// A blank node.
    pub fn new() -> Self {
        let identity = Identity { wire_version: WIRE_VERSION, ..Identity::default() };
        Self { session: Session::new(identity), deframer: Deframer::new(), seen: VecDeque::new() }
    }

    /// Restarts it, blank.
    pub fn restart(&mut self) {
        *self = Self { seen: std::mem::take(&mut self.seen), ..Self::new() };
    }

    /// What the node says to these bytes, frame by frame.
    pub fn hear(&mut self, bytes: &[u8], now: u64) -> Vec<Vec<u8>> {
        let mut said = Vec::new();
        for &byte in bytes {
            if let Some(frame) = self.deframer.push(byte) {
                self.session.on_frame(frame, now);
                said.append(&mut self.poll(now));
            }
        }
        said
    }

    /// What the node says by itself.
    pub fn poll(&mut self, now: u64) -> Vec<Vec<u8>> {
        let mut said = Vec::new();
        while let Some(output) = self.session.poll(now) {
            match output {
                Output::Send(message) => said.push(serial::encode(&message).to_vec()),
                Output::Reply(reply) => {
                    if matches!(reply, Reply::Telemetry(_)) {
                        self.note_seen();
                    }
                    said.push(service(&reply, self.session.id()));
                }
                // A board without storage.
                Output::StorageRequest => self.session.performed(Err(StoreError::Absent)),
                Output::Report(_) | Output::Safe | Output::Sample | Output::Actuate => {}
            }
        }
        said
    }

    /// When it has something to say by itself.
    pub fn poll_at(&self) -> Option<u64> {
        self.session.poll_at()
    }

    /// What its node saw at a tick that it has told of lately, by component.
    pub fn seen_at(&self, tick: u32) -> Option<&[Observation<f32>]> {
        let of = |seen: &&Vec<Observation<f32>>| seen.first().is_some_and(|first| first.tick == tick);
        self.seen.iter().rev().find(of).map(Vec::as_slice)
    }

    /// Frames that the node refused, for any reason.
    pub fn refused(&self) -> u64 {
        let counters = self.session.node().map(|node| node.counters().clone()).unwrap_or_default();
        Refusal::ALL.iter().map(|&reason| u64::from(counters.refused(reason))).sum()
    }

    fn note_seen(&mut self) {
        if let Some(node) = self.session.node() {
            self.seen.push_back(node.observations().to_vec());
            if self.seen.len() > KEPT {
                self.seen.pop_front();
            }
        }
    }
}

impl Default for Board {
    fn default() -> Self {
        Self::new()
    }
}

fn service(body: &impl Body, source: u8) -> Vec<u8> {
    let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
    let length = serial::encode_service(body, source, &mut scratch, &mut frame).unwrap();
    frame[..length].to_vec()
}
