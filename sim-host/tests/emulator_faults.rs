//! What goes wrong with emulated nodes: exit code, message, and nothing left behind. `./ci.sh parity` runs
//! these.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_protocol::config::TickSource;
use sim_host::bus::ideal::{IdealBus, IdealParams};
use sim_host::configure::{Drive, node_configs};
use sim_host::emulator::{self, EmulatorOptions, decode_log};
use sim_host::hub::Hub;
use sim_host::interrupt::Interrupt;
use sim_host::scenario::Scenario;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const IMAGES: &str = "firmware/target/thumbv7em-none-eabihf/release";
/// Within which everything here has to happen: the program's own limits and a slow machine's share.
const SOON: Duration = Duration::from_secs(30);
/// Within which emulators have to be gone once nobody wants them any more.
const AT_ONCE: Duration = Duration::from_secs(5);

/// A run on five emulated nodes, with a temporary folder of its own, by which its emulators are known.
struct Run {
    child: Child,
    folder: TempDir,
}

/// How a run ended.
struct Ended {
    code: Option<i32>,
    out: String,
    err: String,
    took: Duration,
    folder: TempDir,
}

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The five agents without expectations, so that no time goes into a reference.
fn scenario(folder: &Path) -> PathBuf {
    let text = fs::read_to_string(repository().join("scenarios/five-agents.toml")).unwrap();
    let path = folder.join("five.toml");
    let kept = text.replace("funnel_ratio = 1.0\n", "").replace("reference_error = 1e-3\n", "");
    assert!(kept.len() < text.len());
    fs::write(&path, kept).unwrap();
    path
}

/// `run FOLDER/five.toml --on emulator --out FOLDER/out` and more, after `prepare`.
fn start_with(arguments: &[&str], prepare: impl FnOnce(&mut Command, &Path)) -> Run {
    let folder = tempfile::tempdir().unwrap();
    let temporary = folder.path().join("tmp");
    fs::create_dir(&temporary).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command.current_dir(repository()).env("TMPDIR", &temporary);
    command.arg("run").arg(scenario(folder.path())).args(["--on", "emulator"]).args(arguments);
    command.arg("--out").arg(folder.path().join("out"));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    prepare(&mut command, folder.path());
    Run { child: command.spawn().unwrap(), folder }
}

fn start(arguments: &[&str]) -> Run {
    start_with(arguments, |_, _| {})
}

/// Waits for `condition`; how long it took.
fn wait(what: &str, limit: Duration, mut condition: impl FnMut() -> bool) -> Duration {
    let begin = Instant::now();
    while !condition() {
        assert!(begin.elapsed() < limit, "{what}: not within {limit:?}");
        std::thread::sleep(Duration::from_millis(10));
    }
    begin.elapsed()
}

/// Sends a signal by name.
fn signal(name: &str, process: u32) {
    let done = Command::new("sh").args(["-c", &format!("kill -{name} {process}")]).status().unwrap();
    assert!(done.success(), "kill -{name} {process}");
}

/// Processes with `mark` in their command line: process number and command line.
fn processes(mark: &str) -> Vec<(u32, String)> {
    let entries = fs::read_dir("/proc").unwrap().filter_map(Result::ok);
    let process = |entry: fs::DirEntry| {
        let number = entry.file_name().to_str()?.parse().ok()?;
        let line = fs::read(entry.path().join("cmdline")).ok()?;
        Some((number, String::from_utf8_lossy(&line).replace('\0', " ")))
    };
    entries.filter_map(process).filter(|(_, line)| line.contains(mark)).collect()
}

/// The emulators of a run: their serial lines are in its folder for temporary files.
fn emulators(folder: &TempDir) -> Vec<(u32, String)> {
    processes(&folder.path().join("tmp/funnelnet-").display().to_string())
}

/// What an emulated node has logged so far: the file has no name, but its process has it as standard output.
fn log(image: &[u8], process: u32) -> String {
    decode_log(image, &fs::read(format!("/proc/{process}/fd/1")).unwrap_or_default())
}

