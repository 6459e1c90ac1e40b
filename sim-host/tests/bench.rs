//! Nodes behind serial ports: played boards (the firmware's session in this process) and emulated ones,
//! behind pseudo-terminals.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod boards;

use boards::{
    AT_ONCE, Act, Bench, Board, SCENARIO, children, end, entry, loopback_hash, orphaned, repository, second,
    three, wait,
};
use funnelnet_node::Phase;
use funnelnet_protocol::WIRE_VERSION;
use funnelnet_protocol::message::{FaultCode, Message};
use funnelnet_protocol::serial;
use funnelnet_protocol::service::{Identity, ResetCause};
use sim_host::emulator::decode_log;
use std::fs;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use tempfile::NamedTempFile;

const IMAGE: &str = "firmware/target/thumbv7em-none-eabihf/release/mps2_an386";

#[test]
fn three_boards_run_the_bits_of_loopback() {
    let boards = three();
    let bench = Bench::of(&boards.each_ref());
    let ended = bench.run(&["--junit", bench.path("junit.xml").to_str().unwrap()]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.out.contains("bit for bit as loopback"), "{}", ended.out);
    let summary = bench.summary();
    assert_eq!(summary["on"], "bench");
    assert_eq!(summary["trace_hash"], loopback_hash(&bench.path("scenario.toml")));
    assert_eq!(summary["bench"]["bit_for_bit"], true);
    let node = &summary["bench"]["nodes"][2];
    assert_eq!(
        (&node["node"], &node["uid"], &node["firmware"]),
        (&3.into(), &"0000000000000003".into(), &"0.1.0".into())
    );
    assert_eq!(
        (&node["first_difference"], &node["largest_deviation"]),
        (&serde_json::Value::Null, &0.0.into())
    );
    assert!(fs::read_to_string(bench.path("junit.xml")).unwrap().contains("sim-host.bench"));
    assert_stamps(&fs::read_to_string(bench.path("out/bench.csv")).unwrap(), 201, 3);
    assert_eq!(boards.map(Board::end), [Some(Phase::Stopped); 3]);
}

/// A row per tick and node, and in each row the host's times in the order of what happened.
fn assert_stamps(text: &str, ticks: usize, nodes: usize) {
    let mut lines = text.lines();
    assert_eq!(lines.next(), Some("tick,node,sync_s,state_s,telemetry_s,bus_s"));
    let mut last = 0.0;
    for (n, line) in lines.clone().enumerate() {
        // Not on CAN, so without a bus time.
        let line = line.strip_suffix(',').unwrap();
        let row: Vec<f64> = line.split(',').map(|field| field.parse().unwrap()).collect();
        assert_eq!((row[0] as usize, row[1] as usize), (n / nodes, n % nodes + 1));
        assert!(row[2] <= row[3] && row[3] <= row[4], "{line}");
        if n % nodes == 0 {
            assert!(row[2] >= last, "{line}");
            last = row[2];
        }
    }
    assert_eq!(lines.count(), ticks * nodes);
}

#[test]
fn faults_of_the_bus_and_noise_are_made_by_the_hub() {
    let boards = three();
    let bench = Bench::of(&boards.each_ref());
    let faults = ["bus.loss=0.2", "bus.latency=300us", "bus.jitter=900us", "agent.noise=0.01"];
    let sets: Vec<_> = faults.iter().flat_map(|fault| ["--set", fault]).collect();
    let ended = bench.run(&sets);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let summary = bench.summary();
    assert!(summary["bus"]["lost"].as_u64().unwrap() > 50, "{summary}");
    assert_eq!(summary["bench"]["bit_for_bit"], true);
}

#[test]
fn a_recovery_from_what_did_not_happen_is_not_measured() {
    let boards = three();
    let bench = Bench::of(&boards.each_ref());
    let sets =
        ["event=[{at='100ms',kind='sensor',node=2,offset=1.0,for='1ms'}]", "expect.recovered_within=50ms"];
    let ended = bench.run(&["--set", sets[0], "--set", sets[1]]);
    assert_eq!(ended.code, Some(1), "{}", ended.err);
    assert!(ended.err.contains("recovered_within = not measured"), "{}", ended.err);
    assert_eq!(bench.summary()["trace_hash"], loopback_hash(&bench.path("scenario.toml")));
}

