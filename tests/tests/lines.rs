//! Emulated nodes on lines to each other: states go from neighbour to neighbour and nowhere else, commands
//! and SYNC from line to line. `./ci.sh parity` runs it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::message::{Command, FaultCode, Message, Target, TickStamp};
use funnelnet_protocol::report::{Report, Telemetry};
use funnelnet_protocol::serial::{self, Deframer, Frame, MAX_FRAME};
use funnelnet_protocol::service::{Reply, Request};
use sim_host::configure::{Drive, node_configs};
use sim_host::hub::{Link, Received, SLICE, Talk};
use sim_host::interrupt::Interrupt;
use sim_host::record::Row;
use sim_host::run::Fidelity;
use sim_host::scenario::Scenario;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, Stdio};
use std::time::{Duration, Instant};
use system_tests::{repository, run, scenario};
use tempfile::TempDir;

/// For one answer: emulators share a busy machine.
const PATIENCE: Duration = Duration::from_secs(30);
const O_NONBLOCK: i32 = 0o4000;

/// What a line of a node leads to, as QEMU is told.
type Chardev = String;

/// An emulated node and its line to the host.
struct Node {
    link: Talk,
    child: Child,
}

impl Drop for Node {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Node {
    /// Starts node `id` with these lines to neighbours.
    fn start(id: u8, lines: &[Chardev], folder: &Path) -> Self {
        let image = repository("firmware/target/thumbv7em-none-eabihf/release/mps2_peers");
        assert!(image.is_file(), "no firmware image at {}: ./ci.sh parity", image.display());
        let path = folder.join(format!("host-{id}"));
        let listener = UnixListener::bind(&path).unwrap();
        let mut command = Process::new("qemu-system-arm");
        command.args(["-M", "mps2-an386", "-display", "none", "-monitor", "none", "-kernel"]).arg(image);
        command.args(["-semihosting-config", "enable=on,target=native"]);
        // Those that others connect to first: once the host has its line, they are there.
        for (number, chardev) in (1..).zip(lines) {
            command.args(["-chardev", &chardev.replacen(',', &format!(",id=line{number},"), 1)]);
        }
        let to_host = format!("socket,id=line0,path={}", path.display());
        command.args(["-chardev", &to_host]);
        for number in 0..=lines.len() {
            command.args(["-serial", &format!("chardev:line{number}")]);
        }
        let child = command.stdin(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
        let stream = accept(&listener);
        let link = Link::new(id, "the emulator".to_owned(), Box::new(stream), Interrupt::default());
        Self { link: Talk::new(link), child }
    }

    fn write(&mut self, message: &Message) {
        self.link.write(&serial::encode(message)).unwrap();
    }

    fn configure(&mut self, config: &NodeConfig) {
        self.link.request(&Request::Configure(config.clone())).unwrap();
        let configured = |received| match received {
            Received::Reply(Reply::Configured(outcome)) => Some(outcome),
            _ => None,
        };
        assert_eq!(self.link.wait_for(PATIENCE, "configured", configured).unwrap(), Ok(()));
    }

    fn state(&mut self) -> f32 {
        let own = self.link.id();
        let state = |received| match received {
            Received::Message(Message::State { source, x, .. }) if source.get() == own => Some(x),
            Received::Message(message) if !matches!(message, Message::Edge { .. }) => {
                panic!("on the line of node {}: {message:?}", own)
            }
            _ => None,
        };
        self.link.wait_for(PATIENCE, "state", state).unwrap()
    }

    fn telemetry(&mut self) -> Telemetry {
        let telemetry = |received| match received {
            Received::Reply(Reply::Telemetry(telemetry)) => Some(telemetry),
            _ => None,
        };
        self.link.wait_for(PATIENCE, "telemetry", telemetry).unwrap()
    }

    fn report(&mut self) -> Report {
        self.link.request(&Request::Report).unwrap();
        let report = |received| match received {
            Received::Reply(Reply::Report(report)) => Some(report),
            _ => None,
        };
        self.link.wait_for(PATIENCE, "report", report).unwrap()
    }

    /// Waits until the node has accepted so many frames: nothing is on its way to it any more.
    fn settle(&mut self, accepted: u32) {
        let begin = Instant::now();
        while self.report().counters.accepted < accepted {
            let id = self.link.id();
            assert!(begin.elapsed() < PATIENCE, "node {id}: {:?}, not {accepted}", self.report().counters);
        }
    }
}

fn accept(listener: &UnixListener) -> UnixStream {
    listener.set_nonblocking(true).unwrap();
    let begin = Instant::now();
    loop {
        match listener.accept() {
            Ok((stream, _)) => {
                stream.set_nonblocking(false).unwrap();
                stream.set_read_timeout(Some(SLICE)).unwrap();
                stream.set_write_timeout(Some(SLICE)).unwrap();
                return stream;
            }
            Err(error) => assert_eq!(error.kind(), ErrorKind::WouldBlock),
        }
        assert!(begin.elapsed() < PATIENCE, "the emulator does not connect");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Emulated nodes with the lines of a scenario's graph between them, and a line to the host each.
struct Network {
    nodes: Vec<Node>,
    configs: Vec<NodeConfig>,
    /// Number of neighbours, by index.
    degrees: Vec<u32>,
    neighbours: Vec<Vec<usize>>,
    _folder: TempDir,
}

impl Network {
    /// `more` are further lines, before those of the graph, of the node with this index.
    fn start(scenario: &Scenario, more: impl FnOnce(&Path) -> Vec<(usize, Chardev)>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let count = scenario.nodes.len();
        let mut lines = vec![Vec::new(); count];
        let mut neighbours = vec![Vec::new(); count];
        for (node, chardev) in more(folder.path()) {
            lines[node].push(chardev);
        }
        for edge in &scenario.graph.edges {
            let (first, second) = (edge.a.min(edge.b), edge.a.max(edge.b));
            let path = folder.path().join(format!("{first}-{second}")).display().to_string();
            lines[first].push(format!("socket,path={path},server=on,wait=off"));
            lines[second].push(format!("socket,path={path}"));
            neighbours[first].push(second);
            neighbours[second].push(first);
        }
        let drive = Drive { tick_source: TickSource::Sync, telemetry_every: 1, is_simulated: false };
        let configs = node_configs(scenario, drive).unwrap();
        let start = |(config, lines): (&NodeConfig, &Vec<Chardev>)| {
            let mut node = Node::start(config.id, lines, folder.path());
            node.configure(config);
            node
        };
        let nodes = configs.iter().zip(&lines).map(start).collect();
        let degrees = neighbours.iter().map(|list| list.len() as u32).collect();
        Self { nodes, configs, degrees, neighbours, _folder: folder }
    }

    /// Waits until all have accepted everything that belongs to `ticks` ticks: the start, each SYNC once, of
    /// each neighbour its states and, one per tick, its edges.
    fn settle(&mut self, ticks: u32) {
        for index in 0..self.nodes.len() {
            let expected = self.expected(index, ticks);
            self.nodes[index].settle(expected);
        }
    }

    fn expected(&self, index: usize, ticks: u32) -> u32 {
        let edges: u32 = self.neighbours[index].iter().map(|&other| self.degrees[other].min(ticks)).sum();
        1 + ticks + self.degrees[index] * (ticks + 1) + edges
    }

    /// Runs `rows.len()` ticks of which the nodes in `hosts` are told, and compares every bit that is seen.
    fn run(&mut self, rows: &[Row], hosts: &[usize]) {
        let start = ctrl(Command::Start, 1);
        hosts.iter().for_each(|&host| self.nodes[host].write(&start));
        let mut states: Vec<_> = self.nodes.iter_mut().map(Node::state).collect();
        self.settle(0);
        for (k, row) in (0..).zip(rows) {
            let sync = sync(k);
            hosts.iter().for_each(|&host| self.nodes[host].write(&sync));
            for (index, node) in self.nodes.iter_mut().enumerate() {
                let next = node.state();
                let Telemetry { tick, nu, psi, u, .. } = node.telemetry();
                let seen = [states[index], nu, psi, u].map(f32::to_bits);
                let expected =
                    [&row.x, &row.nu, &row.psi, &row.u].map(|values| (values[index] as f32).to_bits());
                assert_eq!((tick, seen), (k, expected), "node {} at tick {k}", index + 1);
                states[index] = next;
            }
            self.settle(k + 1);
        }
        for index in 0..self.nodes.len() {
            let counters = self.nodes[index].report().counters;
            assert_eq!(counters.accepted, self.expected(index, rows.len() as u32), "node {}", index + 1);
            assert_eq!((counters.extrapolated, counters.sync_gaps), (0, 0), "node {}", index + 1);
        }
    }

    /// A node that runs would refuse its configuration.
    fn assert_stopped(&mut self) {
        self.nodes.iter_mut().zip(&self.configs).for_each(|(node, config)| node.configure(config));
    }
}

fn ctrl(command: Command, number: u8) -> Message {
    Message::Ctrl { target: Target::All, command, arg: number, at_tick: 0 }
}

/// What makes tick `k`.
fn sync(k: u32) -> Message {
    Message::Sync { source: None, previous_tick: TickStamp::full(k.wrapping_sub(1)), phase_us: 0 }
}

fn no_more(_: &Path) -> Vec<(usize, Chardev)> {
    Vec::new()
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn a_ring_with_a_host_on_one_node_runs_the_bits_of_loopback() {
    let scenario = scenario("five-agents.toml", &["time.duration=600ms"]);
    let rows = run(&scenario, Fidelity::Loopback).rows;
    let mut network = Network::start(&scenario, no_more);
    network.run(&rows, &[0]);
    for node in &mut network.nodes {
        let counters = node.report().counters;
        assert!(counters.all_refused() == 0, "node {}: {counters:?}", node.link.id());
    }
    // From another node than the start.
    network.nodes[2].write(&ctrl(Command::Stop, 2));
    std::thread::sleep(Duration::from_millis(200));
    network.assert_stopped();
}

/// A chain with a host on each node; noise on a line of the second one, and a line of the third that takes
/// nothing.
#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn noise_and_a_line_that_is_stuck_hold_up_no_other() {
    let scenario = scenario("five-agents-path.toml", &["time.duration=500ms"]);
    let rows = run(&scenario, Fidelity::Loopback).rows;
    let mut full = None;
    let mut noise = PathBuf::new();
    let mut network = Network::start(&scenario, |folder| {
        noise = folder.join("noise");
        full = Some(full_pipe(&folder.join("stuck")));
        vec![
            (1, format!("socket,path={},server=on,wait=off", noise.display())),
            (2, format!("pipe,path={}", folder.join("stuck").display())),
        ]
    });
    let talker = UnixStream::connect(noise).unwrap();
    let chatter = std::thread::spawn(move || chatter(talker));
    network.run(&rows, &[0, 1, 2, 3, 4]);
    let of = |network: &mut Network, index: usize| network.nodes[index].report().counters.all_refused();
    assert!(of(&mut network, 1) > 1_000);
    assert_eq!(of(&mut network, 2), 0);
    drop(network);
    chatter.join().unwrap();
}

/// Both ends of a pipe for QEMU, of which the one that the node writes to is full for as long as the file is
/// open.
fn full_pipe(path: &Path) -> File {
    let [to_node, from_node] = ["in", "out"].map(|end| path.with_extension(end));
    let made = Process::new("mkfifo").args([&to_node, &from_node]).status().unwrap();
    assert!(made.success());
    let mut file =
        OpenOptions::new().read(true).write(true).custom_flags(O_NONBLOCK).open(from_node).unwrap();
    while file.write(&[0; 64]).is_ok() {}
    while file.write(&[0]).is_ok() {}
    file
}

/// Never falls silent: frames that are none, and pieces of frames, until the node is gone.
fn chatter(mut line: UnixStream) {
    let state = serial::encode(&sync(7));
    let mut noise = vec![0x11, 0xFF, 0x00, 0x03, 0x40, 0x00];
    noise.extend_from_slice(&state[..7]);
    noise.extend_from_slice(&[0xAA; 40]);
    noise.push(0);
    while line.write_all(&noise).is_ok() {}
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn the_faults_of_all_reach_every_host_once() {
    let mut scenario = scenario("five-agents.toml", &["time.duration=10ms"]);
    scenario.safety.holdover_ns = Some(1_000_000_000);
    let rows = run(&scenario, Fidelity::Loopback).rows;
    let mut network = Network::start(&scenario, no_more);
    network.run(&rows, &[0]);
    // No SYNC any more.
    for node in &mut network.nodes {
        let mut sources = faults(node, 5, PATIENCE);
        sources.sort_unstable();
        assert_eq!(sources, [1, 2, 3, 4, 5]);
        assert_eq!(faults(node, 1, Duration::from_millis(200)), [0_u8; 0]);
    }
}

/// Whose faults come on a node's line, `count` at most within `limit`. Past the `Link`, which drops those of
/// other nodes.
fn faults(node: &Node, count: usize, limit: Duration) -> Vec<u8> {
    let (mut line, mut deframer) = (node.link.reader().unwrap(), Deframer::<MAX_FRAME>::new());
    let (mut sources, begin) = (Vec::new(), Instant::now());
    while sources.len() < count && begin.elapsed() < limit {
        let mut byte = [0];
        // Nothing within a slice is an error, too.
        if line.read(&mut byte).is_err() {
            continue;
        }
        if let Some(Ok(Frame::RealTime(Message::Fault { source, code, .. }))) = deframer.push(byte[0]) {
            assert_eq!(code, FaultCode::HOLDOVER);
            sources.push(source.get());
        }
    }
    sources
}
