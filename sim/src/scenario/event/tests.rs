use super::*;
use crate::scenario::{Scenario, TimeSpec};
use funnelnet_law::start::SlowStart;
use std::collections::BTreeSet;
use std::path::Path;

const MS: u64 = 1_000_000;

/// A ring of five for 2 s.
fn text(events: &str) -> String {
    format!(
        r#"version = 1
time = {{ tick = "1ms", duration = "2s" }}
graph = {{ kind = "ring", nodes = 5 }}
coupling = {{ kind = "node-wise", gain = {{ kind = "reciprocal", scale = 1.0 }}, funnel = {{ kind = "constant", width = 2.0 }} }}
agent = {{ dynamics = {{ kind = "affine", slope = -1.0 }} }}
{events}
"#
    )
}

fn read(events: &str) -> Scenario {
    Scenario::parse(&text(events), Path::new("a.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}"))
}

/// What is said of events that are refused.
fn refused(events: &str) -> String {
    match Scenario::parse(&text(events), Path::new("a.toml"), &[]) {
        Ok(scenario) => panic!("accepted: {:?}", scenario.events),
        Err(errors) => errors.to_string(),
    }
}

/// One event, as an inline table.
fn one(event: &str) -> String {
    format!("event = [{{ {event} }}]")
}

#[test]
fn events_are_read_and_put_in_the_order_of_time() {
    let scenario = read(
        "event = [{ at = '1.5s', kind = 'repair' }, { at = '1s', kind = 'partition', groups = [[1, 2], [3]] }, \
         { at = '0s', kind = 'bounce', node = 3 }, { at = '1s', kind = 'crash', nodes = [5, 3] }, \
         { at = '1.2s', kind = 'bounce', node = 2, for = '7ms' }, { at = '2s', kind = 'join', node = 3 }]",
    );
    let told: Vec<_> = scenario.events.iter().map(|event| (event.at_ns / MS, event.to_string())).collect();
    let expected = [
        (0, "bounce node 3 for 100ms"),
        // At the same time as in the file.
        (1000, "partition groups 1, 2 | 3"),
        (1000, "crash nodes 5, 3"),
        (1200, "bounce node 2 for 7ms"),
        (1500, "repair all links"),
        (2000, "join node 3"),
    ];
    assert_eq!(told, expected.map(|(at, text)| (at, text.to_owned())));
}

#[test]
fn a_partition_cuts_what_leads_from_group_to_group() {
    let ring = read("").graph;
    let links = |groups: &[&[usize]]| {
        Targets::Groups(groups.iter().map(|group| group.iter().map(|id| id - 1).collect()).collect())
            .links(&ring)
    };
    assert_eq!(links(&[&[1, 2], &[3, 4, 5]]), [(0, 4), (1, 2)]);
    // A node in no group keeps its links.
    assert_eq!(links(&[&[1], &[2]]), [(0, 1)]);
    assert_eq!(Targets::Link(4, 0).links(&ring), [(0, 4)]);
    assert_eq!(Targets::AllLinks.links(&ring).len(), 5);
}

#[test]
fn every_key_of_an_event_is_checked_by_itself() {
    for (event, words) in [
        (
            "at = '1s', kind = 'crash'",
            "missing key 'node' in [event[0]] of kind 'crash': must be the id of a node, 1 to 5",
        ),
        (
            "kind = 'crash', node = 1",
            "missing key 'at' in [event[0]]: must be a duration from the start, as \"5s\"",
        ),
        (
            "at = '1s', node = 1",
            "missing key 'kind' in [event[0]]: must be one of crash, bounce, join, leave, partition, repair",
        ),
        ("at = 1, kind = 'crash', node = 1", "event[0].at = 1: must be a duration with a unit"),
        ("at = '1s', kind = 'crsh', node = 1", "did you mean 'crash'?"),
        (
            "at = '1s', kind = 'crash', node = 6",
            "event[0].node = 6: must be an integer from 1 to 5 (the id of a node of the graph)",
        ),
        (
            "at = '1s', kind = 'crash', nodes = 2",
            "event[0].nodes = 2: must be an array of node ids from 1 to 5",
        ),
        ("at = '1s', kind = 'crash', nodes = []", "must name a node"),
        ("at = '1s', kind = 'crash', nodes = [2, 2]", "names node 2 twice"),
        (
            "at = '1s', kind = 'crash', nodes = [1], node = 2",
            "event[0].nodes = [1]: must not be there beside node",
        ),
        (
            "at = '1s', kind = 'crash', node = 1, for = '1s'",
            "unknown key 'for' in [event[0]] of kind 'crash'",
        ),
        ("at = '1s', kind = 'bounce', node = 1, for = '0s'", "event[0].for = '0s': must be longer than 0s"),
        ("at = '1s', kind = 'leave', link = [1, 2]", "missing key 'node'"),
        (
            "at = '1s', kind = 'partition'",
            "missing key 'groups' in [event[0]] of kind 'partition': must be two or more arrays",
        ),
        ("at = '1s', kind = 'partition', groups = [[1, 2]]", "must be two groups or more"),
        ("at = '1s', kind = 'partition', groups = [[1, 2], []]", "must name a node"),
        ("at = '1s', kind = 'partition', groups = [[1, 2], [2, 3]]", "has node 2 in two"),
        ("at = '1s', kind = 'partition', link = [1, 2, 3]", "must be the ids of two neighbours, as [1, 2]"),
        ("at = '1s', kind = 'partition', link = [1, 1]", "names node 1 twice"),
    ] {
        let found = refused(&one(event));
        assert!(found.contains(words), "{event}\n{found}");
    }
    assert!(refused("event = 3").contains("event = 3: must be an array"));
    assert!(refused("event = [3]").contains("must be a table"));
}

