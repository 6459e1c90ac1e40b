//! The frames of a scenario as a DBC file: what each identifier on CAN means, by protocol/README.md.
//!
//! Written here: the libraries that write DBC (dbc-rs 0.10) have no `SIG_VALTYPE_`, without which a state is an integer.

use crate::scenario::{BusModel, LARGEST_RUN, Scenario};
use funnelnet_protocol::can::function;
use funnelnet_protocol::can_fd::{self, States};
use funnelnet_protocol::{Component, FaultCode, Message, NodeId, TickStamp};
use std::fmt::Write as _;

/// Why a scenario has no frames on CAN.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoFrames {
    /// Its states travel on serial lines.
    #[error(
        "bus.model = \"uart\": no frame of it is on CAN; --set bus.model=can or can-fd says which frames are meant"
    )]
    Serial,
    /// More nodes than identifiers.
    #[error("graph.nodes = {0}: a bus has {LARGEST_RUN} nodes at most, since an id is 7 bits")]
    TooMany(usize),
}

/// What a signal is beside an unsigned integer.
#[derive(Clone, Copy, PartialEq)]
enum Type {
    Unsigned,
    /// IEEE 754, 32 bits.
    Float,
}

/// A field of a frame, little-endian.
struct Signal {
    name: String,
    /// Bits before it.
    at: usize,
    bits: usize,
    kind: Type,
    unit: String,
    /// Numbers that have names.
    values: Vec<(u8, String)>,
}

impl Signal {
    fn new(name: &str, at: usize, bits: usize) -> Self {
        let (name, unit) = (name.to_owned(), String::new());
        Self { name, at, bits, kind: Type::Unsigned, unit, values: Vec::new() }
    }

    /// An f32 in some unit.
    fn float(name: String, at: usize, unit: &str) -> Self {
        Self { name, at, bits: 32, kind: Type::Float, unit: unit.to_owned(), values: Vec::new() }
    }

    fn with_unit(self, unit: &str) -> Self {
        Self { unit: unit.to_owned(), ..self }
    }

    fn with_values(self, values: Vec<(u8, String)>) -> Self {
        Self { values, ..self }
    }
}

/// A frame of one sender.
struct Frame {
    id: u16,
    name: String,
    sender: String,
    /// Length of its data.
    bytes: usize,
    signals: Vec<Signal>,
    comment: &'static str,
}

/// Sender of what no node sends.
const HOST: &str = "Host";
/// Number of the frame format of CAN FD among the names of `VFrameFormat`.
const FD_FORMAT: usize = 14;

/// The DBC file of a scenario, one message for each identifier that its nodes and a host can send.
///
/// Bytes of Windows-1252, which readers of DBC expect; what that has no character for becomes `?`. The format is that of CAN FD with
/// `bus.model = "can-fd"`, else the classic one.
///
/// # Errors
/// There are no such frames.
pub fn dbc(scenario: &Scenario) -> Result<Vec<u8>, NoFrames> {
    if scenario.bus.model == BusModel::Uart {
        return Err(NoFrames::Serial);
    }
    let too_many = || NoFrames::TooMany(scenario.nodes.len());
    let nodes: Option<Vec<NodeId>> =
        scenario.nodes.iter().map(|node| u8::try_from(node.id).ok().and_then(NodeId::new)).collect();
    let nodes = nodes.ok_or_else(too_many)?;
    let is_fd = scenario.bus.model == BusModel::CanFd;
    let frames = frames(scenario, &nodes, is_fd);
    Ok(encoded(&document(scenario, &nodes, &frames, is_fd)))
}

fn frames(scenario: &Scenario, nodes: &[NodeId], is_fd: bool) -> Vec<Frame> {
    let ids = || nodes.iter().copied();
    let masters = scenario.sync.iter().flat_map(|sync| &sync.masters);
    let masters = masters.filter_map(|&id| u8::try_from(id).ok().and_then(NodeId::new));
    let components = scenario.nodes.first().map_or(1, |node| node.state.len());
    let unit = scenario.unit.as_deref().unwrap_or("");
    let mut frames = vec![ctrl(None)];
    frames.extend(ids().map(|node| ctrl(Some(node))));
    frames.push(sync(None));
    frames.extend(masters.map(|node| sync(Some(node))));
    frames.extend(ids().map(fault));
    if is_fd {
        frames.extend(ids().map(|node| state_fd(node, components, unit)));
    } else {
        for component in (0..Component::COUNT).take(components) {
            frames.extend(ids().map(|node| state(node, component, components, unit)));
        }
    }
    frames.extend(ids().map(edge));
    frames
}

