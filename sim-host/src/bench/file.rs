//! `bench.toml`: which node is where (docs/book/src/bench.md).

use super::clock::{self, CLOCKS, Clock};
use super::wires::{self, Wire};
use crate::hub::{OnLoss, Patience};
use crate::scenario::reader::{Choice, Log, Range, Section, ready};
use crate::scenario::tree::{self, Item, Value};
use crate::scenario::{Diagnostic, Diagnostics, LARGEST_RUN, Problem, Scenario, read_text};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Bit rate where the file says none, bit/s.
pub const DEFAULT_BAUD: u32 = 115_200;
/// Bit rates that serial adapters have, bit/s.
const BAUDS: (u64, u64) = (1_200, 12_000_000);
/// How long a node may take for an answer, ns: where the file does not say, and the limits of what it may
/// say.
const ANSWER_NS: u64 = 2_000_000_000;
const ANSWER_LIMITS_NS: (u64, u64) = (100_000_000, 60_000_000_000);
/// How long a node may take to swap its program and to start, and how many answers more: 7 s by the typical times
/// of a flash chip, 52 s by its longest.
const SWAP: Duration = Duration::from_secs(60);
const SWAP_ANSWERS: u32 = 10;
/// How long a node may take to boot and say who it is: boards restart when their port is opened.
const BOOT: Duration = Duration::from_secs(10);

/// How wrong the clock of a process may be.
const DRIFT: Range = Range::between(-1000.0, 1000.0, "ppm").on_host();

const ON_LOSS: [Choice<OnLoss>; 2] = [ready("stop", OnLoss::Stop), ready("go-on", OnLoss::GoOn)];

/// What a node is reached by.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Where {
    /// A serial port by its path.
    Serial(String),
    /// A serial port by the serial number of its USB adapter.
    UsbSerial(String),
    /// An emulator of its own.
    Emulator,
    /// A process of its own on this computer.
    Host,
}

/// One node of a bench.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BenchNode {
    /// Its id in the scenario.
    pub id: u8,
    /// What it is reached by.
    pub at: Where,
    /// The unique number that its chip must have.
    pub uid: Option<u64>,
    /// The CAN interface of the file that its states travel on; then only the service plane is on its line.
    pub can: Option<String>,
    /// File that a process keeps its configuration in.
    pub storage: Option<PathBuf>,
    /// How much too fast the clock of a process is, parts in a billion.
    pub drift_ppb: i64,
}

/// A whole `bench.toml`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BenchFile {
    /// The file as the user named it.
    pub path: PathBuf,
    /// Bit rate of every serial port, bit/s.
    pub baud: u32,
    /// How long a node may take for an answer or for a tick.
    pub answer: Duration,
    /// What happens when a node is lost during a run.
    pub on_loss: OnLoss,
    /// Whose clock the nodes tick by.
    pub clock: Clock,
    /// The CAN interfaces of this computer, for the nodes that are on CAN.
    pub can: Vec<String>,
    /// Frames on them are those of CAN FD.
    pub can_fd: bool,
    /// The nodes, in the order of the file.
    pub nodes: Vec<BenchNode>,
    /// Nodes that are wired to each other.
    pub wires: Vec<Wire>,
    /// Time before each SYNC in which their states get there.
    pub settle: Duration,
}

impl BenchFile {
    /// Reads and checks a file.
    ///
    /// # Errors
    /// Everything that was found to be wrong, with file, line and column.
    pub fn load(path: &Path) -> Result<Self, Diagnostics> {
        Self::parse(&read_text(path)?, path)
    }

