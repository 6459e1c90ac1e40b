//! A bit of a certain frame that one receiver reads wrong.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_can_bus::{
    BitRate, Bus, Event, Filter, Frame, Hit, Id, Noise, Order, SeenBy, Strike, Timing, What,
};

/// Strikes the first frames of a sender, each at the next of these places; `own` are bits disturbed beside.
struct Striker {
    sender: usize,
    places: Vec<u32>,
    own: Vec<Hit>,
}

impl Noise for Striker {
    fn next(&mut self) -> Option<Hit> {
        self.own.pop()
    }

    fn strike(&mut self, _: u64, sender: usize) -> Option<Strike> {
        let place = self.places.pop().filter(|_| sender == self.sender)?;
        Some(Strike { seen_by: SeenBy::One(2), place })
    }
}

fn run(places: &[u32], own: &[Hit], bit_by_bit: bool) -> Vec<Event> {
    let noise = Striker { sender: 0, places: places.to_vec(), own: own.to_vec() };
    let mut bus = Bus::new(Timing::classic(BitRate::new(1_000_000, 875).unwrap()), noise);
    bus.bit_by_bit(bit_by_bit);
    (0..3).for_each(|_| {
        bus.add(Order::Priority, Filter::everything());
    });
    assert!(bus.send(0, Frame::data(Id::Base(0x181), &[1, 2, 3, 4, 5]).unwrap()));
    let mut events = Vec::new();
    bus.advance(2_000_000, &mut |event| events.push(event));
    events
}

fn errors(events: &[Event]) -> Vec<usize> {
    let error = |event: &Event| matches!(event.what, What::Error { .. }).then_some(event.node);
    events.iter().filter_map(error).collect()
}

/// The receiver that is struck marks the error first, all others see its flag, and the frame comes the second time.
#[test]
fn a_struck_frame_is_sent_again() {
    for place in [0, 1 << 30, 1 << 31, 3 << 30, u32::MAX] {
        let events = run(&[place], &[], false);
        assert_eq!(errors(&events).first(), Some(&2), "{place}");
        let sent: Vec<u32> = events
            .iter()
            .filter_map(|event| match event.what {
                What::Sent { errors, .. } => Some(errors),
                _ => None,
            })
            .collect();
        assert_eq!(sent, [1], "{place}");
        assert_eq!(events, run(&[place], &[], true));
    }
}

#[test]
fn the_bits_of_the_bus_stay_where_they_are() {
    // The bit of the bus is in the second attempt: the first, with its error frame, has more than 40 bits.
    let own = [Hit { after: 100, seen_by: SeenBy::All }];
    let events = run(&[1 << 30], &own, false);
    let attempts = events.iter().find_map(|event| match event.what {
        What::Sent { errors, .. } => Some(errors),
        _ => None,
    });
    assert_eq!(attempts, Some(2), "{events:?}");
    assert_eq!(events, run(&[1 << 30], &own, true));
    // One of the bus before the strike comes alone.
    let early = [Hit { after: 5, seen_by: SeenBy::All }];
    assert_eq!(run(&[1 << 31], &early, false), run(&[], &early, false));
}
