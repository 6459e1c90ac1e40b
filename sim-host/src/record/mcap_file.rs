//! `run.mcap`: the rows of a run and what happened in it, for Foxglove, PlotJuggler and whatever else reads MCAP
//! (<https://mcap.dev/spec>), written as they come.
//!
//! Topics are `/node/1`, `/node/2` and so on, `/network`, and `/events`. Messages are JSON with a JSON schema, which
//! those programs read without a plugin; numbers are as in `trajectory.csv`. Times are the run's, from 0 on.

use super::atomic::{AtomicFile, RecordError};
use super::trajectory::{Row, Shape};
use crate::number::Precision;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Attachment, McapError, McapResult, WriteOptions, Writer};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::Path;

/// The file's name.
pub const RECORDING: &str = "run.mcap";

/// Bytes of a chunk. Of a run that is killed all whole chunks can be recovered.
const CHUNK: u64 = 256 * 1024;

/// How grave an event is, as `foxglove.Log` counts it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gravity {
    /// It is as it should be, or the scenario asked for it.
    Info = 2,
    /// A node warns.
    Warning = 3,
    /// A node has stopped by itself.
    Error = 4,
}

/// The file of a run, which gets its name at its end.
pub struct Recording {
    writer: Writer<NoSeek<AtomicFile>>,
    path: std::path::PathBuf,
    shape: Shape,
    precision: Precision,
    /// By node.
    nodes: Vec<u16>,
    network: u16,
    events: u16,
    /// Messages of each of the first two kinds so far.
    rows: u32,
    told: u32,
    text: Vec<u8>,
}

impl Recording {
    /// Opens the file in `folder`. `precision` is that of the nodes' numbers, `unit` that of their states.
    ///
    /// # Errors
    /// [`RecordError`], naming the file and the reason.
    pub fn create(
        folder: &Path,
        shape: Shape,
        precision: Precision,
        unit: Option<&str>,
    ) -> Result<Self, RecordError> {
        let path = folder.join(RECORDING);
        let file = AtomicFile::create(&path)?;
        let open = || -> McapResult<Self> {
            let options = WriteOptions::new().compression(None).chunk_size(Some(CHUNK)).disable_seeking(true);
            let library = concat!("funnelnet ", env!("CARGO_PKG_VERSION"));
            let mut writer = options.library(library).create(NoSeek::new(file))?;
            let mut schema = |name: &str, content: &Value| {
                writer.add_schema(name, "jsonschema", content.to_string().as_bytes())
            };
            let of_node = schema("funnelnet.Node", &numbers(shape, unit, &NODE))?;
            let of_network = schema("funnelnet.Network", &numbers(shape, unit, &NETWORK))?;
            let of_events = schema("foxglove.Log", &log_schema())?;
            let mut channel =
                |schema: u16, topic: &str| writer.add_channel(schema, topic, "json", &BTreeMap::new());
            let nodes = (1..=shape.nodes).map(|id| channel(of_node, &format!("/node/{id}")));
            let nodes = nodes.collect::<McapResult<Vec<_>>>()?;
            let network = channel(of_network, "/network")?;
            let events = channel(of_events, "/events")?;
            let (rows, told, text) = (0, 0, Vec::new());
            let path = path.clone();
            Ok(Self { writer, path, shape, precision, nodes, network, events, rows, told, text })
        };
        open().map_err(|error| failed(&path, error))
    }

    /// Appends a row.
    ///
    /// # Errors
    /// [`RecordError`], for example on a full disk.
    pub fn write(&mut self, row: &Row) -> Result<(), RecordError> {
        self.row(row).map_err(|error| failed(&self.path, error))
    }

    fn row(&mut self, row: &Row) -> McapResult<()> {
        let at = nanoseconds(row.t);
        for (node, &channel) in self.nodes.iter().enumerate() {
            let of_judge = |name| {
                if matches!(name, "true_nu" | "asked_psi") { Precision::Double } else { self.precision }
            };
            let tables = [
                ("x", &row.x),
                ("nu", &row.nu),
                ("psi", &row.psi),
                ("u", &row.u),
                ("true_nu", &row.true_nu),
                ("asked_psi", &row.asked_psi),
            ];
            let fields =
                tables.map(|(name, table)| (name, part(table, node, self.shape.components), of_judge(name)));
            object(&mut self.text, &fields, self.shape.components)?;
            let header =
                MessageHeader { channel_id: channel, sequence: self.rows, log_time: at, publish_time: at };
            self.writer.write_to_known_channel(&header, &self.text)?;
        }
        let fields = [("xi", &row.xi), ("blended", &row.blended)];
        let fields =
            fields.map(|(name, table)| (name, part(table, 0, self.shape.components), Precision::Double));
        object(&mut self.text, &fields, self.shape.components)?;
        let header =
            MessageHeader { channel_id: self.network, sequence: self.rows, log_time: at, publish_time: at };
        self.writer.write_to_known_channel(&header, &self.text)?;
        self.rows = self.rows.wrapping_add(1);
        Ok(())
    }

