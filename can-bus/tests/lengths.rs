//! Lengths and bits of random frames against two judges that know nothing of this crate: can-utils, and a
//! Python program that was written from the text of the standard.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "helpers of tests, which clippy does not know as such"
)]

mod support;

use funnelnet_can_bus::length::INTERMISSION;
use funnelnet_can_bus::{Frame, Kind, Length, Wire};
use std::io::Write as _;
use std::process::{Command, Stdio};
use support::{Random, line};

const FRAMES: usize = 100_000;
/// Frames of a block, of which a hash of can-utils' lengths is kept.
const BLOCK: usize = 10_000;
/// FNV-1a hashes of the lengths of ten blocks as `cfl_exact` of can-utils gives them (commit 95aae6b of
/// 2026-05-12). To compute them anew:
/// `CAN_UTILS=<folder with canframelen.c> cargo test -p funnelnet-can-bus --test lengths -- --ignored --nocapture`.
const BY_CAN_UTILS: [u64; FRAMES / BLOCK] = [
    0x7d37_cc80_8a77_8998,
    0x057f_5770_2982_9f74,
    0xda5e_084a_be40_ce6b,
    0x52d7_402d_af5c_d43d,
    0x2da7_6dc5_892d_0b3a,
    0xda49_51fb_4033_8339,
    0xf67d_4721_358e_7cea,
    0x35ad_c70c_f808_7710,
    0x240d_a620_ecba_b385,
    0xca66_609a_fda5_eb21,
];

fn classic_frames() -> impl Iterator<Item = Frame> {
    let mut random = Random(15);
    std::iter::repeat_with(move || random.classic())
}

/// can-utils counts the data that a remote frame asks for, which are not on the bus: of remote frames it
/// judges those of length 0.
fn frames_for_can_utils() -> Vec<Frame> {
    classic_frames()
        .filter(|frame| frame.kind() != Kind::Remote || frame.length() == 0)
        .take(FRAMES)
        .collect()
}

/// Frames, and whether their sender is passive.
fn fd_frames() -> Vec<(Frame, bool)> {
    let mut random = Random(1721);
    (0..FRAMES).map(|_| (random.fd(), random.below(2) == 0)).collect()
}

fn hashes(lengths: &[u32]) -> Vec<u64> {
    let hash = |block: &[u32]| {
        block.iter().fold(0xCBF2_9CE4_8422_2325, |hash: u64, &length| {
            (hash ^ u64::from(length)).wrapping_mul(0x0000_0100_0000_01B3)
        })
    };
    lengths.chunks(BLOCK).map(hash).collect()
}

/// What a program prints for these lines.
fn judged(program: &mut Command, lines: Vec<String>) -> Vec<String> {
    let mut child = program.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the judge starts");
    let mut input = child.stdin.take().unwrap();
    let writer = std::thread::spawn(move || input.write_all((lines.join("\n") + "\n").as_bytes()));
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap().lines().map(String::from).collect()
}

fn python(lines: Vec<String>) -> Vec<String> {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/judge/frames.py");
    judged(Command::new("python3").arg(script), lines)
}

/// The bits as the Python judge writes them, and what the judge's text says of the length.
fn compare(frames: &[(Frame, bool)]) {
    let texts = python(frames.iter().map(|(frame, passive)| line(frame, *passive)).collect());
    assert_eq!(texts.len(), frames.len());
    for ((frame, passive), text) in frames.iter().zip(&texts) {
        let judge: Vec<bool> = text.chars().map(|bit| matches!(bit, '1' | '^')).collect();
        let wire = Wire::of(frame, *passive);
        assert_eq!(wire.levels().collect::<Vec<_>>(), judge, "{frame:?}");
        let length = Length::of(frame, *passive);
        let fast = text.chars().filter(|bit| matches!(bit, '_' | '^')).count();
        // The judge counts the slot, its delimiter and the end as fast as the rest of its text says: nominal.
        assert_eq!(length.fast as usize, fast, "{frame:?}");
        assert_eq!(length.bits(), text.len() as u32 + INTERMISSION, "{frame:?}");
        assert_eq!(length.stuffed as usize, wire.stuffed(), "{frame:?}");
    }
}

#[test]
fn classic_lengths_are_those_of_can_utils() {
    let lengths: Vec<u32> =
        frames_for_can_utils().iter().map(|frame| Length::of(frame, false).bits()).collect();
    assert_eq!(hashes(&lengths), BY_CAN_UTILS);
}

#[test]
fn classic_bits_are_those_of_the_python_judge() {
    compare(&classic_frames().take(FRAMES).map(|frame| (frame, false)).collect::<Vec<_>>());
}

#[test]
fn fd_bits_are_those_of_the_python_judge() {
    let frames = fd_frames();
    // The trap: five equal bits right before the stuff count. It must be there often, or the judge judges
    // nothing.
    let ends_in_run = |frame: &Frame| matches!(frame.bytes().last(), Some(0x00 | 0xFF));
    assert!(frames.iter().filter(|(frame, _)| ends_in_run(frame)).count() > FRAMES / 5);
    compare(&frames);
}

#[test]
#[ignore = "needs can-utils' source in the folder that CAN_UTILS names"]
fn can_utils_says_the_same_now() {
    let source = std::env::var("CAN_UTILS").expect("CAN_UTILS names a folder with canframelen.c");
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR"));
    let program = folder.join("can_utils");
    let judge = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/judge/can_utils.c");
    let status =
        Command::new("cc").arg("-I").arg(source).arg(judge).arg("-o").arg(&program).status().unwrap();
    assert!(status.success());
    let frames = frames_for_can_utils();
    let printed = judged(&mut Command::new(program), frames.iter().map(|frame| line(frame, false)).collect());
    let lengths: Vec<u32> = printed.iter().map(|length| length.parse().unwrap()).collect();
    for (frame, length) in frames.iter().zip(&lengths) {
        assert_eq!(Length::of(frame, false).bits(), *length, "{frame:?}");
    }
    println!("{:#018x?}", hashes(&lengths));
    assert_eq!(hashes(&lengths), BY_CAN_UTILS);
}
