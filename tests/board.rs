//! A node behind a serial line and perhaps on CAN, in memory: what the firmware does with its link, without a
//! board.

use funnelnet_link::Frame;
use funnelnet_node::{Observation, Output, Session, Task};
use funnelnet_protocol::config::NodeConfig;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::serial::{self, Deframer, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Body, Identity, Reply, StoreError};
use funnelnet_protocol::{Refusal, WIRE_VERSION};
use sim_host::can::{AnyFormat, PortFrame};
use std::collections::VecDeque;

/// Ticks of which a board keeps what its node saw.
const KEPT: usize = 100;

/// A frame that a node says.
#[derive(Clone, Debug, PartialEq)]
pub enum Said {
    /// On its line.
    Line(Vec<u8>),
    /// On its bus.
    Bus(PortFrame),
}

/// How a node on CAN speaks and hears.
struct OnCan {
    saying: AnyFormat,
    hearing: AnyFormat,
}

/// One end of a serial line: bytes in, session, frames out.
pub struct Board {
    session: Session,
    deframer: Deframer,
    on_can: Option<OnCan>,
    /// Parts in a billion that its clock is too fast.
    drift_ppb: i64,
    /// It hears of no other node on its bus, but SYNC and commands.
    pub is_deaf: bool,
    /// What it keeps over a restart.
    pub kept: Kept,
    /// What its node saw at the last ticks that it told of.
    seen: VecDeque<Vec<Observation<f32>>>,
}

impl Board {
    /// A blank node.
    pub fn new() -> Self {
        let identity = Identity { wire_version: WIRE_VERSION, ..Identity::default() };
        Self {
            session: Session::new(identity),
            deframer: Deframer::new(),
            on_can: None,
            drift_ppb: 0,
            is_deaf: false,
            kept: Kept::default(),
            seen: VecDeque::new(),
        }
    }

    /// Its states travel on CAN from now on, in frames of CAN FD if `fd`.
    pub fn put_on_can(&mut self, fd: bool) {
        self.on_can = Some(OnCan { saying: AnyFormat::new(fd), hearing: AnyFormat::new(fd) });
    }

    /// Its clock is so many parts in a billion too fast from the beginning of the world on.
    pub fn set_drift(&mut self, ppb: i64) {
        self.drift_ppb = ppb;
    }

    /// What its clock shows at `now`, ns.
    fn own(&self, now: u64) -> u64 {
        now.saturating_add_signed(gained(now, self.drift_ppb))
    }

    /// When it shows `own` or more, ns.
    fn when(&self, own: u64) -> u64 {
        if self.drift_ppb == 0 {
            return own;
        }
        let rate = 1_000_000_000 + i128::from(self.drift_ppb);
        let mut at = u64::try_from((i128::from(own) * 1_000_000_000 / rate).max(0)).unwrap_or(u64::MAX);
        while self.own(at) < own {
            at += 1;
        }
        at
    }

    /// Its session.
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Restarts it, as what it has stored makes it.
    pub fn restart(&mut self) {
        let (seen, on_can) = (std::mem::take(&mut self.seen), self.on_can.take());
        let kept = Kept { staged: None, ..std::mem::take(&mut self.kept) };
        *self = Self { seen, on_can, kept, drift_ppb: self.drift_ppb, is_deaf: self.is_deaf, ..Self::new() };
        if self.kept.stored.is_some() {
            *self.session.config_buffer() = self.kept.stored.clone();
            self.session.restore().unwrap();
        }
    }

    /// What the node says to a frame on its bus.
    pub fn hear_on_can(&mut self, frame: &PortFrame, now: u64) -> Vec<Said> {
        let Some(can) = &mut self.on_can else { return Vec::new() };
        let mut said = Vec::new();
        for message in can.hearing.unpack(frame.id(), frame.data()) {
            if self.is_deaf && matches!(message, Ok(Message::State { .. } | Message::Edge { .. })) {
                continue;
            }
            let own = self.own(now);
            self.session.on_frame(message.map(serial::Frame::RealTime), own);
            said.append(&mut self.poll(now));
        }
        said
    }

    /// What the node says to these bytes, frame by frame.
    pub fn hear(&mut self, bytes: &[u8], now: u64) -> Vec<Said> {
        let mut said = Vec::new();
        for &byte in bytes {
            if let Some(frame) = self.deframer.push(byte) {
                let own = now.saturating_add_signed(gained(now, self.drift_ppb));
                self.session.on_frame(frame, own);
                said.append(&mut self.poll(now));
            }
        }
        said
    }

    /// What the node says by itself.
    pub fn poll(&mut self, now: u64) -> Vec<Said> {
        let (mut said, now) = (Vec::new(), self.own(now));
        while let Some(output) = self.session.poll(now) {
            match output {
                Output::Send(message) => self.send(&message, &mut said),
                Output::Sync(message) => {
                    self.send(&message, &mut said);
                    self.session.sync_sent(now);
                }
                Output::Reply(reply) => {
                    if matches!(reply, Reply::Telemetry(_)) {
                        self.note_seen();
                    }
                    said.push(Said::Line(service(&reply, self.session.id())));
                }
                Output::StorageRequest => {
                    let outcome = self.session.task().map(|task| self.kept.perform(task));
                    self.session.performed(outcome.unwrap_or(Err(StoreError::Failed)));
                }
                Output::Report(_) | Output::Safe | Output::Sample | Output::Actuate => {}
            }
        }
        let last = self.on_can.as_mut().and_then(|can| can.saying.flush());
        said.extend(last.map(Said::Bus));
        said
    }

    fn send(&mut self, message: &Message, said: &mut Vec<Said>) {
        // A fault is told on both.
        if self.on_can.is_none() || matches!(message, Message::Fault { .. }) {
            said.push(Said::Line(serial::encode(message).to_vec()));
        }
        if let Some(can) = &mut self.on_can {
            said.extend(can.saying.pack(message).into_iter().map(Said::Bus));
        }
    }

    /// When it has something to say by itself.
    pub fn poll_at(&self) -> Option<u64> {
        self.session.poll_at().map(|own| self.when(own))
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

/// What a clock that is so many parts in a billion too fast gains in `passed`, ns.
fn gained(passed: u64, ppb: i64) -> i64 {
    i64::try_from(i128::from(passed) * i128::from(ppb) / 1_000_000_000).unwrap()
}

/// The storage of a board.
#[derive(Default)]
pub struct Kept {
    /// What it starts with.
    pub stored: Option<NodeConfig>,
    staged: Option<NodeConfig>,
    epoch: u32,
    /// It fails at the next commit.
    pub fails: bool,
    /// It keeps nothing that is staged.
    pub is_worn: bool,
}

impl Kept {
    fn perform(&mut self, task: Task<'_>) -> Result<u32, StoreError> {
        match task {
            Task::Stage(_) if self.is_worn => return Err(StoreError::Failed),
            Task::Stage(config) => self.staged = Some(config.clone()),
            Task::Commit(_) if std::mem::take(&mut self.fails) => return Err(StoreError::Failed),
            Task::Commit(room) => {
                self.stored = self.staged.take();
                *room = self.stored.clone();
            }
            Task::Store(config) => (self.stored, self.staged) = (Some(config.clone()), None),
            Task::Erase => (self.stored, self.staged) = (None, None),
            Task::Key(..) => return Err(StoreError::Absent),
        }
        self.epoch += 1;
        Ok(self.epoch)
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
