//! The first difference between what a node sends and what a log says it sent, field by field.

use super::says;
use crate::can::AnyFormat;
use funnelnet_protocol::message::Message;
use serde::Serialize;
use std::fmt;

/// The first difference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Difference {
    /// Tick of the state in which it is; of another frame, the one at which it was sent.
    pub tick: u32,
    /// What differs: `x` or `x of component 1`, `tick`, `weight` and others; `frame` where one of both has
    /// none.
    pub field: String,
    /// The log's value.
    pub log: String,
    /// The value that the node sends.
    pub node: String,
    /// Line of the log.
    pub line: usize,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { tick, field, log, node, line } = self;
        write!(
            f,
            "first difference at tick {tick}, {field}: the log says {log} (line {line}), the node {node}"
        )
    }
}

/// The field in which two frames with the same identifier differ first: its name, and its values in the log
/// and of the node.
pub fn field(id: u16, log: &[u8], node: &[u8], fd: bool) -> (String, String, String) {
    let read = |bytes: &[u8]| says(&mut AnyFormat::new(fd), id, bytes);
    let (of_log, of_node) = (read(log), read(node));
    for (log, node) in of_log.iter().zip(&of_node) {
        let (Ok(log), Ok(node)) = (log, node) else { break };
        let differs = fields(log).into_iter().zip(fields(node)).find(|(log, node)| log != node);
        if let Some(((name, log), (_, node))) = differs {
            return (name, log, node);
        }
    }
    ("bytes".to_owned(), hex(log), hex(node))
}

/// The bytes of a frame.
pub fn hex(bytes: &[u8]) -> String {
    if bytes.is_empty() {
        return "nothing".to_owned();
    }
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}

/// What a message says, by name.
fn fields(message: &Message) -> Vec<(String, String)> {
    let named = |fields: &[(&str, String)]| {
        fields.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect()
    };
    match *message {
        Message::State { component, tick, x, .. } => {
            let name = match component.get() {
                0 => "x".to_owned(),
                component => format!("x of component {component}"),
            };
            vec![("tick".to_owned(), tick.value().to_string()), (name, number(x))]
        }
        Message::Edge { neighbour, weight, .. } => {
            named(&[("neighbour", neighbour.get().to_string()), ("weight", number(weight))])
        }
        Message::Fault { code, severity, arg, tick, .. } => named(&[
            ("code", code.0.to_string()),
            ("severity", format!("{severity:?}")),
            ("arg", arg.to_string()),
            ("tick", tick.value().to_string()),
        ]),
        Message::Sync { previous_tick, phase_us, .. } => named(&[
            ("previous tick", previous_tick.value().to_string()),
            ("phase, us", phase_us.to_string()),
        ]),
        Message::Ctrl { command, arg, at_tick, .. } => named(&[
            ("command", format!("{command:?}")),
            ("arg", arg.to_string()),
            ("tick", at_tick.to_string()),
        ]),
    }
}

/// With its bits: two numbers may look the same.
fn number(x: f32) -> String {
    format!("{x} ({:08X})", x.to_bits())
}