#[test]
fn kinds_that_are_not_there_are_refused_with_those_that_are() {
    let found = refused(&one("at = '1s', kind = 'sets', node = 1"));
    let expected = "event[0].kind = 'sets': must be one of crash, bounce, join, \
         leave, partition, repair, clock, sync-loss, burst, corrupt, hold, release, noise, cut, short, babble, liar, replayer, impostor, sensor, actuator, set";
    assert!(found.contains(expected), "{found}");
}

#[test]
fn what_is_set_is_read_as_if_it_stood_in_its_section() {
    let scenario = read(
        "event = [{ at = '1.5s', kind = 'set', key = 'agent.dynamics.offset', value = 3, nodes = [2, 4] }, \
         { at = '1s', kind = 'set', node = 1, key = 'coupling.funnel.width', value = 1.5 }, \
         { at = '1.5s', kind = 'set', nodes = [2, 3], key = 'coupling.gain', value = { kind = 'logarithmic', scale = 2.0 } }]",
    );
    let told: Vec<_> = scenario.events.iter().map(ToString::to_string).collect();
    let expected = [
        "set node 1: coupling.funnel.width = 1.5",
        "set nodes 2, 4: agent.dynamics.offset = 3",
        "set nodes 2, 3: coupling.gain = { kind = 'logarithmic', scale = 2.0 }",
    ];
    assert_eq!(told, expected);
    assert!(scenario.stays_whole() && scenario.is_honest());
    let ticks: Vec<_> =
        scenario.staged.iter().map(|staged| staged.as_ref().map(|staged| staged.tick)).collect();
    assert_eq!(ticks, [Some(1000), Some(1500), Some(1500), Some(1500), None]);
    let at = |index: usize, k: u64| scenario.node_at(index, k).unwrap();
    assert_eq!([at(0, 999).funnel.width(0.0), at(0, 1000).funnel.width(0.0)], [2.0, 1.5]);
    // What is set at the same time is one configuration, of each node what names it.
    let logarithmic = |index: usize| at(index, 1500).gain != at(index, 1499).gain;
    let loaded = |index: usize| at(index, 1500).dynamics != at(index, 1499).dynamics;
    assert_eq!([1, 2, 3, 4].map(logarithmic), [true, true, false, false]);
    assert_eq!([1, 2, 3, 4].map(loaded), [true, false, true, false]);
    assert_eq!(at(1, 1500).dynamics, at(3, 1500).dynamics);
}

/// As with `--set`, a node that says itself what the key is about keeps that.
#[test]
fn what_is_set_for_all_nodes_leaves_a_node_what_it_says_itself() {
    let events = |rest: &str| {
        read(&format!(
            "event = [{{ at = '1s', kind = 'set', key = 'coupling.funnel.width', value = 1.5{rest} }}]\n\
             node = [{{ id = 2, funnel = {{ width = 3.0 }} }}, {{ id = 3, funnel = {{ factor = 2.0 }} }}]"
        ))
    };
    let widths = |scenario: &Scenario| {
        (0..5).map(|index| scenario.node_at(index, 1000).unwrap().funnel.width(0.0)).collect::<Vec<_>>()
    };
    assert_eq!(widths(&events("")), [1.5, 3.0, 3.0, 1.5, 1.5]);
    assert_eq!(widths(&events(", nodes = [1, 2, 3]")), [1.5, 1.5, 3.0, 2.0, 2.0]);
}

