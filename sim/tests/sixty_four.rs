//! Sixty-four nodes on CAN FD at 100 Hz, through a burst of losses, a partition, two crashes and a restart.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_sim::{Scenario, Simulation, Verdict};
use std::fmt::Write as _;
use std::path::Path;

const NETWORK: &str = r#"version = 1
time = { tick = "10ms", duration = "20s" }
graph = { kind = "random-regular", nodes = 64, degree = 4 }
bus = { model = "can-fd", bitrate = 1000000, data_bitrate = 5000000 }
coupling.kind = "node-wise"
coupling.gain = { kind = "reciprocal", scale = 1.0 }
coupling.funnel = { kind = "exponential", start = 30.0, end = 0.7, rate = 1.0 }
agent.dynamics = { kind = "affine", slope = -0.5, sines = [{ amplitude = 2.0, frequency = 1.0 }] }
expect = { funnel_ratio = 1.0, recovered_within = "500ms" }
"#;

const EVENTS: &str = r#"
[[event]]
at = "6s"
kind = "burst"
loss = { good = 0.05, bad = 0.9, to_bad = 0.1, to_good = 0.3 }
for = "500ms"
[[event]]
at = "10s"
kind = "partition"
groups = [HALVES]
[[event]]
at = "10200ms"
kind = "repair"
[[event]]
at = "14s"
kind = "crash"
nodes = [7, 40]
[[event]]
at = "17s"
kind = "bounce"
node = 20
for = "200ms"
"#;

/// States and fields of the nodes differ.
fn text(partition: &str) -> String {
    let half = |ids: std::ops::RangeInclusive<u32>| format!("{:?}", ids.collect::<Vec<_>>());
    let halves = [half(1..=32), half(33..=64)].join(", ");
    let mut text = format!("{NETWORK}{}", EVENTS.replace("HALVES", &halves).replace("10200ms", partition));
    for id in 1..=64 {
        let (state, offset) = (f64::from(id % 9) * 0.5 - 2.0, f64::from(id * 7 % 11) * 0.2 - 1.0);
        write!(text, "[[node]]\nid = {id}\nstate = {state:?}\ndynamics = {{ offset = {offset:?} }}\n")
            .unwrap();
    }
    text
}

fn verdict(seed: u64, partition: &str) -> Verdict {
    let text = text(partition).replace("version = 1", &format!("version = 1\nseed = {seed}"));
    let scenario = Scenario::parse(&text, Path::new("64.toml"), &[]).unwrap();
    Simulation::new(&scenario).unwrap().run()
}

#[test]
fn all_are_back_inside_within_half_a_second_and_no_other_funnel_is_left() {
    for seed in 1..=3 {
        let verdict = verdict(seed, "10200ms");
        assert!(verdict.holds() && verdict.stops.is_empty(), "{verdict}");
        assert_eq!(verdict.findings.breaches, 0);
        let back: Vec<f64> =
            verdict.findings.events.iter().map(|event| event.recovery.after_s().unwrap()).collect();
        assert!(back.len() == 5 && back.iter().all(|&back| back < 0.5), "{back:?}");
        // Losses and partition are borne inside the funnels; the one that comes back is outside until it has learnt where the others are.
        let ratios: Vec<f64> = verdict.findings.events.iter().map(|event| event.during.max_ratio).collect();
        assert!(ratios[..4].iter().all(|&ratio| ratio < 1.0) && ratios[4] > 1.0, "{ratios:?}");
    }
}

/// The figures can be worse: halves that are apart for 3 s are outside, and say so.
#[test]
fn a_partition_of_three_seconds_is_not_borne() {
    let verdict = verdict(1, "13s");
    let partition = verdict.findings.events[1].during;
    assert!(partition.breaches > 0 && partition.max_ratio > 1.0, "{partition:?}");
}
