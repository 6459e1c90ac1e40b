//! Short circuits and connectors that come off, on a bus whose frames go as a whole, and bit by bit.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

mod support;

use funnelnet_can_bus::{
    BitErrors, BitRate, Bus, Counters, Event, Filter, Frame, Id, Mode, Noise, Order, Quiet, Timing, What,
};
use support::Random;

/// Duration of a bit at 1 Mbit/s, ns.
const BIT: u64 = 1_000;

fn bus<N: Noise>(nodes: usize, bit_by_bit: bool, noise: N) -> Bus<N> {
    let mut bus = Bus::new(Timing::classic(BitRate::new(1_000_000, 875).unwrap()), noise);
    bus.bit_by_bit(bit_by_bit);
    for _ in 0..nodes {
        bus.add(Order::Priority, Filter::everything());
    }
    bus
}

fn frame(id: u16) -> Frame {
    Frame::data(Id::Base(id), &[0x55; 8]).unwrap()
}

/// Who has received what up to `until`, with the time.
fn received<N: Noise>(bus: &mut Bus<N>, until: u64) -> Vec<(u64, usize, Id)> {
    let mut received = Vec::new();
    bus.advance(until, &mut |Event { at, node, what }| {
        if let What::Received { id, .. } = what {
            received.push((at, node, id));
        }
    });
    received
}

#[test]
fn a_short_circuit_of_an_idle_bus_makes_all_passive_and_takes_nobody_off() {
    for bit_by_bit in [false, true] {
        let mut bus = bus(3, bit_by_bit, Quiet);
        bus.short(100 * BIT..400 * BIT);
        assert_eq!(bus.next_at(), Some(100 * BIT + 875));
        // It begins as a frame does; six bits later all see that it is none, and after a flag of six bits each eight are one more error.
        received(&mut bus, 106 * BIT);
        assert_eq!(bus.counters(0), Counters { transmit: 0, receive: 1 });
        received(&mut bus, 240 * BIT);
        assert_eq!((0..3).map(|node| bus.mode(node)).collect::<Vec<_>>(), [Mode::Passive; 3]);
        // What is said meanwhile waits.
        assert!(bus.send(1, frame(1)));
        assert_eq!(received(&mut bus, 400 * BIT), []);
        let heard = received(&mut bus, 700 * BIT);
        assert_eq!(
            heard.iter().map(|&(_, node, id)| (node, id)).collect::<Vec<_>>(),
            [(0, Id::Base(1)), (2, Id::Base(1))]
        );
        // Delimiter, intermission, and the frame but for the last bit of its end: its length is that of any other.
        assert!(heard[0].0 > 400 * BIT + 8 * BIT + 3 * BIT && heard[0].0 < 400 * BIT + 160 * BIT);
        assert_eq!([0, 1].map(|node| bus.mode(node)), [Mode::Active, Mode::Passive]);
    }
}

#[test]
fn a_short_circuit_in_a_frame_takes_its_sender_off() {
    for bit_by_bit in [false, true] {
        let mut bus = bus(3, bit_by_bit, Quiet);
        bus.short(50 * BIT..600 * BIT);
        assert!(bus.send(0, frame(1)));
        received(&mut bus, 300 * BIT);
        assert_eq!(bus.mode(0), Mode::Passive, "{:?}", bus.counters(0));
        received(&mut bus, 320 * BIT);
        assert_eq!((bus.mode(0), bus.mode(1)), (Mode::Off, Mode::Passive));
        // It comes back when it is told to, and its frame with it.
        bus.restart(0);
        assert_eq!(received(&mut bus, 600 * BIT), []);
        assert_eq!(received(&mut bus, 600 * BIT + 128 * 11 * BIT).len(), 0);
        assert_eq!(received(&mut bus, 600 * BIT + 128 * 11 * BIT + 200 * BIT).len(), 2);
    }
}

#[test]
fn a_frame_that_ends_before_a_short_circuit_is_whole() {
    for bit_by_bit in [false, true] {
        let run = |from: u64| {
            let mut bus = bus(2, bit_by_bit, Quiet);
            bus.short(from..from + 30 * BIT);
            assert!(bus.send(0, frame(1)));
            received(&mut bus, 112 * BIT).len()
        };
        // 8 + 103 bits without the stuffed ones: 0x55 has none.
        let whole = (90..130).find(|&from| run(from * BIT) == 1).unwrap();
        assert!((100..112).contains(&whole), "{whole}");
    }
}

/// In the first two bits after a frame it is an overload condition, and who has sent the frame counts it as its sender.
#[test]
fn a_short_circuit_right_after_a_frame_takes_its_sender_off() {
    for bit_by_bit in [false, true] {
        let run = |from: u64| {
            let mut bus = bus(2, bit_by_bit, Quiet);
            bus.short(from * BIT..(from + 400) * BIT);
            assert!(bus.send(0, frame(1)));
            let is_heard = !received(&mut bus, 600 * BIT).is_empty();
            (is_heard, bus.mode(0))
        };
        let heard: Vec<u64> = (90..140).filter(|&from| run(from).0 && run(from).1 == Mode::Off).collect();
        assert!((1..4).contains(&heard.len()), "{heard:?}");
        assert_eq!(run(140), (true, Mode::Passive));
    }
}