#[test]
fn what_cannot_be_set_is_refused_with_its_key_value_and_range() {
    let funnel = "key = 'coupling.funnel.width'";
    for (event, words) in [
        ("kind = 'set', value = 1", "missing key 'key' in [event[0]] of kind 'set'"),
        (&format!("kind = 'set', {funnel}"), "missing key 'value' in [event[0]] of kind 'set'"),
        (
            "kind = 'set', key = 'time.tick', value = '2ms'",
            "event[0].key = 'time.tick': must be one of coupling.funnel, coupling.gain",
        ),
        (
            "kind = 'set', key = 'coupling.kind', value = 'linear'",
            "event[0].key = 'coupling.kind': must be one of",
        ),
        (
            "kind = 'set', key = 'coupling.funnels', value = 1",
            "event[0].key = 'coupling.funnels': must be one of",
        ),
        (
            "kind = 'set', key = 'coupling.funnel..width', value = 1",
            "event[0].key = 'coupling.funnel..width': must be one of",
        ),
        ("kind = 'set', key = 3, value = 1", "event[0].key = 3: must be one of"),
        (
            &format!("kind = 'set', {funnel}, value = -1"),
            "coupling.funnel.width = -1: must be > 0 (state units)",
        ),
        (
            &format!("kind = 'set', {funnel}, value = -1, node = 2"),
            "node.2.funnel.width = -1: must be > 0 (state units)",
        ),
        ("kind = 'set', key = 'coupling.funnel.wide', value = 1", "unknown key 'wide'"),
        ("kind = 'set', key = 'coupling.damping', value = 1", "coupling.damping = 1: must be at least 1.809"),
        (
            "kind = 'set', key = 'coupling.gain', value = { kind = 'linear', slope = 'a' }",
            "coupling.gain.slope = 'a': ",
        ),
        (
            "kind = 'set', key = 'agent.dynamics.offset', value = [1, 2]",
            "event[0].value = [1, 2]: must leave the states of nodes as they are",
        ),
        (&format!("kind = 'set', {funnel}, value = 2"), "event[0].value = 2: changes nothing"),
        (&format!("kind = 'set', {funnel}, value = 1, node = 6"), "event[0].node = 6: "),
        (&format!("kind = 'set', {funnel}, value = 1, for = '1s'"), "unknown key 'for'"),
    ] {
        let found = refused(&one(&format!("at = '1s', {event}")));
        assert!(found.contains(words), "{event}\n{found}");
    }
    for (events, words) in [
        (one(&format!("at = '0s', kind = 'set', {funnel}, value = 1")), "event[0].at = '0s': must be later than 0s"),
        (
            format!("event = [{{ at = '1s', kind = 'set', {funnel}, value = 1, node = 2 }}, {{ at = '1.5s', kind = 'set', {funnel}, value = 1.5 }}]"),
            "event[1].at = '1.5s': node 2 is set at 1s already",
        ),
        (
            "event = [{ at = '1s', kind = 'set', key = 'agent.dynamics.offset', value = 1 }, { at = '1.5s', kind = 'actuator', node = 3, limit = 1 }]".to_owned(),
            "event[0].key = 'agent.dynamics.offset': must not be there for node 3",
        ),
    ] {
        let found = refused(&events);
        assert!(found.contains(words), "{events}\n{found}");
    }
    let edge_wise = text(&one(&format!("at = '1s', kind = 'set', {funnel}, value = 1, node = 2")))
        .replace("kind = \"node-wise\"", "kind = \"edge-wise\"");
    let found = Scenario::parse(&edge_wise, Path::new("a.toml"), &[]).map(|_| ()).unwrap_err().to_string();
    assert!(found.contains("must not be there with edge-wise coupling"), "{found}");
}

#[test]
fn what_events_do_to_frames_lasts_as_long_as_they_say() {
    let scenario = read(
        "event = [{ at = '1s', kind = 'burst', link = [2, 1], for = '100ms', loss = 0.5 }, \
         { at = '1.1s', kind = 'hold', node = 3 }, { at = '1.2s', kind = 'release', link = [3, 4] }, \
         { at = '1.3s', kind = 'release' }, { at = '1.4s', kind = 'corrupt', groups = [[1], [5]], for = '1ms', probability = 1 }]",
    );
    let found: Vec<_> = scenario
        .spells()
        .iter()
        .map(|spell| {
            (spell.event, spell.from + 1, spell.to + 1, spell.during.start / MS, spell.during.end / MS)
        })
        .collect();
    // Tick 0 comes a tick after the start of the engine.
    let expected = [
        (0, 1, 2, 1001, 1101),
        (0, 2, 1, 1001, 1101),
        (1, 2, 3, 1101, 1301),
        (1, 3, 2, 1101, 1301),
        (1, 3, 4, 1101, 1201),
        (1, 4, 3, 1101, 1201),
        (4, 1, 5, 1401, 1402),
        (4, 5, 1, 1401, 1402),
    ];
    assert_eq!(found, expected);
    let told: Vec<_> = scenario.events.iter().map(ToString::to_string).collect();
    let expected = [
        "burst link 2, 1 loses 0.5 for 100ms",
        "hold node 3 for 200ms",
        "release link 3, 4",
        "release all links",
        "corrupt groups 1 | 5 disturbs 1 for 1ms",
    ];
    assert_eq!(told, expected);
    assert!(scenario.stays_whole() && scenario.is_honest());
    // Its end counts for the judge.
    let ends: Vec<_> = scenario
        .course()
        .disturbances(&scenario.events)
        .iter()
        .map(|d| d.end_ns.map(|end| end / MS))
        .collect();
    assert_eq!(ends, [1100, 1300, 1200, 1300, 1401].map(Some));
}