fn id(function: u8, node: Option<NodeId>) -> u16 {
    u16::from(function) << 7 | u16::from(node.map_or(0, NodeId::get))
}

fn sender(node: Option<NodeId>) -> String {
    node.map_or_else(|| HOST.to_owned(), |node| format!("Node{}", node.get()))
}

fn ctrl(target: Option<NodeId>) -> Frame {
    let commands = [(1, "start"), (2, "stop"), (3, "commit")].map(|(value, name)| (value, name.to_owned()));
    Frame {
        id: id(function::CTRL, target),
        name: target.map_or_else(|| "CTRL_all".to_owned(), |node| format!("CTRL_{}", node.get())),
        sender: sender(None),
        bytes: 4,
        signals: vec![
            Signal::new("cmd", 0, 8).with_values(commands.into()),
            Signal::new("arg", 8, 8),
            Signal::new("at_tick", 16, 16),
        ],
        comment: "A command to all nodes, or to one; at_tick has the low 16 bits of a tick.",
    }
}

fn sync(master: Option<NodeId>) -> Frame {
    Frame {
        id: id(function::SYNC, master),
        name: master.map_or_else(|| "SYNC_host".to_owned(), |node| format!("SYNC_{}", node.get())),
        sender: sender(master),
        bytes: 5,
        signals: vec![Signal::new("tick", 0, 24), Signal::new("phase", 24, 16).with_unit("us")],
        comment: "Tick and phase of the SYNC before this one; a phase of 65535 is not known.",
    }
}

fn fault(node: NodeId) -> Frame {
    let codes = (1..=FaultCode::STARTS_ANEW.0).map(|code| (code, FaultCode(code).to_string()));
    let severities =
        [(0, "notice"), (1, "warning"), (2, "stopped")].map(|(value, name)| (value, name.to_owned()));
    Frame {
        id: id(function::FAULT, Some(node)),
        name: format!("FAULT_{}", node.get()),
        sender: sender(Some(node)),
        bytes: 5,
        signals: vec![
            Signal::new("code", 0, 8).with_values(codes.collect()),
            Signal::new("severity", 8, 8).with_values(severities.into()),
            Signal::new("arg", 16, 16),
            Signal::new("tick", 32, 8),
        ],
        comment: "What is wrong with the node, with the low 8 bits of the tick.",
    }
}

/// A state's column of trajectory.csv.
fn column(node: NodeId, component: u8, components: usize) -> String {
    let node = node.get();
    if components == 1 { format!("x_{node}") } else { format!("x_{node}_{component}") }
}

fn state(node: NodeId, component: u8, components: usize, unit: &str) -> Frame {
    let name = column(node, component, components);
    Frame {
        id: id(function::STATE + component, Some(node)),
        name: format!("STATE{}", name.trim_start_matches('x')),
        sender: sender(Some(node)),
        bytes: 5,
        signals: vec![Signal::float(name, 0, unit), Signal::new("tick", 32, 8)],
        comment: "The state of the node at a tick, with the low 8 bits of that.",
    }
}

fn state_fd(node: NodeId, components: usize, unit: &str) -> Frame {
    let indices = (0..Component::COUNT).take(components);
    let x = indices.map(|k| Signal::float(column(node, k, components), 32 * (usize::from(k) + 1), unit));
    Frame {
        id: id(function::STATE_FD, Some(node)),
        name: format!("STATE_FD_{}", node.get()),
        sender: sender(Some(node)),
        bytes: fd_bytes(node, components),
        signals: [Signal::new("header", 0, 8), Signal::new("tick", 16, 16)].into_iter().chain(x).collect(),
        comment: "The state of the node at a tick, with the low 16 bits of that; header: number of components, less one.",
    }
}

