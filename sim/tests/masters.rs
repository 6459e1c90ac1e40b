//! Nodes that go and come, and links that are cut, where nodes have clocks of their own: who tells the time then.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_link::Classic;
use funnelnet_node::{Event, Observation, Phase};
use funnelnet_protocol::message::{FaultCode, NodeId};
use funnelnet_sim::loopback::{can_bus, engine_on};
use funnelnet_sim::{Scenario, Simulation, Verdict};
use std::path::Path;

/// A ring of five that differ, inside a funnel of 0.2 from 1 s on.
const RING: &str = r#"version = 1
time = { tick = "1ms", duration = "5s" }
graph = { kind = "ring", nodes = 5 }
bus = { model = "can", bitrate = 1000000 }
coupling.kind = "node-wise"
coupling.gain = { kind = "reciprocal", scale = 1.0 }
coupling.funnel = { kind = "exponential", start = 10.0, end = 0.2, rate = 4.0 }
agent.dynamics = { kind = "affine", slope = -1.0, offset = 1.0 }
expect = { recovered_within = "1200ms", stopped = "any" }
"#;
const DRIVEN: &str =
    "[[node]]\nid = 3\nstate = 0.5\ndynamics = { sines = [{ amplitude = 2.0, frequency = 3.0 }] }\n";
const DRIFTING: &str =
    "clock = { drift_ppm = 50, wander = 0.01 }\nsync = { period = '100ms', masters = [1, 2] }";
const ONE_MASTER: &str =
    "clock = { drift_ppm = 50, wander = 0.01 }\nsync = { period = '100ms', masters = [1] }";

fn read(events: &[&str], rest: &str) -> Scenario {
    let events: Vec<_> = events.iter().map(|event| format!("{{ {event} }}")).collect();
    let text = format!("{RING}event = [{}]\n{rest}\n{DRIVEN}", events.join(", "));
    Scenario::parse(&text, Path::new("ring.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}"))
}

/// What was reported (s, id), what all nodes saw at each tick, the largest skew (ns) and how all phases ended.
struct Played {
    said: Vec<(f64, usize, Event)>,
    seen: Vec<Vec<Observation<f32>>>,
    skew: u64,
    phases: Vec<Phase>,
}

fn played(scenario: &Scenario) -> Played {
    let mut engine = engine_on(scenario, can_bus::<Classic>(scenario).unwrap()).unwrap();
    engine.start();
    let (mut said, mut seen) = (Vec::new(), Vec::new());
    for _ in 0..=scenario.time.ticks {
        engine.advance();
        let told = engine.take_events();
        said.extend(told.iter().map(|said| ((said.at as f64 - 1e6) / 1e9, said.node + 1, said.event)));
        seen.push(engine.observations().to_vec());
    }
    let phases = engine.nodes().iter().map(|node| node.phase()).collect();
    Played { said, seen, skew: engine.skew().map_or(0, |skew| skew.worst_ns), phases }
}

impl Played {
    /// When a node reported that, s.
    fn when(&self, id: usize, what: impl Fn(&Event) -> bool) -> Vec<f64> {
        self.said.iter().filter(|said| said.1 == id && what(&said.2)).map(|said| said.0).collect()
    }

    fn leads(&self, id: usize) -> Vec<f64> {
        self.when(id, |event| *event == Event::TimeMaster)
    }

    fn follows(&self, id: usize, master: u8) -> Vec<f64> {
        self.when(id, |event| *event == Event::Follows(NodeId::new(master).unwrap()))
    }
}

fn verdict(scenario: &Scenario) -> Verdict {
    Simulation::new(scenario).unwrap().run()
}

/// With clocks that are right, events find the network that they find without clocks.
#[test]
fn with_right_clocks_nodes_that_go_and_links_that_are_cut_change_no_bit() {
    for event in [
        "at = '2s', kind = 'crash', node = 4",
        "at = '2s', kind = 'leave', nodes = [2, 4]",
        "at = '2s', kind = 'partition', groups = [[1, 2], [3, 4, 5]] }, { at = '2.5s', kind = 'repair'",
    ] {
        let (plain, clocked) =
            (played(&read(&[event], "")), played(&read(&[event], "clock = { drift_ppm = 0 }")));
        let x = |played: &Played| -> Vec<Vec<u32>> {
            played.seen.iter().map(|seen| seen.iter().map(|seen| seen.x.to_bits()).collect()).collect()
        };
        assert_eq!(x(&plain), x(&clocked), "{event}");
        let calm = played(&read(&["at = '3.8s', kind = 'crash', node = 5"], ""));
        assert_ne!(x(&plain)[2500], x(&calm)[2500], "{event}");
    }
}