#[test]
fn events_of_frames_that_change_nothing_or_cannot_be_are_refused() {
    for (events, words) in [
        ("at = '1s', kind = 'burst', for = '1s'", "missing key 'loss' in [event[0]] of kind 'burst'"),
        ("at = '1s', kind = 'burst', loss = 0.5", "missing key 'for' in [event[0]] of kind 'burst'"),
        ("at = '1s', kind = 'burst', for = '1s', loss = 0", "event[0].loss = 0: must lose something"),
        ("at = '1s', kind = 'burst', for = '1s', loss = 1.5", "event[0].loss = 1.5: "),
        (
            "at = '1.5s', kind = 'burst', for = '1s', loss = 1",
            "event[0].for = '1s': must be over by the end of the run, 2s",
        ),
        (
            "at = '1s', kind = 'burst', for = '1s', loss = 1, link = [1, 3]",
            "must be an edge of the graph; node 1 has edges to 2, 5",
        ),
        (
            "at = '1s', kind = 'burst', for = '1s', loss = 1, link = [1, 2], node = 1",
            "event[0].link = [1, 2]: must not be there beside node or nodes",
        ),
        ("at = '1s', kind = 'corrupt', for = '1s'", "missing key 'probability'"),
        ("at = '1s', kind = 'corrupt', for = '1s', probability = 0", "event[0].probability = 0: "),
        (
            "at = '1s', kind = 'hold'",
            "event[0].kind = 'hold': needs for, or a release of all its links later",
        ),
        (
            "at = '1s', kind = 'hold', node = 1 }, { at = '1.1s', kind = 'release', link = [1, 2]",
            "event[0].kind = 'hold': needs for",
        ),
        ("at = '1s', kind = 'release'", "event[0].kind = 'release': changes nothing: no frame is held"),
        (
            "at = '1s', kind = 'hold', for = '100ms' }, { at = '1.2s', kind = 'release'",
            "event[1].kind = 'release': changes nothing",
        ),
        (
            "at = '1s', kind = 'noise', for = '1s', bit_errors = 1e-3",
            "event[0].kind = 'noise': needs bus.model = \"can\" or \"can-fd\"",
        ),
        ("at = '1s', kind = 'liar', node = 1", "missing key 'constant' in [event[0]] of kind 'liar'"),
        ("at = '1s', kind = 'liar', node = 1, constant = 1, ramp = 2", "one of them"),
        ("at = '1s', kind = 'liar', node = 1, offset = 0", "event[0].offset = 0: must not be zero"),
        ("at = '1s', kind = 'liar', constant = 1", "missing key 'node'"),
        ("at = '1s', kind = 'impostor', node = 1, constant = 1", "missing key 'as' in [event[0]]"),
        (
            "at = '1s', kind = 'impostor', node = 1, as = 1, constant = 1",
            "event[0].as = 1: must be another node: node 1 speaks for itself",
        ),
        ("at = '1s', kind = 'impostor', node = 1, as = 6, constant = 1", "event[0].as = 6: "),
        ("at = '1s', kind = 'replayer', node = 1", "missing key 'age'"),
        ("at = '1s', kind = 'replayer', node = 1, age = '10us'", "must be from 1ms to 100s"),
    ] {
        let found = refused(&one(events));
        assert!(found.contains(words), "{events}\n{found}");
    }
    // What a node says false lasts to the end of the run where nothing else is said.
    let scenario = read(&one("at = '1s', kind = 'liar', node = 1, constant = 1"));
    assert_eq!(scenario.events[0].end_ns(), 2000 * MS);
    assert!(scenario.stays_whole() && !scenario.is_honest());
}

