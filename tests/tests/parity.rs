//! The promise of the project: the same scenario gives the same bits in the simulator and on emulated
//! Cortex-M4F nodes.

use sim_host::run::{Fidelity, Outcome};
use sim_host::scenario::Scenario;
use system_tests::{assert_same_rows, heterogeneous, run, scenario};

/// Runs both, compares every bit that nodes show, and gives the emulated run.
fn assert_parity(scenario: &Scenario) -> Outcome {
    let loopback = run(scenario, Fidelity::Loopback);
    let emulator = run(scenario, Fidelity::Emulator);
    assert_eq!(loopback.rows.len() as u64, scenario.time.ticks + 1);
    assert_same_rows(&loopback.rows, &emulator.rows);
    assert_eq!(loopback.hash, emulator.hash);
    assert_eq!(loopback.max_ratio, emulator.max_ratio);
    assert_eq!(loopback.bus, emulator.bus);
    for (loopback, emulator) in loopback.counters.iter().zip(&emulator.counters) {
        assert_eq!(loopback.extrapolated, emulator.extrapolated);
        assert_eq!(loopback.breaches, emulator.breaches);
        assert_eq!((emulator.ticks, emulator.sync_gaps), (loopback.ticks, 0));
    }
    assert_eq!(emulator.counters.len(), scenario.nodes.len());
    emulator
}

