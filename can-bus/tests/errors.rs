//! Error frames, counters, bus-off and recovery (ISO 11898-1), at the bit. All times are computed by hand
//! from the standard's fields.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_can_bus::{
    BitRate, Bus, Counters, ErrorKind, Event, Field, Filter, Frame, Hit, Id, Length, Mode, Noise, Order,
    Quiet, SeenBy, Timing, What, Wire,
};

const BIT: u64 = 2000;
const SAMPLE: u64 = 1750;
const SECOND: u64 = 1_000_000_000;
/// Delimiter of an error frame, intermission, suspension.
const DELIMITER: u64 = 8;
const INTERMISSION: u64 = 3;
const SUSPENSION: u64 = 8;
const FLAG: u64 = 6;

fn timing() -> Timing {
    Timing::classic(BitRate::new(500_000, 875).unwrap())
}

fn bus_of<N: Noise>(nodes: usize, noise: N) -> Bus<N> {
    let mut bus = Bus::new(timing(), noise);
    for _ in 0..nodes {
        bus.add(Order::Priority, Filter::everything());
    }
    bus
}

fn bus(nodes: usize, hits: Vec<Hit>) -> Bus<impl Noise> {
    let mut hits = hits.into_iter();
    bus_of(nodes, move || hits.next())
}

fn hit(after: u64, seen_by: SeenBy) -> Hit {
    Hit { after, seen_by }
}

fn frame(id: u16, data: &[u8]) -> Frame {
    Frame::data(Id::Base(id), data).unwrap()
}

/// Alternating bits, so that nothing is stuffed in them.
fn alternating() -> Frame {
    frame(0x555, &[0x55; 8])
}

fn events<N: Noise>(bus: &mut Bus<N>, until: u64) -> Vec<Event> {
    let mut events = Vec::new();
    bus.advance(until, &mut |event| events.push(event));
    events
}

fn errors(events: &[Event], of: usize) -> Vec<(u64, ErrorKind, Field, Counters)> {
    let error = |event: &Event| match event.what {
        What::Error { kind, field, counters, .. } if event.node == of => {
            Some((event.at, kind, field, counters))
        }
        _ => None,
    };
    events.iter().filter_map(error).collect()
}

fn modes(events: &[Event], of: usize) -> Vec<Mode> {
    let mode = |event: &Event| match event.what {
        What::Mode { mode, .. } if event.node == of => Some(mode),
        _ => None,
    };
    events.iter().filter_map(mode).collect()
}

fn count(events: &[Event], what: impl Fn(&Event) -> bool) -> usize {
    events.iter().filter(|event| what(event)).count()
}

fn sent_by(events: &[Event], node: usize) -> usize {
    count(events, |event| event.node == node && matches!(event.what, What::Sent { .. }))
}

fn received_by(events: &[Event], node: usize) -> usize {
    count(events, |event| event.node == node && matches!(event.what, What::Received { .. }))
}

#[test]
fn a_lone_node_stays_error_passive_at_128_for_ever() {
    let mut bus = bus_of(1, Quiet);
    assert!(bus.send(0, alternating()));
    let events = events(&mut bus, 20 * SECOND);
    assert_eq!((bus.counters(0), bus.mode(0)), (Counters { transmit: 128, receive: 0 }, Mode::Passive));
    assert_eq!((modes(&events, 0), sent_by(&events, 0)), (vec![Mode::Passive], 0));
    let errors = errors(&events, 0);
    assert!(errors.iter().all(|&(_, kind, field, _)| (kind, field) == (ErrorKind::Acknowledgement, Field::Acknowledgement)));
    let counts: Vec<u16> = errors.iter().map(|(.., counters)| counters.transmit).take(18).collect();
    assert_eq!(counts[..16], std::array::from_fn::<u16, 16, _>(|at| 8 * (at as u16 + 1)));
    assert_eq!(counts[16..], [128, 128]);
    // From slot to slot: flag, delimiter, intermission, suspension; then the frame to its slot, 8 bits before
    // the end of its end.
    let to_slot = Wire::of(&alternating(), false).levels().count() as u64 - 8;
    let period = |at: usize| errors[at + 1].0 - errors[at].0;
    assert_eq!(period(3), (FLAG + DELIMITER + INTERMISSION + to_slot) * BIT);
    assert_eq!(period(20), (FLAG + DELIMITER + INTERMISSION + SUSPENSION + to_slot) * BIT);
    assert_eq!(errors[0].0, (to_slot - 1) * BIT + SAMPLE);
    assert_eq!(errors.len() as u64, 17 + (20 * SECOND - errors[16].0) / period(20));
}