#[test]
fn sensors_and_actuators_fail_in_one_way_each() {
    let scenario = read(
        "event = [{ at = '1s', kind = 'sensor', node = 1, offset = 0.5 }, { at = '1.1s', kind = 'sensor', nodes = [2, 3], for = '100ms', ramp = 0 }, \
         { at = '1.2s', kind = 'sensor', node = 1, loss = 1 }, { at = '1.3s', kind = 'actuator', node = 4, effectiveness = 0 }, \
         { at = '1.4s', kind = 'actuator', node = 4, for = '50ms', limit = 2 }, { at = '1.5s', kind = 'sensor', node = 1, age = '5ms' }]",
    );
    let told: Vec<_> = scenario.events.iter().map(ToString::to_string).collect();
    let expected = [
        "sensor node 1 measures its state and 0.5 for 1s",
        "sensor nodes 2, 3 is stuck for 100ms",
        "sensor node 1 loses 1 of the samples for 800ms",
        "actuator node 4 is dead for 700ms",
        "actuator node 4 does 2 per s at most for 50ms",
        "sensor node 1 measures what is 5ms old for 500ms",
    ];
    assert_eq!(told, expected);
    assert!(scenario.stays_whole() && scenario.is_honest());
    assert_eq!([0, 1, 2, 3, 4].map(|index| scenario.has_plant(index)), [true, true, true, true, false]);
    for (event, words) in [
        ("kind = 'sensor', node = 1", "missing key 'constant' in [event[0]] of kind 'sensor'"),
        (
            "kind = 'sensor', node = 1, noise = 1, age = '5ms'",
            "event[0].kind = 'sensor': must have one key that says how it fails, and has more",
        ),
        ("kind = 'actuator', node = 1, constant = 1, limit = 1", "must have one key that says how it fails"),
        ("kind = 'sensor', offset = 1", "missing key 'node'"),
        ("kind = 'sensor', node = 1, offset = 0", "event[0].offset = 0: must not be zero: that is no fault"),
        ("kind = 'sensor', node = 1, noise = 0", "event[0].noise = 0: "),
        ("kind = 'sensor', node = 1, loss = 2", "event[0].loss = 2: "),
        ("kind = 'sensor', node = 1, age = '10us'", "event[0].age = '10us': must be from 1ms to 100s"),
        ("kind = 'sensor', node = 1, limit = 1", "unknown key 'limit'"),
        ("kind = 'actuator', node = 1", "missing key 'constant' in [event[0]] of kind 'actuator'"),
        ("kind = 'actuator', node = 1, effectiveness = 1", "event[0].effectiveness = 1: must be below 1"),
        ("kind = 'actuator', node = 1, effectiveness = 1.5", "event[0].effectiveness = 1.5: "),
        ("kind = 'actuator', node = 1, limit = 0", "event[0].limit = 0: "),
        ("kind = 'actuator', node = 6, limit = 1", "event[0].node = 6: "),
    ] {
        let found = refused(&one(&format!("at = '1s', {event}")));
        assert!(found.contains(words), "{event}\n{found}");
    }
    let fails = one("at = '1s', kind = 'sensor', node = 1, offset = 1");
    // Serial lines have no other events.
    read(&format!("{fails}\nbus.model = 'uart'"));
    let mixed = "event = [{ at = '1s', kind = 'sensor', node = 1, offset = 1 }, { at = '1s', kind = 'crash', node = 2 }]";
    let found = refused(&format!("{mixed}\nbus.model = 'uart'"));
    let words = "must not be there with this bus.model: but for sensor, actuator and set";
    assert!(found.contains("event[1]") && found.contains(words), "{found}");
    for (rest, words) in [
        ("clock = { drift_ppm = 10 }", "must not be there beside an [[event]] of kind sensor or actuator"),
        ("time.round = '2ms'", "must not be there with time.round"),
        ("time.slow_start = '10ms'", "must not be there with time.slow_start"),
    ] {
        let (key, text) = (rest.starts_with("time."), text(&fails));
        let text = if key {
            text.replace("duration = \"2s\"", &format!("duration = \"2s\", {}", &rest[5..]))
        } else {
            format!("{text}{rest}\n")
        };
        let found = Scenario::parse(&text, Path::new("a.toml"), &[]).map(|_| ()).unwrap_err().to_string();
        assert!(found.contains(words), "{rest}\n{found}");
    }
}

#[test]
fn an_event_outside_the_run_or_the_graph_is_refused() {
    for (event, words) in [
        (
            "at = '2001ms', kind = 'crash', node = 1",
            "event[0].at = '2001ms': must not be later than the end of the run, 2s",
        ),
        (
            "at = '1.95s', kind = 'bounce', node = 1",
            "event[0].at = '1.95s': must bring the node back by the end of the run, 2s",
        ),
        ("at = '1s', kind = 'bounce', node = 1, for = '2s'", "event[0].for = '2s': must bring the node back"),
        (
            "at = '1s', kind = 'partition', link = [1, 3]",
            "must be an edge of the graph; node 1 has edges to 2, 5",
        ),
        (
            "at = '1s', kind = 'partition', groups = [[1], [3]]",
            "must have an edge of the graph from one group to another",
        ),
    ] {
        let found = refused(&one(event));
        assert!(found.contains(words), "{event}\n{found}");
    }
    // At the end is in the run.
    read(&one("at = '2s', kind = 'crash', node = 1"));
    read(&one("at = '1.9s', kind = 'bounce', node = 1"));
}

#[test]
fn a_node_that_comes_too_late_for_a_sync_to_tell_it_the_tick_is_refused() {
    let long = |at: &str| {
        let text = text(&one(&format!("at = '{at}', kind = 'join', node = 1"))).replace("2s", "3h");
        Scenario::parse(&text, Path::new("a.toml"), &[]).map(drop).map_err(|errors| errors.to_string())
    };
    assert_eq!(long("8388607ms"), Ok(()));
    assert!(long("8388608ms").is_err_and(|error| error.contains("no node can come later than 8388.607s")));
}

#[test]
fn an_event_that_changes_nothing_is_refused() {
    for (events, words) in [
        (
            "{ at = '1s', kind = 'crash', node = 1 }, { at = '1.1s', kind = 'crash', node = 1 }",
            "event[1].node = 1: node 1 is off at 1.1s, since 1s",
        ),
        (
            "{ at = '1s', kind = 'crash', node = 1 }, { at = '1.1s', kind = 'bounce', nodes = [2, 1] }",
            "event[1].nodes = [2, 1]: node 1 is off",
        ),
        (
            "{ at = '1s', kind = 'bounce', node = 1 }, { at = '1.1s', kind = 'join', node = 1 }",
            "event[1].node = 1: node 1 is on at 1.1s, and cannot come",
        ),
        (
            "{ at = '1s', kind = 'bounce', node = 1 }, { at = '1050ms', kind = 'join', node = 1 }",
            "event[0].node = 1: node 1 is on at 1.1s",
        ),
        (
            "{ at = '0s', kind = 'join', node = 1 }",
            "event[0].at = '0s': must be later than 0s: until it joins, a node is absent",
        ),
        (
            "{ at = '1s', kind = 'repair' }",
            "event[0].kind = 'repair': changes nothing: its links are not cut at 1s already",
        ),
        (
            "{ at = '1s', kind = 'partition', link = [1, 2] }, { at = '1.5s', kind = 'repair', link = [2, 3] }",
            "event[1].kind = 'repair': changes nothing",
        ),
        (
            "{ at = '1s', kind = 'partition', link = [1, 2] }, { at = '1.5s', kind = 'partition', link = [2, 1] }",
            "event[1].kind = 'partition': changes nothing: its links are cut",
        ),
    ] {
        let found = refused(&format!("event = [{events}]"));
        assert!(found.contains(words), "{events}\n{found}");
    }
    // It cuts one link more.
    read(
        "event = [{ at = '1s', kind = 'partition', link = [1, 2] }, { at = '1.1s', kind = 'partition', groups = [[1], [2, 5]] }]",
    );
    // Off and on at the same time is a restart.
    read("event = [{ at = '1s', kind = 'crash', node = 1 }, { at = '1s', kind = 'join', node = 1 }]");
}

