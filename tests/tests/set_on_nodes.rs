//! Configurations that nodes adopt while they run, on nodes that are not in the simulator: sessions behind serial lines and on
//! CAN that the real conductor drives in virtual time have the bits of loopback, and what goes wrong is found.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_protocol::config::{NodeConfig, TickSource};
use funnelnet_protocol::message::{Command, Message, NodeId, Target};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::serial::{self, Frame, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Body, Identity, Reply, Request};
use sim_host::conductor::{Conductor, HubError, OnLoss};
use sim_host::configure::Drive;
use sim_host::presence::Presence;
use sim_host::run::Fidelity;
use sim_host::scenario::Scenario;
use system_tests::lockstep::{
    LOCKSTEP, PATIENCE, Ran, TRAVEL, adopted, as_loopback, compared, in_world, on_boards, on_buses,
};
use system_tests::world::{Blow, Fate, Peace, Way, World, conductor, staged};
use system_tests::{run, scenario};

/// A narrower funnel of all nodes.
const NARROW: &str = "{at='150ms',kind='set',key='coupling.funnel.end',value=0.5}";
/// Another load on two of them.
const LOAD: &str = "{at='150ms',kind='set',key='agent.dynamics.offset',value=3.0,nodes=[2,4]}";

/// Five agents with these events, for 300 ms.
fn five(events: &str, sets: &[&str]) -> Scenario {
    let events = format!("event=[{events}]");
    scenario("five-agents.toml", &[&["time.duration=300ms", events.as_str()], sets].concat())
}

/// Index and tick of all who adopt at a tick.
fn all_at(tick: u32) -> Vec<(usize, u32)> {
    (0..5).map(|node| (node, tick)).collect()
}

#[test]
fn what_can_be_set_is_set_at_its_tick_on_lines() {
    let (_, calm) = compared(&five("", &[]), false);
    for event in [
        NARROW,
        LOAD,
        "{at='150ms',kind='set',key='coupling.gain',value={kind='logarithmic',scale=2.0}}",
        "{at='150ms',kind='set',key='coupling.damping',value=2.6}",
        "{at='150ms',kind='set',key='agent.limits',value={low=-0.5,high=0.5}}",
    ] {
        let (_, set) = compared(&five(event, &[]), false);
        assert_eq!(set.adopted.len(), if event == LOAD { 2 } else { 5 }, "{event}");
        assert_ne!(set.hash, calm.hash, "{event}");
    }
    // At two ticks, with frames on their way, and between two ticks.
    let two = "{at='100ms',kind='set',key='coupling.funnel.end',value=0.5,node=1},\
               {at='200.5ms',kind='set',key='coupling.funnel.end',value=0.5,nodes=[2,3]}";
    let (_, set) = compared(&five(two, &["bus.latency=700us", "bus.jitter=900us", "bus.loss=0.1"]), false);
    assert_eq!(set.adopted, [(0, 100), (1, 201), (2, 201)]);
}

/// The engine tells its nodes eight ticks ahead; nodes that tick by SYNC must have run one before.
#[test]
fn also_right_after_the_start_and_at_the_last_tick() {
    for (at, tick) in [("1ms", 1), ("2ms", 2), ("8ms", 8), ("9ms", 9), ("10ms", 10), ("300ms", 300)] {
        let (_, set) = compared(&five(&NARROW.replace("150ms", at), &[]), false);
        assert_eq!(set.adopted, all_at(tick), "{at}");
    }
}

#[test]
fn also_on_can_and_for_vectors() {
    for event in [NARROW, LOAD] {
        let five = five(event, &[]);
        for fd in [false, true] {
            for buses in [vec![&[0, 1, 2, 3, 4][..]], vec![&[0, 2][..], &[1, 4][..]]] {
                let (_, set) = as_loopback(&five, on_buses(&five, false, &buses, fd));
                assert!(!set.adopted.is_empty());
            }
        }
    }
    let event = "event=[{at='50ms',kind='set',key='coupling.damping',value=2.6}]";
    let _ = compared(&scenario("vector-oscillators.toml", &["time.duration=100ms", event]), false);
}

