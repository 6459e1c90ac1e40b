//! A network for an hour: five nodes with their own timers, in one machine, on a bus that this program plays.
//!
//! The host sends the configurations, and compares what comes back with the same scenario in loopback.
//! Integers are little-endian. To the node: period in us u32, ticks u32, then [`NODES`] CONFIGURE frames.
//! From it: [`Seen`], then a REPORT of each.

use embassy_futures::join::join5;
use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_time::{Duration, Instant, Ticker, Timer};
use embedded_io_async::{ErrorType, Read, Write};
use funnelnet_plant::Virtual;
use funnelnet_protocol::message::{Command, Message, Target};
use funnelnet_protocol::serial::{self, Deframer, Frame};
use funnelnet_protocol::service::Request;
use static_cell::{ConstStaticCell, StaticCell};

use crate::app::{self, Chip, SessionOf};
use funnelnet_app::link::serial::Serial;
use funnelnet_app::storage::Absent;

/// Nodes of the network.
pub const NODES: usize = 5;
/// Longer than a node takes to answer.
const ANSWER: Duration = Duration::from_millis(50);

/// Bytes from and to one node.
struct Port {
    from: Pipe<NoopRawMutex, 1024>,
    to: Pipe<NoopRawMutex, 2048>,
}

impl Port {
    const fn new() -> Self {
        Self { from: Pipe::new(), to: Pipe::new() }
    }
}