#[test]
fn a_recovery_is_expected_only_of_events_that_end_and_leave_time_to_judge() {
    let expect = "expect = { recovered_within = '500ms' }\n";
    for (events, words) in [
        ("", "must not be there without an [[event]] to recover from"),
        (
            "event = [{ at = '1s', kind = 'partition', link = [1, 2] }]",
            "must not be there while a partition is never repaired",
        ),
        (
            "event = [{ at = '1s', kind = 'bounce', node = 1, for = '501ms' }]",
            "expect.recovered_within = '500ms': must not be longer than what the run has after its last event, 499ms",
        ),
    ] {
        let found = refused(&format!("{expect}{events}"));
        assert!(found.contains(words), "{events}\n{found}");
    }
    let scenario =
        read(&format!("{expect}event = [{{ at = '1s', kind = 'bounce', node = 1, for = '500ms' }}]"));
    assert_eq!(scenario.expect.recovered_within_ns, Some(500 * MS));
    assert!(!scenario.expect.is_empty());
}

#[test]
fn only_nodes_that_are_there_have_to_start_inside() {
    let far = "node = [{ id = 1, state = 50 }]\n";
    assert!(refused(far).contains("starts outside its funnel"));
    read(&format!("{far}{}", one("at = '1s', kind = 'join', node = 1")));
    // It is there until it leaves.
    assert!(
        refused(&format!("{far}{}", one("at = '1s', kind = 'leave', node = 1"))).contains("starts outside")
    );
}

#[test]
fn a_coupling_without_nodes_and_links_takes_no_event() {
    let text = text(&one("at = '1s', kind = 'crash', node = 1")).replace("node-wise", "weakly-centralised");
    let found = Scenario::parse(&text, Path::new("a.toml"), &[]).unwrap_err().to_string();
    assert!(found.contains("must not be there with weakly-centralised coupling"), "{found}");
}

fn absences(events: &str) -> Vec<(usize, u64, Option<u64>)> {
    let Scenario { events, graph, time, .. } = read(events);
    let absences = Course::of(&events, &graph).absences(&time);
    absences.into_iter().map(|absence| (absence.node + 1, absence.from_tick, absence.to_tick)).collect()
}

#[test]
fn a_node_is_away_for_the_ticks_at_which_it_is_off() {
    let events = "event = [{ at = '1s', kind = 'bounce', node = 2 }, { at = '1.5s', kind = 'join', node = 3 }, \
                  { at = '1800.5ms', kind = 'leave', node = 2 }, { at = '1s', kind = 'bounce', node = 4, for = '1us' }, \
                  { at = '1000.5ms', kind = 'bounce', node = 5, for = '1us' }]";
    // Node 4 misses tick 1000, which comes at the time at which it goes off; node 5 misses none.
    let expected = [(3, 0, Some(1500)), (2, 1000, Some(1100)), (4, 1000, Some(1001)), (2, 1801, None)];
    assert_eq!(absences(events), expected);
}

#[test]
fn a_disturbance_lasts_until_nodes_are_back_and_links_are_mended() {
    let scenario = read(
        "event = [{ at = '1s', kind = 'partition', groups = [[1, 2], [3, 4, 5]] }, { at = '1.1s', kind = 'repair', link = [2, 3] }, \
         { at = '1.3s', kind = 'repair' }, { at = '1.4s', kind = 'bounce', node = 1, for = '50ms' }, \
         { at = '1.5s', kind = 'partition', link = [1, 2] }]",
    );
    let found = scenario.course().disturbances(&scenario.events);
    let found: Vec<_> = found.iter().map(|d| (d.from_ns / MS, d.end_ns.map(|end| end / MS))).collect();
    assert_eq!(
        found,
        [(1000, Some(1300)), (1100, Some(1100)), (1300, Some(1300)), (1400, Some(1450)), (1500, None)]
    );
}

#[test]
fn the_first_tick_of_an_event_is_the_one_at_or_after_it() {
    let time = TimeSpec { tick_ns: MS, ticks: 10, round: 1, start: SlowStart::default() };
    assert_eq!([0, 1, MS, MS + 1].map(|at| time.first_tick(at)), [0, 1, 1, 2]);
}