/// A restart takes what was staged with it, and nothing that was committed. A board that keeps its power is no exception.
#[test]
fn who_was_off_before_the_tick_misses_it_and_who_has_adopted_it_comes_back_with_it() {
    for has_power in [true, false] {
        for (events, missed) in [
            ("{at='50ms',kind='bounce',node=2,for='20ms'}", vec![1]),
            ("{at='50ms',kind='bounce',node=2,for='96ms'}", vec![1]),
            // Off at the tick.
            ("{at='140ms',kind='bounce',node=2,for='20ms'}", vec![1]),
            ("{at='150ms',kind='bounce',node=2,for='20ms'}", vec![]),
            ("{at='149ms',kind='bounce',node=2,for='20ms'}", vec![1]),
            // After it has been told, and before the tick.
            ("{at='145ms',kind='bounce',node=2,for='2ms'}", vec![1]),
            ("{at='170ms',kind='bounce',node=3,for='20ms'}", vec![]),
            (
                "{at='60ms',kind='leave',node=2},{at='90ms',kind='join',node=2},{at='180ms',kind='bounce',node=2,for='10ms'}",
                vec![1],
            ),
            ("{at='60ms',kind='leave',node=2},{at='250ms',kind='join',node=2}", vec![1]),
            ("{at='100ms',kind='join',node=1},{at='60ms',kind='crash',node=5}", vec![0]),
            ("{at='160ms',kind='crash',node=5}", vec![]),
        ] {
            let events = format!("{events},{NARROW}");
            let (loopback, set) = compared(&five(&events, &[]), has_power);
            let words: Vec<_> = missed
                .iter()
                .map(|node| format!("node {} has missed what is set at 0.15 s and goes on as it was: what was staged in it was gone", node + 1))
                .collect();
            assert_eq!(set.contradictions, words, "{events}");
            for (node, (here, there)) in set.reports.iter().zip(&loopback.counters).enumerate() {
                let here = here.as_ref().map(|report| report.counters.refused(Refusal::Phase));
                assert!(
                    here.is_none_or(|here| here == there.refused(Refusal::Phase)),
                    "{node}: {events}: {here:?}"
                );
            }
        }
    }
}

/// Unlike what a run configures.
#[test]
fn what_was_adopted_is_stored_and_nothing_else() {
    let checksum = |board: &system_tests::board::Board| board.kept.stored.as_ref().map(NodeConfig::checksum);
    let two = five(LOAD, &[]);
    let mut world = World::new(5, TRAVEL, Peace);
    let ran = in_world(&two, &mut world, &[], false).unwrap();
    let _ = as_loopback(&two, ran);
    let next: Vec<_> =
        staged(&two, LOCKSTEP).into_iter().map(|staged| Some(staged?.config.checksum())).collect();
    let stored: Vec<_> = world.boards().iter().map(checksum).collect();
    assert_eq!(stored, next);
    assert!(stored[1].is_some() && stored[0].is_none());
    // The next run is on the same boards, and does not care.
    let calm = five("", &[]);
    let again = in_world(&calm, &mut world, &[], false).unwrap();
    let _ = as_loopback(&calm, again);
    assert_eq!(world.boards().iter().map(checksum).collect::<Vec<_>>(), next);
}

/// What happens to frames on the line of the second node.
struct Mischief<T>(T);

impl<T: FnMut(Way, Frame<'_>) -> Option<Vec<u8>>> Fate for Mischief<T> {
    fn carry(&mut self, node: usize, way: Way, _: u64, frame: Vec<u8>) -> Vec<Vec<u8>> {
        if node != 1 {
            return vec![frame];
        }
        let mut bytes = frame.clone();
        bytes.pop();
        match serial::decode(&mut bytes) {
            Ok(whole) => vec![(self.0)(way, whole).unwrap_or(frame)],
            Err(_) => vec![frame],
        }
    }

    fn befall(&mut self, _: usize, _: u64) -> Blow {
        Blow::None
    }
}

