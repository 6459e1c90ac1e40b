//! Ways in which what is behind a serial port misbehaves, each with how `sim-host bench` ends: its exit code,
//! its words, and within what time. It never is a defect of the program (code 4), and it never hangs.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod boards;

use boards::{Act, Bench, Board, Ended, SCENARIO, Says, entry, second, terminal};
use funnelnet_node::Phase;
use funnelnet_protocol::WIRE_VERSION;
use funnelnet_protocol::message::{Command, Component, FaultCode, Message, NodeId, Target, TickStamp};
use funnelnet_protocol::serial::{self, HOST, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Identity, Reply};
use std::fs::{self, File};
use std::io::{Read, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// A device that is no board: what it does with its line, given what it has heard since the last time;
/// `false` unplugs it.
type Device = fn(&mut Line) -> bool;

/// The line of a device.
struct Line {
    port: File,
    heard: Vec<u8>,
    /// Times that it was looked at.
    round: u32,
}

impl Line {
    /// Says what there is room for.
    fn say(&mut self, bytes: &[u8]) -> bool {
        let _ = self.port.write(bytes);
        true
    }

    /// Says it as an answer: where something was heard.
    fn answer(&mut self, bytes: &[u8]) -> bool {
        if !self.heard.is_empty() {
            self.say(bytes);
        }
        true
    }
}

/// A device behind a pseudo-terminal.
struct Played {
    path: String,
    quit: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Played {
    fn start(device: Device) -> Self {
        let (port, path) = terminal();
        let quit = Arc::new(AtomicBool::new(false));
        let stop = quit.clone();
        let thread = std::thread::spawn(move || {
            let mut line = Line { port, heard: Vec::new(), round: 0 };
            while !stop.load(Ordering::Relaxed) {
                let mut bytes = [0; 1024];
                // An error: nothing has come, or nobody has opened the terminal.
                let length = line.port.read(&mut bytes).unwrap_or(0);
                line.heard = bytes[..length].to_vec();
                if !device(&mut line) {
                    return;
                }
                line.round += 1;
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        Self { path, quit, thread }
    }

    fn end(self) {
        self.quit.store(true, Ordering::Relaxed);
        self.thread.join().unwrap();
    }
}

/// An answer to HELLO, changed on its way.
fn identity(change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let identity = Identity { wire_version: WIRE_VERSION, uid: 1, ..Identity::default() };
    let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
    let length = serial::encode_service(&Reply::Identity(identity), HOST, &mut scratch, &mut frame).unwrap();
    let mut frame = frame[..length].to_vec();
    change(&mut frame);
    frame
}

/// Bytes that repeat after a while, and look random.
fn random(round: u32) -> Vec<u8> {
    let next = |x: &u32| Some(x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    std::iter::successors(Some(round), next).skip(1).take(100).map(|x| (x >> 24) as u8).collect()
}

/// As a terminal shows it.
fn shown(heard: &[u8]) -> Vec<u8> {
    let show = |&byte: &u8| if byte < 0x20 { vec![b'^', byte + 0x40] } else { vec![byte] };
    heard.iter().flat_map(show).collect()
}

const NO_IDENTITY: &str = "node 1 did not answer: no identity within 10 s";

/// Devices on which nobody says who they are; words that say why.
const STRANGERS: [(&str, Device, &[&str]); 14] = [
    ("silent", |_| true, &[NO_IDENTITY, "is its baud that of the bench file"]),
    ("echo", |line| line.answer(&line.heard.clone()), &[NO_IDENTITY, "the line echoes what is sent to it"]),
    ("terminal", |line| line.answer(&shown(&line.heard.clone())), &[NO_IDENTITY, "the line echoes"]),
    ("login", |line| line.answer(b"\r\nDebian 12 ttyS0\r\n\r\npi login: "), &[NO_IDENTITY, "a login prompt"]),
    (
        "text",
        |line| if line.round % 40 == 0 { line.say(b"temperature 21.5 C\r\n") } else { true },
        &[NO_IDENTITY, "text is on the line, which no node sends: ", "temperature 21.5 C\""],
    ),
    ("another bit rate", |line| line.say(&[0xD5; 64]), &[NO_IDENTITY, "on the line have no zero"]),
    ("zeros", |line| line.say(&[0; 64]), &[NO_IDENTITY, "nothing but zeros is on the line"]),
    (
        "noise",
        |line| line.say(&random(line.round)),
        &[NO_IDENTITY, "frames from it that could not be read: "],
    ),
    (
        "frames too long",
        |line| line.say(&[&[0xA5; 900][..], if line.round % 4 == 0 { &[0] } else { &[] }].concat()),
        &[NO_IDENTITY, "frames from it that could not be read: "],
    ),
    (
        "spoilt identity",
        |line| line.answer(&identity(|frame| frame[5] ^= 0x40)),
        &[NO_IDENTITY, "frames from it that could not be read: "],
    ),
    ("half an identity", |line| line.answer(&identity(|frame| frame.truncate(9))), &[NO_IDENTITY]),
    ("unplugged as it is asked", |line| line.heard.is_empty(), &["node 1", "ended"]),
    (
        "another wire version",
        |line| {
            let other = Identity { wire_version: WIRE_VERSION + 1, uid: 1, ..Identity::default() };
            let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
            let length =
                serial::encode_service(&Reply::Identity(other), HOST, &mut scratch, &mut frame).unwrap();
            line.answer(&frame[..length])
        },
        &["node 1", "wire version"],
    ),
    (
        "says who it is, and nothing else",
        |line| line.answer(&identity(|_| ())),
        &["node 1 did not answer", "within 1 s"],
    ),
];

/// Three of a kind: the first that does not answer ends it.
fn ended_by(device: Device) -> Ended {
    let devices = [device; 3].map(Played::start);
    let entries: Vec<_> = devices.iter().map(|device| entry(&device.path)).collect();
    let ended = Bench::new(SCENARIO, &entries).run(&[]);
    devices.into_iter().for_each(Played::end);
    ended
}

#[test]
fn what_is_no_node_is_said_to_be_none() {
    let cases =
        STRANGERS.map(|(name, device, words)| (name, words, std::thread::spawn(move || ended_by(device))));
    for (name, words, case) in cases {
        let Ended { code, out, err, took } = case.join().unwrap();
        println!("{name}: code {code:?} after {took:?}: {err}");
        assert_eq!((code, out.as_str()), (Some(3), ""), "{name}: {err}");
        for word in words {
            assert!(err.contains(word), "{name}: no '{word}' in: {err}");
        }
        assert!(took < Duration::from_secs(40), "{name}: {took:?}");
    }
}

#[test]
fn what_is_said_of_a_line_is_not_said_of_a_silent_one() {
    let ended = ended_by(|_| true);
    for word in ["echo", "login", "text", "zero", "could not be read"] {
        assert!(!ended.err.contains(word), "{word} in: {}", ended.err);
    }
}

fn id(id: u8) -> NodeId {
    NodeId::new(id).unwrap()
}

fn state(source: u8, tick: u32, x: f32) -> Message {
    Message::State { source: id(source), component: Component::FIRST, tick: TickStamp::full(tick), x }
}

/// Three boards whose second says what `lie` makes of it.
fn lying(lie: impl FnMut(Says) -> Vec<Says> + Send + 'static) -> [Board; 3] {
    [Board::good(1), Board::lying(2, lie), Board::good(3)]
}

/// What comes before the 51st state of the second board.
fn before(message: Message) -> [Board; 3] {
    let bytes = serial::encode(&message).to_vec();
    second(move || Act::Noise(bytes.clone()))
}

/// Boards whose second runs, and misbehaves on the way: how the bench ends, and words of it.
type Misbehaving = (&'static str, fn() -> [Board; 3], i32, &'static [&'static str]);

const BOARDS: [Misbehaving; 14] = [
    ("unplugged", || second(|| Act::Vanish), 1, &["node 2", "ended", "stopped: 1, 3;"]),
    ("hangs", || second(|| Act::Hang), 1, &["node 2 did not answer: no state within 5 s", "stopped: 1, 3;"]),
    ("floods", || second(|| Act::Flood), 1, &["node 2 did not answer: no state within 5 s", "no zero"]),
    (
        "babbles",
        || {
            let edge = Message::Edge { source: id(2), neighbour: id(1), weight: 1.0 };
            let bytes = serial::encode(&edge).to_vec();
            second(move || Act::Babble(bytes.clone()))
        },
        1,
        &["node 2 goes on speaking, but said no state of tick 49 within 5 s"],
    ),
    ("noise between frames", || second(|| Act::Noise(vec![0xA5, 0x5A, 0])), 0, &[]),
    (
        "noise into a frame",
        || second(|| Act::Noise(vec![0xA5; 60])),
        1,
        &["node 2 ran tick 49, but its state did not arrive", "could not be read: 1"],
    ),
    ("noise to the board", || second(|| Act::Hear(vec![0xA5; 60])), 0, &[]),
    ("prints in between", || second(|| Act::Noise(b"\r\n[12.345] watchdog: fed\r\n\0".to_vec())), 0, &[]),
    (
        "speaks as another node",
        || before(state(3, 50, 1.0)),
        1,
        &["node 2 spoke as another node: a state of node 3"],
    ),
    ("another tick", || before(state(2, 77, 1.0)), 1, &["node 2 sent a state of another tick: the stamp 77"]),
    (
        "two states of a tick",
        || before(state(2, 50, 1.0)),
        1,
        &["node 2 sent two states of one tick: 1 and "],
    ),
    (
        "a state that is not a number",
        || before(state(2, 50, f32::NAN)),
        1,
        &["node 2 sent what is not a number"],
    ),
    (
        "commands as the host does",
        || before(Message::Ctrl { target: Target::All, command: Command::Stop, arg: 0, at_tick: 0 }),
        0,
        &[],
    ),
    (
        "says everything twice",
        || lying(|said| vec![said.clone(), said]),
        1,
        &["failed: consistent: node 2 has a line that doubles frames: a state at tick 0, "],
    ),
];

/// Waits longer for answers: of a loaded computer that runs more than this test, boards that behave are late,
/// too.
fn patient(bench: &Bench) {
    let path = bench.path("bench.toml");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(path, text.replace("answer_within = \"1s\"", "answer_within = \"5s\"")).unwrap();
}

#[test]
fn a_board_that_misbehaves_on_the_way_is_named_in_time_and_the_others_are_stopped() {
    let begin = Instant::now();
    for (name, boards, code, words) in BOARDS {
        let boards = boards();
        let bench = Bench::of(&boards.each_ref());
        patient(&bench);
        let ended = bench.run(&[]);
        println!("{name}: code {:?} after {:?}: {}", ended.code, ended.took, ended.err);
        assert_eq!(ended.code, Some(code), "{name}: {}", ended.err);
        for word in words {
            assert!(ended.err.contains(word), "{name}: no '{word}' in: {}", ended.err);
        }
        assert!(ended.took < Duration::from_secs(40), "{name}: {:?}", ended.took);
        // By command, or by itself where a loaded computer was late.
        let is_over = |phase| matches!(phase, Some(Phase::Stopped | Phase::Faulted(FaultCode::HOLDOVER)));
        let [first, _, third] = boards.map(Board::end);
        assert!(is_over(first) && is_over(third), "{name}: {first:?}, {third:?}");
    }
    println!("{:?} in all", begin.elapsed());
}
