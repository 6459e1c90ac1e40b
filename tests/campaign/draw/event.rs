//! Events: one line each, of one or two events that belong together.

use super::settings::Limits;
use super::{Dice, Net};

/// A time for an event, and how long it lasts, ms.
struct When {
    at_us: usize,
    lasts_ms: usize,
}

impl When {
    /// Most events are at a tick. All is over 800 ms before the end.
    fn drawn(dice: &mut Dice) -> Self {
        let between_ticks = if dice.is(0.2) { dice.below(1_000) } else { 0 };
        Self { at_us: 1_000 * (300 + dice.below(1_000)) + between_ticks, lasts_ms: 1 + dice.below(300) }
    }

    fn event(&self, kind: &str, rest: &str) -> String {
        format!("[[event]]\nat = \"{}us\"\nkind = \"{kind}\"\n{rest}", self.at_us)
    }

    fn lasting(&self, kind: &str, rest: &str) -> String {
        self.event(kind, &format!("for = \"{}ms\"\n{rest}", self.lasts_ms))
    }

    /// The same for half of the time.
    fn short(&self, kind: &str, rest: &str) -> String {
        self.event(kind, &format!("for = \"{}us\"\n{rest}", 500 * self.lasts_ms))
    }

    /// A second event when that time is over.
    fn then(&self, first: &str, kind: &str, rest: &str) -> String {
        let later = Self { at_us: self.at_us + 1_000 * self.lasts_ms, ..*self };
        format!("{first}\n{}", later.event(kind, rest))
    }
}

/// One event of any kind that the bus may have.
pub(super) fn event(dice: &mut Dice, net: &Net) -> String {
    let when = When::drawn(dice);
    match dice.below(22) {
        0..=4 => of_nodes(dice, net, &when),
        5..=9 => of_frames(dice, net, &when),
        10 | 11 => of_wires(dice, net, &when),
        12..=14 => of_lies(dice, net, &when),
        15 | 16 => of_plants(dice, net, &when),
        17..=20 => set(dice, net, &when),
        _ => of_clocks(dice, net),
    }
}

/// Nodes go and come, links are cut and mended.
fn of_nodes(dice: &mut Dice, net: &Net, when: &When) -> String {
    let node = format!("node = {}", dice.id(net.nodes));
    match dice.below(9) {
        0 | 1 => when.lasting("bounce", &node),
        2 => when.event("crash", &node),
        3 => when.event("leave", &node),
        4 => when.then(&when.event("crash", &node), "join", &node),
        5 => when.then(&when.event("leave", &node), "join", &node),
        // Absent from the start, if nothing else happens to it before.
        6 => when.event("join", &node),
        7 => {
            let (a, b) = net.edge(dice);
            let link = format!("link = [{a}, {b}]");
            when.then(&when.event("partition", &link), "repair", &link)
        }
        _ => {
            let ids: Vec<_> = (1..=net.nodes).collect();
            let (left, right) = ids.split_at(net.nodes / 2);
            let groups = format!("groups = [{left:?}, {right:?}]");
            when.then(&when.event("partition", &groups), "repair", "")
        }
    }
}

/// Frames are lost, held, let go or read wrong: on a link, on those of a node, or on all.
fn of_frames(dice: &mut Dice, net: &Net, when: &When) -> String {
    let (a, b) = net.edge(dice);
    let place = match dice.below(4) {
        0 => String::new(),
        1 => format!("node = {a}\n"),
        _ => format!("link = [{a}, {b}]\n"),
    };
    match dice.below(5) {
        0 => when.lasting("burst", &format!("{place}loss = {}", dice.between(0.1, 1.0))),
        1 => when.lasting("burst", &format!("{place}loss = {{ to_bad = 0.05, to_good = 0.1 }}")),
        2 => when.lasting("hold", &place),
        3 => when.then(&when.event("hold", &place), "release", &place),
        _ => when.lasting("corrupt", &format!("{place}probability = {}", dice.between(0.01, 0.3))),
    }
}

/// The wire of a CAN bus.
fn of_wires(dice: &mut Dice, net: &Net, when: &When) -> String {
    let node = format!("node = {}", dice.id(net.nodes));
    match dice.below(4) {
        0 => when.lasting("noise", &format!("bit_errors = {}", dice.between(0.001, 0.02))),
        1 => when.lasting("cut", &node),
        2 => when.event("short", &format!("for = \"{}us\"", 100 + dice.below(5_000))),
        _ => when.lasting("babble", &format!("{node}\nid = {}", dice.below(2) * 2047)),
    }
}

/// Nodes that say what is not so.
fn of_lies(dice: &mut Dice, net: &Net, when: &When) -> String {
    let node = format!("node = {}", dice.id(net.nodes));
    let says = said(dice);
    match dice.below(4) {
        0 => when.lasting("replayer", &format!("{node}\nage = \"{}ms\"", 1 + dice.below(300))),
        1 => when.lasting("impostor", &format!("{node}\nas = {}\n{says}", dice.id(net.nodes))),
        _ => when.lasting("liar", &format!("{node}\n{says}")),
    }
}

fn said(dice: &mut Dice) -> String {
    match dice.below(4) {
        0 => format!("constant = {}", dice.between(-5.0, 5.0)),
        1 => format!("ramp = {}", dice.between(-5.0, 5.0)),
        2 => format!("ramp = {}", dice.between(-100.0, 100.0)),
        _ => format!("offset = {}", dice.between(-2.0, 2.0)),
    }
}