/// Runs the narrower funnel with such mischief.
fn with_mischief(mischief: impl FnMut(Way, Frame<'_>) -> Option<Vec<u8>>) -> Result<Ran, HubError> {
    let mut world = World::new(5, TRAVEL, Mischief(mischief));
    in_world(&five(NARROW, &[]), &mut world, &[], false)
}

fn commit(frame: &Frame<'_>) -> Option<(Target, u16)> {
    match *frame {
        Frame::RealTime(Message::Ctrl { target, command: Command::Commit, at_tick, .. }) => {
            Some((target, at_tick))
        }
        _ => None,
    }
}

fn says_commit(target: Target, at_tick: u16) -> Vec<u8> {
    serial::encode(&Message::Ctrl { target, command: Command::Commit, arg: 0, at_tick }).to_vec()
}

fn service(body: &impl Body, source: u8) -> Vec<u8> {
    let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
    let length = serial::encode_service(body, source, &mut scratch, &mut frame).unwrap();
    frame[..length].to_vec()
}

/// A STAGE with another configuration.
fn stages(frame: &Frame<'_>, change: impl Fn(&mut NodeConfig)) -> Option<Vec<u8>> {
    let Frame::Service { kind, body, .. } = *frame else { return None };
    let Ok(Request::Stage(mut config)) = Request::decode(kind, body) else { return None };
    change(&mut config);
    Some(service(&Request::Stage(config), 0))
}

/// The second node goes on as it was, is named, and the others have adopted it.
fn assert_named(ran: &Ran, words: &str) {
    assert_eq!(ran.adopted, [0, 2, 3, 4].map(|node| (node, 150)), "{:?}", ran.contradictions);
    let [said] = ran.contradictions.as_slice() else { panic!("{:?}", ran.contradictions) };
    assert!(
        said.starts_with("node 2 has not adopted what was staged in it, and goes on as it was: "),
        "{said}"
    );
    assert!(said.contains(words), "{said}");
    let loopback = run(&five(NARROW, &[]), Fidelity::Loopback);
    assert_ne!(loopback.hash, Some(ran.hash));
}

#[test]
fn a_commit_that_does_not_come_comes_for_another_tick_or_for_another_node_is_found() {
    let lost = with_mischief(|_, frame| commit(&frame).map(|_| vec![0])).unwrap();
    assert_named(&lost, "and it has refused no frame at tick 149");
    let late =
        with_mischief(|_, frame| commit(&frame).map(|(target, at)| says_commit(target, at + 1))).unwrap();
    assert_named(&late, "and it has refused no frame at tick 149");
    let other = Target::Node(NodeId::new(3).unwrap());
    let astray = with_mischief(|_, frame| commit(&frame).map(|(_, at)| says_commit(other, at))).unwrap();
    assert_named(&astray, "and it has refused no frame at tick 149");
    // A commit for a tick that is past.
    let past = with_mischief(|_, frame| commit(&frame).map(|(target, _)| says_commit(target, 3))).unwrap();
    assert_named(&past, "and it has refused frames (tick_window 1) at tick 149");
}

/// As the engine hands it over: once the tick nine before it has run.
#[test]
fn a_commit_goes_out_eight_ticks_ahead() {
    let (mut marked, mut told) = (0, None);
    with_mischief(|_, frame| {
        match frame {
            Frame::RealTime(Message::Sync { previous_tick, .. }) => marked = previous_tick.value() + 1,
            frame => told = told.or(commit(&frame).map(|_| marked)),
        }
        None
    })
    .unwrap();
    assert_eq!(told, Some(141));
}

/// A commit is a frame that a node has accepted, and no state.
#[test]
fn who_has_heard_no_state_is_seen_to_also_where_it_has_adopted_something() {
    let deaf = |way, frame: Frame<'_>| match (way, frame) {
        (Way::ToNode, Frame::RealTime(Message::State { .. })) => Some(vec![0]),
        _ => None,
    };
    let path = five(NARROW, &["graph.kind=path"]);
    let ran = in_world(&path, &mut World::new(5, TRAVEL, Mischief(deaf)), &[], false).unwrap();
    assert_eq!((ran.adopted, ran.unheard.0), (all_at(150), vec![1]));
}

#[test]
fn a_storage_that_fails_at_the_commit_is_told_and_the_others_go_on() {
    let mut world = World::new(5, TRAVEL, Peace);
    world.board_mut(1).kept.fails = true;
    let ran = in_world(&five(NARROW, &[]), &mut world, &[], false).unwrap();
    assert_named(&ran, "since its storage has failed (FAULT 9)");
}