#[test]
fn more_events_than_a_run_can_follow_are_refused_in_a_moment() {
    let many = |count: usize| {
        let pair = "{ at = '1s', kind = 'crash', node = 1 }, { at = '1s', kind = 'join', node = 1 },";
        format!("event = [{}]", pair.repeat(count / 2))
    };
    assert_eq!(read(&many(1000)).events.len(), 1000);
    assert!(refused(&many(20_000)).contains("event[1000] = "));
    // A million links of a complete graph, twice.
    let halves = |count: usize| {
        let ids = |range: std::ops::RangeInclusive<u16>| {
            range.map(|id| id.to_string()).collect::<Vec<_>>().join(",")
        };
        let pair = format!(
            "{{ at = '1s', kind = 'partition', groups = [[{}], [{}]] }}, {{ at = '1s', kind = 'repair' }},",
            ids(1..=500),
            ids(501..=1000)
        );
        text(&format!("event = [{}]", pair.repeat(count)))
            .replace("\"ring\", nodes = 5", "\"complete\", nodes = 1000")
            .replace("width = 2.0", "width = 2e6")
    };
    let refused = Scenario::parse(&halves(20), Path::new("a.toml"), &[]).unwrap_err().to_string();
    assert!(
        refused.contains("events change 1000000 nodes and links at most"),
        "{}",
        &refused[refused.len() - 200..]
    );
}

#[test]
fn with_a_slow_start_time_passes_in_eighths_of_a_tick_at_first() {
    let time = TimeSpec { tick_ns: MS, ticks: 90, round: 1, start: SlowStart::new(10) };
    assert_eq!((time.end_ns(), time.end_s()), (20 * MS, 0.02));
    assert_eq!([0, 1, 8, 79, 80, 81].map(|k| time.at_ns(k)), [0, 125_000, MS, 9_875_000, 10 * MS, 11 * MS]);
    assert_eq!((time.at_s(1), time.at_s(80), time.at_s(90)), (0.000_125, 0.01, 0.02));
    let first = [0, 1, 125_000, 125_001, 10 * MS - 1, 10 * MS, 10 * MS + 1].map(|at| time.first_tick(at));
    assert_eq!(first, [0, 1, 1, 2, 80, 80, 81]);
    assert_eq!([124_999, 125_000, 10 * MS - 1, 11 * MS].map(|at| time.last_tick(at)), [0, 1, 79, 81]);
    for at in [0, 1, 125_000, 3 * MS + 17, 10 * MS - 1, 10 * MS, 10 * MS + 5, 19 * MS] {
        assert_eq!(time.from_clock(time.on_clock(at)), at);
    }
    assert_eq!((time.on_clock(5 * MS), time.on_clock(15 * MS)), (40 * MS, 85 * MS));
}

/// The ring with faults by chance.
fn chance(keys: &str, rest: &str) -> String {
    format!("{rest}\n[faults]\n{keys}")
}

#[test]
fn faults_by_chance_are_as_many_and_as_long_as_said_and_of_the_seed() {
    let kinds = "kinds = ['bounce', 'partition', 'burst', 'corrupt', 'hold', 'liar', 'replayer']";
    let keys = format!("rate = 50\n{kinds}\nfrom = '500ms'\nto = '1.5s'\nshortest = '5ms'\nlongest = '20ms'");
    let scenario = read(&chance(&keys, ""));
    assert_eq!(scenario.events, read(&chance(&keys, "")).events);
    assert_ne!(scenario.events, read(&chance(&keys, "seed = 2")).events);
    let begun =
        |scenario: &Scenario| scenario.events.iter().filter(|event| event.kind != EventKind::Repair).count();
    let all: usize = (1..=40).map(|seed| begun(&read(&chance(&keys, &format!("seed = {seed}"))))).sum();
    // 50 on average, less those that happen to who is away already; the standard deviation of the mean of 40 is 1.1.
    assert!((44 * 40..=52 * 40).contains(&all), "{all} in 40 runs");
    for event in &scenario.events {
        assert!(event.at_ns >= 500 * MS && event.end_ns() <= 1500 * MS, "{event}");
        let lasts = (5 * MS..=20 * MS).contains(&event.lasts_ns);
        assert!(lasts || matches!(event.kind, EventKind::Partition | EventKind::Repair), "{event}");
    }
    // Each kind has its turn, and what is drawn is what could have been written.
    assert_eq!(scenario.events.iter().map(|event| event.kind.name()).collect::<BTreeSet<_>>().len(), 8);
    let disturbances = scenario.course().disturbances(&scenario.events);
    assert!(disturbances.iter().all(|disturbance| disturbance.end_ns.is_some_and(|end| end <= 1500 * MS)));
}