/// The node's end of a port.
struct Line(&'static Port);

impl ErrorType for Line {
    type Error = core::convert::Infallible;
}

impl Read for Line {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Self::Error> {
        Ok(self.0.to.read(bytes).await)
    }
}

impl Write for Line {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Self::Error> {
        Ok(self.0.from.write(bytes).await)
    }

    async fn flush(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// What the bus has seen.
#[derive(Default)]
struct Seen {
    /// FNV-1a (64 bit) over the states by tick and node: the `trace_hash` of a run.
    hash: u64,
    /// By the clock of embassy-time, and by adding up the hardware's counts.
    elapsed_us: u64,
    counts: u64,
    /// Frames of the real-time plane.
    frames: u32,
    /// States of another tick than the one that was due, and frames that could not be read.
    strange: u32,
    /// Bytes that a node had no room for.
    lost: u32,
}

impl Seen {
    fn state(&mut self, x: f32) {
        for byte in x.to_le_bytes() {
            self.hash = (self.hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    async fn tell<L: Write>(&self, link: &mut L) -> Result<(), L::Error> {
        for number in [self.hash, self.elapsed_us, self.counts] {
            link.write_all(&number.to_le_bytes()).await?;
        }
        for number in [self.frames, self.strange, self.lost] {
            link.write_all(&number.to_le_bytes()).await?;
        }
        Ok(())
    }
}

/// Runs the test.
pub async fn run<L: Read + Write>(link: &mut L, counts: impl Fn() -> u32) -> Result<(), L::Error> {
    static PORTS: ConstStaticCell<[Port; NODES]> = ConstStaticCell::new([const { Port::new() }; NODES]);
    static LINKS: [StaticCell<Serial<Line>>; NODES] = [const { StaticCell::new() }; NODES];
    static SESSIONS: [StaticCell<SessionOf<Virtual>>; NODES] = [const { StaticCell::new() }; NODES];
    let ports: &'static [Port; NODES] = PORTS.take();
    let node = |index: usize| {
        let link = LINKS[index].init_with(|| Serial::new(Line(&ports[index])));
        async move { app::run(&SESSIONS[index], link, &mut Absent, Virtual, Chip::UNKNOWN).await }
    };
    let [a, b, c, d, e] = core::array::from_fn(node);
    let nodes = join5(a, b, c, d, e);
    let conducted = async {
        let outcome = conduct(link, ports, counts).await;
        // The nodes would go on for ever.
        Timer::after(ANSWER).await;
        outcome
    };
    match select(conducted, nodes).await {
        Either::First(outcome) => outcome,
        Either::Second(_) => Ok(()),
    }
}

async fn conduct<L: Read + Write>(
    link: &mut L,
    ports: &[Port; NODES],
    counts: impl Fn() -> u32,
) -> Result<(), L::Error> {
    let period = Duration::from_micros(number(link).await?.into());
    let ticks = number(link).await?;
    for port in ports {
        forward_frame(link, port).await?;
    }
    // What they answer is for the host: CONFIGURED of each.
    answers(link, ports).await?;
    let seen = carry(ports, period, ticks, counts).await;
    for port in ports {
        give(port, &serial::encode(&control(Command::Stop)));
    }
    seen.tell(link).await?;
    let (mut scratch, mut frame) = ([0; 8], [0; 12]);
    let length =
        serial::encode_service(&Request::Report, serial::HOST, &mut scratch, &mut frame).unwrap_or(0);
    for port in ports {
        give(port, frame.get(..length).unwrap_or(&[]));
    }
    answers(link, ports).await
}

/// Starts the nodes and carries their frames for so many ticks, half a period after they were sent.
async fn carry(ports: &[Port; NODES], period: Duration, ticks: u32, counts: impl Fn() -> u32) -> Seen {
    let mut seen = Seen { hash: 0xcbf2_9ce4_8422_2325, ..Seen::default() };
    let mut deframer = Deframer::new();
    let (begin, mut last) = (Instant::now(), counts());
    for port in ports {
        give(port, &serial::encode(&control(Command::Start)));
    }
    Timer::after(period / 2).await;
    let mut ticker = Ticker::every(period);
    for tick in 0..=ticks {
        for sender in 0..NODES {
            deliver(ports, sender, tick, &mut deframer, &mut seen);
        }
        let now = counts();
        seen.counts += u64::from(now.wrapping_sub(last));
        last = now;
        seen.elapsed_us = begin.elapsed().as_micros();
        if tick < ticks {
            ticker.next().await;
        }
    }
    seen
}

/// Carries what a node has sent to all others, as a bus does.
fn deliver(ports: &[Port; NODES], sender: usize, tick: u32, deframer: &mut Deframer, seen: &mut Seen) {
    let mut bytes = [0; 256];
    let sent = ports.get(sender).map_or(&[][..], |port| take(port, &mut bytes));
    for &byte in sent {
        match deframer.push(byte) {
            Some(Ok(Frame::RealTime(message))) => note(&message, tick, seen),
            Some(_) => seen.strange += 1,
            None => {}
        }
    }
    for (_, port) in ports.iter().enumerate().filter(|&(receiver, _)| receiver != sender) {
        seen.lost += give(port, sent);
    }
}

fn note(message: &Message, tick: u32, seen: &mut Seen) {
    seen.frames += 1;
    if let Message::State { tick: stamp, x, .. } = message {
        seen.state(*x);
        seen.strange += u32::from(stamp.rebuild(tick, 0, 0) != Some(tick));
    }
}

/// What a node has sent. A pipe gives and takes no more at once than up to the end of its ring.
fn take<'a>(port: &Port, bytes: &'a mut [u8]) -> &'a [u8] {
    let mut count = 0;
    while let Ok(more) = port.from.try_read(bytes.get_mut(count..).unwrap_or(&mut [])) {
        if more == 0 {
            break;
        }
        count += more;
    }
    bytes.get(..count).unwrap_or(&[])
}

/// Gives bytes to a node; how many it had no room for.
fn give(port: &Port, mut bytes: &[u8]) -> u32 {
    while let Ok(count) = port.to.try_write(bytes) {
        bytes = bytes.get(count..).unwrap_or(&[]);
        if bytes.is_empty() {
            break;
        }
    }
    bytes.len() as u32
}

fn control(command: Command) -> Message {
    Message::Ctrl { target: Target::All, command, arg: 0, at_tick: 0 }
}

/// A frame from the host to one node.
async fn forward_frame<L: Read>(link: &mut L, port: &Port) -> Result<(), L::Error> {
    let mut byte = [0];
    loop {
        link.read_exact(&mut byte).await.ok();
        port.to.write_all(&byte).await;
        if byte == [0] {
            return Ok(());
        }
    }
}

/// What the nodes answer, in their order, to the host.
async fn answers<L: Write>(link: &mut L, ports: &[Port; NODES]) -> Result<(), L::Error> {
    Timer::after(ANSWER).await;
    let mut bytes = [0; 1024];
    for port in ports {
        link.write_all(take(port, &mut bytes)).await?;
    }
    Ok(())
}

async fn number<L: Read>(link: &mut L) -> Result<u32, L::Error> {
    let mut bytes = [0; 4];
    for byte in &mut bytes {
        let mut one = [0];
        link.read(&mut one).await?;
        [*byte] = one;
    }
    Ok(u32::from_le_bytes(bytes))
}