#[test]
fn what_is_not_staged_as_it_was_given_ends_the_run_before_it_starts() {
    // Another configuration, which the node accepts.
    let another = with_mischief(|_, frame| stages(&frame, |config| config.tuning.damping += 0.1));
    let text = another.err().unwrap().to_string();
    assert!(text.contains("node 2 has the configuration with checksum"), "{text}");
    let refused = with_mischief(|_, frame| stages(&frame, |config| config.tuning.damping = -1.0));
    let text = refused.err().unwrap().to_string();
    assert!(text.contains("node 2 has not staged its configuration"), "{text}");
    // A storage that keeps nothing.
    let mut world = World::new(5, TRAVEL, Peace);
    world.board_mut(1).kept.is_worn = true;
    let text = in_world(&five(NARROW, &[]), &mut world, &[], false).err().unwrap().to_string();
    assert_eq!(text, "node 2 has not staged its configuration: the flash did not take it");
}

/// Three of a path, of which the second stops once it has lost the first, after it has been told to adopt something.
fn stops_before_the_tick() -> Scenario {
    let events = "event=[{at='100ms',kind='crash',node=1},{at='116ms',kind='set',key='coupling.funnel.end',value=0.5,node=2}]";
    let sets = ["time.duration=200ms", "graph={kind='path',nodes=5}", "safety.lost_neighbours=1", events];
    scenario("five-agents.toml", &sets)
}

#[test]
fn nobody_awaits_an_answer_of_a_node_that_has_stopped_before_the_tick() {
    let stops = stops_before_the_tick();
    let mut told = None;
    let look = |_, frame: Frame<'_>| {
        told = told.or(commit(&frame));
        None
    };
    let ran = in_world(&stops, &mut World::new(5, TRAVEL, Mischief(look)), &[], false).unwrap();
    let (_, ran) = as_loopback(&stops, ran);
    assert_eq!((told.map(|(_, tick)| tick), ran.contradictions.as_slice()), (Some(116), &[][..]));
    assert_eq!((ran.presence[110][1], ran.presence[115][1]), (Presence::Ran, Presence::Stopped));
}

/// The question, or its answer, is spoilt: it is asked again.
#[test]
fn what_a_node_has_is_asked_again_where_no_answer_comes() {
    let (mut told, mut spoilt) = (false, 0);
    let ran = with_mischief(|_, frame| {
        told |= commit(&frame).is_some();
        let Frame::Service { kind, body, .. } = frame else { return None };
        let asks = told && matches!(Request::decode(kind, body), Ok(Request::Hello));
        spoilt += u32::from(asks);
        (asks && spoilt <= 2).then(|| vec![0])
    })
    .unwrap();
    assert_eq!((ran.adopted, ran.contradictions.as_slice(), spoilt), (all_at(150), &[][..], 3));
}

/// A node that is lost when it is asked what it has: it has run the tick before, and nobody knows what it has adopted.
#[test]
fn who_is_lost_once_it_was_told_is_named_and_missed_from_the_tick_on() {
    let (mut told, mut spoilt) = (false, 0);
    let deaf = |_, frame: Frame<'_>| {
        told |= commit(&frame).is_some();
        let Frame::Service { kind, body, .. } = frame else { return None };
        let asks = told && matches!(Request::decode(kind, body), Ok(Request::Hello));
        spoilt += u32::from(asks);
        // It is found again when it is looked for later.
        (asks && spoilt <= 3).then(|| vec![0])
    };
    let scenario = five(NARROW, &[]);
    let mut world = World::new(5, 20 * TRAVEL, Mischief(deaf));
    let mut conductor = conductor(&scenario, LOCKSTEP, PATIENCE).with_loss(OnLoss::GoOn);
    world.run(conductor.meet()).unwrap();
    world.run(conductor.stage()).unwrap();
    world.run(conductor.start()).unwrap();
    let mut presence = Vec::new();
    for _ in 0..=scenario.time.ticks {
        world.run(conductor.advance()).unwrap();
        presence.push(conductor.presence()[1]);
    }
    assert_eq!(presence[148..152], [Presence::Ran, Presence::Ran, Presence::Absent, Presence::Absent]);
    let [absence] = conductor.absences() else { panic!("{:?}", conductor.absences()) };
    assert_eq!((absence.node, absence.from, absence.to.is_some()), (2, 150, true));
    let words = "node 2 was lost once it was told to adopt what was staged in it, and goes on as it was: that may be gone at tick 150";
    assert_eq!(conductor.contradictions(), [words]);
}