#[test]
fn a_node_that_computes_otherwise_is_named_with_its_first_tick() {
    // A frame that passes every check and that the node did not mean: its state, a little off, right before
    // the real one.
    let off = |n: u32| {
        let tick = funnelnet_protocol::TickStamp::full(n);
        let source = funnelnet_protocol::NodeId::new(2).unwrap();
        let component = funnelnet_protocol::message::Component::FIRST;
        match n {
            50 => Act::Noise(serial::encode(&Message::State { source, component, tick, x: 1.0 }).to_vec()),
            _ => Act::Send,
        }
    };
    let boards = [Board::good(1), Board::start(2, Box::new(off)), Board::good(3)];
    let bench = Bench::of(&boards.each_ref());
    let ended = bench.run(&[]);
    let summary = bench.summary();
    assert_eq!(summary["bench"]["bit_for_bit"], false);
    let first = |node: usize| summary["bench"]["nodes"][node]["first_difference"].as_u64();
    // Its neighbours hear the wrong value, and it hears them.
    assert_eq!(first(0), Some(50), "{summary}");
    assert!(first(1) >= Some(50), "{summary}");
    assert!(ended.out.contains("differs from loopback: node 1 from tick 50, by at most"), "{}", ended.out);
}

#[test]
fn a_run_that_follows_another_needs_no_reset() {
    let boards = three();
    let bench = Bench::of(&boards.each_ref());
    for _ in 0..2 {
        assert_eq!(bench.run(&["--quiet"]).code, Some(0));
        assert_eq!(bench.summary()["bench"]["bit_for_bit"], true);
    }
}

#[test]
fn a_node_that_was_left_running_is_stopped_and_configured() {
    let boards = three();
    let bench = Bench::of(&boards.each_ref());
    let mut child = bench.spawn(&["--set", "time.duration=10min"]);
    boards.iter().for_each(Board::wait_until_running);
    child.kill().unwrap();
    child.wait().unwrap();
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(bench.summary()["bench"]["bit_for_bit"], true);
}

#[test]
fn nodes_whose_host_program_dies_stop_by_themselves() {
    let boards = three();
    let bench = Bench::of(&boards.each_ref());
    let running = || boards.iter().for_each(Board::wait_until_running);
    // Twice answer_within.
    let faults = orphaned(&bench, &boards[1].path, running, &[]);
    let [(FaultCode::HOLDOVER, after)] = faults[..] else { panic!("{faults:?}") };
    assert!(after > Duration::from_millis(1_900) && after < Duration::from_secs(4), "{after:?}");
    assert_eq!(boards.map(Board::end), [Some(Phase::Faulted(FaultCode::HOLDOVER)); 3]);
}

#[test]
fn the_holdover_of_the_scenario_is_the_one_that_counts() {
    let boards = three();
    let bench = Bench::of(&boards.each_ref());
    let running = || boards.iter().for_each(Board::wait_until_running);
    let faults = orphaned(&bench, &boards[1].path, running, &["--set", "safety.holdover=500ms"]);
    let [(FaultCode::HOLDOVER, after)] = faults[..] else { panic!("{faults:?}") };
    assert!(after > Duration::from_millis(400) && after < Duration::from_millis(1_800), "{after:?}");
}

#[test]
fn a_node_that_has_panicked_is_named_and_runs_when_it_is_told_to() {
    let panicked = Identity {
        wire_version: WIRE_VERSION,
        uid: 2,
        reset: ResetCause::Panic,
        starts: 5,
        ..Identity::default()
    };
    let boards = [Board::good(1), Board::start_as(panicked, Box::new(|_| Act::Send)), Board::good(3)];
    let bench = Bench::of(&boards.each_ref());
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let warning = "node 2: last reset: panic (starts since power-on: 5)";
    assert_eq!(ended.err.lines().filter(|line| line.contains("last reset")).collect::<Vec<_>>(), [warning]);
    let summary = bench.summary();
    assert_eq!(
        (&summary["bench"]["bit_for_bit"], &summary["stopped"]),
        (&true.into(), &serde_json::json!([]))
    );
}

