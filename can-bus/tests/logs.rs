//! Logs of a bus with errors in it, as other people's programs read them. They are not everywhere:
//! `cargo test -p funnelnet-can-bus --features pcapng --test logs -- --ignored` needs can-utils and tshark.
#![cfg(feature = "pcapng")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_can_bus::{BitRate, Bus, Capture, Filter, Frame, Hit, Id, Line, Order, Record, SeenBy, Timing};
use std::io::Write as _;
use std::process::{Command, Stdio};

/// A frame of each kind, the second one disturbed.
fn records() -> Vec<Record> {
    let rate = |rate, sample| BitRate::new(rate, sample).unwrap();
    let mut hits = [Hit { after: 150, seen_by: SeenBy::All }].into_iter();
    let timing = Timing::fd(rate(500_000, 875), rate(2_000_000, 800)).unwrap();
    let mut bus = Bus::new(timing, move || hits.next());
    for _ in 0..2 {
        bus.add(Order::Fifo, Filter::nothing());
    }
    let frames = [
        Frame::data(Id::Base(0x185), &[0, 0, 0xC0, 0x3F, 0xE8]),
        Frame::data(Id::Extended(0x1234), &[1, 2, 3, 4, 5, 6, 7, 8]),
        Frame::remote(Id::Base(0x7FF), 4),
        Frame::fd(Id::Base(0x585), &[0xAB; 12], true),
        Frame::fd(Id::Extended(0x1FFF_FFFF), &[0xCD; 64], false),
    ];
    let mut records = Vec::new();
    for (at, frame) in (0..).zip(frames) {
        bus.advance(at * 5_000_000 + 123, &mut |event| records.extend(Record::of_event(&event)));
        assert!(bus.send(0, frame.unwrap()));
    }
    bus.advance(50_000_000, &mut |event| records.extend(Record::of_event(&event)));
    records
}

fn piped(program: &mut Command, input: &[u8]) -> Vec<String> {
    let mut child = program.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(input).unwrap();
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap().lines().map(str::trim).map(String::from).collect()
}

#[test]
#[ignore = "needs can-utils"]
fn can_utils_reads_every_line() {
    let records = records();
    let lines: Vec<String> =
        records.iter().map(|record| Line { interface: "can0", record }.to_string()).collect();
    let long = piped(&mut Command::new("log2long"), (lines.join("\n") + "\n").as_bytes());
    assert_eq!(long.len(), lines.len());
    let has = |text: &str| assert!(long.iter().any(|line| line.contains(text)), "{text}: {long:#?}");
    has("185   [5]  00 00 C0 3F E8");
    has("00001234   [8]  01 02 03 04 05 06 07 08");
    has("7FF   [4]  remote request");
    has("585  [12]  AB AB AB AB AB AB AB AB AB AB AB AB");
    has("1FFFFFFF  [64]  CD CD");
    has("ERRORFRAME");
}

#[test]
#[ignore = "needs tshark"]
fn wireshark_reads_every_packet_with_its_nanoseconds() {
    let records = records();
    let mut capture = Capture::new(Vec::new(), &["can0"]).unwrap();
    records.iter().for_each(|record| capture.write(0, record).unwrap());
    let fields = [
        "frame.time_epoch",
        "can.id",
        "can.flags.xtd",
        "can.flags.rtr",
        "can.flags.err",
        "can.len",
        "frame.interface_name",
    ];
    let mut tshark = Command::new("tshark");
    tshark.args(["-r", "-", "-T", "fields", "-E", "separator=;"]);
    for field in fields {
        tshark.args(["-e", field]);
    }
    let rows = piped(&mut tshark, &capture.into_inner());
    assert_eq!(rows.len(), records.len());
    for (record, row) in records.iter().zip(&rows) {
        let time = format!("{}.{:09}", record.at / 1_000_000_000, record.at % 1_000_000_000);
        assert!(row.starts_with(&time), "{row}: {time}");
        assert!(row.ends_with(";can0"), "{row}");
        assert!(row.contains(&format!(";{};can0", record.length)), "{row}");
    }
}