/// A lie, and in most worlds what ends the distrust of neighbours with limits: a new start, short or long, or a long silence.
pub(super) fn lie_and_new_start(dice: &mut Dice, net: &Net, limits: &Limits) -> Vec<String> {
    let liar = dice.id(net.nodes);
    let node = format!("node = {liar}");
    let when = When { at_us: 1_000 * (300 + dice.below(300)), lasts_ms: 30 + dice.below(300) };
    let mut lines = vec![when.lasting("liar", &format!("{node}\n{}", said_near(dice, limits)))];
    let over_us = when.at_us + 1_000 * (when.lasts_ms + 1 + dice.below(100));
    let long = When { at_us: over_us, lasts_ms: 130 + dice.below(170) };
    let short = When { lasts_ms: 1 + dice.below(120), ..long };
    match dice.below(5) {
        0 => lines.push(long.lasting("bounce", &node)),
        1 | 2 => lines.push(short.lasting("bounce", &node)),
        3 => {
            let others: Vec<_> = (1..=net.nodes).filter(|&id| id != liar).collect();
            let groups = format!("groups = [[{liar}], {others:?}]");
            lines.push(long.then(&long.event("partition", &groups), "repair", ""));
        }
        _ => {}
    }
    if dice.is(0.3) {
        let (a, b) = net.edge(dice);
        let gap = When { at_us: 1_000 * (100 + dice.below(1_000)), lasts_ms: 2 + dice.below(60) };
        lines.push(gap.lasting("burst", &format!("link = [{a}, {b}]\nloss = 1.0")));
    }
    lines
}

/// What a liar says where there are limits: in most worlds not far from what they allow.
fn said_near(dice: &mut Dice, limits: &Limits) -> String {
    let sign = if dice.is(0.5) { 1.0 } else { -1.0 };
    let rate = limits.rate.unwrap_or(30.0);
    match dice.below(4) {
        0 => said(dice),
        1 => format!("ramp = {:.3}", sign * rate * dice.between(0.5, 0.99)),
        2 => format!("ramp = {:.3}", sign * rate * dice.between(1.01, 2.0)),
        _ => format!("offset = {:.3}", sign * limits.limit.unwrap_or(3.0) * dice.between(0.5, 2.0)),
    }
}

/// Sensors and actuators that fail.
fn of_plants(dice: &mut Dice, net: &Net, when: &When) -> String {
    let node = format!("node = {}", dice.id(net.nodes));
    let (kind, fails) = match dice.below(8) {
        0 => ("sensor", said(dice)),
        1 => ("sensor", format!("noise = {}", dice.between(0.01, 0.5))),
        2 => ("sensor", format!("loss = {}", dice.between(0.05, 0.5))),
        3 => ("sensor", format!("age = \"{}ms\"", 1 + dice.below(50))),
        4 => ("actuator", format!("effectiveness = {}", dice.between(0.0, 0.9))),
        5 => ("actuator", format!("limit = {}", dice.between(0.1, 2.0))),
        6 => ("actuator", format!("constant = {}", dice.between(-5.0, 5.0))),
        _ => ("actuator", format!("ramp = {}", dice.between(-5.0, 5.0))),
    };
    when.lasting(kind, &format!("{node}\n{fails}"))
}

/// Nodes go on with something else.
fn set(dice: &mut Dice, net: &Net, when: &When) -> String {
    let (key, value) = match dice.below(7) {
        0 => ("coupling.gain", "{ kind = \"logarithmic\", scale = 2.0 }".to_owned()),
        1 => ("agent.limits", format!("{{ low = -{0}, high = {0} }}", dice.between(0.3, 3.0))),
        2 => ("agent.dynamics", format!("{{ kind = \"affine\", slope = {} }}", dice.between(-2.0, 0.0))),
        3 => ("agent.dynamics.offset", format!("{:?}", dice.between(-2.0, 2.0))),
        4 => ("coupling.damping", format!("{:?}", dice.between(2.3, 5.0))),
        5 => ("coupling.funnel.end", format!("{:?}", dice.between(0.05, 1.0))),
        _ => ("coupling.funnel", format!("{{ kind = \"constant\", width = {} }}", dice.between(0.1, 5.0))),
    };
    let change = format!("key = \"{key}\"\nvalue = {value}");
    // Who was off before has lost what was staged in it, and who goes after has it.
    let node = format!("node = {}", dice.id(net.nodes));
    match dice.below(5) {
        0 => return when.then(&when.short("bounce", &node), "set", &format!("{node}\n{change}")),
        1 => {
            return when.then(
                &when.event("set", &format!("{node}\n{change}")),
                "bounce",
                &format!("{node}\nfor = \"50ms\""),
            );
        }
        _ => {}
    }
    let of_one = if dice.is(0.5) { format!("node = {}\n", dice.id(net.nodes)) } else { String::new() };
    when.event("set", &format!("{of_one}{change}"))
}

/// Clocks that jump or drift, SYNC that do not go out, a time master that goes.
pub(super) fn of_clocks(dice: &mut Dice, net: &Net) -> String {
    let when = When::drawn(dice);
    let node = format!("node = {}", dice.id(net.nodes));
    match dice.below(if net.sync { 6 } else { 2 }) {
        0 => when.event("clock", &format!("{node}\nby = \"{}us\"", dice.below(2_000) as i64 - 1_000)),
        1 => when.event("clock", &format!("{node}\ndrift_ppm = {:?}", dice.between(-100.0, 100.0))),
        2 => when.lasting("sync-loss", ""),
        3 => when.lasting("sync-loss", "node = 1"),
        4 => when.event("crash", "node = 1"),
        _ => when.lasting("bounce", "node = 1"),
    }
}
