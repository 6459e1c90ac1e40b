//! Lines that lead from node to node, of which this program carries nothing.

use super::clock::Clock;
use super::file::{BenchNode, Where};
use crate::emulator::LINES;
use crate::scenario::reader::{Log, Section, integer};
use crate::scenario::tree::{Item, Value};
use crate::scenario::{Diagnostic, LARGEST_RUN, Problem, Scenario};
use std::time::Duration;

/// How long states have for their way, ns: where the file does not say, and the limits of what it may say.
/// Eight components take 1 ms at 1 Mbit/s.
const SETTLE_NS: u64 = 2_000_000;
const SETTLE_LIMITS_NS: (u64, u64) = (1, 1_000_000_000);

/// Two nodes that are wired to each other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wire {
    /// Their ids, the lower one first.
    pub between: (u8, u8),
    /// Where the file says so.
    place: String,
}

impl Wire {
    /// Whether it leads from one of these nodes to the other.
    pub fn joins(&self, one: u8, other: u8) -> bool {
        self.between == (one.min(other), one.max(other))
    }

    fn ends(&self) -> [u8; 2] {
        [self.between.0, self.between.1]
    }
}

/// The wires of a file, and how long the host leaves their states.
pub(super) fn read(file: &mut Section<'_>, nodes: &[BenchNode], clock: Clock) -> (Vec<Wire>, Duration) {
    let (items, log) = (file.array("wire"), file.log());
    let wires: Vec<_> = items.iter().filter_map(|item| read_wire(item, log)).collect();
    for (n, (key, wire)) in wires.iter().enumerate() {
        let others: Vec<_> = wires.iter().take(n).map(|(_, other)| other).collect();
        if let Some(allowed) = refusal(wire, &others, nodes) {
            log.report(key.diagnostic(Problem::Value, allowed));
        }
    }
    let needless = match clock {
        Clock::Own => Some("must not be there with clock = \"own\": nobody waits before a tick"),
        Clock::Host => items.is_empty().then_some("must come with [[wire]]: there is nothing to wait for"),
    };
    let settle_ns = match (file.take("settle"), needless) {
        (Some(key), Some(why)) => {
            log.report(key.diagnostic(Problem::Value, why));
            0
        }
        (Some(_), None) => file.duration_within("settle", SETTLE_LIMITS_NS, "before each SYNC"),
        (None, _) if clock == Clock::Own => 0,
        (None, _) => SETTLE_NS,
    };
    (wires.into_iter().map(|(_, wire)| wire).collect(), Duration::from_nanos(settle_ns))
}

/// A wire, and the key that says between whom.
fn read_wire<'a>(item: &'a Item, log: &'a Log) -> Option<(&'a Item, Wire)> {
    let mut section = Section::open(item, log)?;
    let key = section.need("between", "must be the ids of two nodes, such as [1, 2]");
    section.finish();
    let key = key?;
    match read_ids(key) {
        Ok((one, other)) => {
            let place = format!("{}:{}:{}", key.place.file, key.place.line, key.place.column);
            Some((key, Wire { between: (one.min(other), one.max(other)), place }))
        }
        Err(diagnostic) => {
            log.report(diagnostic);
            None
        }
    }
}

fn read_ids(key: &Item) -> Result<(u8, u8), Box<Diagnostic>> {
    let wrong = || key.diagnostic(Problem::Value, "must be the ids of two nodes, such as [1, 2]");
    let Value::Array(items) = &key.value else { return Err(wrong()) };
    let [one, other] = items.as_slice() else { return Err(wrong()) };
    let id = |item| integer(item, (1, LARGEST_RUN as u64), "the node's id in the scenario");
    // Within 1 to LARGEST_RUN.
    let ids = [id(one)?, id(other)?].map(|id| u8::try_from(id).unwrap_or(0));
    if ids[0] == ids[1] {
        Err(key.diagnostic(Problem::Value, "must be two different nodes"))
    } else {
        Ok(ids.into())
    }
}

/// Why a wire cannot be there.
fn refusal(wire: &Wire, before: &[&Wire], nodes: &[BenchNode]) -> Option<String> {
    if before.iter().any(|other| other.between == wire.between) {
        return Some("another [[wire]] has it already".to_owned());
    }
    let mut emulated = 0;
    for id in wire.ends() {
        let Some(node) = nodes.iter().find(|node| node.id == id) else {
            return Some(format!("must be nodes of the file; there is no [[node]] with id {id}"));
        };
        if node.at == Where::Host || node.can.is_some() {
            let why = if node.can.is_some() { "has its states on CAN" } else { "is a process with one line" };
            return Some(format!("must be boards with lines to neighbours, or emulators; node {id} {why}"));
        }
        let wired = before.iter().filter(|other| other.ends().contains(&id)).count();
        if node.at == Where::Emulator && wired >= LINES {
            return Some(format!(
                "must leave node {id} with {LINES} wires; the emulated board has no more lines"
            ));
        }
        emulated += usize::from(node.at == Where::Emulator);
    }
    (emulated == 1).then(|| "must be two boards, or two emulators".to_owned())
}