#[test]
fn where_the_master_dies_the_next_one_takes_over_within_three_periods() {
    let scenario = read(&["at = '2s', kind = 'crash', node = 1"], DRIFTING);
    let played = played(&scenario);
    let leads = played.leads(2);
    assert!(leads.len() == 1 && (2.0..2.3).contains(&leads[0]), "{leads:?}");
    for id in 3..=5 {
        assert!(played.follows(id, 2).iter().all(|at| (2.0..2.4).contains(at)), "{id}");
        assert_eq!(played.follows(id, 2).len(), 1, "{id}");
    }
    assert!(played.skew < 20_000, "{}", played.skew);
    let verdict = verdict(&scenario);
    assert!(verdict.holds(), "{verdict}");
}

#[test]
fn a_master_that_comes_back_follows_first_then_leads_and_the_other_one_yields() {
    let scenario = read(&["at = '1s', kind = 'bounce', node = 1, for = '600ms'"], DRIFTING);
    let played = played(&scenario);
    let (second, first) = (played.leads(2), played.leads(1));
    assert!(second.len() == 1 && (1.0..1.3).contains(&second[0]), "{second:?}");
    // It led from the start, too.
    assert!(first.len() == 2 && (1.7..3.0).contains(&first[1]), "{first:?}");
    let (followed, yields) = (played.follows(1, 2), played.follows(2, 1));
    assert!(followed.len() == 1 && (1.6..first[1]).contains(&followed[0]), "{followed:?}");
    // It has followed from the start, too.
    assert!(yields.len() == 2 && (first[1]..first[1] + 0.1).contains(&yields[1]), "{yields:?}");
    assert!(played.skew < 20_000, "{}", played.skew);
    let verdict = verdict(&scenario);
    assert!(verdict.holds(), "{verdict}");
}

/// It is away for less than the others wait for, so that nobody takes over, and it can learn the time from nobody.
#[test]
fn a_master_that_is_back_before_another_one_leads_waits_for_that_one() {
    let scenario = read(&["at = '2s', kind = 'bounce', node = 1, for = '50ms'"], DRIFTING);
    let played = played(&scenario);
    let (second, first) = (played.leads(2), played.leads(1));
    assert!(second.len() == 1 && (2.0..2.3).contains(&second[0]), "{second:?}");
    assert!(first.len() == 2 && first[1] > second[0], "{first:?}");
    assert!(played.skew < 20_000, "{}", played.skew);
    assert!(verdict(&scenario).holds(), "{}", verdict(&scenario));
}

#[test]
fn a_node_that_bounces_with_a_drifting_clock_learns_the_tick_from_the_master_and_joins() {
    let events = ["at = '2s', kind = 'bounce', node = 4, for = '200ms'"];
    let scenario = read(&events, DRIFTING);
    let played = played(&scenario);
    let joins = played.when(4, |event| matches!(event, Event::Joins { .. }));
    assert!(joins.len() == 1 && (2.3..3.2).contains(&joins[0]), "{joins:?}");
    let tick = played.said.iter().find_map(|said| match said.2 {
        Event::Joins { tick } => Some(f64::from(tick) * 1e-3),
        _ => None,
    });
    // It is at the tick of the others.
    assert!((tick.unwrap() - joins[0]).abs() < 2e-3, "{tick:?} {joins:?}");
    assert!(played.skew < 20_000, "{}", played.skew);
    let ticks: Vec<u32> = played.seen[5000].iter().map(|seen| seen.tick).collect();
    assert!(ticks.iter().all(|tick| tick.abs_diff(5000) <= 1), "{ticks:?}");
    let verdict = verdict(&scenario);
    assert!(verdict.holds(), "{verdict}");
}

#[test]
fn a_node_that_is_absent_from_the_start_joins_by_the_masters_time() {
    let scenario = read(&["at = '2s', kind = 'join', node = 5"], DRIFTING);
    let played = played(&scenario);
    assert_eq!(played.when(5, |event| matches!(event, Event::Joins { .. })).len(), 1);
    assert!(played.skew < 20_000, "{}", played.skew);
    let verdict = verdict(&scenario);
    assert!(verdict.holds(), "{verdict}");
}

