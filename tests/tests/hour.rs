//! An hour of node time: five timer-driven nodes in one emulated machine whose time runs ahead while they
//! sleep.
//!
//! Against the same scenario in loopback: a tick too many or too few, a funnel of another tick, or a frame
//! that nobody counted, and this fails. `./ci.sh hour` runs it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_protocol::Refusal;
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::report::Report;
use funnelnet_protocol::serial::{self, Deframer, Frame};
use funnelnet_protocol::service::{Body, Reply, Request};
use sim_host::configure::{Drive, node_configs};
use sim_host::run::Fidelity;
use sim_host::scenario::Scenario;
use std::io::{Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use system_tests::{repository, run, scenario};

const NODES: u32 = 5;
const HOUR_S: u32 = 3600;
/// Counts of the hardware timer in a microsecond.
const COUNTS_PER_US: u64 = 25;
/// Of wall time, without a byte from the machine: it takes about a minute for its hour.
const PATIENCE: Duration = Duration::from_secs(500);

/// An emulator that ends with the test.
struct Machine(Child);

impl Drop for Machine {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts the image whose time is counted in instructions, and skips what it would sleep.
fn machine(folder: &Path) -> (Machine, UnixStream) {
    let image = repository("firmware/target/thumbv7em-none-eabihf/release/selftest");
    assert!(image.is_file(), "no image at {}: ./ci.sh selftest", image.display());
    let socket = folder.join("uart");
    let listener = UnixListener::bind(&socket).unwrap();
    let child = Command::new("qemu-system-arm")
        .args(["-M", "mps2-an386", "-display", "none", "-monitor", "none", "-icount", "shift=0,sleep=off"])
        .args(["-semihosting-config", "enable=on,target=native", "-serial", "chardev:uart", "-chardev"])
        .arg(format!("socket,id=uart,path={}", socket.display()))
        .arg("-kernel")
        .arg(image)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let machine = Machine(child);
    let (stream, _) = listener.accept().unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    (machine, stream)
}

fn frame(request: &Request) -> Vec<u8> {
    let (mut scratch, mut frame) = ([0; serial::MAX_RAW], [0; serial::MAX_FRAME]);
    let length = serial::encode_service(request, serial::HOST, &mut scratch, &mut frame).unwrap();
    frame[..length].to_vec()
}

/// The next reply of a node.
fn reply(stream: &mut UnixStream) -> Reply {
    let mut deframer: Deframer = Deframer::new();
    loop {
        let mut byte = [0];
        stream.read_exact(&mut byte).unwrap();
        match deframer.push(byte[0]) {
            Some(Ok(Frame::Service { kind, body, .. })) => return Reply::decode(kind, body).unwrap(),
            Some(other) => panic!("{other:?}"),
            None => {}
        }
    }
}

fn numbers<const N: usize>(stream: &mut UnixStream) -> [u8; N] {
    let mut bytes = [0; N];
    stream.read_exact(&mut bytes).unwrap();
    bytes
}

fn u64_of(stream: &mut UnixStream) -> u64 {
    u64::from_le_bytes(numbers(stream))
}

fn u32_of(stream: &mut UnixStream) -> u32 {
    u32::from_le_bytes(numbers(stream))
}

/// What the bus in the machine has seen, and the nodes' reports.
struct Hour {
    hash: u64,
    elapsed_us: u64,
    counts: u64,
    frames: u32,
    strange: u32,
    lost: u32,
    reports: Vec<Report>,
}

fn emulated(scenario: &Scenario) -> Hour {
    let folder = tempfile::tempdir().unwrap();
    let (_machine, mut stream) = machine(folder.path());
    let drive = Drive { tick_source: TickSource::Timer, telemetry_every: 0, is_simulated: true };
    let configs = node_configs(scenario, drive).unwrap();
    assert_eq!(configs.len(), NODES as usize);
    let period_us = u32::try_from(scenario.time.tick_ns / 1000).unwrap();
    let ticks = u32::try_from(scenario.time.ticks).unwrap();
    stream.write_all(b"h").unwrap();
    stream.write_all(&period_us.to_le_bytes()).unwrap();
    stream.write_all(&ticks.to_le_bytes()).unwrap();
    for config in configs {
        stream.write_all(&frame(&Request::Configure(config))).unwrap();
    }
    for _ in 0..NODES {
        assert_eq!(reply(&mut stream), Reply::Configured(Ok(())));
    }
    let [hash, elapsed_us, counts] = std::array::from_fn(|_| u64_of(&mut stream));
    let [frames, strange, lost] = std::array::from_fn(|_| u32_of(&mut stream));
    let report = |_| match reply(&mut stream) {
        Reply::Report(report) => report,
        other => panic!("{other:?}"),
    };
    Hour { hash, elapsed_us, counts, frames, strange, lost, reports: (0..NODES).map(report).collect() }
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh hour"]
fn an_hour_of_node_time_is_the_hour_of_the_simulator() {
    let scenario = scenario("five-agents.toml", &["time.tick=20ms", "time.duration=3600s"]);
    let ticks = HOUR_S * 50;
    let loopback = run(&scenario, Fidelity::Loopback);
    let hour = emulated(&scenario);
    // The funnel and the law: every state of every tick.
    assert_eq!(format!("{:016x}", hour.hash), loopback.hash.unwrap().to_string());
    // The time base: an hour and the half period after which the first states were carried, as the hardware
    // counts it too.
    let expected_us = u64::from(ticks) * 20_000 + 10_000;
    assert!(hour.elapsed_us.abs_diff(expected_us) <= 200, "{} us", hour.elapsed_us);
    assert!((hour.counts / COUNTS_PER_US).abs_diff(hour.elapsed_us) <= 200, "{} counts", hour.counts);
    // Every frame: the states of each tick, and each end of each edge of the ring once.
    assert_eq!(hour.frames, NODES * (ticks + 1) + 2 * NODES);
    assert_eq!((hour.strange, hour.lost), (0, 0));
    for (report, loopback) in hour.reports.iter().zip(&loopback.counters) {
        let counters = &report.counters;
        assert_eq!(counters.sent, ticks + 1 + 2);
        // A bus carries everything to everybody: two neighbours' frames, the edges of all, and states of
        // strangers, which are refused.
        let strangers = 2 * (ticks + 1);
        assert_eq!(
            u64::from(counters.accepted) + counters.all_refused(),
            u64::from(4 * (ticks + 3) + 2),
            "{counters:?}"
        );
        assert_eq!(counters.refused(Refusal::UnknownSource), strangers, "{counters:?}");
        assert_eq!(counters.all_refused(), u64::from(strangers), "{counters:?}");
        assert_eq!((counters.overruns, counters.extrapolated, counters.neighbours_lost), (0, 0, 0));
        assert_eq!((counters.breaches, counters.weights_differ), (0, 0));
        assert_eq!(counters.ticks, ticks, "{counters:?}");
        assert!(report.max_ratio < 1.0 && loopback.breaches == 0);
    }
}