/// Where the wire is dominant at no sample point, nothing happens.
#[test]
fn what_is_shorter_than_a_bit_counts_at_the_sample_point() {
    for bit_by_bit in [false, true] {
        let run = |from: u64, to: u64| {
            let mut bus = bus(3, bit_by_bit, Quiet);
            bus.short(from..to);
            assert!(bus.send(0, Frame::data(Id::Base(1), &[0xFF; 8]).unwrap()));
            received(&mut bus, 110 * BIT);
            bus.counters(0).transmit
        };
        assert_eq!([run(61_000, 61_050), run(60_000, 60_001), run(60_100, 60_870)], [0; 3]);
        assert!(run(60_100, 61_000) > 0 && run(60_870, 60_880) > 0);
    }
}

#[test]
fn who_is_unplugged_hears_nobody_becomes_passive_and_speaks_when_it_is_back() {
    for bit_by_bit in [false, true] {
        let mut bus = bus(3, bit_by_bit, Quiet);
        received(&mut bus, 10 * BIT);
        bus.unplug(2);
        assert!(bus.send(2, frame(2)) && bus.send(0, frame(1)));
        let heard: Vec<_> = received(&mut bus, 1_000 * BIT).iter().map(|&(_, node, id)| (node, id)).collect();
        assert_eq!(heard, [(1, Id::Base(1))]);
        // An error of acknowledgement counts eight, until it is passive.
        assert_eq!((bus.mode(2), bus.counters(2).transmit % 8), (Mode::Active, 0));
        assert!(bus.counters(2).transmit >= 48, "{:?}", bus.counters(2));
        received(&mut bus, 100_000 * BIT);
        assert_eq!((bus.mode(2), bus.counters(2).transmit), (Mode::Passive, 128));
        assert_eq!((bus.free_buffers(2), bus.is_absent(2)), (2, false));
        bus.plug(2);
        let heard: Vec<_> =
            received(&mut bus, 100_300 * BIT).iter().map(|&(_, node, id)| (node, id)).collect();
        assert_eq!(heard, [(0, Id::Base(2)), (1, Id::Base(2))]);
        assert_eq!((bus.mode(2), bus.counters(2).transmit), (Mode::Active, 127));
    }
}

/// A frame breaks off for the others as well.
#[test]
fn a_connector_that_comes_off_in_a_frame_is_an_error_for_the_others() {
    for bit_by_bit in [false, true] {
        let mut bus = bus(3, bit_by_bit, Quiet);
        assert!(bus.send(0, frame(1)));
        received(&mut bus, 50 * BIT);
        bus.unplug(0);
        assert_eq!(received(&mut bus, 300 * BIT), []);
        assert_eq!([1, 2].map(|node| bus.counters(node).receive), [1, 1]);
        bus.plug(0);
        assert_eq!(received(&mut bus, 600 * BIT).len(), 2);
    }
}

/// All that can happen at any time: both ways the same is heard at the same times, and counted.
#[test]
fn both_ways_say_the_same_whatever_happens_to_the_wire() {
    let mut seen = (0, 0, 0);
    let mut run = |seed: u64, bit_by_bit: bool| {
        let mut random = Random(seed);
        let mut errors = Random(seed ^ 0x55);
        let noise =
            BitErrors::on_the_bus(if seed.is_multiple_of(2) { 0 } else { 200_000 }, move || errors.next());
        let (mut bus, mut heard, mut now) = (bus(5, bit_by_bit, noise.unwrap()), Vec::new(), 0);
        for _ in 0..400 {
            now += random.below(90 * BIT);
            bus.advance(now, &mut |Event { at, node, what }| match what {
                What::Sent { frame, .. } => heard.push((at, node, Some(frame.id()))),
                What::Received { id, .. } => heard.push((at, node, Some(id))),
                What::Error { .. } | What::Mode { .. } => heard.push((at, node, None)),
                _ => {}
            });
            let node = random.below(5) as usize;
            match random.below(24) {
                0 | 1 if node > 2 => bus.switch_off(node),
                2..=4 if node > 2 => bus.switch_on(node),
                5 | 6 if node > 1 => bus.unplug(node),
                7..=9 if node > 1 => bus.plug(node),
                10 => bus.short(now + 20 * BIT + random.below(200 * BIT)..now + random.below(400 * BIT)),
                11 => bus.restart(node),
                12 => bus.cancel(node),
                _ => drop(bus.send(node, frame(random.below(16) as u16 * 8 + node as u16))),
            }
            while bus.receive(node).is_some() {}
        }
        bus.advance(now + 10_000 * BIT, &mut |event| {
            seen.2 += usize::from(matches!(event.what, What::Received { .. }));
        });
        // What is said at one time has no order.
        heard.sort_by_key(|&(at, node, id)| (at, node, format!("{id:?}")));
        seen.0 += usize::from((0..5).any(|node| bus.mode(node) == Mode::Off));
        seen.1 += heard.iter().filter(|(.., id)| id.is_none()).count();
        (
            heard,
            (0..5).map(|node| (bus.counters(node), bus.free_buffers(node))).collect::<Vec<_>>(),
            bus.busy_ns(),
        )
    };
    for seed in 1..300 {
        let (whole, by_bits) = (run(seed, false), run(seed, true));
        let first = whole.0.iter().zip(&by_bits.0).position(|(a, b)| a != b);
        let about = first.map(|at| (whole.0[at], by_bits.0[at]));
        assert_eq!(about, None, "seed {seed}");
        assert_eq!((whole.1, whole.2), (by_bits.1, by_bits.2), "seed {seed}");
        assert_eq!(whole.0.len(), by_bits.0.len());
    }
    assert!(seen.0 > 20 && seen.1 > 10_000 && seen.2 > 100, "{seen:?}");
}