/// As the encoder has it: not every length is one of CAN FD.
fn fd_bytes(node: NodeId, components: usize) -> usize {
    let tick = TickStamp::full(0);
    let mut states = States::new(node, tick, 0.0);
    for component in (1..Component::COUNT).take(components.saturating_sub(1)).filter_map(Component::new) {
        states.add(&Message::State { source: node, component, tick, x: 0.0 });
    }
    can_fd::encode_states(&states).data().len()
}

fn edge(node: NodeId) -> Frame {
    Frame {
        id: id(function::EDGE, Some(node)),
        name: format!("EDGE_{}", node.get()),
        sender: sender(Some(node)),
        bytes: 5,
        signals: vec![Signal::new("other", 0, 8), Signal::float("alpha".to_owned(), 8, "")],
        comment: "The node's weight of the edge to the other node; its edges take turns.",
    }
}

/// Writing to a string does not fail, here and below.
fn document(scenario: &Scenario, nodes: &[NodeId], frames: &[Frame], is_fd: bool) -> String {
    let mut text = "VERSION \"\"\n\nNS_ :\n\nBS_:\n\n".to_owned();
    let names: Vec<_> = nodes.iter().map(|node| sender(Some(*node))).collect();
    let _ = writeln!(text, "BU_: {HOST} {}\n", names.join(" "));
    frames.iter().for_each(|frame| message(&mut text, frame));
    let title = quoted(&scenario.title);
    let _ =
        writeln!(text, "CM_ \"Frames of the scenario {title}, by sim-host {}\";", env!("CARGO_PKG_VERSION"));
    for Frame { id, comment, .. } in frames {
        let _ = writeln!(text, "CM_ BO_ {id} \"{comment}\";");
    }
    formats(&mut text, frames, is_fd);
    for frame in frames {
        value_names(&mut text, frame);
    }
    for Frame { id, signals, .. } in frames {
        for Signal { name, .. } in signals.iter().filter(|signal| signal.kind == Type::Float) {
            let _ = writeln!(text, "SIG_VALTYPE_ {id} {name} : 1;");
        }
    }
    text
}

fn message(text: &mut String, Frame { id, name, sender, bytes, signals, .. }: &Frame) {
    let _ = writeln!(text, "BO_ {id} {name}: {bytes} {sender}");
    for Signal { name, at, bits, kind, unit, .. } in signals {
        let sign = if *kind == Type::Float { '-' } else { '+' };
        let _ =
            writeln!(text, " SG_ {name} : {at}|{bits}@1{sign} (1,0) [0|0] \"{}\" Vector__XXX", quoted(unit));
    }
    text.push('\n');
}

/// Which format each frame has, as Vector's tools name it.
fn formats(text: &mut String, frames: &[Frame], is_fd: bool) {
    let reserved: Vec<_> = (2..FD_FORMAT).map(|n| format!("\"reserved{n}\"")).collect();
    let names = format!(
        "\"StandardCAN\",\"ExtendedCAN\",{},\"StandardCAN_FD\",\"ExtendedCAN_FD\"",
        reserved.join(",")
    );
    let _ = writeln!(text, "BA_DEF_ \"BusType\" STRING ;");
    let _ = writeln!(text, "BA_DEF_ BO_ \"VFrameFormat\" ENUM {names};");
    let _ = writeln!(text, "BA_DEF_DEF_ \"BusType\" \"CAN\";");
    let _ = writeln!(text, "BA_DEF_DEF_ \"VFrameFormat\" \"StandardCAN\";");
    if is_fd {
        let _ = writeln!(text, "BA_ \"BusType\" \"CAN FD\";");
        for Frame { id, .. } in frames {
            let _ = writeln!(text, "BA_ \"VFrameFormat\" BO_ {id} {FD_FORMAT};");
        }
    }
}

fn value_names(text: &mut String, Frame { id, signals, .. }: &Frame) {
    for Signal { name, values, .. } in signals.iter().filter(|signal| !signal.values.is_empty()) {
        let values: Vec<_> =
            values.iter().map(|(value, what)| format!("{value} \"{}\"", quoted(what))).collect();
        let _ = writeln!(text, "VAL_ {id} {name} {} ;", values.join(" "));
    }
}

