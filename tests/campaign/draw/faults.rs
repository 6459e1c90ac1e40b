//! `[faults]`: events that the scenario draws itself.

use super::{Dice, Net};

/// Kinds that any bus but serial lines takes, those that need the wire of a CAN bus, and those of plants.
const ANYWHERE: [&str; 7] = ["bounce", "partition", "burst", "corrupt", "hold", "liar", "replayer"];
const OF_WIRES: [&str; 4] = ["noise", "cut", "short", "babble"];
const OF_PLANTS: [&str; 2] = ["sensor", "actuator"];

/// Some kinds, and how often. All is over 800 ms before the end.
pub(super) fn faults(dice: &mut Dice, net: &Net) -> String {
    let mut possible: Vec<&str> = Vec::new();
    if net.bus != "uart" {
        possible.extend(ANYWHERE);
    }
    if net.bus.starts_with("can") {
        possible.extend(OF_WIRES);
    }
    match (net.clocks, net.sync) {
        (false, _) => possible.extend(OF_PLANTS),
        (true, false) => possible.push("clock"),
        (true, true) => possible.extend(["clock", "sync-loss"]),
    }
    let mut kinds: Vec<&str> = possible.into_iter().filter(|_| dice.is(0.4)).collect();
    if kinds.is_empty() {
        kinds.push(if net.bus == "uart" { "sensor" } else { "burst" });
    }
    format!(
        "faults = {{ rate = {}, kinds = {kinds:?}, from = \"300ms\", to = \"1600ms\", shortest = \"{}ms\", longest = \"{}ms\", \
         offset = {:?}, loss = {:?} }}",
        dice.between(1.0, 8.0),
        1 + dice.below(20),
        50 + dice.below(200),
        dice.between(-1.5, 1.5),
        dice.between(0.3, 1.0)
    )
}
