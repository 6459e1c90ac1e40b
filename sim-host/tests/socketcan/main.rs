//! Benches on a real SocketCAN bus, `vcan` in a guest kernel, with nodes in processes of their own.
//! `./ci.sh socketcan` runs this.
#![cfg(target_os = "linux")]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "helpers of tests, which clippy does not know as such"
)]

mod logs;
mod own_clock;
mod several;

use funnelnet_protocol::can;
use funnelnet_protocol::can_fd::{self, Content};
use funnelnet_protocol::message::{Command as Order, Message};
use sim_host::record::TraceHash;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use tempfile::TempDir;

const NODES: usize = 5;
const TICKS: usize = 2000;
const FD_TICKS: usize = 1000;
/// What the guest may take, and what the host grants it, s.
const GUEST_S: u32 = 600;
const HOST_S: u32 = 630;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").canonicalize().unwrap()
}

/// The work folder after the guest has run the job in it.
fn guest() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let work = folder.path();
    let nodes: String =
        (1..=NODES).map(|id| format!("[[node]]\nid = {id}\nhost = true\ncan = true\n")).collect();
    fs::write(work.join("can.toml"), format!("version = 1\ncan = \"vcan0\"\n{nodes}")).unwrap();
    // Neighbours on the ring: 1 hears 5 by a relay from its line, and 2 over CAN.
    let mixed = nodes.replace("id = 4\nhost = true\ncan = true", "id = 4\nhost = true");
    let mixed = mixed.replace("id = 5\nhost = true\ncan = true", "id = 5\nhost = true");
    fs::write(work.join("mixed.toml"), format!("version = 1\ncan = \"vcan0\"\n{mixed}")).unwrap();
    let fd =
        |interface: &str, nodes: &str| format!("version = 1\ncan = \"{interface}\"\ncan_fd = true\n{nodes}");
    fs::write(work.join("fd.toml"), fd("vcan0", &nodes)).unwrap();
    fs::write(work.join("fd-mixed.toml"), fd("vcan0", &mixed)).unwrap();
    fs::write(work.join("no-fd.toml"), fd("vcan1", &nodes)).unwrap();
    several::write_benches(work);
    own_clock::write_benches(work);
    let script = repository().join("tests/socketcan");
    let job = format!(
        "exec sh {}/job.sh {} {}/scenarios\n",
        script.display(),
        env!("CARGO_BIN_EXE_sim-host"),
        repository().display()
    );
    fs::write(work.join("job.sh"), job).unwrap();
    let console = fs::File::create(work.join("console")).unwrap();
    let guest =
        std::env::var("FUNNEL_GUEST").expect("FUNNEL_GUEST=`tests/socketcan/find-guest.sh target/guest`");
    let mut guest = guest.split_whitespace();
    let [kernel, modules] = [(); 2].map(|()| guest.next().expect("KERNEL MODULES [OPTION] in FUNNEL_GUEST"));
    let ended = Command::new("timeout")
        .args(["--kill-after=5", &HOST_S.to_string(), kernel, "mem=256M", "quiet"])
        .args(guest)
        .args(["rootfstype=hostfs", "rootflags=/", "ro", "con=null", "con0=null,fd:1"])
        .arg(format!("MODULES={modules}"))
        .arg(format!("init={}/guest.sh", script.display()))
        .arg(format!("WORK={}", work.display()))
        .arg(format!("SECONDS_LEFT={GUEST_S}"))
        .stdin(Stdio::null())
        .stdout(console.try_clone().unwrap())
        .stderr(console)
        .status()
        .unwrap_or_else(|error| panic!("no {kernel}: {error}; ./ci.sh socketcan"));
    let said = [text(work, "console"), text(work, "log")].join("\n");
    assert_eq!(text(work, "status").trim(), "0", "{ended}:\n{said}");
    folder
}

/// A file of the work folder; empty where there is none.
fn text(work: &Path, name: &str) -> String {
    fs::read_to_string(work.join(name)).unwrap_or_default()
}

fn summary(work: &Path, run: &str) -> serde_json::Value {
    let text = text(work, &format!("{run}/summary.json"));
    serde_json::from_str(&text)
        .unwrap_or_else(|_| panic!("{run}: {}", self::text(work, &format!("{run}.err"))))
}

/// The frames of a log of `candump -L`, with everything but the time.
fn frames(log: &str) -> Vec<&str> {
    log.lines().map(|line| line.split_once(' ').unwrap().1).collect()
}

