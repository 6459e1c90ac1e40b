//! `[[link]]`, `bus.loss` and the formats of CAN in whole runs.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use sim_host::record::BusSummary;
use sim_host::run::{Fidelity, Outcome};
use system_tests::{run, scenario};

/// A second of the five agents on a ring, edges 1-2, 2-3, 3-4, 4-5, 5-1.
fn five(sets: &[&str]) -> Outcome {
    let sets: Vec<&str> = [&["time.duration=1s"], sets].concat();
    run(&scenario("five-agents.toml", &sets), Fidelity::Loopback)
}

fn states(outcome: &Outcome) -> Vec<Vec<f64>> {
    outcome.rows.iter().map(|row| row.x.clone()).collect()
}

fn bus(outcome: &Outcome) -> &BusSummary {
    outcome.bus.as_ref().unwrap()
}

/// Values that each node had to extrapolate.
fn extrapolated(outcome: &Outcome) -> Vec<u32> {
    outcome.counters.iter().map(|counters| counters.extrapolated).collect()
}

/// What all links do is what a bus does.
#[test]
fn the_same_latency_on_the_bus_and_on_all_links_gives_the_same_bits() {
    let edges = ["1,2", "2,3", "3,4", "4,5", "5,1"];
    let each = edges.map(|edge| format!("{{between=[{edge}],latency='1200us'}}")).join(",");
    let links = format!("link=[{each}]");
    let (of_bus, of_links, quick) = (five(&["bus.latency=1200us"]), five(&[&links]), five(&[]));
    assert_eq!(states(&of_bus), states(&of_links));
    assert_ne!(states(&of_bus), states(&quick));
}

#[test]
fn a_link_that_loses_all_in_one_direction_is_missed_by_that_receiver_alone() {
    let outcome = five(&["link=[{from=1,to=2,loss=0.3}]"]);
    let [first, second, ref rest @ ..] = extrapolated(&outcome)[..] else { unreachable!() };
    assert!((250..350).contains(&second), "{second}");
    assert_eq!((first, rest.iter().sum::<u32>()), (0, 0));
    // Each of them, and those of the edges that are announced.
    assert!(bus(&outcome).lost.abs_diff(u64::from(second)) <= 3, "{:?}", bus(&outcome));
}

/// On CAN the others have the frame, and nobody sends it again.
#[test]
fn on_can_a_lost_frame_is_acknowledged_and_heard_by_all_others() {
    for model in ["bus.model=can", "bus.model=can-fd"] {
        let (whole, lossy) = (five(&[model]), five(&[model, "link=[{from=1,to=2,loss=0.3}]"]));
        let [first, second, ref rest @ ..] = extrapolated(&lossy)[..] else { unreachable!() };
        assert!((250..350).contains(&second), "{second}");
        assert_eq!((first, rest.iter().sum::<u32>()), (0, 0));
        assert_eq!(bus(&whole).sent, bus(&lossy).sent);
        assert!(bus(&lossy).lost.abs_diff(u64::from(second)) <= 3);
        let all = five(&[model, "bus.loss=0.3"]);
        assert!(
            extrapolated(&all).iter().all(|count| (450..750).contains(count)),
            "{:?}",
            extrapolated(&all)
        );
    }
}

/// Losses in bursts of the same share leave fewer, longer gaps.
#[test]
fn bursts_on_a_link_are_longer_than_independent_losses() {
    let gaps = |loss: &str| {
        let outcome = five(&[&format!("link=[{{from=1,to=2,loss={loss}}}]")]);
        (bus(&outcome).lost, outcome.counters[1].neighbours_lost)
    };
    let (independent, bursts) = (gaps("0.2"), gaps("{to_bad=0.01,to_good=0.005}"));
    assert_eq!(independent.1, 0);
    assert!(bursts.1 > 0, "{bursts:?} {independent:?}");
}

