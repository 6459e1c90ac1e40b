//! Played boards: the app of every board in this process, behind a pseudo-terminal, with a script of what
//! goes wrong.
#![allow(dead_code, reason = "each file of tests has its own use for this")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod bench;

pub use bench::*;

use funnelnet_app::link::{Health, Input};
use funnelnet_app::storage::Storage;
use funnelnet_app::{App, Clock, Link, Platform, watchdog};
use funnelnet_node::{Phase, Session, Task};
use funnelnet_plant::Virtual;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::WIRE_VERSION;
use funnelnet_protocol::message::{Command, Message};
use funnelnet_protocol::serial::{self, Deframer, Frame, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Identity, Reply, StoreError};
use rustix::fs::OFlags;
use rustix::pty::{self, OpenptFlags};
use std::fs::File;
use std::future::{pending, poll_fn};
use std::io::{ErrorKind, Read, Write};
use std::ops::Range;
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::task::{Context, Poll, Waker};
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
    thread: Option<JoinHandle<Option<Phase>>>,
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

    /// A board that keeps what is staged in it until it is told to commit that.
    pub fn keeping(uid: u64) -> Self {
        let identity =
            Identity { wire_version: WIRE_VERSION, firmware: [0, 1, 0], uid, ..Identity::default() };
        Self::play(identity, Part { keeps: true, ..Part::honest() })
    }

    /// The same that hears no commit, and says that it has what was staged in it.
    pub fn pretending(uid: u64) -> Self {
        let identity =
            Identity { wire_version: WIRE_VERSION, firmware: [0, 1, 0], uid, ..Identity::default() };
        let mut staged = None;
        let lie = move |said| match said {
            Says::Reply(id, Reply::Staged(Ok(checksum))) => {
                staged = Some(checksum);
                vec![Says::Reply(id, Reply::Staged(Ok(checksum)))]
            }
            Says::Reply(id, Reply::Identity(identity)) => {
                let checksum = staged.unwrap_or(identity.checksum);
                vec![Says::Reply(id, Reply::Identity(Identity { checksum, ..identity }))]
            }
            said => vec![said],
        };
        Self::play(identity, Part { keeps: true, hears_commits: false, lie: Box::new(lie), ..Part::honest() })
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
        let (port, path) = terminal();
        let (quit, states) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU32::new(0)));
        let noise = Arc::new(AtomicU64::new(0));
        let mut played = Played {
            port,
            deframer: Deframer::new(),
            bytes: [0; 256],
            unread: 0..0,
            part,
            states: states.clone(),
            noise: noise.clone(),
            hung: false,
            quit: quit.clone(),
        };
        let thread = Some(std::thread::spawn(move || played.run(identity)));
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
    pub fn end(mut self) -> Option<Phase> {
        self.quit.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap()
    }
}

/// A board that nobody needs any more would go on looking at its line, ten thousand times a second, beside the tests that come after.
impl Drop for Board {
    fn drop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
    }
}

/// A pseudo-terminal whose other end is at a path.
pub fn terminal() -> (File, String) {
    // Closed in programs that other tests start meanwhile: they would keep an unplugged board's line open.
    let flags = OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC;
    let port = pty::openpt(flags).unwrap();
    pty::grantpt(&port).unwrap();
    pty::unlockpt(&port).unwrap();
    rustix::fs::fcntl_setfl(&port, OFlags::RDWR | OFlags::NONBLOCK).unwrap();
    let path = pty::ptsname(&port, Vec::new()).unwrap().into_string().unwrap();
    (File::from(port), path)
}

/// What a board does that a good one does not.
struct Part {
    /// Of its clock.
    rate: f64,
    script: Script,
    lie: Lie,
    deaf: bool,
    /// It has a storage for what is staged; without, it says nothing any more once it is asked to keep something.
    keeps: bool,
    hears_commits: bool,
}

impl Part {
    fn honest() -> Self {
        Self {
            rate: 1.0,
            script: Box::new(|_| Act::Send),
            lie: Box::new(|said| vec![said]),
            deaf: false,
            keeps: false,
            hears_commits: true,
        }
    }
}