    /// The same for a text that is already in memory; `path` is only named in messages.
    ///
    /// # Errors
    /// Everything that was found to be wrong, with file, line and column.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Diagnostics> {
        let root = tree::parse_file(text, &path.display().to_string())?;
        let log = Log::default();
        let whole =
            || Diagnostics::from(root.place.diagnostic(Problem::Whole, "", "cannot be made sense of"));
        let mut file = Section::open(&root, &log).ok_or_else(whole)?;
        file.integer("version", None, (1, 1), "the version of this format; write version = 1");
        let baud = file.integer("baud", Some(DEFAULT_BAUD.into()), BAUDS, "bit/s");
        let answer_ns = match file.take("answer_within") {
            Some(_) => file.duration_within("answer_within", ANSWER_LIMITS_NS, "for one answer"),
            None => ANSWER_NS,
        };
        let on_loss = file.choice("on_loss", &ON_LOSS, Some(OnLoss::Stop)).unwrap_or_default();
        let clock = file.choice("clock", &CLOCKS, Some(Clock::Host)).unwrap_or_default();
        let can = file.value("can", Vec::new(), read_interfaces);
        let can_fd = file.value("can_fd", false, |item| must_be_true(item).map(|()| true));
        if let Some(key) = root.get("can_fd").filter(|_| can_fd && root.get("can").is_none()) {
            let allowed = "must come with can, the name of an interface such as \"can0\"";
            log.report(key.diagnostic(Problem::Value, allowed));
        }
        let items = file.array("node");
        if items.is_empty() {
            file.missing(
                "node",
                "must be at least one [[node]] with id and serial, usb_serial, emulator or host",
            );
        }
        let nodes: Vec<_> =
            items.iter().filter_map(|item| Some((item, read_node(item, (&can, clock), &log)?))).collect();
        distinct(&nodes, &log);
        let nodes: Vec<_> = nodes.into_iter().map(|(_, node)| node).collect();
        let (wires, settle) = wires::read(&mut file, &nodes, clock);
        file.finish();
        if let Some(key) = root.get("clock").filter(|_| clock == Clock::Own) {
            clock::check(key, on_loss, &log);
        }
        log.checkpoint()?;
        Ok(Self {
            path: path.to_owned(),
            // Within `BAUDS`.
            baud: u32::try_from(baud).unwrap_or(DEFAULT_BAUD),
            answer: Duration::from_nanos(answer_ns),
            on_loss,
            clock,
            can,
            can_fd,
            nodes,
            wires,
            settle,
        })
    }

    /// The entry of a node.
    pub fn node(&self, id: u8) -> Option<&BenchNode> {
        self.nodes.iter().find(|node| node.id == id)
    }

    /// The CAN interfaces that one of `ids` is on, in the order of the file.
    pub fn interfaces(&self, ids: &[u8]) -> Vec<&String> {
        let nodes: Vec<_> = ids.iter().filter_map(|&id| self.node(id)).collect();
        let is_used = |interface: &&String| nodes.iter().any(|node| node.can.as_ref() == Some(interface));
        self.can.iter().filter(is_used).collect()
    }

    /// Whether these two nodes are wired to each other.
    pub fn is_wired(&self, one: u8, other: u8) -> bool {
        self.wires.iter().any(|wire| wire.joins(one, other))
    }

    /// How long the hub waits for these nodes.
    pub fn patience(&self) -> Patience {
        Patience { boot: BOOT, answer: self.answer }
    }

    /// How long a node may take to swap its program and to start.
    pub fn swap_within(&self) -> Duration {
        SWAP + self.answer * SWAP_ANSWERS
    }

    /// How long `nodes` nodes go on without SYNC where the scenario does not say, ns: twice as long as this
    /// program waits for one of them, or for as many as may be lost at once.
    pub fn holdover_ns(&self, nodes: usize) -> u64 {
        let waits = match self.on_loss {
            OnLoss::Stop => 1,
            OnLoss::GoOn => nodes.max(1) as u128,
        };
        u64::try_from(self.answer.as_nanos() * (waits + 1)).unwrap_or(u64::MAX)
    }

    /// Checks that every node of `scenario` has an entry, and that its wires are edges of its graph. Entries
    /// of other nodes are allowed: one file per bench will do.
    ///
    /// # Errors
    /// The ids that are missing, or a wire that is no edge, in one sentence.
    pub fn covers(&self, scenario: &Scenario) -> Result<(), String> {
        let here = |id: u16| self.nodes.iter().any(|node| u16::from(node.id) == id);
        let missing: Vec<_> = scenario.nodes.iter().map(|node| node.id).filter(|&id| !here(id)).collect();
        if missing.is_empty() {
            return wires::fit(&self.wires, scenario);
        }
        let ids: Vec<_> = missing.iter().map(u16::to_string).collect();
        Err(format!(
            "{}: no [[node]] with id {}, which {} has; every node of the scenario needs one",
            self.path.display(),
            ids.join(", "),
            scenario.path.display()
        ))
    }
}