/// A receiver that reads a bit wrong breaks the frame for all; it is sent again, and all have it in time.
#[test]
fn on_can_what_a_link_disturbs_is_an_error_frame_and_no_loss() {
    for model in ["bus.model=can", "bus.model=can-fd"] {
        let ideal = five(&["time.tick=2500us"]);
        let quiet = five(&[model, "time.tick=2500us"]);
        let noisy = five(&[model, "time.tick=2500us", "link=[{between=[1,2],corrupt=0.05}]"]);
        assert_eq!(states(&noisy), states(&ideal));
        let more = bus(&noisy).utilisation / bus(&quiet).utilisation;
        // One frame in twenty of two nodes of five, half of each and an error frame longer. Of one in nine,
        // whose errors count eight, nodes would go off the bus.
        assert!((1.005..1.03).contains(&more), "{more}");
        assert_eq!((bus(&noisy).sent, bus(&noisy).lost), (bus(&quiet).sent, 0));
    }
}

/// Without a checksum, as on the ideal bus, it is a wrong value or a refused frame.
#[test]
fn on_the_ideal_bus_what_a_link_disturbs_is_wrong() {
    let outcome = five(&["link=[{between=[1,2],corrupt=0.01}]"]);
    let bus = bus(&outcome);
    assert!((5..60).contains(&bus.corrupted), "{bus:?}");
    assert_ne!(states(&outcome), states(&five(&[])));
    assert!(bus.refused.values().sum::<u64>() > 0, "{bus:?}");
}

#[test]
fn copies_are_heard_once_and_overtaken_frames_are_late() {
    let outcome = five(&["link=[{from=1,to=2,duplicate=0.1,reorder=0.1}]"]);
    assert!((50..150).contains(&bus(&outcome).duplicated) && (50..150).contains(&bus(&outcome).reordered));
    // What is overtaken is missed at its tick, and then it is old.
    let late = u64::from(extrapolated(&outcome)[1]);
    assert!(late.abs_diff(bus(&outcome).reordered) <= 5, "{late} {:?}", bus(&outcome));
    let refused = |reason| u64::from(outcome.counters[1].refused(reason));
    let old = refused(funnelnet_protocol::Refusal::Stale) + refused(funnelnet_protocol::Refusal::Duplicate);
    assert!(old + 3 >= bus(&outcome).reordered + bus(&outcome).duplicated, "{old}");
}

#[test]
fn links_are_random_by_the_seed_alone() {
    let sets =
        "link=[{between=[1,2],loss={to_bad=0.01,to_good=0.1},jitter='1500us',reorder=0.05,duplicate=0.05}]";
    for model in ["bus.model=ideal", "bus.model=can", "bus.model=can-fd"] {
        let [one, again, other] =
            ["seed=3", "seed=3", "seed=4"].map(|seed| states(&five(&[model, sets, seed])));
        assert!(one == again && one != other, "{model}");
    }
}

/// Frames of eight bytes whose data are fast: in time, as on the ideal bus, and the bus as busy as their
/// lengths say.
#[test]
fn can_fd_has_the_bits_of_the_ideal_bus_and_a_lower_load() {
    let (ideal, can, fd) = (five(&[]), five(&["bus.model=can"]), five(&["bus.model=can-fd"]));
    assert_eq!(states(&fd), states(&ideal));
    // 11-bit identifier, eight bytes, CRC-17: 29 bits at 1 Mbit/s, and 97 to 113 at 2 Mbit/s, five times in
    // each ms.
    let (low, high) = (5.0 * (29.0 + 97.0 / 2.0) * 1e-3, 5.0 * (33.0 + 113.0 / 2.0) * 1e-3);
    assert!((low..high).contains(&bus(&fd).utilisation), "{}", bus(&fd).utilisation);
    assert!(bus(&fd).utilisation < bus(&can).utilisation);
    let faster = five(&["bus.model=can-fd", "bus.data_bitrate=5000000"]);
    assert!(bus(&faster).utilisation < bus(&fd).utilisation);
}

/// Two components travel in one frame, where classic CAN has two.
#[test]
fn components_share_a_frame_of_can_fd() {
    let of = |sets: &[&str]| {
        let sets = [&["time.duration=1s"], sets].concat();
        run(&scenario("vector-oscillators.toml", &sets), Fidelity::Loopback)
    };
    let (ideal, can, fd) = (of(&[]), of(&["bus.model=can"]), of(&["bus.model=can-fd"]));
    assert_eq!(states(&fd), states(&ideal));
    let of_states = |outcome: &Outcome| bus(outcome).sent as f64;
    assert!((of_states(&can) / of_states(&fd) - 2.0).abs() < 0.05, "{} {}", bus(&can).sent, bus(&fd).sent);
}