fn assert_logs(emulator: &Outcome) {
    let ids: Vec<_> = emulator.logs.iter().map(|(id, _)| *id).collect();
    assert_eq!(ids, [1, 2, 3, 4, 5]);
    for (id, log) in &emulator.logs {
        for word in ["ready, wire version 3", "started", "stopped"] {
            assert!(log.contains(word), "no '{word}' in the log of node {id}:\n{log}");
        }
        assert!(!log.contains("malformed"), "the log of node {id}:\n{log}");
    }
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn five_emulated_nodes_run_the_bits_of_the_simulator() {
    let emulator = assert_parity(&scenario("five-agents.toml", &["time.duration=2s"]));
    assert_logs(&emulator);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_where_frames_are_lost_late_and_out_of_order() {
    let bus = ["time.duration=2s", "bus.loss=0.1", "bus.latency=300us", "bus.jitter=900us"];
    let emulator = assert_parity(&scenario("five-agents.toml", &bus));
    assert!(emulator.bus.unwrap().lost > 1000);
    assert!(emulator.counters.iter().all(|counters| counters.extrapolated > 100));
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_for_nodes_that_differ() {
    assert_logs(&assert_parity(&heterogeneous("300ms")));
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_where_nodes_stop_at_their_state_limit() {
    // Unstable agents whose frames come late: the states grow until one node after the other stops.
    let slopes = [30.0, 30.0, 30.0, 25.0, 20.0];
    let slopes = slopes.iter().zip(1..).map(|(slope, id)| format!("node.{id}.dynamics.slope={slope:?}"));
    let settings: Vec<_> = slopes.collect();
    let settings = settings.iter().map(String::as_str);
    let unstable: Vec<_> = ["time.duration=1s", "bus.latency=1500us"].into_iter().chain(settings).collect();
    let emulator = assert_parity(&scenario("five-agents.toml", &unstable));
    assert!(emulator.counters.iter().all(|counters| counters.ticks < 1000), "{:?}", emulator.counters);
    assert_eq!(emulator.events.len(), 5, "{:?}", emulator.events);
}

/// Honest agents that are faster than what is taken: they refuse each other, and drop edges.
#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_where_limits_of_what_is_heard_drop_edges() {
    let limited = ["time.duration=300ms", "safety.heard_rate=3"];
    let emulator = assert_parity(&scenario("five-agents.toml", &limited));
    let dropped: u32 = emulator.counters.iter().map(|counters| counters.kept.edges).sum();
    assert_eq!(dropped, 8, "{:?}", emulator.counters);
    let told = |(_, log): &(_, String)| log.matches("it could take no state of it for too long").count();
    assert_eq!(emulator.logs.iter().map(told).sum::<usize>(), 8, "{:?}", emulator.logs);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_with_vector_states() {
    let lossy = ["time.duration=300ms", "bus.loss=0.1"];
    assert_parity(&scenario("vector-oscillators.toml", &lossy));
    assert_parity(&scenario("vector-max-gain.toml", &["time.duration=300ms"]));
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_with_other_couplings() {
    let short = "time.duration=300ms";
    assert_parity(&scenario("economic-dispatch.toml", &[short]));
    let tracker =
        ["coupling.kind=lambda-tracker", "coupling.eta=0.1", "coupling.gain={kind='linear',slope=20}"];
    assert_parity(&scenario("five-agents.toml", &[&[short], &tracker[..]].concat()));
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_with_schedules_noise_and_breaches() {
    let schedule =
        "coupling.funnel={kind='schedule',start=40,at='150ms',eps=0.01,then={kind='constant',width=1}}";
    let noisy = ["time.duration=300ms", schedule, "agent.noise=0.02"];
    let reopen = "coupling.on_breach={kind='reopen',margin=1.5,rate=20}";
    assert_parity(&scenario("five-agents.toml", &[&noisy[..], &[reopen]].concat()));
    // Neighbours drop the edge to a node that says it has stopped: the other two stay inside. Short: a node
    // that has stopped takes a frame of 256 ticks later for an old one in CAN's 8 bits, not in the 16 of a
    // serial line.
    let stop = ["coupling.on_breach=stop", "time.duration=200ms"];
    let emulator = assert_parity(&scenario("five-agents.toml", &[&noisy[1..], &stop].concat()));
    let stopped = emulator.counters.iter().filter(|counters| counters.ticks < 201).count();
    assert_eq!(stopped, 3, "{:?}", emulator.counters);
}

/// Runs both with events, and compares every bit that nodes show.
fn assert_parity_with(events: &str, sets: &[&str]) -> Outcome {
    let events = format!("event=[{events}]");
    let scenario = scenario("five-agents.toml", &[&["time.duration=700ms", events.as_str()], sets].concat());
    let loopback = run(&scenario, Fidelity::Loopback);
    let emulator = run(&scenario, Fidelity::Emulator);
    assert_same_rows(&loopback.rows, &emulator.rows);
    assert_eq!(loopback.hash, emulator.hash, "{events}");
    assert_eq!(loopback.happened, emulator.happened);
    // As text: a state that is not there is not equal to itself.
    assert_eq!(format!("{:?}", loopback.findings), format!("{:?}", emulator.findings));
    assert_eq!((loopback.bus, &emulator.contradictions), (emulator.bus.clone(), &Vec::new()));
    for (loopback, emulator) in loopback.counters.iter().zip(&emulator.counters) {
        assert_eq!((emulator.ticks, emulator.breaches), (loopback.ticks, loopback.breaches), "{events}");
        assert_eq!(emulator.extrapolated, loopback.extrapolated, "{events}");
    }
    emulator
}

const HALVES: &str = "{at='150ms',kind='partition',groups=[[1,2],[3,4,5]]},{at='300ms',kind='repair'}";

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_with_events_of_links_and_frames() {
    let frames =
        "{at='400ms',kind='burst',node=1,loss=0.5,for='50ms'},{at='500ms',kind='hold',link=[3,4],for='30ms'}";
    let emulator = assert_parity_with(&format!("{HALVES},{frames}"), &["bus.jitter=300us"]);
    assert_eq!(emulator.happened.len(), 4);
    let lies = "{at='100ms',kind='liar',node=2,offset=0.5,for='50ms'},{at='300ms',kind='replayer',node=4,age='3ms',for='50ms'},\
                {at='500ms',kind='impostor',node=5,as=3,constant=1.0,for='20ms'}";
    assert_parity_with(lies, &[]);
}

/// An emulator that crashes or is bounced is a process that ends, and a new one that knows nothing.
#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_with_events_of_nodes() {
    let events = "{at='150ms',kind='leave',node=2},{at='250ms',kind='bounce',nodes=[3,5],for='60ms'},\
                  {at='400ms',kind='join',node=2},{at='500ms',kind='crash',node=4},{at='100ms',kind='join',node=1}";
    let emulator = assert_parity_with(events, &[]);
    let log = |id: u8| emulator.logs.iter().find(|(of, _)| *of == id).map_or("", |(_, log)| log.as_str());
    let starts = [1, 2, 3, 4, 5].map(|id| log(id).matches("ready, wire version 3").count());
    // Who comes is started anew, also after a goodbye.
    assert_eq!(starts, [2, 2, 2, 1, 2], "{:?}", emulator.logs);
}

/// Off for less than they are extrapolated, with limits of what is heard: they say that they start anew, and nobody bars them.
#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_where_nodes_that_are_off_for_a_moment_say_that_they_start_anew() {
    let events =
        "{at='150ms',kind='bounce',node=3,for='20ms'},{at='300.5ms',kind='bounce',nodes=[1,4],for='5ms'}";
    let emulator = assert_parity_with(events, &["safety.heard_rate=60", "coupling.u_max=20"]);
    assert!(emulator.counters.iter().all(|counters| counters.kept.edges == 0), "{:?}", emulator.counters);
    // Nor drop an edge: they extrapolate until the first state comes.
    assert!(
        emulator.counters.iter().all(|counters| counters.neighbours_lost == 0),
        "{:?}",
        emulator.counters
    );
    assert!(emulator.counters.iter().any(|counters| counters.extrapolated > 0), "{:?}", emulator.counters);
}

/// An emulator has a storage for as long as it runs: one that is bounced has lost what was staged in it, and is given what it has adopted.
#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_with_what_is_set() {
    let narrow = "{at='300ms',kind='set',key='coupling.funnel.end',value=0.5}";
    let emulator = assert_parity_with(narrow, &["bus.jitter=300us"]);
    let told = |(_, log): &(_, String)| log.matches("has another configuration from tick 300 on").count();
    assert_eq!(emulator.logs.iter().map(told).sum::<usize>(), 5, "{:?}", emulator.logs);
    let bounced = "{at='400ms',kind='bounce',node=2,for='60ms'}";
    assert_parity_with(&format!("{narrow},{bounced}"), &[]);
    let missed = "{at='100ms',kind='bounce',node=2,for='60ms'}";
    let events = format!("event=[{narrow},{missed}]");
    let scenario = scenario("five-agents.toml", &["time.duration=400ms", &events]);
    let (loopback, emulator) = (run(&scenario, Fidelity::Loopback), run(&scenario, Fidelity::Emulator));
    assert_eq!((loopback.hash, &loopback.contradictions), (emulator.hash, &emulator.contradictions));
    assert!(
        emulator.contradictions[0].starts_with("node 2 has missed what is set at 0.3 s"),
        "{:?}",
        emulator.contradictions
    );
    // The refusal is counted by the node as by that of loopback.
    assert_eq!(loopback.bus, emulator.bus);
}

/// Worlds in which the comparison has to fail: an event that one of the two does not have, or has a tick later.
#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn an_event_that_is_missing_or_a_tick_late_differs() {
    let hash = |events: &str, on: Fidelity| {
        let events = format!("event=[{events}]");
        run(&scenario("five-agents.toml", &["time.duration=350ms", &events]), on).hash
    };
    let emulated = hash(HALVES, Fidelity::Emulator);
    assert_eq!(emulated, hash(HALVES, Fidelity::Loopback));
    for other in ["", &HALVES.replace("150ms", "151ms"), &HALVES.replace("300ms", "301ms")] {
        assert_ne!(emulated, hash(other, Fidelity::Loopback), "{other}");
    }
}

/// Every function and operator that an expression can have, and the example of the documentation.
const FIELDS: [&str; 5] = [
    "-x + 3*tanh(x) + 2*sin(0.5*t)",
    "-2*x + sin(x) + cos(3*x) - tan(0.1*x) + exp(-abs(x)) + t/10",
    "-x + ln(1 + x^2) + sqrt(abs(x) + 1) + abs(x)^0.7 + 2^(0.1*x)",
    "-x + clamp(x, -1, 1) + min(x, 2) - max(x, -2) + sign(x - 1) + step(t - 1)",
    "-3*x + 10*cos(7*t + 1) - x^3/100 + pow(1.1, -x) + sin(0.3*t*t)",
];

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_with_fields_that_are_expressions() {
    let fields =
        FIELDS.iter().zip(1..).map(|(f, id)| format!("node.{id}.dynamics={{kind='expression',f='{f}'}}"));
    let sets: Vec<_> = fields.chain(["time.duration=2s".to_owned()]).collect();
    let scenario = scenario("five-agents.toml", &sets.iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(scenario.time.ticks, 2_000);
    assert_parity(&scenario);
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn also_with_expressions_of_vectors_and_with_limits() {
    assert_parity(&scenario("van-der-pol.toml", &["time.duration=300ms"]));
    let narrow = ["time.duration=1500ms", "agent.limits={low=-0.3,high=0.2}"];
    let emulator = assert_parity(&scenario("tank.toml", &narrow));
    assert!(emulator.counters.iter().any(|counters| counters.saturated > 10), "{:?}", emulator.counters);
}