#[test]
fn an_unplugged_board_is_named_and_the_others_stop() {
    let boards = second(|| Act::Vanish);
    let bench = Bench::of(&boards.each_ref());
    let ended = bench.run(&[]);
    let place = format!("the serial port {} of node 2 ended", boards[1].path);
    ended.fell_short(&[
        &place,
        "look at cable and power",
        "stopped: 1, 3; told to stop, but did not confirm it: 2",
        "failed: complete: the run ended after 49 of 201 ticks",
    ]);
    assert!(ended.took < AT_ONCE, "{:?}", ended.took);
    assert!(bench.ended_early().starts_with("after 49 of 201 ticks: the serial port"));
    let stamps = fs::read_to_string(bench.path("out/bench.csv")).unwrap();
    assert_eq!(stamps.lines().count(), 1 + 49 * 3);
    let [first, _, third] = boards.map(Board::end);
    assert_eq!([first, third], [Some(Phase::Stopped); 2]);
}

/// The scenario for so long that a board can be away and come back, with what the bench file says more.
fn long_bench(entries: &[String]) -> Bench {
    let bench = Bench::new(&SCENARIO.replace("200ms", "20s"), entries);
    let path = bench.path("bench.toml");
    let text = fs::read_to_string(&path).unwrap().replace("version = 1", "version = 1\non_loss = \"go-on\"");
    fs::write(path, text).unwrap();
    bench
}

#[test]
fn a_board_that_is_plugged_in_again_joins_the_others_who_went_on() {
    let folder = tempfile::tempdir().unwrap();
    // What the bench file names leads to the board, and after it was unplugged to its successor.
    let (name, again) = (folder.path().join("port"), folder.path().join("again"));
    let (first, successor, third) = (Board::good(1), Board::good(2), Board::good(3));
    std::os::unix::fs::symlink(&successor.path, &again).unwrap();
    let link = name.clone();
    let second = Board::start(
        2,
        Box::new(move |n| {
            if n != 50 {
                return Act::Send;
            }
            fs::rename(&again, &link).unwrap();
            Act::Vanish
        }),
    );
    std::os::unix::fs::symlink(&second.path, &name).unwrap();
    let entries = [entry(&first.path), entry(name.to_str().unwrap()) + "\nuid = \"2\"\n", entry(&third.path)];
    let bench = long_bench(&entries);
    let ended = bench.run(&["--every", "1ms"]);
    ended.fell_short(&["failed: absent: node 2 was away from tick 49 to tick "]);
    for word in ["node 2 is lost at tick 49, the others go on: the serial port", "node 2 is back at tick "] {
        assert!(ended.err.contains(word), "no '{word}' in: {}", ended.err);
    }
    // What a node that was restarted reports is less than what was seen, and no contradiction.
    assert_eq!(bench.failed_checks(), ["absent"]);
    let absences = &bench.summary()["bench"]["absences"];
    let back = absences[0]["to_tick"].as_u64().unwrap() as usize;
    assert_eq!((&absences[0]["node"], &absences[0]["from_tick"]), (&2.into(), &49.into()));
    assert!((50..20_000).contains(&back), "{absences}");
    // Nothing is known of it while it is away, which is no difference of its value. It joins at the mean of
    // the two others, and then moves with them.
    let rows = every_tick(&bench);
    assert!(rows[back - 1][1].is_nan() && rows[50][1].is_nan());
    let (bench, away) = (&bench.summary()["bench"], back - 49);
    assert_eq!((&bench["bit_for_bit"], &bench["unrecorded"]), (&false.into(), &away.into()));
    assert_eq!(bench["nodes"][1]["first_difference"], 49);
    let mean = (rows[back][0] + rows[back][2]) / 2.0;
    assert!((rows[back][1] - mean).abs() < 1e-5, "{:?} at tick {back}", rows[back]);
    let last = &rows[20_000];
    assert!(last[1] != rows[back][1] && (last[1] - last[0]).abs() < 2.0, "{last:?}");
}

