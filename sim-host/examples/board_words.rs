//! What a host says to boards and what they shall answer, as bytes: for the tests of board images on
//! emulators (`firmware/emulated`).
//!
//! Usage: `board_words SCENARIO [section.key=value]...` prints JSON: requests, and of each tick the SYNC and
//! the states that loopback gives. `board_words --read` reads frames of nodes, a line of hexadecimal digits
//! each, and prints each as a line of JSON. So the tests know no byte of the wire themselves: they follow its
//! version.
#![allow(clippy::expect_used, clippy::panic)]

use funnelnet_link::{Classic, Fd, Format, Frame as _};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::message::{Command, Component, Message, NodeId, Target, TickStamp};
use funnelnet_protocol::serial::{self, Deframer, Frame, HOST, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Body, Reply, Request};
use serde_json::{Value, json};
use sim_host::configure::{Drive, node_configs};
use sim_host::interrupt::Interrupt;
use sim_host::run::{Fidelity, RunOptions, Verbosity, simulate};
use sim_host::scenario::{Override, Scenario};
use std::io::{BufRead, Write};
use std::path::PathBuf;

/// The tick at which a node that runs changes to what it has staged.
const COMMIT_AT: u16 = 20;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut out = std::io::stdout().lock();
    match arguments.split_first() {
        Some((first, [])) if first == "--read" => {
            for line in std::io::stdin().lock().lines() {
                writeln!(out, "{}", read(&bytes(&line.expect("text")))).expect("somebody listens");
            }
        }
        Some((path, overrides)) => writeln!(out, "{}", words(path, overrides)).expect("somebody listens"),
        None => panic!("usage: board_words SCENARIO [section.key=value]... | board_words --read"),
    }
}

/// All that is said to the nodes of a scenario, and what they say on the real-time plane.
fn words(path: &str, overrides: &[String]) -> Value {
    let overrides: Vec<_> =
        overrides.iter().map(|text| Override::parse(text).expect("section.key=value")).collect();
    let scenario = Scenario::load(&PathBuf::from(path), &overrides).expect("a scenario");
    let drive = Drive { tick_source: TickSource::Sync, telemetry_every: 0, is_simulated: false };
    let configs = node_configs(&scenario, drive).expect("a scenario for nodes");
    let outcome = simulate(&scenario, &options()).expect("a run in loopback");
    let ticks =
        outcome.rows.iter().zip(0..).map(
            |(row, tick)| json!({ "sync": message(&sync(tick)), "states": states(&configs, &row.x, tick) }),
        );
    json!({
        "hello": service(&Request::Hello),
        "report": service(&Request::Report),
        "store": service(&Request::Store),
        "erase": service(&Request::Erase),
        "start": message(&ctrl(Command::Start)),
        "stop": message(&ctrl(Command::Stop)),
        "commit": message(&ctrl(Command::Commit)),
        "commit_at": message(&Message::Ctrl { target: Target::All, command: Command::Commit, arg: 0, at_tick: COMMIT_AT }),
        "commit_at_tick": COMMIT_AT,
        "nodes": configs.iter().map(node).collect::<Vec<_>>(),
        "ticks": ticks.collect::<Vec<_>>(),
    })
}

/// Every tick, in memory alone.
fn options() -> RunOptions {
    RunOptions {
        on: Fidelity::Loopback,
        out: None,
        every_ticks: Some(1),
        json: None,
        junit: None,
        image: PathBuf::new(),
        bench: None,
        bus_logs: Default::default(),
        mcap: false,
        verbosity: Verbosity::Quiet,
        interrupt: Interrupt::default(),
        repeat: String::new(),
    }
}

/// A node's configuration; the same with another state to begin with, which has another checksum, by SYNC and by its own clock; with
/// neighbours whose numbers are larger by one; with its own clock; with telemetry at each tick.
fn node(config: &NodeConfig) -> Value {
    let by_timer = NodeConfig { tick_source: TickSource::Timer, ..config.clone() };
    let telling = NodeConfig { telemetry_every: 1, ..by_timer.clone() };
    let mut moved = config.clone();
    moved.neighbours.iter_mut().for_each(|edge| edge.id += 1);
    let mut other = config.clone();
    other.initial_state.iter_mut().for_each(|x| *x += 1.0);
    let other_by_timer = NodeConfig { tick_source: TickSource::Timer, ..other.clone() };
    json!({
        "id": config.id,
        "configure": service(&Request::Configure(config.clone())),
        "checksum": config.checksum(),
        "stage_other": service(&Request::Stage(other.clone())),
        "other_checksum": other.checksum(),
        "stage_other_by_timer": service(&Request::Stage(other_by_timer.clone())),
        "other_by_timer_checksum": other_by_timer.checksum(),
        "stage_moved": service(&Request::Stage(moved)),
        "configure_by_timer": service(&Request::Configure(by_timer)),
        "configure_telling": service(&Request::Configure(telling)),
    })
}