/// The world in which the test above would be no news: with another node the same frame is sent at once.
#[test]
fn with_another_node_the_same_frame_is_acknowledged() {
    let mut bus = bus_of(2, Quiet);
    assert!(bus.send(0, alternating()));
    let events = events(&mut bus, SECOND);
    assert_eq!((sent_by(&events, 0), received_by(&events, 1), errors(&events, 0).len()), (1, 1, 0));
    assert_eq!(bus.counters(0), Counters::default());
}

/// A bit in the data, recessive between dominant ones, that all read as dominant, in each attempt. The
/// sender's flag follows; receivers see two dominant bits and four of the flag, and mark a stuff error: ten
/// dominant bits. A passive sender sends nothing more: the receivers see a stuff error after six recessive
/// bits.
const HIT_AT: u64 = 22;

fn failing_attempts() -> Vec<Hit> {
    let active = FLAG + 4 + DELIMITER + INTERMISSION;
    let passive = FLAG + FLAG + DELIMITER + INTERMISSION;
    // Bits count while the bus is busy, so not in the suspension.
    let afters = (0..64).map(|attempt| match attempt {
        0 => HIT_AT,
        1..=16 => active + HIT_AT,
        _ => passive + HIT_AT,
    });
    afters.map(|after| hit(after, SeenBy::All)).collect()
}

#[test]
fn thirty_two_failed_frames_lead_to_bus_off() {
    let mut bus = bus(2, failing_attempts());
    assert!(bus.send(0, alternating()));
    let events = events(&mut bus, SECOND);
    let errors = errors(&events, 0);
    let counts: Vec<u16> = errors.iter().map(|(.., counters)| counters.transmit).collect();
    assert_eq!(counts, (1..=32).map(|at| 8 * at).collect::<Vec<u16>>());
    assert!(errors.iter().all(|&(_, kind, field, _)| (kind, field) == (ErrorKind::Bit, Field::Data)));
    assert_eq!(modes(&events, 0), [Mode::Passive, Mode::Off]);
    assert_eq!((bus.mode(0), sent_by(&events, 0), received_by(&events, 1)), (Mode::Off, 0, 0));
    // Each attempt is a stuff error for the receiver, which is not the first to see it.
    assert_eq!(bus.counters(1), Counters { transmit: 0, receive: 32 });
    let periods: Vec<u64> = errors.windows(2).map(|pair| (pair[1].0 - pair[0].0) / BIT).collect();
    let active = 1 + FLAG + 4 + DELIMITER + INTERMISSION + HIT_AT;
    let passive = 1 + FLAG + FLAG + DELIMITER + INTERMISSION + SUSPENSION + HIT_AT;
    let expected: Vec<u64> = (1..32)
        .map(|at| {
            if at < 16 {
                active
            } else if at == 16 {
                active + SUSPENSION
            } else {
                passive
            }
        })
        .collect();
    assert_eq!(periods, expected);
}

/// One attempt less, and it is still on the bus: the frame goes.
#[test]
fn thirty_one_failed_frames_do_not() {
    let mut bus = bus(2, failing_attempts()[..31].to_vec());
    assert!(bus.send(0, alternating()));
    let events = events(&mut bus, SECOND);
    assert_eq!((bus.mode(0), sent_by(&events, 0), received_by(&events, 1)), (Mode::Passive, 1, 1));
    assert_eq!(bus.counters(0).transmit, 31 * 8 - 1);
    let retries = events.iter().find_map(|event| match event.what {
        What::Sent { errors, .. } => Some(errors),
        _ => None,
    });
    assert_eq!(retries, Some(31));
}

/// A bus whose first controller is off.
fn bus_with_one_off(nodes: usize) -> Bus<impl Noise> {
    let mut bus = bus(nodes, failing_attempts()[..32].to_vec());
    assert!(bus.send(0, alternating()));
    events(&mut bus, SECOND);
    assert_eq!(bus.mode(0), Mode::Off);
    bus.cancel(0);
    bus
}

#[test]
fn recovery_takes_1408_bits_of_an_idle_bus() {
    let mut bus = bus_with_one_off(2);
    assert_eq!(events(&mut bus, 2 * SECOND), []);
    let now = bus.now();
    bus.restart(0);
    let events = events(&mut bus, 3 * SECOND);
    let [event] = events[..] else { panic!("{events:?}") };
    assert_eq!(event.what, What::Mode { mode: Mode::Active, counters: Counters::default() });
    // Bits of an idle bus have no beginning but the one of the last frame: less than one bit may pass before
    // the first.
    let bits = (event.at - now).div_ceil(BIT);
    assert_eq!(bits, 128 * 11);
    assert!(bus.send(0, alternating()));
    assert_eq!(sent_by(&self::events(&mut bus, 4 * SECOND), 0), 1);
}