/// What may stand between quotes: the format has no way to write a quote, and readers differ about a backslash.
fn quoted(text: &str) -> String {
    let allowed = |c: char| match c {
        '"' => '\'',
        '\\' => '/',
        c if c.is_control() => ' ',
        c => c,
    };
    text.chars().map(allowed).collect()
}

/// From U+00A0 on Windows-1252 has the characters of Unicode.
fn encoded(text: &str) -> Vec<u8> {
    let byte = |c: char| match u32::from(c) {
        0x80..=0x9F => b'?',
        number => u8::try_from(number).unwrap_or(b'?'),
    };
    text.chars().map(byte).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
    use super::*;
    use crate::scenario::Override;
    use funnelnet_protocol::can;
    use std::path::Path;

    fn of(sets: &[&str]) -> Result<Vec<u8>, NoFrames> {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
        let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
        dbc(&Scenario::load(&path, &sets).unwrap())
    }

    fn text(sets: &[&str]) -> String {
        String::from_utf8(of(sets).unwrap()).unwrap()
    }

    /// Each frame has the identifier and the length that the encoder gives it.
    #[test]
    fn identifiers_and_lengths_are_those_of_the_encoder() {
        let (node, tick) = (NodeId::new(5).unwrap(), TickStamp::full(0));
        let last = Component::new(7).unwrap();
        let state = |component| Message::State { source: node, component, tick, x: 0.0 };
        let of = |message: Message| {
            let frame = can::encode(&message);
            (frame.id(), frame.data().len())
        };
        let known = |frame: &Frame| (frame.id, frame.bytes);
        assert_eq!(known(&super::state(node, 0, 1, "")), of(state(Component::FIRST)));
        assert_eq!(known(&super::state(node, 7, 8, "")), of(state(last)));
        for (components, bytes) in [8, 12, 16, 20, 24, 32, 32, 48].into_iter().enumerate() {
            assert_eq!(known(&state_fd(node, components + 1, "")), (0x585, bytes), "{components}");
        }
        assert_eq!((id(function::EDGE, Some(node)), id(function::SYNC, None)), (0x605, 0x80));
    }

    #[test]
    fn signals_end_within_their_frames_and_do_not_overlap() {
        let node = NodeId::new(1).unwrap();
        let fd = (1..=8).map(|components| state_fd(node, components, ""));
        for frame in
            [ctrl(None), sync(None), fault(node), state(node, 0, 1, ""), edge(node)].into_iter().chain(fd)
        {
            let mut end = 0;
            for signal in &frame.signals {
                assert!(signal.at >= end, "{} {}", frame.name, signal.name);
                end = signal.at + signal.bits;
            }
            assert!(end <= 8 * frame.bytes, "{}", frame.name);
        }
    }

    #[test]
    fn a_unit_is_written_as_readers_expect_it() {
        let bytes = of(&["agent.unit=°C \"x\" Ω"]).unwrap();
        let unit = b"\"\xb0C 'x' ?\"";
        assert!(bytes.windows(unit.len()).any(|window| window == unit));
    }

    #[test]
    fn networks_without_frames_on_can_are_refused() {
        assert_eq!(of(&["bus.model=uart"]), Err(NoFrames::Serial));
        let many = [
            "graph={kind='star',nodes=128}",
            "coupling.funnel.start=4000",
            "agent.dynamics={kind='affine',slope=-1}",
        ];
        assert_eq!(of(&many), Err(NoFrames::TooMany(128)));
    }

    #[test]
    fn time_masters_have_a_sync_of_their_own() {
        let sets = ["bus.model=can", "clock.drift_ppm=10", "sync.masters=[2, 4]"];
        let text = text(&sets);
        for line in ["BO_ 130 SYNC_2: 5 Node2", "BO_ 132 SYNC_4: 5 Node4", "BO_ 128 SYNC_host: 5 Host"] {
            assert!(text.contains(line), "{line}");
        }
        assert!(!text.contains("SYNC_1:"));
    }
}