/// Our log holds what candump's does; else says where they part, since each is long.
fn assert_same(ours: &[&str], candumps: &[&str]) {
    let parting = ours.iter().zip(candumps).position(|(one, other)| one != other);
    let at = parting.unwrap_or(ours.len().min(candumps.len()));
    let place = |log: &[&str]| log.iter().skip(at).take(3).map(|&frame| frame.to_owned()).collect::<Vec<_>>();
    assert_eq!((ours.len(), place(ours)), (candumps.len(), place(candumps)), "from frame {at} on");
}

fn decoded(frame: &str) -> Message {
    let (id, data) = frame.split_once(' ').unwrap().1.split_once('#').unwrap();
    let byte = |n: usize| u8::from_str_radix(&data[2 * n..2 * n + 2], 16).unwrap();
    let bytes: Vec<_> = (0..data.len() / 2).map(byte).collect();
    can::decode(u16::from_str_radix(id, 16).unwrap(), &bytes)
        .unwrap_or_else(|reason| panic!("{frame}: {reason:?}"))
}

#[test]
#[ignore = "needs user-mode Linux and can-utils: ./ci.sh socketcan"]
fn benches_on_a_real_can_bus() {
    let folder = guest();
    let work = folder.path();
    the_bits_of_loopback(work);
    every_frame_is_explained(work);
    can_fd_has_a_frame_for_all_components(work);
    a_bus_that_cannot_do_can_fd_is_refused(work);
    lines_and_can_are_mixed(work);
    logs::loopback_and_the_guest_kernel_have_the_same_frames(work);
    logs::everything_on_the_bus_is_in_the_log(work);
    logs::logs_replay_clean(work);
    several::two_buses_have_the_bits_of_loopback(work);
    own_clock::five_on_a_bus_are_recorded_from_it(work);
    own_clock::between_buses_frames_come_between_two_ticks(work);
    own_clock::states_of_lines_go_into_one_frame(work);
    own_clock::whoever_is_on_the_bus_can_stop_it(work);
    what_a_real_bus_does_not_do_is_skipped(work);
    a_node_that_dies_is_named(work);
    another_takes_its_place(work);
    twins_fall_silent(work);
}

fn the_bits_of_loopback(work: &Path) {
    assert_eq!(text(work, "whole.status").trim(), "0", "{}", text(work, "whole.err"));
    let summary = summary(work, "whole");
    assert_eq!((&summary["ticks"], &summary["bench"]["bit_for_bit"]), (&TICKS.into(), &true.into()));
    let json = work.join("loopback.json");
    let loopback = Command::new(env!("CARGO_BIN_EXE_sim-host"))
        .arg("run")
        .arg(repository().join("scenarios/five-agents.toml"))
        .args(["--quiet", "--set", "time.duration=2s", "--json"])
        .arg(&json)
        .status();
    assert!(loopback.unwrap().success());
    let loopback: serde_json::Value = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
    assert_eq!(summary["trace_hash"], loopback["trace_hash"]);
}

/// Candump, which knows nothing of the run, has seen what the nodes say of it: each state of each tick, and
/// nothing else but a start, a SYNC per tick and the announced edges.
fn every_frame_is_explained(work: &Path) {
    let log = text(work, "candump.log");
    let frames = frames(&log);
    let mut states: BTreeMap<(usize, u8), f32> = BTreeMap::new();
    let (mut starts, mut edges, mut syncs) = (0, 0, 0);
    for message in frames.iter().map(|frame| decoded(frame)) {
        match message {
            Message::Ctrl { command: Order::Start, .. } => starts += 1,
            Message::Sync { source: None, previous_tick, .. } => {
                let previous = (syncs as u32).wrapping_sub(1) & 0xFF_FFFF;
                assert_eq!(previous_tick.value(), previous, "SYNC {syncs}");
                syncs += 1;
            }
            Message::State { source, tick, x, .. } => {
                // Announced before the first SYNC; then each belongs to the tick after the last SYNC.
                assert_eq!(tick.value(), syncs as u32 & 0xFF, "node {source:?} after {syncs} SYNCs");
                let twice = states.insert((syncs, source.get()), x);
                assert_eq!(twice, None, "node {source:?} after {syncs} SYNCs");
            }
            Message::Edge { .. } => edges += 1,
            other => panic!("unexplained: {other:?}"),
        }
    }
    assert_eq!((starts, syncs, edges), (1, TICKS + 1, 2 * NODES));
    assert_eq!(states.len(), NODES * (TICKS + 2));
    let mut hash = TraceHash::new();
    // The nodes send one state more than a run has ticks.
    hash.extend(states.iter().filter(|((tick, _), _)| *tick <= TICKS).map(|(_, &x)| x));
    assert_eq!(summary(work, "whole")["trace_hash"], hash.to_string());
    // Our own log, which has the kernel's times too, is the same.
    let ours = text(work, "whole/can.log");
    assert_same(&self::frames(&ours), &frames);
    let can = &summary(work, "whole")["bench"]["can"];
    assert_eq!((&can["frames"], &can["strangers"]), (&frames.len().into(), &0.into()));
    assert_eq!((&can["unreadable"], &can["errors"]), (&0.into(), &0.into()));
    bus_times_are_those_of_the_log(work, &ours);
}

