//! Several buses in one bench, with the host between them.

use super::{assert_same, decoded, frames, summary, text};
use funnelnet_protocol::message::{Command as Order, Message};
use std::fs;
use std::path::Path;

/// Neighbours on the ring 1 2 3 4 5: on the same bus, on two buses, on a bus and on a line.
pub fn write_benches(work: &Path) {
    let on = |id: u8, bus: &str| format!("[[node]]\nid = {id}\nhost = true\ncan = \"{bus}\"\n");
    let nodes = [on(1, "vcan0"), on(2, "vcan0"), on(3, "vcan1"), on(4, "vcan1")].concat();
    let file = format!("version = 1\ncan = [\"vcan1\", \"vcan0\"]\n{nodes}[[node]]\nid = 5\nhost = true\n");
    fs::write(work.join("two.toml"), file).unwrap();
}

pub fn two_buses_have_the_bits_of_loopback(work: &Path) {
    assert_eq!(text(work, "two.status").trim(), "0", "{}", text(work, "two.err"));
    let bench = &summary(work, "two")["bench"];
    assert_eq!(bench["bit_for_bit"], true, "{bench}");
    let log = text(work, "two/can.log");
    for (bus, candump) in [(0, "vcan1"), (1, "vcan0")].map(|(bus, name)| (bus, (name, &bench["can"][bus]))) {
        let (name, counts) = candump;
        let theirs = text(work, &format!("candump-two-{}.log", 1 - bus));
        let ours: Vec<_> = frames(&log).into_iter().filter(|frame| frame.starts_with(name)).collect();
        assert_same(&ours, &frames(&theirs));
        assert_eq!((&counts["interface"], &counts["frames"]), (&name.into(), &ours.len().into()));
        assert_eq!((&counts["strangers"], &counts["unreadable"]), (&0.into(), &0.into()), "{bench}");
        // States of those that are there, once each, and of neighbours elsewhere; the last one finds no tick
        // any more.
        let here = if name == "vcan0" { [602, 602, 601, 0, 601] } else { [0, 601, 602, 602, 601] };
        assert_eq!([1, 2, 3, 4, 5].map(|id| states(&ours, id)), here, "{name}");
        let starts = |frame: &&&str| matches!(decoded(frame), Message::Ctrl { command: Order::Start, .. });
        let syncs = |frame: &&&str| matches!(decoded(frame), Message::Sync { source: None, .. });
        assert_eq!((ours.iter().filter(starts).count(), ours.iter().filter(syncs).count()), (1, 601));
    }
}

fn states(frames: &[&str], id: u8) -> usize {
    let of = |frame: &&&str| matches!(decoded(frame), Message::State { source, .. } if source.get() == id);
    frames.iter().filter(of).count()
}
