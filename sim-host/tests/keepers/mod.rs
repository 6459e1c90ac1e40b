//! Played nodes that keep their configuration: the app of every node in a thread, behind a pair of sockets,
//! with what goes wrong as it is commissioned.

use funnelnet_app::link::{self, Health, Input};
use funnelnet_app::storage::Storage;
use funnelnet_app::{App, Clock, Platform, watchdog};
use funnelnet_node::{Session, Task};
use funnelnet_plant::Virtual;
use funnelnet_protocol::config::{Field, NodeConfig, Shape, TickSource};
use funnelnet_protocol::message::{Command, Message, Target};
use funnelnet_protocol::serial::{self, Deframer, Frame, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Identity, Reply, StoreError};
use funnelnet_protocol::{Refusal, WIRE_VERSION};
use sim_host::hub::{Attached, Device, Link, Stream};
use sim_host::interrupt::Interrupt;
use std::future::pending;
use std::io::{self, Read, Write};
use std::ops::Range;
use std::os::unix::net::UnixStream;
use std::pin::pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::task::{Context, Waker};

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Flaw {
    Nothing,
    /// It keeps another configuration than the one that it was given.
    StagesAnother,
    /// It does not hear the commit.
    HearsNoCommit,
    /// Its storage fails at a commit and at an erase.
    StorageFails,
    /// It is gone right after it has committed or erased, and has told nobody.
    Dies,
    /// The user wants to stop when its answer to STAGE has been read.
    InterruptedAtStage,
    /// The same for its answer to HELLO, after it has committed.
    InterruptedAtCommit,
}

/// What a node's storage holds: nothing, `staged`, `committed`, `erased`.
pub type Kept = Arc<Mutex<&'static str>>;

/// A played node, and what it has.
pub struct Keeper {
    pub kept: Kept,
    attached: Attached,
}

impl Keeper {
    /// A node that is blank.
    pub fn blank(id: u8, flaw: Flaw) -> Self {
        Self::with_session(id, flaw, Interrupt::default(), session())
    }

    /// A blank node whose user wants to stop.
    pub fn interrupted(id: u8, flaw: Flaw, interrupt: &Interrupt) -> Self {
        Self::with_session(id, flaw, interrupt.clone(), session())
    }

    /// A node that has been configured.
    pub fn configured(config: NodeConfig, flaw: Flaw) -> Self {
        let id = config.id;
        let mut session = session();
        *session.config_buffer() = Some(config);
        session.restore().unwrap();
        Self::with_session(id, flaw, Interrupt::default(), session)
    }

    /// A node that runs.
    pub fn running(config: NodeConfig) -> Self {
        let id = config.id;
        let mut session = session();
        *session.config_buffer() = Some(config);
        session.restore().unwrap();
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
        session.on_frame(Ok(Frame::RealTime(start)), 0);
        Self::with_session(id, Flaw::Nothing, Interrupt::default(), session)
    }

    fn with_session(id: u8, flaw: Flaw, interrupt: Interrupt, session: Session) -> Self {
        let (ours, theirs) = UnixStream::pair().unwrap();
        ours.set_read_timeout(Some(sim_host::hub::SLICE)).unwrap();
        let (kept, answered) = (Kept::default(), Arc::new(AtomicBool::new(false)));
        let line = Line { stream: ours, answered: answered.clone(), interrupt: interrupt.clone() };
        let link = Played { line: theirs, flaw, deframer: Deframer::new(), bytes: [0; 512], unread: 0..0 };
        let storage = PlayedStorage { flaw, staged: None, kept: kept.clone(), answered };
        std::thread::spawn(move || run(session, link, storage));
        let link = Link::new(id, "the played node".to_owned(), Box::new(line), interrupt);
        let attached = Attached { link, device: Box::new(PlayedDevice), uid: None };
        Self { kept, attached }
    }
}

/// What the nodes keep, and what a commissioning takes.
pub fn attached<const N: usize>(keepers: [Keeper; N]) -> ([Kept; N], Vec<Attached>) {
    let kept = keepers.each_ref().map(|keeper| keeper.kept.clone());
    (kept, keepers.into_iter().map(|keeper| keeper.attached).collect())
}

/// What each of them keeps now.
pub fn words<const N: usize>(kept: &[Kept; N]) -> [&'static str; N] {
    kept.each_ref().map(|kept| *kept.lock().unwrap())
}

pub fn config(id: u8, width: f32) -> NodeConfig {
    NodeConfig::builder(id, 1_000_000)
        .tick_source(TickSource::Sync)
        .state([1.0])
        .state_limit(1e6)
        .field(Field {
            slope: [-0.7].into_iter().collect(),
            offset: [1.0].into_iter().collect(),
            sines: [].into_iter().collect(),
        })
        .funnel(Shape::Constant { width })
        .extrapolate_ticks(3)
        .build()
        .unwrap()
}

fn session() -> Session {
    Session::new(Identity { wire_version: WIRE_VERSION, ..Identity::default() })
}

