//! Events that the host makes on nodes: sessions behind serial lines that the real conductor drives in virtual
//! time have the bits of loopback with the same events.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use sim_host::presence::Presence;
use sim_host::run::Fidelity;
use sim_host::scenario::Scenario;
use system_tests::lockstep::{
    as_loopback as assert_as_loopback, compared as assert_same_bits, on_boards, on_buses,
};
use system_tests::{run, scenario};

/// Five agents with these events.
fn five(events: &str, sets: &[&str]) -> Scenario {
    let events = format!("event=[{events}]");
    scenario("five-agents.toml", &[&["time.duration=900ms", events.as_str()], sets].concat())
}

const HALVES: &str = "{at='200ms',kind='partition',groups=[[1,2],[3,4,5]]},{at='420ms',kind='repair'}";

#[test]
fn links_that_are_cut_and_mended() {
    let (_, calm) = assert_same_bits(&five("", &[]), false);
    let (_, cut) = assert_same_bits(&five(HALVES, &[]), false);
    assert_ne!(calm.hash, cut.hash);
    assert_same_bits(&five("{at='0s',kind='partition',link=[1,2]},{at='300.5ms',kind='repair'}", &[]), false);
    // Frames are on their way meanwhile.
    let late = ["bus.latency=700us", "bus.jitter=900us", "bus.loss=0.1"];
    assert_same_bits(&five(HALVES, &late), false);
}

#[test]
fn frames_that_are_lost_and_held_back() {
    let burst = "{at='200ms',kind='burst',loss={good=0.1,bad=0.9,to_bad=0.05,to_good=0.05},for='300ms'}";
    let (loopback, _) = assert_same_bits(&five(burst, &[]), false);
    assert!(loopback.bus.unwrap().lost > 300);
    let held = "{at='200ms',kind='hold',link=[1,2]},{at='300ms',kind='hold',node=4,for='50ms'},{at='380ms',kind='release'}";
    let (calm, held) =
        (on_boards(&five("", &[]), false), assert_same_bits(&five(held, &["bus.jitter=400us"]), false).1);
    assert_ne!(calm.hash, held.hash);
}

#[test]
fn nodes_that_say_what_is_not_so() {
    for lie in [
        "{at='200ms',kind='liar',node=2,ramp=3.0,for='200ms'}",
        "{at='200ms',kind='liar',nodes=[1,4],offset=0.5}",
        "{at='200ms',kind='replayer',node=2,age='1ms',for='200ms'}",
        "{at='200ms',kind='impostor',node=2,as=3,offset=0.5,for='10ms'}",
        "{at='200ms',kind='impostor',node=2,as=4,constant=0.5,for='200ms'}",
    ] {
        let (_, told) = assert_same_bits(&five(lie, &[]), false);
        let honest = on_boards(&five("", &[]), false);
        // An old state is refused by who has the newer one.
        assert_eq!(told.hash == honest.hash, lie.contains("replayer"), "{lie}");
        assert_same_bits(&five(lie, &["bus.jitter=1300us", "agent.noise=0.001"]), false);
    }
}