#[test]
fn clocks_jump_and_sync_is_lost_by_chance() {
    let keys = "rate = 40\nkinds = ['clock', 'sync-loss']\njump = '-200us'\nlongest = '20ms'";
    let scenario = read(&chance(keys, "bus = { model = 'can' }\nsync = {}"));
    let (jumps, losses): (Vec<_>, Vec<_>) =
        scenario.events.iter().partition(|event| event.kind == EventKind::Clock);
    assert!(jumps.len() > 15 && losses.len() > 15, "{} {}", jumps.len(), losses.len());
    for jump in jumps {
        let change = ClockChange { by_ns: -200_000, drift_ppb: None };
        assert_eq!((&jump.detail, jump.lasts_ns), (&Detail::Clock(change), 0));
    }
    assert!(losses.iter().all(|loss| loss.kind == EventKind::SyncLoss && loss.targets == Targets::Masters));
    assert!(losses.iter().all(|loss| (10 * MS..=20 * MS).contains(&loss.lasts_ns)));
}

#[test]
fn faults_leave_what_named_events_take_away_to_those_and_time_to_recover() {
    let keys = "rate = 200\nkinds = ['bounce']\nlongest = '20ms'";
    let named = "event = [{ at = '1s', kind = 'crash', nodes = [1, 2, 3, 4] }]\nexpect = { recovered_within = '300ms' }";
    let scenario = read(&chance(keys, named));
    let drawn: Vec<_> = scenario.events.iter().filter(|event| event.kind == EventKind::Bounce).collect();
    assert!(drawn.len() > 20 && drawn.iter().all(|event| event.targets == Targets::Nodes(vec![4])));
    assert!(drawn.iter().all(|event| event.end_ns() <= 1700 * MS));
    // A node is on before it goes.
    assert!(drawn.windows(2).all(|pair| pair[0].end_ns() < pair[1].at_ns));
}

#[test]
fn faults_that_cannot_be_drawn_are_refused() {
    for (keys, words) in [
        ("kinds = ['burst']", "missing key 'rate' in [faults]"),
        ("rate = 0\nkinds = ['burst']", "faults.rate = 0: "),
        ("rate = 1", "missing key 'kinds' in [faults]: must be an array of kinds of events"),
        ("rate = 1\nkinds = []", "faults.kinds = []: "),
        ("rate = 1\nkinds = ['burst', 'burst']", "each once"),
        (
            "rate = 1\nkinds = ['crash']",
            "of bounce, partition, burst, corrupt, hold, noise, cut, short, babble, liar, replayer",
        ),
        ("rate = 1\nkinds = ['noise']", "must be without noise"),
        ("rate = 1\nkinds = ['burst']\nto = '3s'", "faults.to = '3s': must leave time for"),
        (
            "rate = 1\nkinds = ['burst']\nfrom = '2s'",
            "faults.from = '2s': must be before the last event may end, 2s",
        ),
        ("rate = 1\nkinds = ['burst']\nlongest = '1ms'", "must not be longer than longest, 1ms"),
        ("rate = 1\nkinds = ['liar']\noffset = 0", "faults.offset = 0: must not be zero"),
        ("rate = 1\nkinds = ['replayer']\nage = '1us'", "faults.age = '1us': must be from 1ms to 100s"),
        ("rate = 1\nkinds = ['burst']\nlos = 1", "unknown key 'los' in [faults]"),
        ("rate = 1\nkinds = ['clock']", "must be without clock, which needs [clock] or [sync]"),
        ("rate = 1\nkinds = ['sync-loss']", "must be without sync-loss, which needs [sync]"),
        ("rate = 1\nkinds = ['burst']\njump = '2s'", "faults.jump = '2s': must be a second at most"),
    ] {
        let found = refused(&chance(keys, ""));
        assert!(found.contains(words), "{keys}\n{found}");
    }
}

#[test]
fn faults_beside_clocks_are_refused_by_their_kinds_whatever_the_seed_draws() {
    // So few that none is drawn.
    let of = |kind: &str, clocks: &str| chance(&format!("rate = 1e-6\nkinds = ['burst', '{kind}']"), clocks);
    for clocks in ["clock = { drift_ppm = 50 }", "[[node]]\nid = 1\nclock = { drift_ppm = 50 }"] {
        for (kind, words) in [
            ("sensor", "must be without sensor beside [clock], [sync] or a clock of a [[node]]"),
            ("actuator", "must be without actuator beside"),
            ("bounce", "must be without bounce beside clocks and no [sync]"),
        ] {
            let found = refused(&of(kind, clocks));
            assert!(found.contains(words), "{kind} {clocks}\n{found}");
        }
        read(&of("liar", clocks));
        read(&of("partition", clocks));
    }
    let kept = "bus = { model = 'can' }\nsync = {}\nclock = { drift_ppm = 50 }";
    read(&of("bounce", kept));
    // Clocks alone have no SYNC to lose.
    read(&of("clock", "clock = { drift_ppm = 50 }"));
    assert!(refused(&of("sync-loss", "clock = { drift_ppm = 50 }")).contains("must be without sync-loss"));
    let still = format!("{kept}\n[faults]\nrate = 1\nkinds = ['clock']\njump = '0s'");
    assert!(refused(&still).contains("faults.jump = '0s': must not be zero"));
    let named = "event = [{ at = '1s', kind = 'sensor', node = 2, offset = 1 }]\n[[node]]\nid = 1\nclock = { drift_ppm = 50 }";
    let found = refused(named);
    assert!(found.contains("a plant keeps the true time"), "{found}");
}
