//! Controllers that lose their power and get it again, on a bus whose frames go as a whole, and bit by bit.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod support;

use funnelnet_can_bus::{BitRate, Bus, Event, Filter, Frame, Id, Mode, Order, Quiet, Timing, What};
use support::Random;

/// Duration of a bit at 1 Mbit/s, ns.
const BIT: u64 = 1_000;

fn bus(nodes: usize, bit_by_bit: bool) -> Bus<Quiet> {
    let mut bus = Bus::new(Timing::classic(BitRate::new(1_000_000, 875).unwrap()), Quiet);
    bus.bit_by_bit(bit_by_bit);
    for _ in 0..nodes {
        bus.add(Order::Priority, Filter::everything());
    }
    bus
}

fn frame(id: u16) -> Frame {
    Frame::data(Id::Base(id), &[0x55; 8]).unwrap()
}

/// What is said up to `until`: who has sent and received what, and when.
fn heard(bus: &mut Bus<Quiet>, until: u64) -> Vec<(u64, usize, Id, bool)> {
    let mut heard = Vec::new();
    bus.advance(until, &mut |Event { at, node, what }| match what {
        What::Sent { frame, .. } => heard.push((at, node, frame.id(), true)),
        What::Received { id, .. } => heard.push((at, node, id, false)),
        _ => {}
    });
    heard
}

#[test]
fn who_has_no_power_hears_nothing_and_sends_nothing() {
    for bit_by_bit in [false, true] {
        let mut bus = bus(3, bit_by_bit);
        bus.switch_off(2);
        assert!(bus.is_absent(2) && bus.send(0, frame(1)));
        let nodes: Vec<_> = heard(&mut bus, 200 * BIT).iter().map(|&(_, node, ..)| node).collect();
        assert_eq!(nodes, [1, 0]);
        // Eleven recessive bits later it is there.
        bus.switch_on(2);
        assert_eq!((bus.is_absent(2), bus.mode(2)), (true, Mode::Off));
        heard(&mut bus, 212 * BIT);
        assert_eq!((bus.is_absent(2), bus.mode(2)), (false, Mode::Active));
        assert!(bus.send(2, frame(2)));
        let nodes: Vec<_> = heard(&mut bus, 400 * BIT).iter().map(|&(_, node, ..)| node).collect();
        assert_eq!(nodes, [0, 1, 2]);
    }
}

#[test]
fn who_has_no_power_takes_no_frame() {
    for bit_by_bit in [false, true] {
        let mut bus = bus(2, bit_by_bit);
        assert!(bus.send(0, frame(1)));
        heard(&mut bus, 20 * BIT);
        // It goes at once, and is there again after eleven recessive bits.
        bus.switch_off(0);
        assert!(!bus.send(0, frame(2)));
        heard(&mut bus, 200 * BIT);
        assert!(bus.is_absent(0) && !bus.send(0, frame(2)));
        bus.switch_on(0);
        heard(&mut bus, 220 * BIT);
        assert!(bus.send(0, frame(3)));
        let ids: Vec<_> = heard(&mut bus, 400 * BIT).iter().map(|&(_, node, id, _)| (node, id)).collect();
        assert_eq!(ids, [(1, Id::Base(3)), (0, Id::Base(3))]);
    }
}

#[test]
fn a_frame_that_is_sent_breaks_off_and_what_waits_is_lost() {
    for bit_by_bit in [false, true] {
        let mut bus = bus(3, bit_by_bit);
        assert!(bus.send(0, frame(1)) && bus.send(0, frame(2)));
        heard(&mut bus, 50 * BIT);
        bus.switch_off(0);
        assert!(bus.is_absent(0));
        let mut errors = Vec::new();
        bus.advance(600 * BIT, &mut |event| match event.what {
            What::Error { .. } => errors.push(event.node),
            what => panic!("{what:?}"),
        });
        // Six recessive bits are no bits of a frame. Who is left goes on.
        assert_eq!(errors, [1, 2]);
        assert!(bus.send(1, frame(3)));
        assert_eq!(heard(&mut bus, 800 * BIT).len(), 2);
    }
}

/// A frame that the only other one does not hear to its end is not acknowledged.
#[test]
fn a_receiver_that_goes_does_not_acknowledge() {
    for bit_by_bit in [false, true] {
        let mut bus = bus(2, bit_by_bit);
        assert!(bus.send(0, frame(1)));
        heard(&mut bus, 50 * BIT);
        bus.switch_off(1);
        assert_eq!(heard(&mut bus, 2_000 * BIT), []);
        assert!(bus.counters(0).transmit > 0);
    }
}

/// Nodes that go and come at any time, beside two that stay: both ways the same is said and heard at the same
/// times.
#[test]
fn both_ways_say_the_same_while_nodes_go_and_come() {
    let run = |seed: u64, bit_by_bit: bool| {
        let (mut random, mut bus, mut said) = (Random(seed), bus(5, bit_by_bit), Vec::new());
        let mut now = 0;
        for _ in 0..400 {
            now += random.below(90 * BIT);
            said.extend(heard(&mut bus, now));
            let node = random.below(5) as usize;
            match random.below(8) {
                0 if node > 1 => bus.switch_off(node),
                1 if node > 1 => bus.switch_on(node),
                _ => drop(bus.send(node, frame(random.below(16) as u16 * 8 + node as u16))),
            }
            while bus.receive(node).is_some() {}
        }
        said.extend(heard(&mut bus, now + 10_000 * BIT));
        said
    };
    for seed in 1..200 {
        let (whole, by_bits) = (run(seed, false), run(seed, true));
        let first = whole.iter().zip(&by_bits).position(|(a, b)| a != b);
        assert_eq!(first, None, "seed {seed}");
        assert!(whole.len() == by_bits.len() && whole.len() > 100, "{} {}", whole.len(), by_bits.len());
    }
}
