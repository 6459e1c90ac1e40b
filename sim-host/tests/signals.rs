//! SIGKILL, SIGTERM and SIGHUP at random moments of runs, benches and commissionings: no process, lock or
//! half file is left.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The moments are drawn from it.
const SEED: u64 = 17;
/// Within which everything has to be over after a signal.
const SOON: Duration = Duration::from_secs(30);
/// Set for a program and all that it starts.
const MARK: &str = "FUNNELNET_TEST_PLACE";

const SCENARIO: &str = r#"
version = 1
time = { tick = "1ms", duration = "50ms" }
graph = { kind = "path", nodes = 3 }
coupling = { kind = "node-wise", gain = { kind = "reciprocal", scale = 1.0 }, funnel = { kind = "constant", width = 9.0 } }
agent = { dynamics = { kind = "affine", slope = -1.0, offset = 1.0 } }
"#;

const LONG: &str = "time.duration=10h";

/// Numbers from a seed (SplitMix64).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ (z >> 31)) % limit
    }
}

/// A folder with a scenario and a bench of three processes that keep their configuration.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        fs::write(place.at("a.toml"), SCENARIO).unwrap();
        let node = |id| {
            let storage = place.at(&format!("flash{id}"));
            format!("[[node]]\nid = {id}\nhost = true\nstorage = {:?}\n", storage.display().to_string())
        };
        let nodes: String = (1..=3).map(node).collect();
        fs::write(place.at("bench.toml"), format!("version = 1\n{nodes}")).unwrap();
        place
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn start(&self, arguments: &[&str]) -> Child {
        // Whoever runs the tests by nohup has them ignore SIGHUP, and so their children.
        let mut command = Command::new("env");
        command.args(["--default-signal=HUP,INT,TERM", env!("CARGO_BIN_EXE_sim-host")]);
        command.current_dir(self.0.path()).env(MARK, self.0.path()).args(arguments);
        let errors = fs::File::create(self.at("errors")).unwrap();
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(errors).spawn().unwrap()
    }

    /// What the program that was started last has said of errors.
    fn errors(&self) -> String {
        fs::read_to_string(self.at("errors")).unwrap()
    }

    /// Files that have no name of their own yet, and locks.
    fn leftovers(&self) -> Vec<PathBuf> {
        let folders = [self.0.path().to_owned(), self.at("out")];
        let entries = folders.iter().flat_map(|folder| fs::read_dir(folder).into_iter().flatten());
        let paths = entries.map(|entry| entry.unwrap().path());
        let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
        paths.filter(|path| name(path).ends_with(".tmp") || name(path) == ".sim-host.lock").collect()
    }

    /// Processes that were started here and live.
    fn processes(&self) -> Vec<u32> {
        let mark = format!("{MARK}={}", self.0.path().display());
        let is_ours = |id: &u32| {
            let read = |name: &str| fs::read(format!("/proc/{id}/{name}")).unwrap_or_default();
            let is_dead = String::from_utf8_lossy(&read("stat")).contains(") Z ");
            !is_dead && read("environ").split(|&byte| byte == 0).any(|line| line == mark.as_bytes())
        };
        let entries = fs::read_dir("/proc").unwrap();
        let ids = entries.filter_map(|entry| entry.unwrap().file_name().to_str()?.parse().ok());
        ids.filter(is_ours).collect()
    }
}

