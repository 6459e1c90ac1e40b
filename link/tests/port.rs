//! The CAN port of a node with a controller that is played here, by hand: no clock, no bus.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_link::bus::{FIRST_WAIT_MS, RESTART_MS};
use funnelnet_link::port::LOOK_EVERY_NS;
use funnelnet_link::{BusState, CanPort, Change, Classic, Fd, Format, Frame, Heard, Request};
use funnelnet_protocol::message::{Component, Message, NodeId, TickStamp};
use funnelnet_protocol::{FaultCode, Refusal, Severity};

const MS: u64 = 1_000_000;

fn node(id: u8) -> NodeId {
    NodeId::new(id).unwrap()
}

fn state(component: u8, tick: u32) -> Message {
    let component = Component::new(component).unwrap();
    Message::State { source: node(5), component, tick: TickStamp::full(tick), x: 1.5 }
}

fn fault() -> Message {
    Message::Fault {
        source: node(5),
        code: FaultCode::BUS_OFF,
        severity: Severity::Stopped,
        arg: 1,
        tick: TickStamp::low(9, 8),
    }
}

/// Lets the controller take what waits; gives it as it is on the wire.
fn taken<F: Format>(port: &mut CanPort<F>) -> Vec<(u16, Vec<u8>)> {
    let mut frames = Vec::new();
    while let Some(frame) = port.next_frame() {
        frames.push((frame.id(), frame.data().to_vec()));
        port.on_taken();
    }
    frames
}

/// What another node with a port of the format `F` hears of these frames.
fn heard_of<F: Format>(frames: &[(u16, Vec<u8>)]) -> Vec<Heard> {
    let mut port = CanPort::<F>::new();
    let mut heard = Vec::new();
    for (id, data) in frames {
        port.on_frame(*id, data);
        heard.extend(std::iter::from_fn(|| port.hear()));
    }
    heard
}

/// Tick and component of what is heard of states.
fn stamps(heard: &[Heard]) -> Vec<(u32, u8)> {
    let stamp = |heard: &Heard| match heard {
        Heard::Message(Ok(Message::State { component, tick, .. })) => (tick.value(), component.get()),
        other => panic!("{other:?}"),
    };
    heard.iter().map(stamp).collect()
}

/// Looks at the error state as often as the port wants it, from `from` ms on and before `to` ms; gives what
/// is asked for, and when (ms).
fn looks<F: Format>(
    port: &mut CanPort<F>,
    from: u64,
    to: u64,
    mut read: impl FnMut(u64) -> BusState,
) -> Vec<(u64, Request)> {
    let mut requests = Vec::new();
    let mut now = port.look_at().max(from * MS);
    while now < to * MS {
        requests.extend(port.on_state(read(now / MS), now).map(|request| (now / MS, request)));
        assert_eq!(port.look_at(), now + LOOK_EVERY_NS);
        now = port.look_at();
    }
    requests
}

#[test]
fn of_two_states_that_wait_the_newer_one_wins_and_what_the_controller_holds_is_cancelled() {
    let mut port = CanPort::<Classic>::new();
    assert_eq!((port.send(&state(0, 1)), port.send(&state(1, 1))), (None, None));
    assert_eq!(port.send(&state(0, 2)), Some(Request::Cancel));
    assert_eq!(stamps(&heard_of::<Classic>(&taken(&mut port))), [(2, 0), (1, 1)]);
    assert_eq!(port.send(&state(0, 3)), None, "the controller has taken the one before");
}

#[test]
fn a_state_of_several_components_is_replaced_as_a_whole_in_frames_of_can_fd() {
    let mut port = CanPort::<Fd>::new();
    for tick in [1, 2] {
        assert_eq!((port.send(&state(0, tick)), port.send(&state(1, tick))), (None, None));
        assert_eq!(port.flush(), (tick == 2).then_some(Request::Cancel));
    }
    let frames = taken(&mut port);
    assert_eq!((frames.len(), stamps(&heard_of::<Fd>(&frames))), (1, vec![(2, 0), (2, 1)]));
}

#[test]
fn a_fault_is_sent_before_states_that_wait_already() {
    fn first<F: Format>() -> Option<Heard> {
        let mut port = CanPort::<F>::new();
        let requests = [state(0, 1), state(1, 1), fault()].map(|message| port.send(&message));
        assert_eq!(requests, [None; 3]);
        heard_of::<F>(&taken(&mut port)).first().copied()
    }
    assert_eq!(first::<Classic>(), Some(Heard::Message(Ok(fault()))));
    assert_eq!(first::<Fd>(), Some(Heard::Message(Ok(fault()))));
}

