//! `sim-host bench` as a process, with its files in a folder of their own.

use super::Board;
use funnelnet_protocol::message::{FaultCode, Message};
use funnelnet_protocol::serial::{Deframer, Frame, MAX_RAW};
use rustix::fs::OFlags;
use std::fs;
use std::io::Read;
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Within which everything here has to happen.
pub const SOON: Duration = Duration::from_secs(180);
/// Within which a run has to end once a node is gone.
pub const AT_ONCE: Duration = Duration::from_secs(3);

/// Three nodes on a path, 200 ticks.
pub const SCENARIO: &str = r#"version = 1
[time]
tick = "1ms"
duration = "200ms"
[graph]
kind = "path"
nodes = 3
[coupling]
kind = "node-wise"
gain = { kind = "reciprocal", scale = 1.0 }
funnel = { kind = "exponential", start = 40.0, end = 2.0, rate = 1.0 }
[agent]
dynamics = { kind = "affine", slope = -1.0, sines = [{ amplitude = 10.0, frequency = 1.0 }] }
[[node]]
id = 2
state = 3.5
[[node]]
id = 3
state = -2.5
[expect]
funnel_ratio = 1.0
"#;

/// How `sim-host` ended.
pub struct Ended {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
    pub took: Duration,
}

impl Ended {
    pub fn failed(&self, code: i32, words: &[&str]) {
        assert_eq!((self.code, self.out.as_str()), (Some(code), ""), "{}", self.err);
        for word in words {
            assert!(self.err.contains(word), "no '{word}' in: {}", self.err);
        }
    }
}

impl Ended {
    /// It ran, failed, and said so in `words`; nothing of it is a defect of the program.
    pub fn fell_short(&self, words: &[&str]) {
        assert_eq!(self.code, Some(1), "{}", self.err);
        for word in words {
            assert!(self.err.contains(word), "no '{word}' in: {}", self.err);
        }
    }
}

/// A folder with a scenario, a bench file and the outputs.
pub struct Bench {
    folder: TempDir,
}

impl Bench {
    /// With the lines of each node, for ids from 1.
    pub fn new(scenario: &str, entries: &[String]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let nodes: String =
            entries.iter().zip(1..).map(|(entry, id)| format!("[[node]]\nid = {id}\n{entry}\n")).collect();
        fs::write(folder.path().join("scenario.toml"), scenario).unwrap();
        let text = format!("version = 1\nanswer_within = \"1s\"\n{nodes}");
        fs::write(folder.path().join("bench.toml"), text).unwrap();
        Self { folder }
    }

    pub fn of(boards: &[&Board]) -> Self {
        let entries: Vec<_> = boards.iter().map(|board| entry(&board.path)).collect();
        Self::new(SCENARIO, &entries)
    }

    /// With one more line for the whole bench.
    pub fn with(self, line: &str) -> Self {
        let path = self.path("bench.toml");
        let text = fs::read_to_string(&path).unwrap();
        fs::write(path, text.replacen("version = 1", &format!("version = 1\n{line}"), 1)).unwrap();
        self
    }

    /// With time for emulators, which stand still for a second now and then where a computer has other things to do.
    pub fn patient(self) -> Self {
        let path = self.path("bench.toml");
        let text =
            fs::read_to_string(&path).unwrap().replace("answer_within = \"1s\"", "answer_within = \"30s\"");
        fs::write(path, text).unwrap();
        self
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn spawn(&self, arguments: &[&str]) -> Child {
        let mut command = self.command();
        command.arg(self.path("scenario.toml")).arg("--out").arg(self.path("out")).args(arguments);
        command.spawn().unwrap()
    }

    pub fn spawn_commission(&self, arguments: &[&str]) -> Child {
        let mut command = self.command();
        command.arg(self.path("scenario.toml")).arg("--commission").args(arguments).spawn().unwrap()
    }

    pub fn spawn_update(&self, image: &Path, arguments: &[&str]) -> Child {
        let mut command = self.command();
        command.arg(self.path("scenario.toml")).arg("--update").arg(image).args(arguments).spawn().unwrap()
    }

    /// The same with standard error on the terminal at this path.
    pub fn spawn_update_on(&self, terminal: &str, image: &Path) -> Child {
        let terminal = fs::OpenOptions::new().read(true).write(true).open(terminal).unwrap();
        let mut command = self.command();
        command.env("TERM", "xterm").arg(self.path("scenario.toml")).arg("--update").arg(image);
        command.stderr(terminal).spawn().unwrap()
    }

    pub fn spawn_erase(&self) -> Child {
        self.command().arg("--erase").spawn().unwrap()
    }

    fn command(&self) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
        command.current_dir(repository()).arg("bench").arg("--bench").arg(self.path("bench.toml"));
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }

    pub fn run(&self, arguments: &[&str]) -> Ended {
        end(self.spawn(arguments))
    }

    /// After how many ticks of how many the run ended, and why, as its summary says; there is a row of the
    /// trajectory for each.
    pub fn ended_early(&self) -> String {
        let summary = self.summary();
        let why = summary["ended_early"].as_str().unwrap().to_owned();
        assert_eq!((&summary["passed"], &summary["bench"]["bit_for_bit"]), (&false.into(), &false.into()));
        let recorded: usize = why.split(' ').nth(1).unwrap().parse().unwrap();
        let rows = fs::read_to_string(self.path("out/trajectory.csv")).unwrap().lines().count() - 1;
        assert!(rows == recorded || summary["ticks"].as_u64() > Some(2000), "{rows} rows: {why}");
        why
    }

    /// The checks that the run did not pass.
    pub fn failed_checks(&self) -> Vec<String> {
        let summary = self.summary();
        let checks = summary["checks"].as_array().unwrap().iter().filter(|check| check["pass"] == false);
        checks.map(|check| check["name"].as_str().unwrap().to_owned()).collect()
    }

    pub fn summary(&self) -> serde_json::Value {
        serde_json::from_str(&fs::read_to_string(self.path("out/summary.json")).unwrap()).unwrap()
    }
}

pub fn wait(what: &str, mut condition: impl FnMut() -> bool) {
    let begin = Instant::now();
    while !condition() {
        assert!(begin.elapsed() < SOON, "{what}: not within {SOON:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

pub fn entry(path: &str) -> String {
    format!("serial = \"{path}\"")
}

pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

pub fn end(mut child: Child) -> Ended {
    let begin = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if begin.elapsed() > SOON {
            let _ = child.kill();
            panic!("the bench did not end within {SOON:?}");
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let took = begin.elapsed();
    let (mut out, mut err) = (String::new(), String::new());
    child.stdout.take().unwrap().read_to_string(&mut out).unwrap();
    child.stderr.take().unwrap().read_to_string(&mut err).unwrap();
    Ended { code: status.code(), out, err, took }
}

/// The trace hash of the same scenario in loopback.
pub fn loopback_hash(scenario: &Path) -> String {
    let json = scenario.with_extension("json");
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command.arg("run").arg(scenario).arg("--quiet").arg("--json").arg(&json);
    assert!(command.status().unwrap().success());
    let summary: serde_json::Value = serde_json::from_str(&fs::read_to_string(json).unwrap()).unwrap();
    summary["trace_hash"].as_str().unwrap().to_owned()
}

/// Kills a bench (SIGKILL) whose nodes run, and gives what the node at `port` says within five seconds.
pub fn orphaned(
    bench: &Bench,
    port: &str,
    running: impl FnOnce(),
    sets: &[&str],
) -> Vec<(FaultCode, Duration)> {
    let mut child = bench.spawn(&[&["--set", "time.duration=10min"], sets].concat());
    running();
    // Open at once: what a node says when nobody listens is lost.
    let mut line = fs::OpenOptions::new()
        .read(true)
        .custom_flags((OFlags::NONBLOCK | OFlags::NOCTTY).bits() as i32)
        .open(port)
        .unwrap();
    child.kill().unwrap();
    child.wait().unwrap();
    let (begin, mut deframer, mut faults) = (Instant::now(), Deframer::<MAX_RAW>::new(), Vec::new());
    while begin.elapsed() < Duration::from_secs(5) {
        let mut bytes = [0; 256];
        let length = line.read(&mut bytes).unwrap_or(0);
        for &byte in &bytes[..length] {
            if let Some(Ok(Frame::RealTime(Message::Fault { code, .. }))) = deframer.push(byte) {
                faults.push((code, begin.elapsed()));
            }
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    faults
}

/// The processes that a process has started, in order.
pub fn children(id: u32) -> Vec<u32> {
    let text = fs::read_to_string(format!("/proc/{id}/task/{id}/children")).unwrap_or_default();
    text.split_whitespace().map(|id| id.parse().unwrap()).collect()
}