    /// Appends something that happened at `at`, ns of the run, to `who`.
    ///
    /// # Errors
    /// [`RecordError`], for example on a full disk.
    pub fn tell(&mut self, at: u64, gravity: Gravity, who: &str, what: &str) -> Result<(), RecordError> {
        let time = json!({ "sec": at / 1_000_000_000, "nsec": at % 1_000_000_000 });
        let message = json!({
            "timestamp": time, "level": gravity as u8, "name": who, "message": what, "file": "", "line": 0,
        });
        let header =
            MessageHeader { channel_id: self.events, sequence: self.told, log_time: at, publish_time: at };
        let written = self.writer.write_to_known_channel(&header, message.to_string().as_bytes());
        self.told = self.told.wrapping_add(1);
        written.map_err(|error| failed(&self.path, error))
    }

    /// The whole file with the scenario as it was run, under its temporary name.
    ///
    /// # Errors
    /// [`RecordError`], for example on a full disk.
    pub fn into_file(mut self, scenario: &str) -> Result<AtomicFile, RecordError> {
        let entries = [("version", env!("CARGO_PKG_VERSION"))];
        let metadata = entries.map(|(key, value)| (key.to_owned(), value.to_owned())).into_iter().collect();
        let attachment = Attachment {
            log_time: 0,
            create_time: 0,
            name: "scenario.toml".to_owned(),
            media_type: "application/toml".to_owned(),
            data: scenario.as_bytes().into(),
        };
        let end = || {
            self.writer.write_metadata(&Metadata { name: "funnelnet".to_owned(), metadata })?;
            self.writer.attach(&attachment)?;
            self.writer.finish()
        };
        end().map_err(|error| failed(&self.path, error))?;
        Ok(self.writer.into_inner().into_inner())
    }
}

fn failed(path: &Path, error: McapError) -> RecordError {
    let reason = match error {
        McapError::Io(reason) => reason,
        other => io::Error::other(other),
    };
    RecordError { path: path.to_owned(), reason }
}

/// Seconds of a row as nanoseconds; rows are at whole ones.
fn nanoseconds(t: f64) -> u64 {
    (t * 1e9).round() as u64
}

/// What a table has of a node; nothing where the table is empty.
fn part(table: &[f64], node: usize, components: usize) -> &[f64] {
    table.get(node * components..(node + 1) * components).unwrap_or_default()
}

/// Writes known values as a JSON object: numbers, or arrays of vector states. One that is not finite, or of which a
/// component is not, is left out, since JSON has no such number.
fn object(text: &mut Vec<u8>, fields: &[(&str, &[f64], Precision)], components: usize) -> io::Result<()> {
    text.clear();
    text.push(b'{');
    for (name, values, precision) in fields {
        if values.is_empty() || !values.iter().all(|value| value.is_finite()) {
            continue;
        }
        let comma = if text.len() > 1 { "," } else { "" };
        write!(text, "{comma}\"{name}\":")?;
        if components > 1 {
            text.push(b'[');
        }
        for (n, &value) in values.iter().enumerate() {
            if n > 0 {
                text.push(b',');
            }
            precision.write(text, value)?;
        }
        if components > 1 {
            text.push(b']');
        }
    }
    text.push(b'}');
    Ok(())
}

/// A field, what it is, and what it is measured in besides the unit of a state.
type Field = (&'static str, &'static str, &'static str);

const NODE: [Field; 6] = [
    ("x", "state", ""),
    ("nu", "diffusive term", ""),
    ("psi", "performance funnel", ""),
    ("u", "coupling input", "/s"),
    ("true_nu", "diffusive term of the states of all nodes at this time", ""),
    ("asked_psi", "funnel by which it is judged", ""),
];
const NETWORK: [Field; 2] = [("xi", "emergent trajectory", ""), ("blended", "blended dynamics", "")];

fn numbers(shape: Shape, unit: Option<&str>, fields: &[Field]) -> Value {
    let property = |&(name, what, per): &Field| {
        let description = unit.map_or(what.to_owned(), |unit| format!("{what}, in {unit}{per}"));
        let number = json!({ "type": "number" });
        let value = match shape.components {
            1 => json!({ "type": "number", "description": description }),
            _ => json!({ "type": "array", "items": number, "description": description }),
        };
        (name.to_owned(), value)
    };
    let properties: serde_json::Map<_, _> = fields.iter().map(property).collect();
    json!({ "type": "object", "properties": properties })
}

/// What Foxglove expects of its log panel (<https://docs.foxglove.dev/docs/sdk/schemas/log>).
fn log_schema() -> Value {
    let whole = json!({ "type": "integer" });
    let text = json!({ "type": "string" });
    json!({
        "title": "foxglove.Log",
        "type": "object",
        "properties": {
            "timestamp": { "type": "object", "title": "time", "properties": { "sec": whole, "nsec": whole } },
            "level": whole,
            "message": text,
            "name": text,
            "file": text,
            "line": whole,
        },
    })
}
