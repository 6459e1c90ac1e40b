//! An undisturbed frame is one step, all else goes bit by bit. Both ways are the same bus: random traffic
//! gives the same events, whether undisturbed frames go in one step or not.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod support;

use funnelnet_can_bus::{
    BitErrors, BitRate, Bus, Counters, Event, Filter, Frame, Hit, Id, Mode, Noise, Order, SeenBy, Timing,
    What,
};
use proptest::prelude::*;
use support::Random;

/// What is compared: all but the time of a lost arbitration, which an undisturbed frame reports at its start,
/// and what follows from the order.
fn comparable(events: &[Event]) -> Vec<(u64, usize, String)> {
    let mut lines: Vec<_> = events
        .iter()
        .map(|event| {
            let lost = matches!(event.what, What::LostArbitration { .. });
            (if lost { 0 } else { event.at }, event.node, format!("{:?}", event.what))
        })
        .collect();
    lines.sort();
    lines
}

struct Outcome {
    events: Vec<Event>,
    busy_ns: u64,
    counters: Vec<Counters>,
}

#[derive(Clone, Copy, Debug)]
struct Load {
    seed: u64,
    nodes: usize,
    fd: bool,
    /// Bit errors in a billion.
    errors: u32,
    local: bool,
    /// Mean time between two frames, bits.
    gap: u64,
}

fn noise(load: Load) -> Box<dyn FnMut() -> Option<Hit>> {
    let mut random = Random(load.seed ^ 0xABCD);
    let number = move || random.next();
    let mut errors = if load.local {
        BitErrors::at_one_of(load.nodes, load.errors, number)
    } else {
        BitErrors::on_the_bus(load.errors, number)
    }
    .unwrap();
    Box::new(move || errors.next())
}

fn run(load: Load, bit_by_bit: bool) -> Outcome {
    let rate = |rate, sample| BitRate::new(rate, sample).unwrap();
    let timing = if load.fd {
        Timing::fd(rate(500_000, 875), rate(2_000_000, 800)).unwrap()
    } else {
        Timing::classic(rate(500_000, 875))
    };
    let mut bus = Bus::new(timing, noise(load));
    bus.bit_by_bit(bit_by_bit);
    for node in 0..load.nodes {
        bus.add(if node % 2 == 0 { Order::Priority } else { Order::Fifo }, Filter::everything());
    }
    let mut random = Random(load.seed);
    let mut events = Vec::new();
    let mut now = 0;
    for _ in 0..400 {
        now += random.below(2 * load.gap * 2000);
        bus.advance(now, &mut |event| events.push(event));
        let node = random.below(load.nodes as u64) as usize;
        let frame = if load.fd && random.below(2) == 0 { random.fd() } else { random.classic() };
        // One identifier in eight is shared, and collides.
        let frame =
            if random.below(8) == 0 { Frame::data(Id::Base(7), &[node as u8]).unwrap() } else { frame };
        let _full = bus.send(node, frame);
        match random.below(40) {
            0 => bus.cancel(node),
            1 => bus.restart(node),
            _ => {}
        }
        for node in 0..load.nodes {
            while bus.receive(node).is_some() {}
        }
    }
    bus.advance(now + 20_000_000, &mut |event| events.push(event));
    let counters = (0..load.nodes).map(|node| bus.counters(node)).collect();
    Outcome { events, busy_ns: bus.busy_ns(), counters }
}

fn loads() -> impl Strategy<Value = Load> {
    let errors = prop_oneof![Just(0_u32), Just(100_000), Just(1_000_000), Just(10_000_000)];
    (any::<u64>(), 2..7_usize, any::<bool>(), errors, any::<bool>(), 20..400_u64)
        .prop_map(|(seed, nodes, fd, errors, local, gap)| Load { seed, nodes, fd, errors, local, gap })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn one_step_and_bit_by_bit_are_the_same(load in loads()) {
        let (step, bits) = (run(load, false), run(load, true));
        let (these, those) = (comparable(&step.events), comparable(&bits.events));
        let difference = these.iter().zip(&those).find(|(this, that)| this != that);
        prop_assert!(difference.is_none(), "{:#?}", difference);
        prop_assert_eq!(these.len(), those.len());
        prop_assert_eq!(step.busy_ns, bits.busy_ns);
        prop_assert_eq!(step.counters, bits.counters);
    }
}

/// The comparison above sees all that can happen: without this it could agree on nothing.
#[test]
fn the_traffic_of_the_comparison_has_everything_in_it() {
    let mut events = Vec::new();
    for seed in 0..40 {
        let errors = [0, 1_000_000, 10_000_000][seed as usize % 3];
        let load = Load { seed, nodes: 4, fd: seed % 2 == 0, errors, local: seed % 5 == 0, gap: 60 };
        events.extend(run(load, false).events);
    }
    let has = |what: &dyn Fn(&What) -> bool| assert!(events.iter().any(|event| what(&event.what)));
    has(&|what| matches!(what, What::Sent { errors: 0, .. }));
    has(&|what| matches!(what, What::Sent { errors: 3.., .. }));
    has(&|what| matches!(what, What::Received { .. }));
    has(&|what| matches!(what, What::LostArbitration { to: Some(_), .. }));
    has(&|what| matches!(what, What::Overload));
    has(&|what| matches!(what, What::Error { sender: false, .. }));
    for mode in [Mode::Active, Mode::Passive, Mode::Off] {
        has(&|what| matches!(what, What::Mode { mode: now, .. } if *now == mode));
    }
}

/// A source that a test writes by hand: bits to the next hit, and who reads it.
#[test]
fn a_script_is_a_source_of_noise() {
    let mut script = [Hit { after: 5, seen_by: SeenBy::All }].into_iter();
    let mut noise = move || script.next();
    assert_eq!(Noise::next(&mut noise), Some(Hit { after: 5, seen_by: SeenBy::All }));
    assert_eq!(Noise::next(&mut noise), None);
}