#[test]
fn nodes_that_leave_crash_and_come() {
    for has_power in [true, false] {
        for events in [
            "{at='200ms',kind='leave',node=2}",
            "{at='200ms',kind='crash',nodes=[2,4]}",
            "{at='200ms',kind='bounce',node=3}",
            "{at='200.25ms',kind='bounce',node=3,for='500us'}",
            "{at='200.25ms',kind='bounce',node=3,for='100us'}",
            "{at='200ms',kind='leave',node=2},{at='300ms',kind='join',node=2},{at='850ms',kind='leave',node=2}",
            "{at='300ms',kind='join',node=2}",
            "{at='0s',kind='crash',node=1},{at='150ms',kind='join',node=1},{at='151ms',kind='crash',node=1}",
            "{at='0s',kind='leave',node=1},{at='150ms',kind='join',node=1}",
            // Nobody hears it, and it speaks when it has waited long enough.
            "{at='100ms',kind='partition',groups=[[3],[1,2,4,5]]},{at='150ms',kind='bounce',node=3},{at='700ms',kind='repair'}",
            // What the false one says next is lost with it.
            "{at='150ms',kind='impostor',node=2,as=4,constant=0.5},{at='200.25ms',kind='crash',node=2}",
            // Nobody is left.
            "{at='200ms',kind='crash',nodes=[1,2,3,4,5]},{at='400ms',kind='join',nodes=[1,2,3]}",
        ] {
            assert_same_bits(&five(events, &[]), has_power);
        }
    }
    let late = ["bus.latency=700us", "bus.jitter=900us", "bus.loss=0.1", "agent.noise=0.001"];
    assert_same_bits(
        &five("{at='100ms',kind='bounce',node=3,for='120ms'},{at='700ms',kind='leave',node=1}", &late),
        true,
    );
}

/// Who comes says that it starts anew, which its neighbours have to hear before its first state.
#[test]
fn nodes_that_are_off_for_a_moment_where_there_are_limits_of_what_is_heard() {
    let events =
        "{at='200ms',kind='bounce',node=3,for='20ms'},{at='400.5ms',kind='bounce',nodes=[1,4],for='5ms'}";
    let limits = ["safety.heard_rate=60", "coupling.u_max=20"];
    let five = five(events, &limits);
    let (loopback, boards) = assert_same_bits(&five, true);
    assert_eq!(boards.reports.iter().flatten().map(|report| report.counters.kept.edges).sum::<u32>(), 0);
    for (here, there) in boards.reports.iter().flatten().zip(&loopback.counters) {
        assert_eq!((here.counters.neighbours_lost, there.neighbours_lost), (0, 0));
    }
    assert_same_bits(&five, false);
    for fd in [false, true] {
        for buses in [vec![&[0, 1, 2, 3, 4][..]], vec![&[0, 2][..], &[1, 4][..]]] {
            assert_as_loopback(&five, on_buses(&five, false, &buses, fd));
        }
    }
    let late = ["bus.latency=700us", "bus.jitter=900us", "bus.loss=0.1"];
    assert_same_bits(&self::five(events, &[&limits[..], &late].concat()), true);
}

/// A node that has just come has accepted fewer states than it was handed other frames before.
#[test]
fn a_node_that_has_just_come_has_heard_its_neighbours() {
    assert_same_bits(&five("{at='800ms',kind='bounce',node=2,for='99ms'}", &["graph.kind=path"]), true);
}

#[test]
fn events_happen_also_where_all_nodes_have_stopped_by_themselves() {
    // Unstable agents whose frames come late.
    let slopes: Vec<_> = (1..=5).map(|id| format!("node.{id}.dynamics.slope={}.0", 50 + 5 * id)).collect();
    let stop: Vec<_> = slopes.iter().map(String::as_str).chain(["bus.latency=1500us"]).collect();
    let (_, boards) = assert_same_bits(&five("{at='500ms',kind='bounce',node=2}", &stop), true);
    assert_eq!(boards.presence[499], [Presence::Stopped; 5]);
    assert_eq!((boards.presence[500][1], boards.presence[600][1]), (Presence::Off, Presence::Ran));
}

#[test]
fn also_with_vectors_and_without_coupling() {
    let events = "event=[{at='50ms',kind='bounce',node=2,for='60ms'},{at='200ms',kind='leave',node=1}]";
    assert_same_bits(&scenario("vector-oscillators.toml", &["time.duration=300ms", events]), true);
    assert_same_bits(&five("{at='50ms',kind='bounce',node=2,for='60ms'}", &["coupling.kind=none"]), true);
}