#[test]
fn without_another_master_all_hold_over_and_stop_by_the_fault_that_is_configured() {
    let crash = ["at = '2s', kind = 'crash', node = 1"];
    let held = played(&read(&crash, ONE_MASTER));
    assert!(held.phases[1..].iter().all(|phase| *phase == Phase::Running), "{:?}", held.phases);
    assert!(held.skew < 200_000, "{}", held.skew);
    let stopped = played(&read(&crash, &format!("{ONE_MASTER}\nsafety.holdover = '1s'")));
    let fault = Phase::Faulted(FaultCode::HOLDOVER);
    assert!(stopped.phases[1..].iter().all(|phase| *phase == fault), "{:?}", stopped.phases);
    for id in 2..=5 {
        let at = stopped.when(id, |event| *event == Event::Fault(FaultCode::HOLDOVER));
        assert!(at.len() == 1 && (2.8..3.1).contains(&at[0]), "{id} {at:?}");
    }
}

/// Nobody can tell it the time, and nobody believes the one that it has: the others go on without it.
#[test]
fn the_only_master_does_not_find_back_into_its_network() {
    let scenario = read(&["at = '2s', kind = 'bounce', node = 1, for = '200ms'"], ONE_MASTER);
    let played = played(&scenario);
    let leads = played.leads(1);
    assert!(leads.len() == 2 && (2.2..2.6).contains(&leads[1]), "{leads:?}");
    let last: Vec<u32> = played.seen[5000].iter().map(|seen| seen.tick).collect();
    assert!(last[0] < 3000 && last[1..].iter().all(|tick| tick.abs_diff(5000) <= 1), "{last:?}");
    let verdict = verdict(&scenario);
    assert!(!verdict.holds(), "{verdict}");
}

/// The same with two, where none is left to tell them the time: they are a network of their own from then on.
#[test]
fn masters_that_are_off_at_the_same_time_do_not_find_back_into_their_network() {
    let scenario = read(&["at = '2s', kind = 'bounce', nodes = [1, 2], for = '200ms'"], DRIFTING);
    let played = played(&scenario);
    let last: Vec<u32> = played.seen[5000].iter().map(|seen| seen.tick).collect();
    assert!(last[2..].iter().all(|tick| tick.abs_diff(5000) <= 1), "{last:?}");
    assert!(last[0].abs_diff(last[1]) <= 1 && last[0] < 4000, "{last:?}");
    let verdict = verdict(&scenario);
    assert!(!verdict.holds(), "{verdict}");
}

/// A commit is for the tick of that number, on each clock.
#[test]
fn what_is_set_is_adopted_at_one_tick_while_the_master_changes() {
    let set = "at = '2.1s', kind = 'set', key = 'coupling.funnel.end', value = 0.1";
    let scenario = read(&["at = '2s', kind = 'crash', node = 1", set], DRIFTING);
    let played = played(&scenario);
    for id in 2..=5 {
        let at = played.when(id, |event| *event == Event::Adopted { tick: 2100 });
        assert!(at.len() == 1 && (2.098..2.1005).contains(&at[0]), "{id} {at:?}");
    }
    let verdict = verdict(&scenario);
    assert!(verdict.holds(), "{verdict}");
}

/// What it is handed is its own clock's time: that of the network leaps as it becomes known.
#[test]
fn a_node_that_comes_is_not_stopped_by_its_holdover_as_it_learns_the_time() {
    let bounce = ["at = '2s', kind = 'bounce', node = 4, for = '200ms'"];
    let scenario = read(&bounce, &format!("{DRIFTING}\nsafety.holdover = '500ms'"));
    let played = played(&scenario);
    assert!(played.phases.iter().all(|phase| *phase == Phase::Running), "{:?}", played.phases);
    let verdict = verdict(&scenario);
    assert!(verdict.holds() && verdict.stops.is_empty(), "{verdict}");
}

/// SYNC is on no link: else one that a link has lost, or holds, would leave its stamp to the next one, and clocks would be a period apart.
#[test]
fn no_link_keeps_a_sync_from_its_stamp() {
    let link = "[[link]]\nbetween = [1, 2]\nloss = 0.3\nreorder = 0.1\nduplicate = 0.1\njitter = '300us'";
    let burst = "at = '2s', kind = 'burst', link = [1, 5], for = '500ms', loss = 1.0";
    let hold = "at = '3s', kind = 'hold', link = [1, 5], for = '300ms'";
    for sync in [DRIFTING, ONE_MASTER] {
        let disturbed = played(&read(&[burst, hold], &format!("{sync}\n{link}")));
        assert!(disturbed.skew < 20_000, "{} ns", disturbed.skew);
    }
}
