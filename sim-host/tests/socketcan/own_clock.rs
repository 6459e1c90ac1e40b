//! Nodes on CAN that tick by their own clock, in real time.
//!
//! On a bus a frame takes a tenth of a millisecond, and nodes tick within that of each other: a state comes
//! before its receiver's own tick or after it, as it happens. So the bits of loopback are demanded only where
//! every frame passes this program, which delays it by half a tick.

use super::{NODES, assert_same, decoded, fd_frame, frames, summary, text};
use funnelnet_protocol::can_fd::{self, Content};
use funnelnet_protocol::message::{Command as Order, Message};
use serde_json::Value;
use sim_host::record::TraceHash;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// More than the eight bits of a classic frame tell apart.
const TICKS: usize = 270;
/// Of the bench that relays every frame.
const HALF_A_LONG_TICK_S: f64 = 0.1;

pub fn write_benches(work: &Path) {
    let node = |id: usize, bus: &str| match bus {
        "" => format!("[[node]]\nid = {id}\nhost = true\n"),
        bus => format!("[[node]]\nid = {id}\nhost = true\ncan = \"{bus}\"\n"),
    };
    let write = |name: &str, head: &str, buses: [&str; NODES]| {
        let nodes: String = (1..).zip(buses).map(|(id, bus)| node(id, bus)).collect();
        fs::write(work.join(name), format!("version = 1\nclock = \"own\"\n{head}\n{nodes}")).unwrap();
    };
    write("own.toml", "can = \"vcan0\"", ["vcan0"; NODES]);
    // On a path.
    let apart = ["vcan0", "", "vcan1", "vcan0", "vcan1"];
    write("own-apart.toml", "can = [\"vcan0\", \"vcan1\"]", apart);
    write("own-fd-mixed.toml", "can = \"vcan0\"\ncan_fd = true", ["vcan0", "vcan0", "vcan0", "", ""]);
}

/// What a run that ended well says of its clocks: ticks of which a part was lost, ticks that were late,
/// values and states that were.
fn clocks(work: &Path, run: &str) -> (u64, u64, u64) {
    assert_eq!(text(work, &format!("{run}.status")).trim(), "0", "{}", text(work, &format!("{run}.err")));
    let summary = summary(work, run);
    assert_eq!(summary["stopped"], serde_json::json!([]), "{summary}");
    let clocks = &summary["bench"]["own_clock"];
    let sum = |count: &str| -> u64 {
        clocks["nodes"].as_array().unwrap().iter().map(|node| node[count].as_u64().unwrap()).sum()
    };
    let (missed, overruns) = (clocks["missed"].as_u64().unwrap(), sum("overruns"));
    // A node that was late by almost a tick, or by several, replaces what it has to say by what is newer.
    assert!(missed <= (NODES * TICKS / 10) as u64, "{clocks}");
    (missed, overruns, sum("extrapolated") + sum("late"))
}

fn largest_deviation(bench: &Value) -> f64 {
    let nodes = bench["nodes"].as_array().unwrap();
    nodes.iter().map(|node| node["largest_deviation"].as_f64().unwrap()).fold(0.0, f64::max)
}