/// Checks that the wires are edges of the scenario's graph; those of nodes that it does not have are left
/// alone.
///
/// # Errors
/// The first wire that is none, in one sentence.
pub(super) fn fit(wires: &[Wire], scenario: &Scenario) -> Result<(), String> {
    let index = |id: u8| scenario.nodes.iter().position(|node| node.id == u16::from(id));
    for Wire { between: (one, other), place } in wires {
        let (Some(a), Some(b)) = (index(*one), index(*other)) else { continue };
        if !scenario.graph.edges.iter().any(|edge| [(a, b), (b, a)].contains(&(edge.a, edge.b))) {
            return Err(format!(
                "{place}: wire.between = [{one}, {other}]: must be an edge of the scenario's graph; {} has none between these nodes",
                scenario.path.display()
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::BenchFile;
    use crate::scenario::Override;
    use std::path::Path;

    fn parse(head: &str, wires: &str) -> Result<BenchFile, String> {
        let nodes: String = (1..=6).map(|id| format!("[[node]]\nid = {id}\nemulator = true\n")).collect();
        let boards = "[[node]]\nid = 7\nserial = \"/dev/a\"\n[[node]]\nid = 8\nserial = \"/dev/b\"\n";
        let more = "[[node]]\nid = 9\nhost = true\n[[node]]\nid = 10\nserial = \"/dev/c\"\ncan = true\n";
        let text = format!("version = 1\ncan = \"can0\"\n{head}\n{wires}\n{nodes}{boards}{more}");
        BenchFile::parse(&text, Path::new("bench.toml")).map_err(|errors| errors.to_string())
    }

    fn wire(between: &str) -> String {
        format!("[[wire]]\nbetween = {between}\n")
    }

    #[test]
    fn wires_and_the_time_that_their_states_have_are_read() {
        let file = parse("", "").unwrap();
        assert_eq!((file.wires.as_slice(), file.settle), (&[][..], Duration::from_millis(2)));
        let file = parse("settle = \"15ms\"", &(wire("[2, 1]") + &wire("[7, 8]"))).unwrap();
        assert_eq!(file.wires.iter().map(|wire| wire.between).collect::<Vec<_>>(), [(1, 2), (7, 8)]);
        assert_eq!(file.settle, Duration::from_millis(15));
        assert!(file.wires[0].joins(1, 2) && file.wires[0].joins(2, 1) && !file.wires[0].joins(1, 3));
    }

    #[test]
    fn what_cannot_be_wired_is_refused_at_its_line() {
        let five: String = (2..=6).map(|id| wire(&format!("[1, {id}]"))).collect();
        let cases = [
            ("", wire("[1]"), "bench.toml:5:11: wire[0].between = [1]: must be the ids of two nodes"),
            ("", wire("3"), "wire[0].between = 3: must be the ids of two nodes"),
            ("", wire("[1, 200]"), "= 200: must be an integer from 1 to 127"),
            ("", wire("[3, 3]"), "must be two different nodes"),
            ("", wire("[1, 20]"), "there is no [[node]] with id 20"),
            (
                "",
                wire("[1, 2]") + &wire("[2, 1]"),
                "bench.toml:7:11: wire[1].between = [2, 1]: another [[wire]] has it",
            ),
            ("", wire("[1, 7]"), "must be two boards, or two emulators"),
            ("", wire("[7, 9]"), "node 9 is a process with one line"),
            ("", wire("[8, 10]"), "node 10 has its states on CAN"),
            ("", five, "must leave node 1 with 4 wires"),
            ("", "[[wire]]\n".to_owned(), "missing key 'between'"),
            ("", wire("[1, 2]") + "betwen = [1, 3]\n", "did you mean 'between'?"),
            (
                "settle = \"2s\"",
                wire("[1, 2]"),
                "bench.toml:3:10: settle = \"2s\": must be from 1ns to 1s, before each SYNC",
            ),
            ("settle = \"2ms\"", String::new(), "settle = \"2ms\": must come with [[wire]]"),
        ];
        for (head, wires, expected) in cases {
            let error = parse(head, &wires).unwrap_err();
            assert!(error.contains(expected), "no '{expected}' in: {error}");
        }
        let own = "version = 1\nclock = \"own\"\nsettle = \"2ms\"\n[[wire]]\nbetween = [1, 2]\n[[node]]\nid = 1\nemulator = true\n[[node]]\nid = 2\nemulator = true\n";
        let error = BenchFile::parse(own, Path::new("bench.toml")).unwrap_err().to_string();
        assert!(error.contains("bench.toml:3:10: settle = \"2ms\": must not be there with clock"), "{error}");
        let own =
            BenchFile::parse(&own.replacen("settle = \"2ms\"\n", "", 1), Path::new("bench.toml")).unwrap();
        assert_eq!((own.wires.len(), own.settle), (1, Duration::ZERO));
    }

    #[test]
    fn a_wire_is_an_edge_of_the_graph() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
        let ring = Scenario::load(&path, &[]).unwrap();
        let file = |wires: &str| parse("", wires).unwrap();
        assert_eq!(file(&(wire("[1, 5]") + &wire("[2, 3]"))).covers(&ring), Ok(()));
        // Node 6 is not of the scenario.
        assert_eq!(file(&wire("[1, 6]")).covers(&ring), Ok(()));
        let error = file(&wire("[3, 1]")).covers(&ring).unwrap_err();
        let expected = "bench.toml:5:11: wire.between = [1, 3]: must be an edge of the scenario's graph";
        assert!(error.starts_with(expected), "{error}");
        let complete = Scenario::load(&path, &[Override::parse("graph.kind=complete").unwrap()]).unwrap();
        assert_eq!(file(&wire("[3, 1]")).covers(&complete), Ok(()));
    }
}