/// `bus_s` of bench.csv grows from tick to tick, and spans what the log spans.
fn bus_times_are_those_of_the_log(work: &Path, log: &str) {
    let csv = text(work, "whole/bench.csv");
    let times: Vec<f64> = csv
        .lines()
        .skip(1)
        .filter(|line| line.split(',').nth(1) == Some("1"))
        .map(|line| line.rsplit(',').next().unwrap().parse().unwrap())
        .collect();
    assert_eq!(times.len(), TICKS + 1);
    assert!(times.windows(2).all(|pair| pair[0] < pair[1]));
    let at = |line: &str| -> f64 { line[1..line.find(')').unwrap()].parse().unwrap() };
    let spans = at(log.lines().last().unwrap()) - at(log.lines().next().unwrap());
    let last = times.last().unwrap();
    assert!((spans - last).abs() < 0.05, "{spans} s in the log, {last} s in bench.csv");
}

/// Identifier, flags and data of a frame of CAN FD in a log.
fn fd_frame(frame: &str) -> (u16, u8, Vec<u8>) {
    let (id, rest) = frame.strip_prefix("vcan0 ").unwrap().split_once("##").unwrap();
    let hex = |text: &str| u8::from_str_radix(text, 16).unwrap();
    let data = (1..rest.len()).step_by(2).map(|at| hex(&rest[at..at + 2])).collect();
    (u16::from_str_radix(id, 16).unwrap(), hex(&rest[..1]), data)
}

/// Five nodes with two components each: one frame per node and tick, with the whole state and the bits of
/// loopback; nothing else but a start, a SYNC per tick and the announced edges; and our own log is candump's.
fn can_fd_has_a_frame_for_all_components(work: &Path) {
    for run in ["fd", "fd-mixed"] {
        assert_eq!(text(work, &format!("{run}.status")).trim(), "0", "{}", text(work, &format!("{run}.err")));
        let bench = &summary(work, run)["bench"];
        assert_eq!(
            (&bench["bit_for_bit"], &bench["can"]["unreadable"]),
            (&true.into(), &0.into()),
            "{bench}"
        );
    }
    let log = text(work, "candump-fd.log");
    let frames = frames(&log);
    assert_same(&self::frames(&text(work, "fd/can.log")), &frames);
    let (mut states, mut others, mut hash) = (BTreeMap::new(), [0; 3], TraceHash::new());
    for (id, flags, data) in frames.iter().map(|frame| fd_frame(frame)) {
        assert_eq!(flags & 1, 1, "no bit rate switch");
        match can_fd::decode(id, &data) {
            Ok(Content::States(state)) => {
                let both = [0, 1].map(|component| match state.message(component) {
                    Some(Message::State { tick, x, .. }) if tick.value() == others[1] as u32 => x,
                    other => panic!("{other:?} after {} SYNCs", others[1]),
                });
                let twice = states.insert((others[1], id & 0x7F), both);
                assert_eq!((state.message(2), twice), (None, None));
            }
            Ok(Content::Message(Message::Ctrl { command: Order::Start, .. })) => others[0] += 1,
            Ok(Content::Message(Message::Sync { .. })) => others[1] += 1,
            Ok(Content::Message(Message::Edge { .. })) => others[2] += 1,
            other => panic!("unexplained: {other:?}"),
        }
    }
    assert_eq!((others, states.len()), ([1, FD_TICKS + 1, 2 * NODES], NODES * (FD_TICKS + 2)));
    let counted = states.iter().filter(|((tick, _), _)| *tick <= FD_TICKS);
    hash.extend(counted.flat_map(|(_, &both)| both));
    assert_eq!(summary(work, "fd")["trace_hash"], hash.to_string());
}