/// What is kept of the run is what candump, which knows nothing of it, has heard: each state of each tick,
/// and nothing else but one start, one stop and the announced edges. Nothing is relayed.
pub fn five_on_a_bus_are_recorded_from_it(work: &Path) {
    let (missed, overruns, _) = clocks(work, "own");
    let summary = summary(work, "own");
    let bench = &summary["bench"];
    assert!(overruns > 0 || largest_deviation(bench) < 1.0, "{summary}");
    let log = text(work, "candump-own.log");
    let frames = frames(&log);
    let mut next = BTreeMap::new();
    let (mut states, mut orders, mut edges) = (BTreeMap::new(), Vec::new(), 0);
    for message in frames.iter().map(|frame| decoded(frame)) {
        match message {
            Message::State { source, tick, x, .. } => {
                let awaited = next.entry(source.get()).or_insert(0);
                let tick =
                    tick.rebuild(*awaited, 0, 4).unwrap_or_else(|| panic!("{message:?}, not {awaited}"));
                *awaited = tick + 1;
                assert_eq!(states.insert((tick as usize, source.get()), x), None, "{message:?}");
            }
            Message::Ctrl { command, .. } => orders.push(command),
            Message::Edge { .. } => edges += 1,
            other => panic!("unexplained: {other:?}"),
        }
    }
    assert_eq!((orders, edges), (vec![Order::Start, Order::Stop], 2 * NODES));
    let counted: Vec<_> = states.iter().filter(|((tick, _), _)| *tick <= TICKS).map(|(_, &x)| x).collect();
    assert!(counted.len() as u64 + missed >= (NODES * (TICKS + 1)) as u64, "{}", counted.len());
    let csv = text(work, "own/bench.csv");
    let on_bus = csv.lines().skip(1).filter(|line| !line.ends_with(',')).count() as u64;
    // A row has its bus time, or says that it has none; a host that is held up may read a line first.
    let nodes = bench["own_clock"]["nodes"].as_array().unwrap();
    let without: u64 = nodes.iter().map(|node| node["no_bus_time"].as_u64().unwrap()).sum();
    let rows = (NODES * (TICKS + 1)) as u64;
    assert_eq!(on_bus + without, rows, "{on_bus} rows with a bus time, {without} without");
    assert!(without <= 2 * missed + rows / 20, "{without} rows without a bus time");
    if missed == 0 {
        let mut hash = TraceHash::new();
        hash.extend(counted);
        assert_eq!(summary["trace_hash"], hash.to_string());
    }
    assert_same(&self::frames(&text(work, "own/can.log")), &frames);
    assert_eq!((&bench["can"]["strangers"], &bench["can"]["unreadable"]), (&0.into(), &0.into()), "{bench}");
}

/// No neighbours are on the same bus, so that every frame passes this program and arrives half a tick later. A
/// tick is longer here: that a guest kernel holds nobody up for half of it is the rule.
pub fn between_buses_frames_come_between_two_ticks(work: &Path) {
    let (missed, _, late) = clocks(work, "own-apart");
    let bench = &summary(work, "own-apart")["bench"];
    assert_eq!(bench["can"].as_array().map(Vec::len), Some(2), "{bench}");
    let skew = bench["own_clock"]["largest_skew_s"].as_f64().unwrap();
    if missed + late == 0 && skew < HALF_A_LONG_TICK_S {
        assert_eq!(bench["bit_for_bit"], true, "{bench}");
    } else {
        eprintln!(
            "NOT CHECKED, a guest that was held up: bits of loopback between buses: {}",
            bench["own_clock"]
        );
    }
}

/// Components that a line brings one by one, whenever they come, are in one frame on the bus.
pub fn states_of_lines_go_into_one_frame(work: &Path) {
    let (missed, _, _) = clocks(work, "own-fd-mixed");
    let mut relayed = 0;
    for (id, _, data) in frames(&text(work, "own-fd-mixed/can.log")).iter().map(|frame| fd_frame(frame)) {
        if let Ok(Content::States(state)) = can_fd::decode(id, &data) {
            assert!(state.message(1).is_some() && state.message(2).is_none(), "{state:?}");
            relayed += u64::from([4, 5].contains(&(id & 0x7F)));
        }
    }
    assert!(relayed + missed >= 2 * (TICKS as u64 + 1), "{relayed}");
}

pub fn whoever_is_on_the_bus_can_stop_it(work: &Path) {
    let said = text(work, "halted.err");
    assert_eq!(text(work, "halted.status").trim(), "1", "{said}");
    for words in ["has said nothing for 2.05 s", "all nodes confirmed that they stopped"] {
        assert!(said.contains(words), "no '{words}' in: {said}");
    }
}
