//! Played boards: the firmware's session in this process, behind a pseudo-terminal, with a script of what goes wrong.
#![allow(dead_code, reason = "each file of tests has its own use for this")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod bench;

pub use bench::*;

use funnelnet_node::{Output, Phase, Session};
use funnelnet_protocol::WIRE_VERSION;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::serial::{self, Deframer, Frame, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Identity, Reply};
use rustix::fs::OFlags;
use rustix::pty::{self, OpenptFlags};
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long a board rests where nothing is to be done.
const PAUSE: Duration = Duration::from_micros(100);

/// What a board does instead of sending its state.
pub enum Act {
    /// Nothing else: it sends it.
    Send,
    /// Puts these bytes on the line before it.
    Noise(Vec<u8>),
    /// It hears these bytes before what the host sends next.
    Hear(Vec<u8>),
    /// It is unplugged.
    Vanish,
    /// It says nothing any more.
    Hang,
    /// It puts noise on the line as fast as it can.
    Flood,
    /// It says this, a frame that is none of what is awaited, as fast as it can.
    Babble(Vec<u8>),
}

/// What a board says, by the id that it says it by.
#[derive(Clone)]
pub enum Says {
    Message(Message),
    Reply(u8, Reply),
}

/// What a board says instead of what its node does.
pub type Lie = Box<dyn FnMut(Says) -> Vec<Says> + Send>;

/// What a board does before it sends its `n`-th state, from 0.
pub type Script = Box<dyn FnMut(u32) -> Act + Send>;

/// A board behind a pseudo-terminal. Its thread gives the phase that its node ends in.
pub struct Board {
    /// Its terminal.
    pub path: String,
    quit: Arc<AtomicBool>,
    states: Arc<AtomicU32>,
    noise: Arc<AtomicU64>,
    thread: JoinHandle<Option<Phase>>,
}

impl Board {
    pub fn start(uid: u64, script: Script) -> Self {
        let identity =
            Identity { wire_version: WIRE_VERSION, firmware: [0, 1, 0], uid, ..Identity::default() };
        Self::start_as(identity, script)
    }

    pub fn start_as(identity: Identity, script: Script) -> Self {
        Self::start_with(identity, 1.0, script)
    }

    /// A board whose clock is `rate` times as fast as it should be.
    pub fn with_clock(uid: u64, rate: f64) -> Self {
        let identity = Identity { wire_version: WIRE_VERSION, uid, ..Identity::default() };
        Self::start_with(identity, rate, Box::new(|_| Act::Send))
    }

    /// A board that says something else than its node does.
    pub fn lying(uid: u64, lie: impl FnMut(Says) -> Vec<Says> + Send + 'static) -> Self {
        let identity =
            Identity { wire_version: WIRE_VERSION, firmware: [0, 1, 0], uid, ..Identity::default() };
        Self::play(identity, Part { lie: Box::new(lie), ..Part::honest() })
    }

    /// A board whose node hears no state.
    pub fn deaf(uid: u64) -> Self {
        let identity =
            Identity { wire_version: WIRE_VERSION, firmware: [0, 1, 0], uid, ..Identity::default() };
        Self::play(identity, Part { deaf: true, ..Part::honest() })
    }

    fn start_with(identity: Identity, rate: f64, script: Script) -> Self {
        Self::play(identity, Part { rate, script, ..Part::honest() })
    }