#[test]
fn a_process_that_is_killed_is_started_anew_and_joins() {
    let bench = long_bench(&[1, 2, 3].map(|_| "host = true".to_owned()));
    let child = bench.spawn(&["--set", "time.duration=120s"]);
    wait("three processes", || children(child.id()).len() == 3);
    // Past the start, which takes some hundredths.
    std::thread::sleep(Duration::from_millis(300));
    let second = children(child.id())[1].to_string();
    assert!(Command::new("kill").args(["-KILL", &second]).status().unwrap().success());
    let ended = end(child);
    ended.fell_short(&["node 2 is back at tick ", "failed: absent: node 2 was away from tick "]);
    assert_eq!(bench.failed_checks(), ["absent"]);
    let summary = bench.summary();
    assert_eq!(summary["stopped"], serde_json::json!([]));
    let absences = summary["bench"]["absences"].as_array().unwrap();
    let away = |absence: &serde_json::Value| absence["to_tick"].as_u64() > absence["from_tick"].as_u64();
    assert!(absences.len() == 1 && absences.iter().all(away), "{absences:?}");
}

/// The states of every tick.
fn every_tick(bench: &Bench) -> Vec<Vec<f64>> {
    let text = fs::read_to_string(bench.path("out/trajectory.csv")).unwrap();
    // What is not known is left empty.
    let x = |x: &str| if x.is_empty() { f64::NAN } else { x.parse().unwrap() };
    let row = |line: &str| line.split(',').skip(1).take(3).map(x).collect();
    text.lines().skip(1).map(row).collect()
}

#[test]
fn a_board_that_stays_away_is_no_end_for_the_others() {
    let boards = second(|| Act::Hang);
    let entries: Vec<_> = boards.iter().map(|board| entry(&board.path)).collect();
    let bench = long_bench(&entries);
    let ended = bench.run(&[]);
    ended.fell_short(&[
        "the others go on: node 2 did not answer: no state within 1 s",
        "failed: absent: node 2 was away from tick 49 to the end",
    ]);
    let absences = &bench.summary()["bench"]["absences"];
    assert_eq!(absences[0]["to_tick"], serde_json::Value::Null);
    let [first, _, third] = boards.map(Board::end);
    assert_eq!([first, third], [Some(Phase::Stopped); 2]);
}

#[test]
fn nobody_goes_on_once_the_last_node_is_lost() {
    let boards =
        [1, 2].map(|uid| Board::start(uid, Box::new(|n| if n == 50 { Act::Vanish } else { Act::Send })));
    let entries: Vec<_> = boards.iter().map(|board| entry(&board.path)).collect();
    let bench = long_bench(&entries);
    let scenario = SCENARIO.replace("nodes = 3", "nodes = 2").replace("[[node]]\nid = 3\nstate = -2.5\n", "");
    fs::write(bench.path("scenario.toml"), scenario).unwrap();
    bench.run(&[]).fell_short(&["of node 2 ended", "no node confirmed it"]);
    assert!(bench.ended_early().starts_with("after 49 of 201 ticks"));
}

#[test]
fn a_board_that_hangs_is_named_within_its_time() {
    let boards = second(|| Act::Hang);
    let ended = Bench::of(&boards.each_ref()).run(&[]);
    ended.fell_short(&["node 2 did not answer: no state within 1 s", "is its baud", "stopped: 1, 3;"]);
    assert!(ended.took < 2 * AT_ONCE, "{:?}", ended.took);
    let [first, _, third] = boards.map(Board::end);
    assert_eq!([first, third], [Some(Phase::Stopped); 2]);
}

