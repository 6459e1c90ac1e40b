//! Networks, laws, buses and faults by chance, and what must be so of every run (`--example campaign` runs more of them).
#![allow(clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_sim::judge::Recovered;
use system_tests::campaign::kinds::{GRAPHS, KINDS, happen};
use system_tests::campaign::{Broken, World, draw, look, smaller, smaller_by};

/// Worlds of a campaign in a test.
const WORLDS: u64 = 200;

#[test]
fn two_hundred_worlds_by_chance_are_as_they_must_be() {
    let (mut promised, mut foretold, mut recovers, mut counted, mut events) = (0, 0, 0, 0, 0);
    let (mut limited, mut timed, mut noticed, mut adopted) = (0, 0, 0, 0);
    for number in 1..=WORLDS {
        let world = draw(number);
        let seen = look(&world).unwrap_or_else(|broken| {
            let (world, broken) = smaller(&world, &broken);
            panic!("world {number}: {broken}\n{}", world.text())
        });
        promised += u64::from(seen.promised);
        foretold += u64::from(seen.foretold);
        recovers += u64::from(seen.recovers);
        counted += u64::from(seen.counted);
        limited += u64::from(seen.limited);
        timed += u64::from(seen.timed);
        (noticed, adopted) = (noticed + seen.noticed, adopted + seen.adopted);
        events += world.optional.iter().filter(|line| line.starts_with("[[event]]")).count();
    }
    println!(
        "{promised} promised, {recovers} judged after events, {counted} with counted frames, {events} events, {limited} with limits, \
         {timed} with clocks, {noticed} edges to liars, {adopted} nodes that adopted"
    );
    // A campaign that judges nothing finds nothing.
    assert!(promised > 5 && foretold > 5 && recovers > 10 && counted > 50 && events > 150);
    assert!(limited > 5 && timed > 3 && noticed > 3 && adopted > 20);
}

/// A world whose inputs are large for one reason, with much that has nothing to do with it.
#[test]
fn what_is_broken_is_made_as_small_as_it_can_be() {
    let mut world = draw(1);
    world.needed = [
        "seed = 1",
        "graph = { kind = \"path\", nodes = 3 }",
        "coupling.kind = \"node-wise\"",
        "coupling.gain = { kind = \"reciprocal\", scale = 1.0 }",
        "coupling.funnel = { kind = \"constant\", width = 0.5 }",
        "agent.dynamics = { kind = \"affine\", slope = -1.0 }",
    ]
    .map(str::to_owned)
    .to_vec();
    let lie = "[[event]]\nat = \"500ms\"\nkind = \"liar\"\nnode = 2\nconstant = 9.0";
    world.optional = [
        "coupling.guard = 0.1",
        "[[node]]\nid = 1\ndynamics = { offset = 0.3 }",
        lie,
        "[[event]]\nat = \"100ms\"\nkind = \"bounce\"\nnode = 3",
    ]
    .map(str::to_owned)
    .to_vec();
    let strains = |world: &World| {
        let scenario = world.scenario().unwrap_or_else(|errors| panic!("{errors}"));
        let verdict = funnelnet_sim::Simulation::new(&scenario).map(funnelnet_sim::Simulation::run);
        verdict.is_ok_and(|verdict| verdict.findings.max_input > Some(1.5))
    };
    assert!(strains(&world));
    let (found, broken) = smaller_by(&world, &Broken::Promise(2.0), |world| {
        if strains(world) { Err(Broken::Promise(2.0)) } else { Ok(()) }
    });
    assert_eq!(found.optional, [lie]);
    assert!(found.lasts_ms < 1_000 && broken.is_like(&Broken::Promise(1.0)), "{}", found.lasts_ms);
}

/// What the book's page of faults says of every kind; its table is of 1,000 runs on each graph (`--example every_kind -- --runs 1000`).
#[test]
fn one_event_of_any_kind_leaves_all_inside_but_where_a_node_has_stopped() {
    for kind in &KINDS {
        let (mut borne, mut stopped, mut runs) = (0, 0, 0);
        for graph in GRAPHS {
            for number in 0..2 {
                let run = happen(kind, graph, number).unwrap_or_else(|why| panic!("{}: {why}", kind.name));
                assert!(run.input.is_finite() && run.input < 500.0, "{}: {}", kind.name, run.input);
                if run.stopped == 0 {
                    assert_ne!(run.recovery, Recovered::Outside, "{}, {}:\n{}", kind.name, graph.0, run.text);
                } else {
                    assert!(kind.may_stop, "{}, {}:\n{}", kind.name, graph.0, run.text);
                }
                (borne, stopped, runs) =
                    (borne + u32::from(run.is_borne()), stopped + u32::from(run.stopped > 0), runs + 1);
            }
        }
        // An event that does nothing to anybody would pass, too.
        let harms = match kind.name {
            "bounce" | "join" | "liar, a constant" | "impostor" | "sensor, an offset" => borne < runs / 2,
            "partition, in halves"
            | "corrupt, on the ideal bus"
            | "cut"
            | "short"
            | "babble"
            | "liar, a ramp"
            | "sensor, stuck"
            | "actuator, dead"
            | "actuator, limited" => borne < runs,
            "set, a narrower funnel" | "bounce, of the time master" => borne < runs,
            "noise, one bit in 50" => stopped == runs,
            _ => true,
        };
        assert!(harms, "{}: {borne} of {runs} borne, {stopped} stopped", kind.name);
    }
}
