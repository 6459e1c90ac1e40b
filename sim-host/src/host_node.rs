//! A node in a process of its own: the firmware's session, with a line for the service plane and, if wanted, a CAN interface for states.
//!
//! So a Linux computer with a CAN adapter takes part in a network, and a bench is tried without a board. It ticks by its own clock or by
//! SYNC like any node, but on a computer whose system takes its time now and then: what is late is counted.

use crate::can::{AnyFormat, CanPort, Heard, Own, PortFrame, Traffic};
use crate::exit::Exit;
use crate::flash_file::FileStorage;
use funnelnet_link::Mailbox;
use funnelnet_node::{Output, Session};
use funnelnet_protocol::WIRE_VERSION;
use funnelnet_protocol::message::{FaultCode, Message};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::serial::{self, Deframer, Frame, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Identity, Reply, ResetCause, StoreError};
use std::fmt::Display;
use std::io::{self, ErrorKind, Read, Write};
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

/// How long a node without anything to do rests, at most, and how soon a frame for which there was no room is sent again.
const REST: Duration = Duration::from_millis(100);
const AGAIN: Duration = Duration::from_micros(200);

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

/// What a node waits for.
enum Input {
    Bytes(Vec<u8>),
    Heard(Heard),
    Ended(End),
}

/// Runs a node until its line is closed, with what `storage` keeps for it. `uid` is the unique number that it gives itself.
pub fn run(line: Line, can: Option<CanPort>, storage: Option<FileStorage>, uid: u64) -> End {
    let fd = matches!(can, Some(CanPort::Fd(_)));
    let (sender, inputs) = mpsc::channel();
    let Line { from_host, to_host } = line;
    let can = can.map(Arc::new);
    if let Some(port) = can.clone() {
        let sender = sender.clone();
        std::thread::spawn(move || listen(&port, &sender));
    }
    std::thread::spawn(move || read(from_host, &sender));
    let [major, minor, patch] = [0, 1, 2].map(version);
    let identity = Identity {
        wire_version: WIRE_VERSION,
        firmware: [major, minor, patch],
        uid,
        reset: ResetCause::PowerOn,
        starts: 1,
        ..Identity::default()
    };
    let mut node = HostNode {
        session: Session::new(identity),
        deframer: Deframer::new(),
        saying: AnyFormat::new(fd),
        hearing: AnyFormat::new(fd),
        mailbox: Mailbox::new(),
        begin: Instant::now(),
        offs: 0,
        to_host,
        can,
        storage,
    };
    node.restore();
    node.run(&inputs)
}

/// Part of this program's version: major, minor, patch.
fn version(part: usize) -> u8 {
    env!("CARGO_PKG_VERSION").split('.').nth(part).and_then(|number| number.parse().ok()).unwrap_or(0)
}

/// Until nobody listens any more.
fn read(mut from: Box<dyn Read + Send>, to: &Sender<Input>) {
    let mut bytes = [0; 1024];
    loop {
        let input = match from.read(&mut bytes) {
            Ok(0) => Input::Ended(End::Closed),
            Ok(length) => Input::Bytes(bytes.get(..length).unwrap_or(&[]).to_vec()),
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
                ) =>
            {
                continue;
            }
            Err(_) => Input::Ended(End::Closed),
        };
        let last = matches!(input, Input::Ended(_));
        if to.send(input).is_err() || last {
            return;
        }
    }
}

/// The same for a bus.
fn listen(port: &CanPort, to: &Sender<Input>) {
    loop {
        let input = match port.receive() {
            Ok(None) => {
                port.wait(REST);
                continue;
            }
            Ok(Some(heard)) => Input::Heard(heard),
            Err(error) => Input::Ended(End::CanGone(error.to_string())),
        };
        let last = matches!(input, Input::Ended(_));
        if to.send(input).is_err() || last {
            return;
        }
    }
}

struct HostNode {
    session: Session,
    deframer: Deframer,
    saying: AnyFormat,
    hearing: AnyFormat,
    mailbox: Mailbox<PortFrame>,
    begin: Instant,
    /// How often the controller went off the bus.
    offs: u16,
    to_host: Box<dyn Write>,
    can: Option<Arc<CanPort>>,
    storage: Option<FileStorage>,
}