#[test]
fn a_line_that_is_flooded_with_noise_hangs_nothing() {
    let boards = second(|| Act::Flood);
    let ended = Bench::of(&boards.each_ref()).run(&[]);
    ended.fell_short(&["node 2 did not answer: no state within 1 s", "stopped: 1, 3;"]);
    assert!(ended.took < 2 * AT_ONCE, "{:?}", ended.took);
    let noise = boards[1].noise();
    println!("{noise} bytes of noise in the 1 s that the bench waits");
    assert!(noise > 1_000_000, "{noise} bytes: less than 1 MB/s");
    let [first, _, third] = boards.map(Board::end);
    assert_eq!([first, third], [Some(Phase::Stopped); 2]);
}

#[test]
fn noise_between_frames_is_counted_and_the_run_goes_on() {
    let boards = second(|| Act::Noise([&[0xA5; 60][..], &[0]].concat()));
    let bench = Bench::of(&boards.each_ref());
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.out.contains("bit for bit as loopback; 1 unreadable frames from nodes"), "{}", ended.out);
    assert_eq!(bench.summary()["bench"]["nodes"][1]["unreadable"], 1);
}

#[test]
fn noise_towards_a_node_destroys_nothing() {
    let boards = second(|| Act::Hear(vec![0xA5; 60]));
    let bench = Bench::of(&boards.each_ref());
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let summary = bench.summary();
    // The node counts it.
    assert_eq!(
        (&summary["bench"]["bit_for_bit"], &summary["bus"]["refused"]["cobs"]),
        (&true.into(), &1.into())
    );
}

#[test]
fn noise_that_destroys_a_state_ends_the_run_and_is_named_as_the_reason() {
    let boards = second(|| Act::Noise(vec![0xA5; 60]));
    let ended = Bench::of(&boards.each_ref()).run(&[]);
    let words = [
        "node 2 ran tick 49, but its state did not arrive",
        "frames from it that could not be read: 1 (the last one: cobs)",
    ];
    ended.fell_short(&words);
}

#[test]
fn another_chip_than_the_named_one_is_refused_before_anything_is_configured() {
    let boards = three();
    let mut entries: Vec<_> = boards.iter().map(|board| entry(&board.path)).collect();
    entries[0] += "\nuid = \"1\"";
    entries[2] += "\nuid = \"0123456789abcdef\"";
    let ended = Bench::new(SCENARIO, &entries).run(&[]);
    let place =
        format!("the serial port {} of node 3 has the unique number 0000000000000003", boards[2].path);
    ended.failed(3, &[&place, "the bench file says 0123456789abcdef", "bench --list"]);
    assert_eq!(boards.map(Board::end), [None; 3], "nothing is configured");
}

#[test]
fn ctrl_c_stops_every_node() {
    for name in ["INT", "TERM"] {
        let boards = three();
        let bench = Bench::of(&boards.each_ref());
        let child = bench.spawn(&["--set", "time.duration=10min"]);
        boards.iter().for_each(Board::wait_until_running);
        let sent = Command::new("sh").args(["-c", &format!("kill -{name} {}", child.id())]).status().unwrap();
        assert!(sent.success());
        let ended = end(child);
        ended.failed(
            130,
            &["interrupted after ", " of 600001 ticks; ", "all nodes confirmed that they stopped"],
        );
        assert!(bench.ended_early().ends_with(" of 600001 ticks: interrupted"));
        assert!(ended.took < AT_ONCE, "{:?}", ended.took);
        assert_eq!(boards.map(Board::end), [Some(Phase::Stopped); 3]);
    }
}

#[test]
fn a_port_that_cannot_be_used_is_code_3_and_says_what_to_try() {
    let boards = three();
    let mut entries: Vec<_> = boards.iter().map(|board| entry(&board.path)).collect();
    let mut failed = |second: &str, words: &[&str]| {
        entries[1] = second.to_owned();
        Bench::new(SCENARIO, &entries).run(&[]).failed(3, words);
    };
    failed(
        &entry("/dev/no-such-port"),
        &["node 2: the serial port /dev/no-such-port does not exist", "plugged in?"],
    );
    failed(
        &entry("/dev/null"),
        &["node 2: the serial port /dev/null cannot be opened", "Is it a serial port?"],
    );
    failed(
        "usb_serial = \"NOSUCH\"",
        &["node 2: the serial port with the USB serial number NOSUCH is not there"],
    );
    let held = serialport::new(boards[1].path.as_str(), 115_200).open_native().unwrap();
    failed(&entry(&boards[1].path), &["node 2: the serial port", "is in use", "end that first"]);
    drop(held);
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("port");
    std::os::unix::fs::symlink(&boards[0].path, &link).unwrap();
    // The same port by another name is a mistake of the file, which is found before any is opened.
    entries[1] = entry(link.to_str().unwrap());
    let twice = Bench::new(SCENARIO, &entries).run(&[]);
    twice.failed(2, &["node 2: the serial port", "is that of node 1: each node needs a port of its own"]);
    assert_eq!(boards.map(Board::end), [None; 3]);
}