fn wait(child: &mut Child) -> ExitStatus {
    let begin = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        assert!(begin.elapsed() < SOON, "it has not ended within {SOON:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Sends a signal after so long, and gives how the program ended.
fn struck(place: &Place, arguments: &[&str], signal: &str, after: Duration) -> ExitStatus {
    let mut child = place.start(arguments);
    std::thread::sleep(after);
    if child.try_wait().unwrap().is_none() {
        let sent = Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status();
        assert!(sent.unwrap().success());
    }
    wait(&mut child)
}

/// Strikes a command at random moments with each signal, and looks at what is left. `again` is a command that
/// has to succeed afterwards.
fn survives(seed: u64, arguments: &[&str], latest_ms: u64, again: &[&str], check: impl Fn(&Place)) {
    let mut random = Random(SEED + seed);
    let place = Place::new();
    let mut ends = Vec::new();
    for round in 0..12 {
        let signal = ["KILL", "TERM", "HUP"][round % 3];
        let after = Duration::from_millis(random.below(latest_ms));
        let status = struck(&place, arguments, signal, after);
        let what = format!("{signal} after {after:?}: {status}");
        let begin = Instant::now();
        while !place.processes().is_empty() {
            assert!(begin.elapsed() < SOON, "{what}: {:?} live on", place.processes());
            std::thread::sleep(Duration::from_millis(5));
        }
        // A signal that comes before the program has its own way with it ends it at once.
        let by_itself =
            matches!((signal, status.code()), ("TERM", Some(130)) | ("HUP", Some(129)) | (_, Some(0)));
        assert!(by_itself || status.signal().is_some(), "{what}: {}", place.errors());
        if signal != "KILL" && by_itself {
            assert_eq!(place.leftovers(), Vec::<PathBuf>::new(), "{what}");
        }
        // Nothing that was left is in the way, and it goes.
        let after = wait(&mut place.start(again));
        assert!(after.success(), "{what}, and then: {after}: {}", place.errors());
        assert_eq!(place.leftovers(), Vec::<PathBuf>::new(), "{what}, and after another run");
        check(&place);
        ends.push(what);
    }
    println!("{}", ends.join("\n"));
    assert!(ends.iter().any(|end| end.contains("exit status: 130")), "no moment was within a run: {ends:?}");
}

/// Whole, and of the run that came last.
fn is_whole(place: &Place) {
    let summary: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(place.at("out/summary.json")).unwrap()).unwrap();
    assert_eq!((&summary["passed"], &summary["ended_early"]), (&true.into(), &serde_json::Value::Null));
    let rows = fs::read_to_string(place.at("out/trajectory.csv")).unwrap().lines().count() - 1;
    assert_eq!(rows, 51);
    assert!(!fs::read_to_string(place.at("j.xml")).unwrap().contains("has not come to its end"));
}

const OUTPUTS: [&str; 6] = ["--out", "out", "--json", "a.json", "--junit", "j.xml"];

#[test]
fn runs() {
    let long = [&["run", "a.toml", "--set", LONG, "--every", "1s"][..], &OUTPUTS].concat();
    survives(1, &long, 600, &[&["run", "a.toml"][..], &OUTPUTS].concat(), is_whole);
}

#[test]
fn benches() {
    let bench = ["bench", "a.toml", "--bench", "bench.toml"];
    let long = [&bench[..], &["--set", LONG, "--every", "1s"], &OUTPUTS].concat();
    survives(2, &long, 1_500, &[&bench[..], &OUTPUTS].concat(), is_whole);
}

#[test]
fn commissionings() {
    let place = Place::new();
    let mut random = Random(SEED + 3);
    let commission = ["bench", "a.toml", "--bench", "bench.toml", "--commission"];
    for round in 0..12 {
        let signal = ["KILL", "TERM", "HUP"][round % 3];
        // Each time another configuration, so that every round has something to store.
        let set = format!("coupling.funnel.width={}", 2 + round);
        let arguments = [&commission[..], &["--set", &set]].concat();
        let after = Duration::from_millis(random.below(400));
        let status = struck(&place, &arguments, signal, after);
        let what = format!("{signal} after {after:?}: {status}");
        println!("{what}");
        let by_itself =
            matches!((signal, status.code()), ("TERM", Some(130)) | ("HUP", Some(129)) | (_, Some(0)));
        assert!(by_itself || status.signal().is_some(), "{what}: {}", place.errors());
        let begin = Instant::now();
        while !place.processes().is_empty() {
            assert!(begin.elapsed() < SOON, "{what}: {:?} live on", place.processes());
            std::thread::sleep(Duration::from_millis(5));
        }
        // Each node has its old or its new configuration, whole: it starts, says so, and takes the next one.
        let again = wait(&mut place.start(&commission));
        assert!(again.success(), "{what}, and then: {again}");
        assert_eq!(place.leftovers(), Vec::<PathBuf>::new(), "{what}");
    }
}