/// It comes by its slow line, and ticks by its bus.
#[test]
fn a_node_on_can_that_comes_has_had_its_start_and_its_commit_before_the_next_tick() {
    for event in
        ["{at='140ms',kind='bounce',node=2,for='3ms'}", "{at='145ms',kind='bounce',node=2,for='2ms'}"]
    {
        let scenario = five(&format!("{event},{NARROW}"), &[]);
        let buses: [&[usize]; 1] = [&[0, 1, 2, 3, 4]];
        let mut world = World::new(5, TRAVEL, Peace).with_bus(buses[0], false);
        world.line_delay = 5_000_000;
        let ran = in_world(&scenario, &mut world, &buses, false).unwrap();
        let (_, ran) = as_loopback(&scenario, ran);
        assert_eq!(ran.contradictions.len(), 1, "{:?}", ran.contradictions);
        assert_eq!(ran.reports[1].as_ref().unwrap().counters.refused(Refusal::Phase), 1);
    }
}

/// It says that it has what it was given, and its funnel is the old one.
#[test]
fn a_node_that_says_it_has_adopted_and_has_not_is_betrayed_by_its_funnel() {
    let claimed = staged(&five(NARROW, &[]), LOCKSTEP)[1].clone().unwrap().config.checksum();
    let ran = with_mischief(|_, frame| match frame {
        Frame::Service { kind, body, .. } => match Reply::decode(kind, body) {
            Ok(Reply::Identity(identity)) => {
                Some(service(&Reply::Identity(Identity { checksum: claimed, ..identity }), 2))
            }
            _ => None,
        },
        frame => commit(&frame).map(|_| vec![0]),
    })
    .unwrap();
    assert_eq!((ran.adopted.as_slice(), ran.contradictions.as_slice()), (&all_at(150)[..], &[][..]));
    // The judge compares each node's funnel with the scenario's at each tick (`sim-host/tests/bench_events.rs`).
    assert_eq!(ran.psi[149][0], ran.psi[149][1]);
    assert!(ran.psi[150][1] > ran.psi[150][0], "{:?}", ran.psi[150]);
}

/// Nodes that tick by their own timers, told by the host's count of ticks.
mod own_clock {
    use super::*;

    const DRIVE: Drive = Drive { tick_source: TickSource::Timer, telemetry_every: 1, is_simulated: false };

    fn ran<F: Fate>(scenario: &Scenario, world: &mut World<F>) -> (Conductor, Vec<Vec<f32>>) {
        let mut conductor = conductor(scenario, DRIVE, PATIENCE).with_own_clock();
        world.run(conductor.meet()).unwrap();
        world.run(conductor.stage()).unwrap();
        world.run(conductor.start()).unwrap();
        let mut psi = Vec::new();
        for _ in 0..=scenario.time.ticks {
            world.run(conductor.advance()).unwrap();
            assert_eq!(conductor.presence(), [Presence::Ran; 5]);
            psi.push(conductor.observations().iter().map(|seen| seen.psi).collect());
        }
        world.run(conductor.finish()).unwrap();
        (conductor, psi)
    }

    #[test]
    fn all_adopt_it_at_their_own_tick_of_that_number() {
        for (event, count) in [(NARROW, 5), (LOAD, 2), (&NARROW.replace("150ms", "8ms"), 5)] {
            let scenario = five(event, &[]);
            let (conductor, psi) = ran(&scenario, &mut World::new(5, TRAVEL, Peace));
            assert_eq!(adopted(conductor.events()).len(), count, "{event}");
            assert_eq!(conductor.contradictions(), [""; 0], "{event}");
            for (row, psi) in run(&scenario, Fidelity::Loopback).rows.iter().zip(psi) {
                assert_eq!(row.psi, psi.into_iter().map(f64::from).collect::<Vec<_>>(), "{event}");
            }
        }
    }