#[test]
fn nodes_on_can_leave_crash_and_come() {
    // A goodbye on CAN is heard at once: at the time of a tick it would be a tick earlier than in loopback.
    let events = "{at='100.5ms',kind='leave',node=2},{at='200ms',kind='bounce',nodes=[3,5],for='60ms'},{at='300ms',kind='join',node=2},\
                  {at='0s',kind='crash',node=1},{at='250ms',kind='join',node=1},{at='800.5ms',kind='leave',node=1}";
    for fd in [false, true] {
        for buses in [vec![&[0, 1, 2, 3, 4][..]], vec![&[0, 1, 2][..]], vec![&[0, 2][..], &[1, 4][..]]] {
            let five = five(events, &[]);
            assert_as_loopback(&five, on_buses(&five, false, &buses, fd));
        }
    }
    let vectors = "event=[{at='50ms',kind='bounce',node=2,for='60ms'},{at='200.5ms',kind='leave',node=1}]";
    let vectors = scenario("vector-oscillators.toml", &["time.duration=300ms", vectors]);
    assert_as_loopback(&vectors, on_buses(&vectors, false, &[&[0, 1]], true));
}

/// Worlds that the comparison must not take for loopback's: nothing is made, or it is made a tick late.
#[test]
fn an_event_that_is_not_made_or_comes_a_tick_late_differs() {
    for (events, late) in [
        (HALVES, HALVES.replace("200ms", "201ms")),
        (HALVES, HALVES.replace("420ms", "421ms")),
        (
            "{at='200ms',kind='burst',loss=1.0,for='9ms'}",
            "{at='201ms',kind='burst',loss=1.0,for='9ms'}".to_owned(),
        ),
        ("{at='200ms',kind='hold',for='9ms'}", "{at='201ms',kind='hold',for='9ms'}".to_owned()),
        ("{at='200ms',kind='leave',node=2}", "{at='201ms',kind='leave',node=2}".to_owned()),
        ("{at='200ms',kind='leave',node=2}", "{at='200ms',kind='crash',node=2}".to_owned()),
        ("{at='200ms',kind='crash',node=2}", "{at='201ms',kind='crash',node=2}".to_owned()),
        ("{at='200ms',kind='bounce',node=2}", "{at='200ms',kind='bounce',node=2,for='101ms'}".to_owned()),
        (
            "{at='200ms',kind='liar',node=2,offset=1.0}",
            "{at='201ms',kind='liar',node=2,offset=1.0}".to_owned(),
        ),
    ] {
        let hash = run(&five(events, &[]), Fidelity::Loopback).hash;
        assert_eq!(hash, Some(on_boards(&five(events, &[]), true).hash), "{events}");
        assert_ne!(hash, Some(on_boards(&five(&late, &[]), true).hash), "{events}");
        assert_ne!(hash, Some(on_boards(&five("", &[]), true).hash), "{events}");
    }
}

/// Events by chance, of all kinds that the host makes and that can be drawn, several at a time.
#[test]
fn events_by_chance_have_the_bits_of_loopback() {
    let faults = |kind: &str| {
        format!(
            "faults={{rate=15.0,kinds=['{kind}','partition','burst','hold','liar'],loss=0.7,longest='150ms'}}"
        )
    };
    // Not both: a node that was off says once more what is older than the eight bits of the ideal bus can tell.
    let faults = [faults("bounce"), faults("replayer")];
    let (mut kinds, mut count) = (std::collections::BTreeSet::new(), 0);
    for (seed, faults) in (1..=20).zip(faults.iter().cycle()) {
        let seed = format!("seed={seed}");
        let late = if seed.ends_with('5') { "bus.jitter=1300us" } else { "bus.jitter=0ns" };
        let drawn = scenario("five-agents.toml", &["time.duration=1s", faults, &seed, late]);
        kinds.extend(drawn.events.iter().map(|event| event.kind.name()));
        count += drawn.events.len();
        assert_same_bits(&drawn, true);
    }
    assert!(kinds.len() == 7 && count > 150, "{count} of {kinds:?}");
}