#[test]
fn a_bench_file_that_does_not_fit_is_code_2() {
    let twice = vec![entry("/dev/pts/0"); 3];
    Bench::new(SCENARIO, &twice)
        .run(&[])
        .failed(2, &["bench.toml:8:10: node.2.serial", "node 1 has it already"]);
    Bench::new(SCENARIO, &twice[..1]).run(&[]).failed(2, &["no [[node]] with id 2, 3, which"]);
}

#[test]
fn the_list_shows_who_answers_and_who_does_not() {
    let [first, second] = [Board::good(0xABC), Board::start(2, Box::new(|_| Act::Send))];
    let bench = Bench::new(SCENARIO, &[entry(&first.path), entry(&second.path), entry("/dev/no-such-port")]);
    second.end();
    let mut command = Command::new(env!("CARGO_BIN_EXE_sim-host"));
    command.args(["bench", "--list", "--bench"]).arg(bench.path("bench.toml"));
    let output = command.output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success());
    let answer = format!(
        "{}  uid = \"0000000000000abc\"  firmware 0.1.0, wire version 3, blank, last reset: unknown, starts: 0\n",
        first.path
    );
    assert!(text.contains(&answer), "{text}");
    assert!(text.contains("/dev/no-such-port  does not exist\n"), "{text}");
    first.end();
}

/// An emulator whose UART is a pseudo-terminal; dropping it ends it.
struct Emulated {
    child: Child,
    log: NamedTempFile,
    path: String,
}

impl Emulated {
    fn start() -> Self {
        assert!(repository().join(IMAGE).is_file(), "no image at {IMAGE}: ./ci.sh parity builds it");
        let log = NamedTempFile::new().unwrap();
        let mut command = Command::new("qemu-system-arm");
        command.current_dir(repository()).args(["-M", "mps2-an386", "-display", "none", "-monitor", "none"]);
        command.args(["-kernel", IMAGE, "-chardev", "pty,id=uart", "-serial", "chardev:uart"]);
        command.args(["-semihosting-config", "enable=on,target=native"]).stdin(Stdio::null());
        command.stdout(log.reopen().unwrap()).stderr(Stdio::null());
        let mut emulated = Self { child: command.spawn().unwrap(), log, path: String::new() };
        wait("a pseudo-terminal", || emulated.said().is_some());
        emulated.path = emulated.said().unwrap().0;
        emulated
    }

    /// The terminal that it says its UART is, and the bytes of the node's log after that line.
    fn said(&self) -> Option<(String, Vec<u8>)> {
        let bytes = fs::read(self.log.path()).unwrap();
        let end = bytes.iter().position(|&byte| byte == b'\n')?;
        let line = String::from_utf8_lossy(&bytes[..end]).into_owned();
        let path = line.split_once("redirected to ")?.1.split_once(' ')?.0;
        Some((path.to_owned(), bytes[end + 1..].to_vec()))
    }

    /// Waits until it ticks: it has heard a neighbour.
    fn wait_until_running(&self) {
        let image = fs::read(repository().join(IMAGE)).unwrap();
        wait("ticks", || decode_log(&image, &self.said().unwrap().1).contains("hears node"));
        // Some of them, so that there is something to record.
        std::thread::sleep(Duration::from_millis(100));
    }
}