/// On a bus without a gap each frame ends with eleven recessive bits, and has no other such run: it takes 128
/// frames.
#[test]
fn recovery_on_a_saturated_bus_takes_128_frames() {
    let mut bus = bus_with_one_off(3);
    let mut seen: Vec<Event> = Vec::new();
    let mut until = bus.now();
    let mut restarted = 0;
    while bus.mode(0) == Mode::Off {
        while bus.free_buffers(1) > 0 {
            assert!(bus.send(1, frame(0x100, &[0xFF; 8])));
        }
        if seen.len() > 40 && restarted == 0 {
            restarted = seen.iter().filter(|event| matches!(event.what, What::Sent { .. })).count();
            bus.restart(0);
        }
        until += 5 * BIT;
        bus.advance(until, &mut |event| seen.push(event));
        while bus.receive(2).is_some() {}
    }
    let back =
        seen.iter().position(|event| matches!(event.what, What::Mode { mode: Mode::Active, .. })).unwrap();
    // The frame that was on the way at the restart counts too.
    assert_eq!(sent_by(&seen[..back], 1) - restarted, 128);
}

/// Both send the same identifier at the same time, with different data: the one that sends the recessive bit
/// sees an error. They begin again at the same time, until they are passive. Then the error of the one
/// disturbs the other no more.
#[test]
fn the_same_identifier_at_the_same_time_collides_until_both_are_passive() {
    let mut bus = bus_of(3, Quiet);
    assert!(bus.send(0, frame(0x123, &[1])) && bus.send(1, frame(0x123, &[2])));
    let events = events(&mut bus, SECOND);
    let kinds = |of| errors(&events, of).iter().map(|&(_, kind, ..)| kind).collect::<Vec<_>>();
    // Bits 0000 0001 and 0000 0010: the second differs first, with a recessive bit.
    assert_eq!(kinds(1), [ErrorKind::Bit; 17]);
    assert!(errors(&events, 1).iter().all(|&(_, _, field, _)| field == Field::Data));
    assert_eq!(kinds(0).len(), 16);
    assert_eq!((sent_by(&events, 0), sent_by(&events, 1), received_by(&events, 2)), (1, 1, 2));
    assert_eq!(count(&events, |event| matches!(event.what, What::LostArbitration { .. })), 0);
    // 16 errors, and 17; one success each.
    assert_eq!([0, 1].map(|node| bus.counters(node).transmit), [127, 135]);
}

/// The same frame of two senders is one frame on the bus.
#[test]
fn the_same_frame_at_the_same_time_is_no_collision() {
    let mut bus = bus_of(3, Quiet);
    assert!(bus.send(0, alternating()) && bus.send(1, alternating()));
    let events = events(&mut bus, SECOND);
    assert_eq!((sent_by(&events, 0), sent_by(&events, 1), received_by(&events, 2)), (1, 1, 1));
    assert_eq!(errors(&events, 2).len(), 0);
}

fn end_of_frame() -> u64 {
    Wire::of(&alternating(), false).levels().count() as u64
}

/// Receivers take a frame at the last bit but one of its end, the sender at the last: one that is disturbed
/// in the last bit comes twice.
#[test]
fn a_frame_that_is_disturbed_in_its_last_bit_is_received_twice() {
    let mut bus = bus(3, vec![hit(end_of_frame() - 1, SeenBy::One(0))]);
    assert!(bus.send(0, alternating()));
    let events = events(&mut bus, SECOND);
    assert_eq!((sent_by(&events, 0), received_by(&events, 1), received_by(&events, 2)), (1, 2, 2));
    // The sender's flag begins in the intermission of the receivers.
    assert_eq!(count(&events, |event| event.what == What::Overload), 2);
    assert_eq!(
        [0, 1, 2].map(|node| bus.counters(node)),
        [Counters { transmit: 7, receive: 0 }, Counters::default(), Counters::default()]
    );
}

/// In the last bit but one, at one receiver: that one has not taken it, the other has, and gets it again.
#[test]
fn a_frame_that_is_disturbed_in_its_last_bit_but_one_at_one_receiver_is_received_twice_by_the_other() {
    let mut bus = bus(3, vec![hit(end_of_frame() - 2, SeenBy::One(1))]);
    assert!(bus.send(0, alternating()));
    let events = events(&mut bus, SECOND);
    assert_eq!((sent_by(&events, 0), received_by(&events, 1), received_by(&events, 2)), (1, 1, 2));
}