    /// A tick that comes before this program knows that the node runs, and the commit to the node.
    #[test]
    fn what_is_told_too_late_is_said_and_the_node_goes_on_as_it_was() {
        let scenario = five(&NARROW.replace("150ms", "1ms"), &[]);
        let (conductor, _) = ran(&scenario, &mut World::new(5, 12 * TRAVEL, Peace));
        assert!(adopted(conductor.events()).is_empty());
        let said = conductor.contradictions().join("; ");
        assert!(said.contains("node 2 has not adopted what was staged in it"), "{said}");
        assert!(said.contains("refused frames (tick_window "), "{said}");
        assert!(said.contains("; it was told too late, when this program had counted to "), "{said}");
    }

    /// A node that does not run yet would adopt at once, and a start on CAN may come later than a commit on a line.
    #[test]
    fn nobody_is_told_before_it_has_ticked() {
        let (mut ticked, mut told) = (false, None);
        let look = |_, frame: Frame<'_>| {
            match frame {
                Frame::Service { kind, body, .. } => {
                    ticked |= matches!(Reply::decode(kind, body), Ok(Reply::Telemetry(_)));
                }
                frame => told = told.or(commit(&frame).map(|_| ticked)),
            }
            None
        };
        ran(&five(NARROW, &[]), &mut World::new(5, TRAVEL, Mischief(look)));
        assert_eq!(told, Some(true));
    }

    #[test]
    fn a_commit_that_does_not_come_is_found_at_the_end() {
        let lost = |_, frame: Frame<'_>| commit(&frame).map(|_| vec![0]);
        let (conductor, _) = ran(&five(NARROW, &[]), &mut World::new(5, TRAVEL, Mischief(lost)));
        assert_eq!(adopted(conductor.events()).len(), 4);
        let said = conductor.contradictions().join("; ");
        assert!(
            said.starts_with("node 2 has not adopted what was staged in it, and goes on as it was: "),
            "{said}"
        );
        assert!(said.ends_with(" at tick 150"), "{said}");
    }

    #[test]
    fn a_storage_that_fails_at_the_commit_is_told_also_here() {
        let mut world = World::new(5, TRAVEL, Peace);
        world.board_mut(1).kept.fails = true;
        let (conductor, _) = ran(&five(NARROW, &[]), &mut world);
        let said = conductor.contradictions().join("; ");
        assert!(said.contains(", since its storage has failed (FAULT 9) at tick 150"), "{said}");
    }

    /// It hears no state, and stops: before the tick, or after one at which it has not adopted anything.
    #[test]
    fn who_has_stopped_before_the_tick_is_not_asked_and_who_has_after_it_does_not_go_on() {
        for (at, named) in [("300ms", false), ("150ms", true)] {
            let mut states = 0;
            let deaf = |way, frame: Frame<'_>| {
                let is_heard = way == Way::ToNode && matches!(frame, Frame::RealTime(Message::State { .. }));
                states += u32::from(is_heard);
                (commit(&frame).is_some() || is_heard && states > 400).then(|| vec![0])
            };
            let scenario = five(&NARROW.replace("150ms", at), &["safety.lost_neighbours=1"]);
            let mut world = World::new(5, TRAVEL, Mischief(deaf));
            let mut conductor = conductor(&scenario, DRIVE, PATIENCE).with_own_clock();
            world.run(conductor.meet()).unwrap();
            world.run(conductor.stage()).unwrap();
            world.run(conductor.start()).unwrap();
            for _ in 0..=scenario.time.ticks {
                world.run(conductor.advance()).unwrap();
            }
            assert_eq!(conductor.presence()[1], Presence::Stopped);
            world.run(conductor.finish()).unwrap();
            let said = conductor.contradictions().into_iter().filter(|said| said.contains("adopted"));
            let said: Vec<_> = said.collect();
            assert_eq!(said.len(), usize::from(named), "{said:?}");
            let words = "node 2 had not adopted what was staged in it when it stopped: ";
            assert!(said.iter().all(|said| said.starts_with(words)), "{said:?}");
        }
    }
}

/// Worlds that the comparison must not take for loopback's.
#[test]
fn what_is_not_set_or_a_tick_late_differs() {
    let hash = run(&five(NARROW, &[]), Fidelity::Loopback).hash;
    assert_eq!(hash, Some(on_boards(&five(NARROW, &[]), false).hash));
    for other in ["", &NARROW.replace("150ms", "151ms"), &NARROW.replace("0.5", "0.6")] {
        assert_ne!(hash, Some(on_boards(&five(other, &[]), false).hash), "{other}");
    }
}