/// The state of each node at a tick, in the order of components.
fn states(configs: &[NodeConfig], x: &[f64], tick: u32) -> Vec<Value> {
    let mut x = x.iter();
    let of_node = |config: &NodeConfig| {
        let components = (0..config.initial_state.len()).zip(x.by_ref());
        let messages = components.map(|(component, &x)| {
            message(&Message::State {
                source: NodeId::new(config.id).expect("an id"),
                component: Component::new(component as u8).expect("a component"),
                tick: TickStamp::full(tick),
                x: x as f32,
            })
        });
        Value::from(messages.collect::<Vec<_>>())
    };
    configs.iter().map(of_node).collect()
}

fn ctrl(command: Command) -> Message {
    Message::Ctrl { target: Target::All, command, arg: 0, at_tick: 0 }
}

fn sync(tick: u32) -> Message {
    Message::Sync { source: None, previous_tick: TickStamp::full(tick.wrapping_sub(1)), phase_us: 0 }
}

/// A message on a serial line, and on CAN in both formats; of a state with several components the first one.
fn message(message: &Message) -> Value {
    json!({ "serial": hex(&serial::encode(message)), "can": frame::<Classic>(message), "fd": frame::<Fd>(message) })
}

fn frame<F: Format>(message: &Message) -> Value {
    let mut format = F::default();
    let frame = format.pack(message).into_iter().flatten().next().or_else(|| format.flush());
    frame.map_or(Value::Null, |frame| json!({ "id": frame.id(), "data": hex(frame.data()) }))
}

fn service(request: &Request) -> String {
    let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
    let length =
        serial::encode_service(request, HOST, &mut scratch, &mut frame).expect("room for every frame");
    hex(&frame[..length])
}

/// What a node's frame says; `{"refused": reason}` where it says nothing.
fn read(bytes: &[u8]) -> Value {
    let mut deframer: Deframer = Deframer::new();
    let frame = bytes.strip_suffix(&[0]).unwrap_or(bytes);
    assert!(!frame.contains(&0), "one frame per line");
    for &byte in frame {
        let _ = deframer.push(byte);
    }
    match deframer.push(0) {
        None => json!({ "refused": "Empty" }),
        Some(Err(reason)) => json!({ "refused": format!("{reason:?}") }),
        Some(Ok(Frame::RealTime(message))) => json!({ "message": format!("{message:?}") }),
        Some(Ok(Frame::Service { kind, source, body })) => match Reply::decode(kind, body) {
            Ok(reply) => with_source(told(&reply), source),
            Err(reason) => json!({ "refused": format!("{reason:?}") }),
        },
    }
}

fn with_source(mut value: Value, source: u8) -> Value {
    value["source"] = source.into();
    value
}

fn told(reply: &Reply) -> Value {
    match reply {
        Reply::Identity(identity) => json!({ "identity": identity }),
        Reply::Report(report) => json!({ "report": report }),
        Reply::Telemetry(telemetry) => json!({ "telemetry": telemetry }),
        Reply::Configured(result) => outcome("configured", result),
        Reply::Stored(result) => outcome("stored", result),
        Reply::Erased(result) => outcome("erased", result),
        Reply::Staged(result) => outcome("staged", result),
        Reply::Keyed(result) => outcome("keyed", result),
        Reply::Update(reply) => json!({ "update": format!("{reply:?}") }),
    }
}

fn outcome<T: serde::Serialize, E: std::fmt::Debug>(name: &str, result: &Result<T, E>) -> Value {
    match result {
        Ok(value) => json!({ name: { "ok": value } }),
        Err(reason) => json!({ name: { "error": format!("{reason:?}") } }),
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn bytes(hex: &str) -> Vec<u8> {
    let digits = hex.trim().as_bytes();
    assert!(digits.len().is_multiple_of(2), "two digits a byte: {hex}");
    let byte = |pair: &[u8]| {
        u8::from_str_radix(std::str::from_utf8(pair).expect("digits"), 16).expect("hexadecimal digits")
    };
    digits.chunks(2).map(byte).collect()
}
