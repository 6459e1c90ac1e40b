//! Played nodes that keep their configuration: the firmware's session in a thread, behind a pair of sockets, with what goes wrong as it is
//! commissioned.

use funnelnet_node::{Output, Session, Task};
use funnelnet_protocol::config::{Field, NodeConfig, Shape, TickSource};
use funnelnet_protocol::message::{Command, Message, Target};
use funnelnet_protocol::serial::{self, Deframer, Frame, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Identity, Reply, StoreError};
use funnelnet_protocol::{Refusal, WIRE_VERSION};
use sim_host::hub::{Attached, Device, Link, Stream};
use sim_host::interrupt::Interrupt;
use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

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
        let played = Played { line: theirs, session, flaw, staged: None, kept: kept.clone(), answered };
        std::thread::spawn(move || played.run());
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

struct Played {
    line: UnixStream,
    session: Session,
    flaw: Flaw,
    staged: Option<NodeConfig>,
    kept: Kept,
    answered: Arc<AtomicBool>,
}

impl Played {
    /// Until its line is closed, or it dies.
    fn run(mut self) {
        let (mut deframer, mut bytes) = (Deframer::<MAX_RAW>::new(), [0; 512]);
        while let Ok(length @ 1..) = self.line.read(&mut bytes) {
            for &byte in &bytes[..length] {
                let Some(frame) = deframer.push(byte) else { continue };
                if self.hears(&frame) {
                    self.session.on_frame(frame, 0);
                }
                if self.drain().is_err() {
                    return;
                }
            }
        }
    }

    fn hears(&self, frame: &Result<Frame<'_>, Refusal>) -> bool {
        let commit = matches!(frame, Ok(Frame::RealTime(Message::Ctrl { command: Command::Commit, .. })));
        !commit || self.flaw != Flaw::HearsNoCommit
    }

    fn drain(&mut self) -> io::Result<()> {
        while let Some(output) = self.session.poll(0) {
            match output {
                Output::StorageRequest => self.keep()?,
                Output::Reply(reply) => {
                    let reply = self.altered(reply);
                    let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
                    let id = self.session.id();
                    let length = serial::encode_service(&reply, id, &mut scratch, &mut frame).unwrap();
                    self.line.write_all(&frame[..length])?;
                }
                Output::Send(message) => self.line.write_all(&serial::encode(&message))?,
                Output::Report(_) | Output::Safe | Output::Sample | Output::Actuate => {}
            }
        }
        Ok(())
    }

    fn altered(&self, reply: Reply) -> Reply {
        match reply {
            Reply::Staged(Ok(checksum)) if self.flaw == Flaw::StagesAnother => {
                Reply::Staged(Ok(checksum ^ 1))
            }
            reply => reply,
        }
    }

    /// Does what the session wants of a storage; fails where that is the end of the node.
    fn keep(&mut self) -> io::Result<()> {
        let (fails, kept, at) = match self.session.task().unwrap() {
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
        self.session.performed(if fails { Err(StoreError::Failed) } else { Ok(1) });
        let dies = self.flaw == Flaw::Dies && kept != "staged";
        if dies { Err(io::ErrorKind::BrokenPipe.into()) } else { Ok(()) }
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