fn read_node(item: &Item, (interfaces, clock): (&[String], Clock), log: &Log) -> Option<BenchNode> {
    let mut section = Section::open(item, log)?;
    let id = section.integer("id", None, (1, LARGEST_RUN as u64), "the node's id in the scenario");
    let serial = section.text("serial").map(Where::Serial);
    let usb_serial = section.text("usb_serial").map(Where::UsbSerial);
    let emulator = section.value("emulator", None, |item| must_be_true(item).map(|()| Some(Where::Emulator)));
    let host = section.value("host", None, |item| must_be_true(item).map(|()| Some(Where::Host)));
    let can = section.value("can", None, |item| which_interface(item, interfaces).map(Some));
    let storage = section.text("storage").map(PathBuf::from);
    if let (Some(item), None) = (item.get("storage"), host.as_ref()) {
        let allowed = "must come with host = true: boards have a storage of their own";
        log.report(item.diagnostic(Problem::Value, allowed));
    }
    let drift = section.optional_number("drift_ppm", DRIFT);
    if let (Some(item), None) = (item.get("drift_ppm"), host.as_ref()) {
        let allowed = "must come with host = true: boards have a crystal of their own";
        log.report(item.diagnostic(Problem::Value, allowed));
    }
    if let (Some(item), Clock::Host) = (item.get("drift_ppm"), clock) {
        let allowed =
            "must come with clock = \"own\": nodes that tick by this program's clock look at no other";
        log.report(item.diagnostic(Problem::Value, allowed));
    }
    let uid = section.value("uid", None, |item| read_uid(item).map(Some));
    if let (Some(uid), true) = (item.get("uid"), emulator.is_some()) {
        log.report(
            uid.diagnostic(Problem::Value, "must not be there with emulator = true: it has no number"),
        );
    }
    if let (Some(item), true) = (item.get("can"), can.is_some() && emulator.is_some()) {
        let allowed = "must not be there with emulator = true: the emulated board has no CAN controller";
        log.report(item.diagnostic(Problem::Value, allowed));
    }
    let mut places = [serial, usb_serial, emulator, host].into_iter().flatten();
    let (at, another) = (places.next(), places.next());
    let wrong =
        |item: &Item| ["serial", "usb_serial", "emulator", "host"].iter().any(|key| item.get(key).is_some());
    match (&at, another) {
        // What is there and wrong has been reported.
        (None, _) if !wrong(item) => section.missing(
            "serial",
            "must be the port's path, such as \"/dev/ttyACM0\"; or usb_serial, its USB adapter's serial number; or emulator = true; or host = true",
        ),
        (Some(_), Some(_)) => {
            let allowed = "must have one of serial, usb_serial, emulator and host, not several";
            log.report(item.place.diagnostic(Problem::Whole, &item.path, allowed));
        }
        _ => {}
    }
    section.finish();
    // Within 1 to LARGEST_RUN.
    let drift_ppb = drift.map_or(0, |ppm| (ppm * 1000.0).round() as i64);
    Some(BenchNode { id: u8::try_from(id).unwrap_or(0), at: at?, uid, can, storage, drift_ppb })
}

/// The file's interfaces: a name, or several in an array.
fn read_interfaces(item: &Item) -> Result<Vec<String>, Box<Diagnostic>> {
    let allowed = "must be the name of a CAN interface, such as \"can0\", or an array of several, each once";
    let wrong = |item: &Item| item.diagnostic(Problem::Value, allowed);
    let items = match &item.value {
        Value::Array(items) if !items.is_empty() => items.as_slice(),
        _ => std::slice::from_ref(item),
    };
    let mut names: Vec<String> = Vec::new();
    for item in items {
        match item.text() {
            Some(name) if !name.is_empty() && !names.iter().any(|other| other == name) => {
                names.push(name.to_owned());
            }
            _ => return Err(wrong(item)),
        }
    }
    Ok(names)
}

/// The interface that a node is on: one of the file's by its name, or the file's only one.
fn which_interface(item: &Item, interfaces: &[String]) -> Result<String, Box<Diagnostic>> {
    let named = interfaces.iter().find(|name| item.text() == Some(name));
    let only = interfaces.first().filter(|_| item.raw == "true" && interfaces.len() == 1);
    if let Some(name) = named.or(only) {
        return Ok(name.clone());
    }
    let names = || interfaces.iter().map(|name| format!("{name:?}")).collect::<Vec<_>>().join(", ");
    let allowed = match interfaces {
        [] => "must come with the file's can, the name of an interface such as \"can0\"".to_owned(),
        [name] => format!("must be true or {name:?}, or left out"),
        _ => format!("must be one of the file's interfaces {}, or left out", names()),
    };
    Err(item.diagnostic(Problem::Value, allowed))
}

