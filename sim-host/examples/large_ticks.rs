//! Runs nodes without a bus, of degree 4 on a random graph, for a number of ticks: the load behind the figures of
//! large networks (docs/book/src/large-networks.md).
//!
//! Usage: `large_ticks [NODES [TICKS [THREADS]]]`; prints node-steps per second, the hash, and the largest memory of
//! the process.
#![allow(clippy::expect_used, reason = "an example that cannot go on has failed")]

use funnelnet_sim::large::Network;
use funnelnet_sim::scenario::{AnyScenario, Source};
use std::time::Instant;

fn main() {
    let mut arguments = std::env::args().skip(1).map(|text| text.parse::<usize>().expect("a whole number"));
    let nodes = arguments.next().unwrap_or(100_000);
    let ticks = arguments.next().unwrap_or(1_000);
    let threads = arguments.next().unwrap_or(1);
    let text = format!(
        r#"
        version = 1
        time = {{ tick = "1ms", duration = "{ticks}ms" }}
        graph = {{ kind = "random-regular", nodes = {nodes}, degree = 4 }}
        coupling = {{ kind = "node-wise", gain = {{ kind = "reciprocal" }}, funnel = {{ kind = "exponential", start = 40, end = 2, rate = 1 }} }}
        agent.dynamics = {{ kind = "affine", slope = -1.0 }}
        agent.random = {{ state = {{ uniform = [-2, 2] }}, slope = {{ uniform = [-1.5, -0.5] }}, offset = {{ normal = [0, 1] }} }}
        bus.model = "none"
        "#
    );
    let begin = Instant::now();
    let source = Source { text, path: "large_ticks.toml".into() };
    let Ok(AnyScenario::Large(scenario)) = source.any_scenario(&[]) else {
        eprintln!("this size is refused");
        std::process::exit(2);
    };
    let mut network = Network::new(&scenario, threads).expect("the nodes take it");
    println!("{nodes} nodes read and made in {:.2} s", begin.elapsed().as_secs_f64());
    let (begin, mut steps) = (Instant::now(), 0u64);
    while let Some(k) = network.step() {
        steps += nodes as u64;
        if k.is_power_of_two() || k == ticks as u64 {
            println!("tick {k}: {} MiB at most so far", peak_mib());
        }
    }
    let seconds = begin.elapsed().as_secs_f64();
    let rate = steps as f64 / seconds;
    println!("{steps} node-steps in {seconds:.2} s on {threads} threads: {rate:.3e} per second");
    println!("hash {}, largest |nu|/psi {}", network.hash(), network.findings().max_ratio);
}

/// Largest resident memory of this process so far, MiB; 0 where the system does not say.
fn peak_mib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok());
    kib.unwrap_or(0) / 1024
}
