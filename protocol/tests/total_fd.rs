//! CAN FD: decoders are total, a state has one form only, and what is not quite one is refused.
#![allow(clippy::unwrap_used, clippy::panic)]

use funnelnet_protocol::can_fd::{Content, States, decode, encode, encode_states};
use funnelnet_protocol::message::{Component, Message, NodeId, TickStamp};
use funnelnet_protocol::{Refusal, can};
use proptest::prelude::*;

/// Lengths that a frame of CAN FD can have (ISO 11898-1).
const LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

fn state(node: u8, component: u8, tick: TickStamp, x: f32) -> Message {
    let (source, component) = (NodeId::new(node).unwrap(), Component::new(component).unwrap());
    Message::State { source, component, tick, x }
}

fn states(node: u8, tick: TickStamp, x: &[f32]) -> States {
    let mut states = States::new(NodeId::new(node).unwrap(), tick, x[0]);
    for (component, &x) in (1..).zip(&x[1..]) {
        assert!(states.add(&state(node, component, tick, x)));
    }
    states
}

fn messages(states: &States) -> Vec<Message> {
    (0..).map_while(|index| states.message(index)).collect()
}

#[test]
fn the_length_is_one_that_can_fd_has_and_the_shortest() {
    let lengths: Vec<_> = (1..=8)
        .map(|count| encode_states(&states(5, TickStamp::full(1), &vec![1.0; count])).data().len())
        .collect();
    assert_eq!(lengths, [8, 12, 16, 20, 24, 32, 32, 48]);
    assert!(lengths.iter().all(|length| LENGTHS.contains(length)));
}

#[test]
fn only_the_next_component_of_the_same_state_is_added() {
    let tick = TickStamp::full(7);
    let mut all = states(5, tick, &[1.0, 2.0]);
    let before = all.clone();
    let others = [
        state(5, 1, tick, 3.0),
        state(5, 3, tick, 3.0),
        state(6, 2, tick, 3.0),
        state(5, 2, TickStamp::full(8), 3.0),
        Message::Sync { source: None, previous_tick: tick, phase_us: 0 },
    ];
    for other in others {
        assert!(!all.add(&other), "{other:?}");
    }
    assert_eq!(all, before);
    assert!(all.add(&state(5, 2, tick, 3.0)));
    let values: Vec<_> = messages(&all)
        .into_iter()
        .map(|message| if let Message::State { x, .. } = message { x } else { 0.0 })
        .collect();
    assert_eq!(values, [1.0, 2.0, 3.0]);
}

#[test]
fn what_is_not_quite_a_state_is_refused() {
    let good = encode_states(&states(5, TickStamp::full(1), &[1.0; 6]));
    let (id, data) = (good.id(), good.data());
    let changed = |at: usize, value: u8| {
        let mut data = data.to_vec();
        data[at] = value;
        decode(id, &data)
    };
    assert!(decode(id, data).is_ok());
    assert_eq!(changed(0, 0x85), Err(Refusal::Value), "an authenticated one");
    assert_eq!(changed(0, 0x0D), Err(Refusal::Value), "a reserved bit");
    assert_eq!(changed(1, 1), Err(Refusal::Value), "the reserved byte");
    assert_eq!(changed(0, 7), Err(Refusal::Length), "eight components in the room of six");
    // Six and seven have the same length: the value that is no component is padding.
    assert_eq!(changed(31, 1), Err(Refusal::Value), "padding");
    assert_eq!(decode(id, &data[..24]), Err(Refusal::Length));
    assert_eq!(decode(id, &[data, &[0; 16]].concat()), Err(Refusal::Length));
    assert_eq!(decode(id & !0x7F, data), Err(Refusal::Value), "node 0");
    for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let bad = encode_states(&states(5, TickStamp::full(1), &[1.0, x]));
        assert_eq!(decode(bad.id(), bad.data()), Err(Refusal::NotFinite));
    }
    assert_eq!(
        can::decode(id, &data[..5]),
        Err(Refusal::Kind),
        "in the classic format there is no such frame"
    );
    let classic = can::encode(&state(5, 0, TickStamp::full(1), 1.0));
    assert_eq!(decode(classic.id(), classic.data()), Err(Refusal::Kind), "nor here the classic one");
}

proptest! {
    #[test]
    fn any_fd_frame_says_something_or_gives_a_reason(
        id: u16, function in prop_oneof![Just(11u16), 0u16..16], header in prop_oneof![0u8..8, any::<u8>()],
        data in prop::sample::select(&LENGTHS[..]).prop_flat_map(|length| proptest::collection::vec(prop_oneof![Just(0u8), any::<u8>()], length))
    ) {
        let id = id & !0x780 | function << 7;
        let mut data = data;
        if let Some(first) = data.first_mut().filter(|_| function == 11) {
            *first = header;
        }
        let again = match decode(id, &data) {
            Ok(Content::States(states)) => encode_states(&states),
            Ok(Content::Message(message)) => encode(&message),
            Err(_) => return Ok(()),
        };
        prop_assert_eq!((again.id(), again.data()), (id & 0x7FF, data.as_slice()));
    }

    #[test]
    fn states_survive(node in 1u8..=127, tick: u32, x in proptest::collection::vec(proptest::num::f32::NORMAL, 1..=8)) {
        let frame = encode_states(&states(node, TickStamp::full(tick), &x));
        let got = states(node, TickStamp::low(tick, 16), &x);
        prop_assert_eq!(messages(&got).len(), x.len());
        prop_assert_eq!(decode(frame.id(), frame.data()), Ok(Content::States(got)));
    }
}