fn must_be_true(item: &Item) -> Result<(), Box<Diagnostic>> {
    if item.raw == "true" {
        Ok(())
    } else {
        Err(item.diagnostic(Problem::Value, "must be true, or left out"))
    }
}

fn read_uid(item: &Item) -> Result<u64, Box<Diagnostic>> {
    let hex =
        |text: &str| !text.is_empty() && text.len() <= 16 && text.bytes().all(|b| b.is_ascii_hexdigit());
    let number = item.text().filter(|text| hex(text)).and_then(|text| u64::from_str_radix(text, 16).ok());
    number.ok_or_else(|| {
        let allowed = "must be the chip's unique number in a string of up to 16 hexadecimal digits, as `sim-host bench --list` shows it";
        item.diagnostic(Problem::Value, allowed)
    })
}

/// Two entries must not share an id, a port or a chip.
fn distinct(nodes: &[(&Item, BenchNode)], log: &Log) {
    for (n, (item, node)) in nodes.iter().enumerate() {
        for (_, other) in nodes.iter().take(n) {
            let same_place = node.at == other.at && !matches!(node.at, Where::Emulator | Where::Host);
            let key = match () {
                () if node.id == other.id => "id",
                () if same_place && matches!(node.at, Where::Serial(_)) => "serial",
                () if same_place => "usb_serial",
                () if node.uid.is_some() && node.uid == other.uid => "uid",
                () => continue,
            };
            let at = item.get(key).unwrap_or(item);
            log.report(at.diagnostic(Problem::Value, format!("node {} has it already", other.id)));
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn errors(text: &str) -> String {
        BenchFile::parse(text, Path::new("bench.toml")).unwrap_err().to_string()
    }

    const FILE: &str = "version = 1\n\n[[node]]\nid = 1\nserial = \"/dev/ttyACM0\"\nuid = \"0123456789abcdef\"\n\n[[node]]\nid = 2\n\
                        usb_serial = \"066AFF\"\n\n[[node]]\nid = 3\nemulator = true\n";

    #[test]
    fn every_way_to_reach_a_node_is_read() {
        let file = BenchFile::parse(FILE, Path::new("bench.toml")).unwrap();
        assert_eq!((file.baud, file.answer), (115_200, Duration::from_secs(2)));
        let node = |id, at, uid| BenchNode { id, at, uid, can: None, storage: None, drift_ppb: 0 };
        let expected = [
            node(1, Where::Serial("/dev/ttyACM0".into()), Some(0x0123_4567_89AB_CDEF)),
            node(2, Where::UsbSerial("066AFF".into()), None),
            node(3, Where::Emulator, None),
        ];
        assert_eq!(file.nodes, expected);
        assert_eq!(file.on_loss, OnLoss::Stop);
        let more = "version = 1\nbaud = 1000000\nanswer_within = \"500ms\"\non_loss = \"go-on\"";
        let fast = FILE.replacen("version = 1", more, 1);
        let fast = BenchFile::parse(&fast, Path::new("bench.toml")).unwrap();
        assert_eq!((fast.baud, fast.answer), (1_000_000, Duration::from_millis(500)));
        assert_eq!(fast.on_loss, OnLoss::GoOn);
        let can = FILE.replacen("version = 1", "version = 1\ncan = \"can0\"", 1);
        let can =
            can.replace("emulator = true", "host = true\ncan = true").replace("AFF\"", "AFF\"\ncan = true");
        let can = BenchFile::parse(&can, Path::new("bench.toml")).unwrap();
        assert_eq!((can.can.as_slice(), can.can_fd), (&["can0".to_owned()][..], false));
        let on = |file: &BenchFile| file.nodes.iter().map(|node| node.can.clone()).collect::<Vec<_>>();
        assert_eq!(on(&can), [None, Some("can0".into()), Some("can0".into())]);
        assert_eq!(can.nodes[2].at, Where::Host);
    }

    #[test]
    fn nodes_are_on_one_of_several_interfaces() {
        let two = FILE.replacen("version = 1", "version = 1\ncan = [\"can0\", \"can1\"]\ncan_fd = true", 1);
        let two = two.replace("emulator = true", "host = true\ncan = \"can1\"");
        let file = BenchFile::parse(&two, Path::new("bench.toml")).unwrap();
        assert_eq!((file.can.len(), file.can_fd), (2, true));
        assert_eq!(file.nodes[2].can.as_deref(), Some("can1"));
        // Only those that are needed.
        assert_eq!(
            (file.interfaces(&[1, 2, 3]), file.interfaces(&[1, 2])),
            (vec![&"can1".to_owned()], vec![])
        );
        let cases = [
            (("can = \"can1\"", "can = true"), "must be one of the file's interfaces \"can0\", \"can1\""),
            (("can = \"can1\"", "can = \"can2\""), "node.3.can = \"can2\": must be one of the file's"),
            (("\"can0\", \"can1\"]", "\"can1\", \"can1\"]"), "or an array of several, each once"),
            (("[\"can0\", \"can1\"]", "[]"), "must be the name of a CAN interface"),
            (("[\"can0\", \"can1\"]", "7"), "can = 7: must be the name of a CAN interface"),
            (("[\"can0\", \"can1\"]", "\"can0\""), "node.3.can = \"can1\": must be true or \"can0\""),
            (("can = [\"can0\", \"can1\"]\n", ""), "can_fd = true: must come with can"),
        ];
        for ((from, to), expected) in cases {
            assert!(two.contains(from), "{from}");
            let text = errors(&two.replacen(from, to, 1));
            assert!(text.contains(expected), "no '{expected}' in: {text}");
        }
    }

    #[test]
    fn messages_name_the_place_what_was_found_and_what_is_allowed() {
        let cases = [
            (("serial = \"", "seriel = \""), "bench.toml:5:1: unknown key 'seriel' in [node.1]"),
            (("serial = \"", "seriel = \""), "did you mean 'serial'?"),
            (("id = 2", "id = 200"), "bench.toml:9:6: node.200.id = 200: must be an integer from 1 to 127"),
            (("id = 2\n", "id = 1\n"), "bench.toml:9:6: node.1.id = 1: node 1 has it already"),
            (
                ("usb_serial = \"066AFF\"", "serial = \"/dev/ttyACM0\""),
                "bench.toml:10:10: node.2.serial = \"/dev/ttyACM0\": node 1 has it",
            ),
            (
                ("usb_serial = \"066AFF\"", "serial = \"b\"\nuid = \"123456789abcdef\""),
                "node.2.uid = \"123456789abcdef\": node 1 has it",
            ),
            (
                ("0123456789abcdef", "0123456789abcdefg"),
                "bench.toml:6:7: node.1.uid = \"0123456789abcdefg\": must be the chip's",
            ),
            (("emulator = true", ""), "missing key 'serial' in [node.3]: must be the port's path"),
            (("emulator = true", "emulator = false"), "node.3.emulator = false: must be true, or left out"),
            (("emulator = true", "emulator = true\nserial = \"a\""), "node.3: must have one of"),
            (("emulator = true", "emulator = true\nuid = \"1\""), "node.3.uid = \"1\": must not be there"),
            (
                ("version = 1", "version = 1\nbaud = 5"),
                "baud = 5: must be an integer from 1200 to 12000000 (bit/s)",
            ),
            (
                ("version = 1", "version = 1\nanswer_within = \"1ms\""),
                "must be from 100ms to 60s, for one answer",
            ),
            (
                ("emulator = true", "host = true\ncan = true"),
                "node.3.can = true: must come with the file's can",
            ),
            (("emulator = true", "host = false"), "node.3.host = false: must be true, or left out"),
            (("version = 1", "version = 1\non_loss = \"go on\""), "must be one of stop, go-on"),
        ];
        for ((from, to), expected) in cases {
            assert!(FILE.contains(from), "{from}");
            let text = errors(&FILE.replacen(from, to, 1));
            assert!(text.contains(expected), "no '{expected}' in: {text}");
        }
        assert!(
            errors("version = 1").contains("missing key 'node' in the file"),
            "{}",
            errors("version = 1")
        );
        assert!(errors("").contains("missing key 'version'"));
    }

    #[test]
    fn a_scenario_needs_an_entry_for_each_node_and_others_may_be_there() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
        let scenario = Scenario::load(&path, &[]).unwrap();
        let entries = |ids: &[u8]| {
            let text: String =
                ids.iter().map(|id| format!("[[node]]\nid = {id}\nemulator = true\n")).collect();
            BenchFile::parse(&format!("version = 1\n{text}"), Path::new("bench.toml")).unwrap()
        };
        assert_eq!(entries(&[7, 5, 4, 3, 2, 1]).covers(&scenario), Ok(()));
        let text = entries(&[1, 3, 5]).covers(&scenario).unwrap_err();
        assert!(text.starts_with("bench.toml: no [[node]] with id 2, 4, which"), "{text}");
    }
}