impl HostNode {
    fn run(mut self, inputs: &Receiver<Input>) -> End {
        loop {
            if let Err(end) = self.drain() {
                return end;
            }
            match inputs.recv_timeout(self.rest()) {
                Ok(Input::Bytes(bytes)) => {
                    if let Err(end) = bytes.iter().try_for_each(|&byte| self.take_byte(byte)) {
                        return end;
                    }
                }
                Ok(Input::Heard(heard)) => self.take_heard(&heard),
                Ok(Input::Ended(end)) => return end,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return End::Closed,
            }
        }
    }

    /// Time since the start, ns.
    fn now(&self) -> u64 {
        u64::try_from(self.begin.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn rest(&self) -> Duration {
        let due = self.session.poll_at().map(|at| Duration::from_nanos(at.saturating_sub(self.now())));
        let rest = due.unwrap_or(REST).min(REST);
        if self.mailbox.next().is_some() { rest.min(AGAIN) } else { rest }
    }

    /// Answers each frame before it looks at the next one, as firmware does: a HELLO that follows a commit tells what was committed.
    fn take_byte(&mut self, byte: u8) -> Result<(), End> {
        let now = self.now();
        let on_can = self.can.is_some();
        let Some(frame) = self.deframer.push(byte) else { return Ok(()) };
        let frame = match frame {
            // On CAN the states of others come by CAN (protocol/README.md, "Nodes on CAN").
            Ok(Frame::RealTime(Message::State { .. } | Message::Edge { .. } | Message::Fault { .. }))
                if on_can =>
            {
                Err(Refusal::Kind)
            }
            frame => frame,
        };
        self.session.on_frame(frame, now);
        self.drain()
    }

    fn take_heard(&mut self, heard: &Heard) {
        if let Traffic::Error { off: true, .. } = heard.what {
            self.offs = self.offs.saturating_add(1);
            self.mailbox.clear();
            drop(self.saying.flush());
            self.session.fail(FaultCode::BUS_OFF, self.offs);
        }
        let now = self.now();
        for message in heard.messages(&mut self.hearing) {
            self.session.on_frame(message.map(Frame::RealTime), now);
        }
    }

    fn drain(&mut self) -> Result<(), End> {
        while let Some(output) = self.session.poll(self.now()) {
            match output {
                Output::Send(message) => self.send(&message)?,
                Output::Reply(reply) => self.reply(&reply)?,
                Output::Report(event) => log(&event),
                Output::StorageRequest => self.keep(),
                // It has no plant.
                Output::Sample | Output::Actuate | Output::Safe => {}
            }
        }
        if let Some(frame) = self.saying.flush() {
            self.mailbox.put(frame);
        }
        self.empty_mailbox()
    }

    /// As a board does at its start: what cannot be used is said, and the node is blank.
    fn restore(&mut self) {
        let Some(storage) = &mut self.storage else { return };
        match storage.load(self.session.config_buffer()) {
            Ok(has_key) => self.session.note_key(has_key),
            Err(error) => return log(&format_args!("storage: {error}")),
        }
        if self.session.config_buffer().is_some()
            && let Err(error) = self.session.restore()
        {
            log(&format_args!("the stored configuration: {error}"));
        }
    }

    fn keep(&mut self) {
        let Some(task) = self.session.task() else { return };
        let outcome = match &mut self.storage {
            Some(storage) => storage.perform(task),
            None => Err(StoreError::Absent),
        };
        self.session.performed(outcome);
    }

    fn send(&mut self, message: &Message) -> Result<(), End> {
        if self.can.is_none() {
            return self.write(&serial::encode(message));
        }
        for frame in self.saying.pack(message) {
            self.mailbox.put(frame);
        }
        if matches!(message, Message::Fault { .. }) {
            self.write(&serial::encode(message))?;
        }
        Ok(())
    }

    fn reply(&mut self, reply: &Reply) -> Result<(), End> {
        let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
        // Every reply fits a frame.
        let length = serial::encode_service(reply, self.session.id(), &mut scratch, &mut frame).unwrap_or(0);
        self.write(frame.get(..length).unwrap_or(&[]))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), End> {
        self.to_host.write_all(bytes).and_then(|()| self.to_host.flush()).map_err(|_| End::Closed)
    }

    fn empty_mailbox(&mut self) -> Result<(), End> {
        let Some(port) = &self.can else { return Ok(()) };
        while let Some(frame) = self.mailbox.next() {
            match port.send(frame) {
                Ok(true) => self.mailbox.taken(),
                Ok(false) => break,
                Err(error) => return Err(End::CanGone(error.to_string())),
            }
        }
        Ok(())
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