impl Drop for Emulated {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The five agents for 2,000 ticks, without expectations.
fn five() -> String {
    let text = fs::read_to_string(repository().join("scenarios/five-agents.toml")).unwrap();
    let text =
        text.replace("duration = \"20s\"", "duration = \"2s\"").replace("reference_error = 1e-3\n", "");
    assert!(text.contains("\"2s\"") && !text.contains("reference_error"));
    text
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn five_emulated_nodes_behind_pseudo_terminals_run_the_bits_of_loopback() {
    let nodes: Vec<_> = (0..5).map(|_| Emulated::start()).collect();
    let entries: Vec<_> = nodes.iter().map(|node| entry(&node.path)).collect();
    let bench = Bench::new(&five(), &entries).patient();
    let ended = bench.run(&[]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let summary = bench.summary();
    assert_eq!((&summary["ticks"], &summary["bench"]["bit_for_bit"]), (&2000.into(), &true.into()));
    assert_eq!(summary["trace_hash"], loopback_hash(&bench.path("scenario.toml")));
    assert_eq!(summary["bench"]["nodes"].as_array().unwrap().len(), 5);
}

/// All edges of the five agents' graph.
const RING: [&str; 5] = ["[1, 2]", "[2, 3]", "[3, 4]", "[4, 5]", "[5, 1]"];

/// The five agents on emulators of the bench's own, some of them wired to each other.
fn wired(wires: &[&str], head: &str, settings: &[&str]) -> serde_json::Value {
    let mut entries = vec!["emulator = true".to_owned(); 5];
    entries.last_mut().unwrap().push('\n');
    entries.last_mut().unwrap().extend(wires.iter().map(|ids| format!("[[wire]]\nbetween = {ids}\n")));
    let bench = Bench::new(&five(), &entries).patient().with(head);
    let sets = settings.iter().flat_map(|setting| ["--set", setting]);
    let ended = bench.run(&["--image", IMAGE].into_iter().chain(sets).collect::<Vec<_>>());
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert!(ended.out.contains(" from node to node, "), "{}", ended.out);
    bench.summary()
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn a_ring_of_wires_between_emulators_runs_the_bits_of_loopback() {
    let summary = wired(&RING, "settle = \"100ms\"", &["time.duration=100ms"]);
    let wires = &summary["bench"]["wires"];
    assert_eq!((&wires["count"], &wires["settle_s"]), (&5.into(), &0.1.into()));
    assert_eq!(
        (&wires["extrapolated"], &summary["bench"]["bit_for_bit"]),
        (&0.into(), &true.into()),
        "{summary}"
    );
    assert_eq!(summary["bench"]["nodes"][0]["unreadable"], 0);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn wires_and_relayed_states_can_be_mixed() {
    let summary = wired(&["[1, 2]", "[3, 4]"], "settle = \"100ms\"", &["time.duration=60ms"]);
    assert_eq!(summary["bench"]["wires"]["extrapolated"], 0, "{summary}");
    assert_eq!(summary["bench"]["bit_for_bit"], true, "{summary}");
}

/// Whether a SYNC overtakes a state then is up to the machine; that is seen or it has not happened.
#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn states_without_time_to_settle_are_counted_where_they_come_too_late() {
    let summary = wired(&RING, "settle = \"1ns\"", &["time.duration=500ms"]);
    let wires = &summary["bench"]["wires"];
    let none_late = (&wires["extrapolated"], &wires["late"]) == (&0.into(), &0.into());
    assert_eq!(summary["bench"]["bit_for_bit"], none_late, "{summary}");
}

/// Emulators share a busy computer, so states may be late; without the wires each node would go its own way.
#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn a_ring_of_wires_between_emulators_runs_by_clocks_of_its_own() {
    let summary = wired(&RING, "clock = \"own\"", &["time.tick=20ms", "time.duration=2s"]);
    let (ticks, bench) = (100, &summary["bench"]);
    assert_eq!(
        (&summary["ticks"], &summary["stopped"]),
        (&ticks.into(), &serde_json::json!([])),
        "{summary}"
    );
    assert_eq!((&bench["wires"]["count"], &bench["wires"]["settle_s"]), (&5.into(), &0.0.into()));
    // A neighbour that was never heard is not extrapolated.
    let late = bench["wires"]["extrapolated"].as_u64().unwrap();
    assert!(late < 5 * 2 * ticks / 4, "{summary}");
    let deviations = bench["nodes"].as_array().unwrap().iter().map(|node| node["largest_deviation"].as_f64());
    assert!(deviations.flatten().all(|deviation| deviation < 1.0), "{summary}");
}

#[test]
fn between_nodes_that_are_wired_to_each_other_nothing_is_relayed() {
    let boards = three();
    let mut entries: Vec<_> = boards.iter().map(|board| entry(&board.path)).collect();
    // Played boards have one line each, so this wire carries nothing.
    entries[2].push_str("\n[[wire]]\nbetween = [1, 2]");
    let bench = Bench::new(SCENARIO, &entries);
    let ended = bench.run(&["--set", "bus.loss=0.1"]);
    ended
        .fell_short(&["whose lines are real: bus.loss", "failed: heard: no neighbour has ever heard node 1"]);
    let summary = bench.summary();
    assert_eq!(summary["bench"]["wires"]["count"], 1);
    let first = |node: usize| summary["bench"]["nodes"][node]["first_difference"].clone();
    assert_eq!((first(0), first(1)), (0.into(), 0.into()), "{summary}");
}

#[test]
fn a_wire_that_is_no_edge_is_refused_before_any_node_is_touched() {
    let boards = three();
    let mut entries: Vec<_> = boards.iter().map(|board| entry(&board.path)).collect();
    entries[2].push_str("\n[[wire]]\nbetween = [1, 3]");
    let bench = Bench::new(SCENARIO, &entries);
    for child in [bench.spawn(&[]), bench.spawn_commission(&[])] {
        end(child).failed(2, &["bench.toml:", "wire.between = [1, 3]: must be an edge", "has none between"]);
    }
    assert_eq!(boards.map(Board::end), [None; 3]);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn emulators_of_its_own_and_terminals_can_be_mixed() {
    let nodes: Vec<_> = (0..2).map(|_| Emulated::start()).collect();
    let own = "emulator = true".to_owned();
    let entries = [entry(&nodes[0].path), own.clone(), entry(&nodes[1].path)];
    let bench = Bench::new(SCENARIO, &entries).patient();
    let ended = bench.run(&["--image", IMAGE]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    assert_eq!(bench.summary()["bench"]["bit_for_bit"], true);
    assert!(bench.path("out/node-2.log").is_file() && !bench.path("out/node-1.log").exists());
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn an_emulated_node_that_is_killed_is_named_and_the_others_stop() {
    let mut nodes: Vec<_> = (0..3).map(|_| Emulated::start()).collect();
    let entries: Vec<_> = nodes.iter().map(|node| entry(&node.path)).collect();
    let bench = Bench::new(SCENARIO, &entries);
    let child = bench.spawn(&["--set", "time.duration=10min"]);
    nodes.iter().for_each(Emulated::wait_until_running);
    nodes[1].child.kill().unwrap();
    let ended = end(child);
    let place = format!("the serial port {} of node 2 ended", nodes[1].path);
    ended.fell_short(&[&place, "stopped: 1, 3; told to stop, but did not confirm it: 2"]);
    assert!(ended.took < AT_ONCE, "{:?}", ended.took);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn an_emulated_node_whose_host_program_dies_stops_by_itself() {
    let nodes: Vec<_> = (0..3).map(|_| Emulated::start()).collect();
    let entries: Vec<_> = nodes.iter().map(|node| entry(&node.path)).collect();
    let bench = Bench::new(SCENARIO, &entries);
    let running = || nodes.iter().for_each(Emulated::wait_until_running);
    let faults = orphaned(&bench, &nodes[1].path, running, &[]);
    let [(FaultCode::HOLDOVER, after)] = faults[..] else { panic!("{faults:?}") };
    assert!(after > Duration::from_secs(1), "{after:?}");
}