/// Time stands still.
#[derive(Clone, Copy)]
struct NoTime;

impl Clock for NoTime {
    fn now(self) -> u64 {
        0
    }

    async fn wait_until(self, at: u64) {
        if at > 0 {
            pending().await
        }
    }
}

/// Runs a node until its line is closed, or it dies.
fn run(mut session: Session, mut link: Played, mut storage: PlayedStorage) {
    let platform = Platform { watchdog: watchdog::Absent, clock: NoTime, log: () };
    let mut app = App::new(&mut session, &mut link, &mut storage, Virtual, platform);
    // It waits for its line by blocking, so whatever else it waits for is its end.
    let _ = pin!(app.run()).poll(&mut Context::from_waker(Waker::noop()));
}

struct Played {
    line: UnixStream,
    flaw: Flaw,
    deframer: Deframer<MAX_RAW>,
    bytes: [u8; 512],
    /// Bytes that were received and not read yet.
    unread: Range<usize>,
}

impl Played {
    fn hears(flaw: Flaw, frame: &Result<Frame<'_>, Refusal>) -> bool {
        let commit = matches!(frame, Ok(Frame::RealTime(Message::Ctrl { command: Command::Commit, .. })));
        !commit || flaw != Flaw::HearsNoCommit
    }

    fn altered(&self, reply: &Reply) -> Reply {
        match reply {
            Reply::Staged(Ok(checksum)) if self.flaw == Flaw::StagesAnother => {
                Reply::Staged(Ok(checksum ^ 1))
            }
            reply => reply.clone(),
        }
    }

    async fn write(&mut self, bytes: &[u8]) {
        if self.line.write_all(bytes).is_err() {
            pending().await
        }
    }
}

impl link::Link for Played {
    async fn wait(&mut self, _: impl Clock) {
        if self.unread.is_empty() {
            match self.line.read(&mut self.bytes) {
                Ok(length @ 1..) => self.unread = 0..length,
                _ => pending().await,
            }
        }
    }

    fn next(&mut self, _: u64) -> Option<Input<'_>> {
        while let Some(byte) = self.unread.next().map(|at| self.bytes[at]) {
            if byte == 0 {
                let frame = self.deframer.push(byte)?;
                return Self::hears(self.flaw, &frame).then_some(Input::Frame(frame));
            }
            let _ = self.deframer.push(byte);
        }
        None
    }

    async fn send(&mut self, message: &Message, _: u64) {
        self.write(&serial::encode(message)).await;
    }

    async fn reply(&mut self, reply: &Reply, source: u8) {
        let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
        let length = serial::encode_service(&self.altered(reply), source, &mut scratch, &mut frame).unwrap();
        self.write(&frame[..length]).await;
    }

    fn health(&self) -> Health {
        Health::default()
    }
}

struct PlayedStorage {
    flaw: Flaw,
    staged: Option<NodeConfig>,
    kept: Kept,
    answered: Arc<AtomicBool>,
}

impl Storage for PlayedStorage {
    /// The session has been restored already.
    async fn load(&mut self, _: &mut Option<NodeConfig>) {}

    async fn has_key(&mut self) -> bool {
        false
    }

    /// Does what the session wants; waits for ever where that is the end of the node.
    async fn perform(&mut self, task: Task<'_>) -> Result<u32, StoreError> {
        let (fails, kept, at) = match task {
            Task::Stage(config) => {
                self.staged = Some(config.clone());
                (false, "staged", Flaw::InterruptedAtStage)
            }
            Task::Commit(room) => {
                *room = self.staged.take();
                (self.flaw == Flaw::StorageFails, "committed", Flaw::InterruptedAtCommit)
            }
            Task::Erase => (self.flaw == Flaw::StorageFails, "erased", Flaw::InterruptedAtCommit),
            task => panic!("nobody asks for {task:?}"),
        };
        if !fails {
            *self.kept.lock().unwrap() = kept;
        }
        self.answered.store(self.flaw == at, Ordering::Relaxed);
        if self.flaw == Flaw::Dies && kept != "staged" {
            pending::<()>().await;
        }
        if fails { Err(StoreError::Failed) } else { Ok(1) }
    }
}

/// The host's end of a node's line. The user wants to stop when it gives the answer that was waited for.
struct Line {
    stream: UnixStream,
    answered: Arc<AtomicBool>,
    interrupt: Interrupt,
}

impl Read for Line {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let length = self.stream.read(bytes)?;
        if self.answered.load(Ordering::Relaxed) {
            self.interrupt.set();
        }
        Ok(length)
    }
}

impl Write for Line {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

impl Stream for Line {
    fn reader(&self) -> io::Result<Box<dyn Read + Send>> {
        self.stream.reader()
    }
}

/// What a played node runs on: nobody knows more than it says.
struct PlayedDevice;

impl Device for PlayedDevice {
    fn last_words(&mut self, _: bool) -> Vec<String> {
        Vec::new()
    }

    fn into_log(self: Box<Self>) -> Option<String> {
        None
    }
}