#[test]
fn off_the_bus_nothing_is_sent_until_the_controller_has_come_back() {
    let mut port = CanPort::<Classic>::new();
    assert_eq!(port.send(&state(0, 1)), None);
    assert_eq!(port.on_state(BusState::Off, 0), Some(Request::Cancel));
    let off = Change::Off { count: 1, wait_ms: FIRST_WAIT_MS };
    assert_eq!((port.hear(), port.hear()), (Some(Heard::Change(off)), None));
    assert_eq!(port.next_frame(), None, "what waited is dropped");
    assert_eq!(port.send(&fault()), None);
    assert_eq!(port.next_frame(), None, "what is said now waits");

    let restart = FIRST_WAIT_MS;
    let mut read = |now| if now > restart { BusState::Active } else { BusState::Off };
    assert_eq!(looks(&mut port, 0, restart + 1, &mut read), [(restart, Request::Restart)]);
    assert_eq!((port.hear(), port.next_frame()), (None, None), "it is not back yet");
    assert_eq!(looks(&mut port, restart, restart + 20, &mut read), []);
    assert_eq!(
        (port.hear(), port.state(), port.offs()),
        (Some(Heard::Change(Change::Back)), BusState::Active, 1)
    );
    assert_eq!(heard_of::<Classic>(&taken(&mut port)), [Heard::Message(Ok(fault()))]);
}

#[test]
fn a_restart_that_leads_nowhere_is_followed_by_another_after_twice_the_wait() {
    let mut port = CanPort::<Classic>::new();
    let requests = looks(&mut port, 0, 700, |_| BusState::Off);
    let again = FIRST_WAIT_MS + RESTART_MS;
    let restarts = [FIRST_WAIT_MS, again + 2 * FIRST_WAIT_MS].map(|at| (at, Request::Restart));
    assert_eq!(requests, [(0, Request::Cancel), restarts[0], (again, Request::Cancel), restarts[1]]);
    assert_eq!(port.offs(), 2);
}

#[test]
fn a_collected_state_is_not_sent_after_a_recovery() {
    let mut port = CanPort::<Fd>::new();
    assert_eq!(port.send(&state(0, 1)), None);
    assert_eq!(port.on_state(BusState::Off, 0), Some(Request::Cancel));
    assert_eq!(port.flush(), None);
    assert_eq!(
        looks(&mut port, 0, 150, |now| if now < 100 { BusState::Off } else { BusState::Active }).len(),
        1
    );
    assert_eq!(port.next_frame(), None);
}

#[test]
fn error_passive_and_active_are_told_and_keep_nothing_back() {
    let mut port = CanPort::<Classic>::new();
    assert_eq!(port.send(&state(0, 1)), None);
    for (reading, change) in [(BusState::Passive, Change::Passive), (BusState::Active, Change::Active)] {
        assert_eq!(port.on_state(reading, port.look_at()), None);
        assert_eq!((port.hear(), port.hear()), (Some(Heard::Change(change)), None));
        assert_eq!(port.state(), reading);
        assert!(port.next_frame().is_some());
    }
}

#[test]
fn a_change_that_nobody_has_heard_yet_is_not_lost_by_a_look() {
    let mut port = CanPort::<Classic>::new();
    assert_eq!(port.on_state(BusState::Passive, 0), None);
    assert_eq!(port.on_state(BusState::Passive, LOOK_EVERY_NS), None);
    assert_eq!(port.hear(), Some(Heard::Change(Change::Passive)));
}

#[test]
fn frames_of_the_other_format_are_refused_once_each() {
    let said = |port: &mut dyn FnMut(&Message)| [state(0, 1), state(1, 1)].iter().for_each(port);
    let (mut classic, mut fd) = (CanPort::<Classic>::new(), CanPort::<Fd>::new());
    said(&mut |message| assert_eq!(classic.send(message), None));
    said(&mut |message| assert_eq!(fd.send(message), None));
    assert_eq!(fd.flush(), None);
    let kind = Heard::Message(Err(Refusal::Kind));
    assert_eq!(heard_of::<Fd>(&taken(&mut classic)), [kind, kind]);
    assert_eq!(heard_of::<Classic>(&taken(&mut fd)), [kind]);
}

#[test]
fn what_is_refused_unread_is_heard_once_and_errors_are_counted() {
    let mut port = CanPort::<Classic>::new();
    port.on_refused(Refusal::Kind);
    assert_eq!((port.hear(), port.hear()), (Some(Heard::Message(Err(Refusal::Kind))), None));
    port.on_error();
    port.on_error();
    assert_eq!((port.errors(), port.hear()), (2, None));
}