/// A receiver that alone reads a bit wrong marks it first: 1 for the error and 8 for the dominant bit after
/// its flag.
#[test]
fn a_receiver_that_alone_sees_an_error_counts_nine() {
    let mut bus = bus(3, vec![hit(40, SeenBy::One(1))]);
    assert!(bus.send(0, alternating()));
    let mut seen = Vec::new();
    bus.advance(end_of_frame() * BIT, &mut |event| seen.push(event));
    assert_eq!(
        [0, 1, 2].map(|node| bus.counters(node)),
        [
            Counters { transmit: 8, receive: 0 },
            Counters { transmit: 0, receive: 9 },
            Counters { transmit: 0, receive: 1 }
        ]
    );
    seen.extend(events(&mut bus, SECOND));
    // Sent again, and received by both.
    assert_eq!((sent_by(&seen, 0), received_by(&seen, 1), received_by(&seen, 2)), (1, 1, 1));
    assert_eq!(
        [0, 1, 2].map(|node| bus.counters(node)),
        [
            Counters { transmit: 7, receive: 0 },
            Counters { transmit: 0, receive: 8 },
            Counters { transmit: 0, receive: 0 }
        ]
    );
}

/// Corrupted bits make error frames and retransmission, not silent loss: whatever is hit, each frame arrives,
/// once or (see above) twice.
#[test]
fn no_hit_loses_a_frame() {
    for seen_by in [SeenBy::All, SeenBy::One(0), SeenBy::One(1), SeenBy::One(2)] {
        for after in 0..end_of_frame() + INTERMISSION {
            let mut bus = bus(3, vec![hit(after, seen_by)]);
            assert!(bus.send(0, alternating()));
            let events = events(&mut bus, SECOND);
            assert_eq!(sent_by(&events, 0), 1, "{seen_by:?} {after}");
            for node in [1, 2] {
                let received = received_by(&events, node);
                let twice = after + 2 >= end_of_frame();
                assert!(received == 1 || twice && received == 2, "{seen_by:?} {after}: {received}");
                assert!(std::iter::from_fn(|| bus.receive(node)).all(|frame| frame == alternating()));
            }
        }
    }
}

/// A passive receiver marks an error with recessive bits, and ends its error frame only after some idle bits
/// (Bosch, CAN Specification 2.0): on a bus without a gap it hears nothing more.
#[test]
fn a_passive_receiver_with_an_error_of_its_own_is_deaf_on_a_saturated_bus() {
    // Frames with this many idle bits between them, after node 2 became passive by seventeen failed frames,
    // of which one is disturbed for it.
    let run = |idle: u64| {
        let length = u64::from(Length::of(&alternating(), false).bits());
        let mut hits = failing_attempts()[..17].to_vec();
        let rest = FLAG + FLAG + DELIMITER + INTERMISSION;
        hits.push(hit(rest + length + 2 * length + 30, SeenBy::One(2)));
        let mut bus = bus(3, hits);
        assert!(bus.send(2, alternating()));
        events(&mut bus, SECOND);
        assert_eq!((bus.mode(2), bus.counters(2).transmit), (Mode::Passive, 17 * 8 - 1));
        let mut seen = Vec::new();
        for _ in 0..100 {
            assert!(bus.send(0, alternating()));
            let sent = sent_by(&seen, 0);
            while sent_by(&seen, 0) == sent {
                let next = bus.next_at().unwrap();
                bus.advance(next, &mut |event| seen.push(event));
            }
            // It is the sample point of the last bit of the frame.
            let free = bus.now() - SAMPLE + (1 + INTERMISSION + idle) * BIT;
            if idle > 0 {
                bus.advance(free, &mut |event| seen.push(event));
            }
            while bus.receive(1).is_some() || bus.receive(2).is_some() {}
        }
        assert_eq!((sent_by(&seen, 0), received_by(&seen, 1)), (100, 100));
        (received_by(&seen, 2), count(&seen, |event| event.node == 2 && event.what == What::Overload))
    };
    // Two before the disturbed one, and none after it.
    assert_eq!([0, 1].map(run), [(2, 0); 2]);
    // The wrong checksum is marked from the first bit of the end of frame on. Six bits of flag and eight of
    // delimiter are there if four bits are idle. With three the next frame begins in the last bit of the
    // delimiter, with four or five in the intermission after it: an overload, and the frame is sent again.
    // With two it is one bit too early, and the same one frame later.
    assert_eq!([2, 3, 4, 5].map(run), [(98, 1), (99, 1), (99, 1), (99, 1)]);
    assert_eq!([6, 20].map(run), [(99, 0); 2]);
}