    fn play(identity: Identity, part: Part) -> Self {
        // Closed in programs that other tests start meanwhile: they would keep an unplugged board's line open.
        let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
        let port = pty::openpt(flags).unwrap();
        pty::grantpt(&port).unwrap();
        pty::unlockpt(&port).unwrap();
        rustix::fs::fcntl_setfl(&port, OFlags::RDWR | OFlags::NONBLOCK).unwrap();
        let path = pty::ptsname(&port, Vec::new()).unwrap().into_string().unwrap();
        let port = File::from(port);
        let (quit, states) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU32::new(0)));
        let noise = Arc::new(AtomicU64::new(0));
        let session = Session::new(identity);
        let mut played = Played {
            port,
            deframer: Deframer::new(),
            session,
            part,
            states: states.clone(),
            noise: noise.clone(),
            hung: false,
            quit: quit.clone(),
        };
        let thread = std::thread::spawn(move || {
            played.run();
            played.session.node().map(|node| node.phase())
        });
        Self { path, quit, states, noise, thread }
    }

    pub fn good(uid: u64) -> Self {
        Self::start(uid, Box::new(|_| Act::Send))
    }

    /// Waits until it ticks.
    pub fn wait_until_running(&self) {
        wait("ticks", || self.states.load(Ordering::Relaxed) > 10);
    }

    /// Bytes of noise that its line has taken.
    pub fn noise(&self) -> u64 {
        self.noise.load(Ordering::Relaxed)
    }

    /// Whether it has announced its state.
    pub fn has_started(&self) -> bool {
        self.states.load(Ordering::Relaxed) > 0
    }

    /// Unplugs it; the phase that its node ended in.
    pub fn end(self) -> Option<Phase> {
        self.quit.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

/// What a board does that a good one does not.
struct Part {
    /// Of its clock.
    rate: f64,
    script: Script,
    lie: Lie,
    deaf: bool,
}

impl Part {
    fn honest() -> Self {
        Self { rate: 1.0, script: Box::new(|_| Act::Send), lie: Box::new(|said| vec![said]), deaf: false }
    }
}

struct Played {
    port: File,
    deframer: Deframer,
    session: Session,
    part: Part,
    states: Arc<AtomicU32>,
    noise: Arc<AtomicU64>,
    hung: bool,
    quit: Arc<AtomicBool>,
}

impl Played {
    fn run(&mut self) {
        let mut bytes = [0; 256];
        let begin = Instant::now();
        while !self.quit.load(Ordering::Relaxed) {
            let length = match self.port.read(&mut bytes) {
                Ok(length) => length,
                // Nothing has come, or nobody has opened the terminal.
                Err(_) => {
                    std::thread::sleep(PAUSE);
                    0
                }
            };
            let rate = self.part.rate;
            let now = || (begin.elapsed().as_nanos() as f64 * rate) as u64;
            if self.session.poll_at().is_some_and(|at| at <= now()) {
                self.drain(now());
            }
            for &byte in &bytes[..length] {
                let now = now();
                if let Some(frame) = self.deframer.push(byte) {
                    if self.part.deaf && matches!(frame, Ok(Frame::RealTime(Message::State { .. }))) {
                        continue;
                    }
                    self.session.on_frame(frame, now);
                    self.drain(now);
                }
            }
        }
    }

    fn drain(&mut self, now: u64) {
        while let Some(output) = self.session.poll(now) {
            match output {
                Output::Send(message) => self.send(&message),
                Output::Reply(reply) => self.reply(&reply),
                // A bench never asks for these.
                Output::StorageRequest => {}
                Output::Report(_) => {}
                Output::Safe | Output::Sample | Output::Actuate => {}
            }
        }
    }

    fn send(&mut self, message: &Message) {
        if let Message::State { .. } = message {
            let act = (self.part.script)(self.states.fetch_add(1, Ordering::Relaxed));
            match act {
                Act::Send => {}
                Act::Noise(bytes) => self.put(&bytes),
                Act::Hear(bytes) => {
                    for &byte in &bytes {
                        let _ = self.deframer.push(byte);
                    }
                }
                Act::Vanish => self.quit.store(true, Ordering::Relaxed),
                Act::Hang => self.hung = true,
                Act::Babble(bytes) => {
                    while !self.quit.load(Ordering::Relaxed) {
                        self.put(&bytes);
                    }
                }
                Act::Flood => {
                    while !self.quit.load(Ordering::Relaxed) {
                        self.put(&[0x55; 200]);
                        self.noise.fetch_add(200, Ordering::Relaxed);
                    }
                }
            }
        }
        if !self.quit.load(Ordering::Relaxed) {
            self.say(Says::Message(*message));
        }
    }

    fn reply(&mut self, reply: &Reply) {
        self.say(Says::Reply(self.session.id(), reply.clone()));
    }

    fn say(&mut self, said: Says) {
        for said in (self.part.lie)(said) {
            match said {
                Says::Message(message) => self.put(&serial::encode(&message)),
                Says::Reply(id, reply) => {
                    let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
                    let length = serial::encode_service(&reply, id, &mut scratch, &mut frame).unwrap();
                    self.put(&frame[..length]);
                }
            }
        }
    }

    /// Waits for room while somebody has the terminal open.
    fn put(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() && !self.hung && !self.quit.load(Ordering::Relaxed) {
            match self.port.write(rest) {
                Ok(length) => rest = &rest[length..],
                Err(error) if error.kind() == ErrorKind::WouldBlock => std::thread::sleep(PAUSE),
                Err(_) => return,
            }
        }
    }
}

pub fn three() -> [Board; 3] {
    [1, 2, 3].map(Board::good)
}

/// Three boards of which the second does `act` before its 51st state.
pub fn second(mut act: impl FnMut() -> Act + Send + 'static) -> [Board; 3] {
    let script = move |n| if n == 50 { act() } else { Act::Send };
    [Board::good(1), Board::start(2, Box::new(script)), Board::good(3)]
}
