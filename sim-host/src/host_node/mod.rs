//! A node in a process of its own: the app of every board, with a line for the service plane and, if wanted,
//! a CAN interface for states.
//!
//! So a Linux computer with a CAN adapter takes part in a network, and a bench is tried without a board. It
//! ticks by its own clock or by SYNC like any node, but on a computer whose system takes its time now and
//! then: what is late is counted.

mod clock;
mod inbox;
mod ports;

use crate::can::{CanPort, Own};
use crate::exit::Exit;
use crate::flash_file::FileStorage;
use clock::SystemClock;
use embassy_futures::select::{Either, select};
use funnelnet_app::link::can::CanNode;
use funnelnet_app::link::serial::Serial;
use funnelnet_app::storage::{Absent, Storage};
use funnelnet_app::{App, Link, Log, Platform, watchdog};
use funnelnet_link::{Classic, Fd};
use funnelnet_node::{Event, Session};
use funnelnet_plant::Virtual;
use funnelnet_protocol::WIRE_VERSION;
use funnelnet_protocol::config::ConfigError;
use funnelnet_protocol::service::{Identity, ResetCause};
use inbox::Inbox;
use ports::{HostLine, SocketController};
use std::fmt::Display;
use std::future::poll_fn;
use std::io::{self, Read, Write};
use std::sync::Arc;
use std::task::Poll;

/// Both ends of a node's line.
pub struct Line {
    /// What the host says.
    pub from_host: Box<dyn Read + Send>,
    /// What the node says.
    pub to_host: Box<dyn Write>,
}

/// Why a node ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum End {
    /// Its line was closed: nobody needs it any more.
    Closed,
    /// Its CAN interface is gone, in words.
    CanGone(String),
}

/// How the program ends for it.
impl From<&End> for Exit {
    fn from(end: &End) -> Self {
        match end {
            End::Closed => Self::Success,
            End::CanGone(_) => Self::NoHardware,
        }
    }
}

/// What makes a node another one than its neighbour.
#[derive(Clone, Copy, Debug, Default)]
pub struct Kind {
    /// The unique number that it gives itself.
    pub uid: u64,
    /// How much too fast its clock is, ppm.
    pub drift_ppm: f64,
}

/// Runs a node until its line is closed, with what `storage` keeps for it.
pub fn run(line: Line, can: Option<CanPort>, storage: Option<FileStorage>, kind: Kind) -> End {
    let Kind { uid, drift_ppm } = kind;
    let fd = matches!(can, Some(CanPort::Fd(_)));
    let can = can.map(Arc::new);
    let (inbox, clock) = (Inbox::open(line.from_host, can.clone()), SystemClock::start(drift_ppm));
    let service = Serial::new(HostLine::new(&inbox, line.to_host));
    let node = HostNode { inbox: &inbox, clock: &clock, storage, uid };
    match can {
        None => node.run(service),
        Some(port) if fd => {
            node.run(CanNode::new(SocketController::<Fd>::new(port, &inbox, &clock), service))
        }
        Some(port) => node.run(CanNode::new(SocketController::<Classic>::new(port, &inbox, &clock), service)),
    }
}

/// What a node has, beside its link.
struct HostNode<'a> {
    inbox: &'a Inbox,
    clock: &'a SystemClock,
    storage: Option<FileStorage>,
    uid: u64,
}

impl HostNode<'_> {
    fn run(mut self, link: impl Link) -> End {
        match self.storage.take() {
            Some(storage) => self.run_with(link, storage),
            None => self.run_with(link, Absent),
        }
    }

    fn run_with(self, mut link: impl Link, mut storage: impl Storage) -> End {
        let identity = Identity {
            wire_version: WIRE_VERSION,
            firmware: [0, 1, 2].map(version),
            uid: self.uid,
            reset: ResetCause::PowerOn,
            starts: 1,
            ..Identity::default()
        };
        let mut session = Session::new(identity);
        let platform = Platform { watchdog: watchdog::Absent, clock: self.clock, log: StandardError };
        let mut app = App::new(&mut session, &mut link, &mut storage, Virtual, platform);
        let end = poll_fn(|_| self.inbox.end().map_or(Poll::Pending, Poll::Ready));
        match self.clock.run(select(app.run(), end)) {
            Either::First(never) => never,
            Either::Second(end) => end,
        }
    }
}

/// Part of this program's version: major, minor, patch.
fn version(part: usize) -> u8 {
    env!("CARGO_PKG_VERSION").split('.').nth(part).and_then(|number| number.parse().ok()).unwrap_or(0)
}

/// The log of a node in a process.
struct StandardError;

impl Log for StandardError {
    fn unusable(&mut self, why: ConfigError) {
        log(&format_args!("the stored configuration: {why}"));
    }

    fn event(&mut self, event: &Event) {
        log(event);
    }
}

fn log(event: &impl Display) {
    // Nobody is left to tell where standard error is closed.
    let _ = writeln!(io::stderr(), "{event}");
}

/// The line of a node that was started by a bench: its standard input is one end of a pair of sockets.
///
/// # Errors
/// It is none.
#[cfg(unix)]
pub fn inherited_line() -> io::Result<Line> {
    use std::os::fd::AsFd;
    use std::os::unix::net::UnixStream;
    let stream = UnixStream::from(io::stdin().as_fd().try_clone_to_owned()?);
    // Fails for what is not a socket.
    stream.peer_addr()?;
    Ok(Line { from_host: Box::new(stream.try_clone()?), to_host: Box::new(stream) })
}

/// A port for a line.
///
/// # Errors
/// What the problem is, and what to try.
pub fn serial_line(path: &str, baud: u32) -> Result<Line, String> {
    let opened = crate::bench::open_port(path, baud);
    let port = opened.map_err(|(problem, advice)| format!("the serial port {path} {problem}. {advice}"))?;
    let reader = port.try_clone_native().map_err(|error| format!("the serial port {path}: {error}"))?;
    Ok(Line { from_host: Box::new(reader), to_host: Box::new(port) })
}

/// Opens what a node shall send its states on, in frames of CAN FD if `fd`.
///
/// # Errors
/// What the problem is, and what to try.
pub fn can_port(interface: &str, fd: bool) -> Result<CanPort, String> {
    CanPort::open(interface, Own::Ignored, fd).map_err(|error| error.to_string())
}