fn a_bus_that_cannot_do_can_fd_is_refused(work: &Path) {
    let said = text(work, "no-fd.err");
    assert_eq!(text(work, "no-fd.status").trim(), "3", "{said}");
    for words in [
        "the CAN interface vcan1 is not set up for CAN FD: its MTU is 16, not 72",
        "sudo ip link set vcan0 mtu 72",
    ] {
        assert!(said.contains(words), "no '{words}' in: {said}");
    }
}

fn lines_and_can_are_mixed(work: &Path) {
    assert_eq!(text(work, "mixed.status").trim(), "0", "{}", text(work, "mixed.err"));
    let bench = &summary(work, "mixed")["bench"];
    assert_eq!(bench["bit_for_bit"], true, "{bench}");
    let log = text(work, "mixed/can.log");
    let from = |id: u8| {
        let states = frames(&log).into_iter().map(decoded);
        states
            .filter(|message| matches!(message, Message::State { source, .. } if source.get() == id))
            .count()
    };
    // Those on lines are relayed, each state once; the last one finds no tick any more.
    assert_eq!([1, 2, 3, 4, 5].map(from), [602, 602, 602, 601, 601]);
}

fn what_a_real_bus_does_not_do_is_skipped(work: &Path) {
    let skipped = &summary(work, "skipped")["bench"]["skipped"];
    assert_eq!(skipped[0], "bus.loss", "{skipped}");
    let said = text(work, "skipped.err");
    assert!(
        said.contains("skipped between nodes on CAN or wired to each other, whose lines are real: bus.loss"),
        "{said}"
    );
}

fn a_node_that_dies_is_named(work: &Path) {
    let said = text(work, "killed.err");
    assert_eq!(text(work, "killed.status").trim(), "1", "{said}");
    for words in [
        "the process of node 3 ended",
        "signal: 9",
        "stopped: 1, 2, 4, 5; told to stop, but did not confirm it: 3",
    ] {
        assert!(said.contains(words), "no '{words}' in: {said}");
    }
    let [at, end] = ["killed.at", "killed.end"].map(|name| text(work, name).trim().parse::<f64>().unwrap());
    // Half a second of silence, and the time of a guest on a busy computer; not the run's ten minutes.
    assert!(end - at < 20.0, "it took {} s", end - at);
}

/// A node that was killed is away for a while, and another one joins. From its first SYNC on no state is
/// refused, by it or by the others.
fn another_takes_its_place(work: &Path) {
    // It was away, which fails the run.
    assert_eq!(text(work, "go-on.status").trim(), "1", "{}", text(work, "go-on.err"));
    let summary = summary(work, "go-on");
    let absences = summary["bench"]["absences"].as_array().unwrap();
    let [absence] = absences.as_slice() else { panic!("{absences:?}") };
    let [from, to] = ["from_tick", "to_tick"].map(|tick| absence[tick].as_u64().unwrap());
    assert!(absence["node"] == 3 && from < to && to + 256 < 3000, "{absence}");
    let refused = summary["bus"]["refused"].as_object().unwrap();
    // Nodes on CAN hear all, and those that they are no neighbours of are no matter.
    let refused = |reason: &str| refused[reason].as_u64().unwrap();
    assert!(refused("tick_window") <= 4 && refused("stale") + refused("duplicate") == 0, "{summary}");
    assert_eq!(summary["stopped"], serde_json::json!([]));
    let sync = &summary["sync"];
    assert!(sync["final_spread"].as_f64().unwrap() < sync["bound"].as_f64().unwrap(), "{sync}");
}

/// The nodes that were there first all fall silent, and are named. Those that came later do too, or have
/// already been made to tick by the first bench, whose bus it is.
fn twins_fall_silent(work: &Path) {
    let said = text(work, "first.err");
    for id in 1..=NODES {
        let fault = format!("node {id} stopped by itself: another node has its id");
        assert!(said.contains(&fault), "node {id}: {said}");
    }
    let stopped = &summary(work, "first")["stopped"];
    assert_eq!(stopped.as_array().map(Vec::len), Some(NODES), "{stopped}");
    let said = text(work, "twins.err");
    assert!(
        said.contains("another node has its id")
            || said.contains("when it was asked for tick")
            || said.contains("sent a state of another tick"),
        "{said}"
    );
}
