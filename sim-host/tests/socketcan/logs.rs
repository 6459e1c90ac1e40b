//! Logs of the guest kernel: beside that of a simulated bus, with all that is on a bus in them, and replayed.

use super::{NODES, repository, summary, text};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::process::Command;

const TICKS: usize = 1000;

/// What sim-host says with these arguments, and its exit code.
fn sim_host(arguments: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_sim-host"))
        .current_dir(repository())
        .args(arguments)
        .output()
        .unwrap();
    let said = [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    (output.status.code(), said.concat())
}

/// Frames of nodes with all their bits, tick by tick, and the announced edges: in a simulation what is sent
/// before t = T belongs to tick 0, in lockstep what comes after its SYNC. A host waits for the states of a
/// tick, and for no edge, so that these may come a tick later. What a host says is left out; it has no part
/// in a simulation. The first states are the announced ones.
fn frames_by_tick(
    log: &str,
    tick: impl Fn(usize, f64) -> usize,
) -> (Vec<BTreeSet<String>>, BTreeSet<String>) {
    let (mut sets, mut edges) = (vec![BTreeSet::new()], BTreeSet::new());
    let mut syncs = 0;
    for line in log.lines() {
        let (time, frame) = line.split_once(") ").unwrap();
        let (time, frame) = (time[1..].parse::<f64>().unwrap(), frame.split_once(' ').unwrap().1);
        let function = u16::from_str_radix(&frame[..3], 16).unwrap() >> 7;
        syncs += usize::from(function == 1);
        if function == 12 {
            assert!(edges.insert(frame.to_owned()), "twice: {line}");
        } else if function >= 3 {
            let tick = tick(syncs, time);
            while sets.len() <= tick {
                sets.push(BTreeSet::new());
            }
            assert!(sets[tick].insert(frame.to_owned()), "twice in tick {tick}: {line}");
        }
    }
    (sets, edges)
}

/// The same scenario on `can` in loopback and by host nodes on `vcan`: equal states at every tick, and the
/// same frames in it.
pub fn loopback_and_the_guest_kernel_have_the_same_frames(work: &Path) {
    assert_eq!(text(work, "bus.status").trim(), "0", "{}", text(work, "bus.err"));
    let folder = work.join("bus-loopback");
    let scenario = work.join("five.toml");
    let (scenario, out) = (scenario.to_str().unwrap(), folder.to_str().unwrap());
    let sets = ["--set", "bus.model=can", "--set", "time.duration=1s", "--every", "1ms"];
    let (code, said) = sim_host(&[&["run", scenario, "--out", out][..], &sets].concat());
    assert_eq!(code, Some(0), "{said}");
    let (bench, loopback) = (summary(work, "bus"), summary(work, "bus-loopback"));
    assert_eq!(bench["bench"]["bit_for_bit"], true, "{}", bench["bench"]);
    assert_eq!(bench["trace_hash"], loopback["trace_hash"]);
    let (guest, edges) = frames_by_tick(&text(work, "bus/can.log"), |syncs, _| syncs);
    // Announced states have time 0; the first of a tick comes a frame later.
    let (simulated, simulated_edges) =
        frames_by_tick(&text(work, "bus-loopback/can.log"), |_, time| match time {
            0.0 => 0,
            time => 1 + (time / 1e-3) as usize,
        });
    assert_eq!((&edges, edges.len()), (&simulated_edges, 2 * NODES));
    assert_eq!((guest.len(), simulated.len()), (TICKS + 2, TICKS + 1));
    for (tick, (guest, simulated)) in guest.iter().zip(&simulated).enumerate() {
        assert_eq!(guest, simulated, "tick {tick}");
        assert_eq!(guest.len(), NODES, "tick {tick}: {guest:?}");
    }
    the_tables_agree(&bench, &loopback);
}

/// The same rows, with the same numbers of frames, but for the last state, which loopback does not carry, and
/// the host's frames.
fn the_tables_agree(bench: &serde_json::Value, loopback: &serde_json::Value) {
    let rows = |summary: &serde_json::Value| -> Vec<(String, u64)> {
        let rows = summary["bus"]["can"]["identifiers"].as_array().unwrap();
        rows.iter()
            .map(|row| (row["id"].as_str().unwrap().to_owned(), row["frames"].as_u64().unwrap()))
            .collect()
    };
    let simulated = rows(loopback);
    let mut of_nodes = rows(bench);
    of_nodes.retain(|(id, _)| id.as_str() >= "180");
    assert_eq!(of_nodes.len(), simulated.len());
    for ((id, frames), (simulated_id, simulated)) in of_nodes.iter().zip(&simulated) {
        let more = u64::from(id.as_str() < "600");
        assert_eq!((id, *frames), (simulated_id, simulated + more));
    }
    let can = &bench["bus"]["can"];
    assert_eq!((&can["latency_from"], &can["bitrate"]), (&"sync".into(), &1_000_000.into()));
    assert!(
        can["identifiers"].as_array().unwrap().iter().any(|row| row["latency_s"]["max"].as_f64() > Some(0.0))
    );
    // SYNC comes on top of what a simulation has.
    let busy = |summary: &serde_json::Value| summary["bus"]["utilisation"].as_f64().unwrap();
    let sync = 105.0 / 1000.0;
    assert!((busy(loopback)..busy(loopback) + sync + 0.01).contains(&busy(bench)), "{can}");
}

/// 29-bit identifiers and remote frames are in our log as they are in candump's.
pub fn everything_on_the_bus_is_in_the_log(work: &Path) {
    let (ours, candumps) = (text(work, "foreign/can.log"), text(work, "candump-foreign.log"));
    for frame in [" 12345678#DEADBEEF", " 123#R4", " 00000123#R"] {
        assert!(ours.lines().any(|line| line.ends_with(frame)), "no{frame} in our log");
        assert!(candumps.lines().any(|line| line.ends_with(frame)), "no{frame} in candump's log");
    }
    super::assert_same(&super::frames(&ours), &super::frames(&candumps));
}

/// Node by node: our log and candump's, classic and CAN FD, by SYNC and by clocks of their own.
pub fn logs_replay_clean(work: &Path) {
    let at = |name: &str| work.join(name).to_str().unwrap().to_owned();
    let (five, vector, unjudged) = (at("five.toml"), at("vector.toml"), at("unjudged.toml"));
    for (log, scenario, sets, nodes) in [
        ("whole/can.log", &five, &["time.duration=2s"][..], NODES),
        ("candump.log", &five, &["time.duration=2s"], 2),
        ("bus/can.log", &five, &["bus.model=can", "time.duration=1s"], 2),
        ("foreign/can.log", &five, &["time.duration=1s"], 1),
        ("fd/can.log", &vector, &["time.duration=1s"], NODES),
        ("own/can.log", &unjudged, &["time.tick=50ms", "time.duration=13500ms"], NODES),
    ] {
        let sets: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
        for node in 1..=nodes {
            let (log, node) = (at(log), node.to_string());
            let (code, said) =
                sim_host(&[&["replay", &log, "--scenario", scenario, "--node", &node][..], &sets].concat());
            assert_eq!(code, Some(0), "{log}: {said}");
        }
    }
    one_bit_is_found(work);
}

fn one_bit_is_found(work: &Path) {
    let log = text(work, "whole/can.log");
    // The announced state is the first one; the last digit is one of the tick, the one before the last byte
    // of x.
    let (at, line) = log.lines().enumerate().filter(|(_, line)| line.contains(" 183#")).nth(700).unwrap();
    let old = line.as_bytes()[line.len() - 3];
    let new = if old == b'0' { '1' } else { '0' };
    let changed = format!("{}{new}{}", &line[..line.len() - 3], &line[line.len() - 2..]);
    let lines: Vec<&str> =
        log.lines().enumerate().map(|(n, line)| if n == at { changed.as_str() } else { line }).collect();
    let path = work.join("changed.log");
    fs::write(&path, lines.join("\n") + "\n").unwrap();
    let scenario = work.join("five.toml");
    let arguments =
        ["replay", path.to_str().unwrap(), "--scenario", scenario.to_str().unwrap(), "--node", "3"];
    let (code, said) = sim_host(&[&arguments[..], &["--set", "time.duration=2s"]].concat());
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("first difference at tick 700, x: the log says"), "{said}");
}