/// The link of a board.
struct Played {
    port: File,
    deframer: Deframer,
    bytes: [u8; 256],
    /// Bytes that were received and not read yet.
    unread: Range<usize>,
    part: Part,
    states: Arc<AtomicU32>,
    noise: Arc<AtomicU64>,
    hung: bool,
    quit: Arc<AtomicBool>,
}

/// A clock that is `rate` times as fast as it should be.
#[derive(Clone, Copy)]
struct BoardClock {
    begin: Instant,
    rate: f64,
}

impl Clock for BoardClock {
    fn now(self) -> u64 {
        (self.begin.elapsed().as_nanos() as f64 * self.rate) as u64
    }

    fn wait_until(self, at: u64) -> impl Future<Output = ()> {
        poll_fn(move |_| if self.now() >= at { Poll::Ready(()) } else { Poll::Pending })
    }
}

/// A storage for what is staged, or one that is never done.
struct PlayedStorage {
    keeps: bool,
    staged: Option<NodeConfig>,
}

impl Storage for PlayedStorage {
    async fn load(&mut self, _: &mut Option<NodeConfig>) {}

    async fn has_key(&mut self) -> bool {
        false
    }

    async fn perform(&mut self, task: Task<'_>) -> Result<u32, StoreError> {
        if !self.keeps {
            return pending().await;
        }
        match task {
            Task::Stage(config) => self.staged = Some(config.clone()),
            Task::Commit(room) => *room = self.staged.take(),
            Task::Store(_) | Task::Erase | Task::Key(..) => return Err(StoreError::Absent),
        }
        Ok(1)
    }
}

impl Played {
    /// Until it is unplugged; the phase that its node ends in.
    fn run(&mut self, identity: Identity) -> Option<Phase> {
        let mut session = Session::new(identity);
        let clock = BoardClock { begin: Instant::now(), rate: self.part.rate };
        let platform = Platform { watchdog: watchdog::Absent, clock, log: () };
        let quit = self.quit.clone();
        {
            let mut storage = PlayedStorage { keeps: self.part.keeps, staged: None };
            let mut app = App::new(&mut session, self, &mut storage, Virtual, platform);
            let mut node = pin!(app.run());
            while !quit.load(Ordering::Relaxed) {
                let pending = node.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending();
                assert!(pending, "a node runs for ever");
                std::thread::sleep(PAUSE);
            }
        }
        session.node().map(|node| node.phase())
    }

    /// Whether something has come.
    fn receive(&mut self) -> bool {
        if self.unread.is_empty() && !self.quit.load(Ordering::Relaxed) {
            // An error: nothing has come, or nobody has opened the terminal.
            self.unread = 0..self.port.read(&mut self.bytes).unwrap_or(0);
        }
        !self.unread.is_empty()
    }

    /// Does what the script says before a state. A board that is unplugged then says nothing.
    fn act(&mut self) {
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

impl Link for Played {
    async fn wait(&mut self, _: impl Clock) {
        poll_fn(|_| if self.receive() { Poll::Ready(()) } else { Poll::Pending }).await;
    }

    fn next(&mut self, _: u64) -> Option<Input<'_>> {
        while let Some(byte) = self.unread.next().map(|at| self.bytes[at]) {
            if byte == 0 {
                let frame = self.deframer.push(byte)?;
                let unheard = match &frame {
                    Ok(Frame::RealTime(Message::State { .. })) => self.part.deaf,
                    Ok(Frame::RealTime(Message::Ctrl { command: Command::Commit, .. })) => {
                        !self.part.hears_commits
                    }
                    _ => false,
                };
                return (!unheard).then_some(Input::Frame(frame));
            }
            let _ = self.deframer.push(byte);
        }
        None
    }

    async fn send(&mut self, message: &Message, _: u64) {
        if let Message::State { .. } = message {
            self.act();
        }
        if self.quit.load(Ordering::Relaxed) {
            return pending().await;
        }
        self.say(Says::Message(*message));
    }

    async fn reply(&mut self, reply: &Reply, source: u8) {
        self.say(Says::Reply(source, reply.clone()));
    }

    fn health(&self) -> Health {
        Health::default()
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