/// Everything in a folder and below, by path.
fn files(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let paths = entries.map(|entry| entry.unwrap().path());
    paths.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

impl Run {
    /// Waits until nodes tick: they have heard their neighbours.
    fn wait_until_ticking(&mut self) {
        let image = fs::read(repository().join(image("mps2_an386"))).unwrap();
        wait("ticks on five emulators", SOON, || {
            assert_eq!(self.child.try_wait().unwrap(), None, "the run ended");
            let logs = emulators(&self.folder).into_iter().map(|(process, _)| log(&image, process));
            logs.filter(|log| log.contains("hears node")).count() == 5
        });
        // Some of them, so that there is something to record.
        std::thread::sleep(Duration::from_millis(300));
    }

    /// The emulator of a node.
    fn emulator(&self, node: u8) -> u32 {
        let mark = format!("/funnelnet-{node}-");
        emulators(&self.folder).iter().find(|(_, line)| line.contains(&mark)).unwrap().0
    }

    /// Waits for the end. Emulators must be gone then, without outliving it.
    fn end(mut self) -> Ended {
        let begin = Instant::now();
        let mut code = None;
        wait("the end of the run", SOON, || {
            code = self.child.try_wait().unwrap();
            code.is_some()
        });
        let took = begin.elapsed();
        assert_eq!(emulators(&self.folder), [], "emulators that outlive the run");
        assert_eq!(files(&self.folder.path().join("tmp")), [] as [PathBuf; 0], "temporary files");
        let (mut out, mut err) = (String::new(), String::new());
        self.child.stdout.take().unwrap().read_to_string(&mut out).unwrap();
        self.child.stderr.take().unwrap().read_to_string(&mut err).unwrap();
        let folder = std::mem::replace(&mut self.folder, tempfile::tempdir().unwrap());
        Ended { code: code.and_then(|status| status.code()), out, err, took, folder }
    }
}

impl Drop for Run {
    /// A failed test leaves nothing running either.
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Ended {
    /// Code, nothing on standard output, each of `words` in the message, no outputs.
    fn failed(&self, code: i32, words: &[&str]) {
        assert_eq!((self.code, self.out.as_str()), (Some(code), ""), "{}", self.err);
        for word in words {
            assert!(self.err.contains(word), "no '{word}' in: {}", self.err);
        }
        assert_eq!(files(&self.folder.path().join("out")), [] as [PathBuf; 0], "half-written output");
    }
}

impl Ended {
    /// Code 1, each of `words` in the message, and what was recorded.
    fn fell_short(&self, words: &[&str]) {
        assert_eq!(self.code, Some(1), "{}", self.err);
        for word in words {
            assert!(self.err.contains(word), "no '{word}' in: {}", self.err);
        }
        assert!(self.ended_early().contains(words[0]), "{}", self.ended_early());
    }

    /// What the summary says about the end.
    fn ended_early(&self) -> String {
        let text = fs::read_to_string(self.folder.path().join("out/summary.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(summary["passed"], false);
        summary["ended_early"].as_str().unwrap().to_owned()
    }
}

fn image(name: &str) -> String {
    let path = format!("{IMAGES}/{name}");
    assert!(repository().join(&path).is_file(), "no image at {path}: ./ci.sh parity builds it");
    path
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn a_missing_image_is_code_3_and_says_what_builds_it() {
    let ended = start(&["--image", "no/such.elf"]).end();
    ended.failed(3, &["no firmware image at no/such.elf", "./ci.sh firmware"]);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn a_missing_emulator_is_code_3_and_says_what_installs_it() {
    let run = start_with(&["--image", &image("mps2_an386")], |command, folder| {
        command.env("PATH", folder);
    });
    run.end().failed(3, &["cannot start 'qemu-system-arm'", "./ci.sh setup"]);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn an_image_that_never_answers_is_code_3_and_its_log_is_quoted() {
    let ended = start(&["--image", &image("selftest")]).end();
    ended.failed(3, &["node 1 did not answer: no identity within 10 s", "its log: ", "selftest ready"]);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn an_image_that_is_none_is_code_3_with_the_emulators_complaint() {
    let ended = start(&["--image", "Cargo.toml"]).end();
    ended.failed(3, &["node 1", "its emulator: "]);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn a_node_refuses_a_configuration_with_its_reason() {
    // The scenario reader refuses such a tick first; the node has the last word all the same.
    let scenario = Scenario::load(&repository().join("scenarios/five-agents.toml"), &[]).unwrap();
    let drive = Drive { tick_source: TickSource::Sync, telemetry_every: 1, is_simulated: false };
    let mut configs = node_configs(&scenario, drive).unwrap();
    configs.truncate(1);
    configs[0].tick_ns = 5000;
    let bus = IdealBus::new(IdealParams::default(), 1, vec![Vec::new()]);
    let options = EmulatorOptions {
        image: repository().join(image("mps2_an386")),
        qemu: "qemu-system-arm".to_owned(),
        interrupt: Interrupt::default(),
    };
    let attached = emulator::attach(&[1], &options).unwrap();
    let hub = Hub::new(attached, &configs, bus, emulator::PATIENCE);
    let Err(error) = hub else { panic!("the node takes a tick of 5 us") };
    let text = error.to_string();
    assert!(text.contains("node 1 refused its configuration: time.tick"), "{text}");
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn ctrl_c_ends_the_run_and_all_emulators() {
    for name in ["INT", "TERM"] {
        let mut run = start(&["--set", "time.duration=10min"]);
        run.wait_until_ticking();
        signal(name, run.child.id());
        let ended = run.end();
        assert_eq!((ended.code, ended.out.as_str()), (Some(130), ""), "{}", ended.err);
        assert!(
            ended.err.contains("interrupted after ") && ended.err.contains(" of 600001 ticks"),
            "{}",
            ended.err
        );
        assert!(ended.ended_early().ends_with(": interrupted"));
        assert!(ended.took < AT_ONCE, "{:?}", ended.took);
    }
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn ctrl_c_while_nodes_boot_is_no_different() {
    let run = start(&["--image", &image("selftest")]);
    wait("emulators", SOON, || emulators(&run.folder).len() == 5);
    signal("INT", run.child.id());
    let ended = run.end();
    ended.failed(130, &["interrupted"]);
    assert!(ended.took < AT_ONCE, "{:?}", ended.took);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn emulators_do_not_outlive_a_run_that_is_killed() {
    let mut run = start(&["--set", "time.duration=10min"]);
    run.wait_until_ticking();
    signal("KILL", run.child.id());
    run.child.wait().unwrap();
    wait("the end of all emulators", AT_ONCE, || emulators(&run.folder).is_empty());
    assert_eq!(files(&run.folder.path().join("tmp")), [] as [PathBuf; 0], "temporary files");
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn an_emulator_that_dies_is_named() {
    let mut run = start(&["--set", "time.duration=10min"]);
    run.wait_until_ticking();
    signal("KILL", run.emulator(4));
    let ended = run.end();
    ended.fell_short(&["the emulator of node 4 ended", "signal: 9", "its log: "]);
    assert!(ended.took < AT_ONCE, "{:?}", ended.took);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn an_emulator_that_hangs_is_named() {
    let mut run = start(&["--set", "time.duration=10min"]);
    run.wait_until_ticking();
    signal("STOP", run.emulator(2));
    run.end().fell_short(&["node 2 did not answer: no ", " within 5 s"]);
}
