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
    let (begin, before, mut steps) = (Instant::now(), cpu_seconds(), 0u64);
    while let Some(k) = network.step() {
        steps += nodes as u64;
        if k.is_power_of_two() || k == ticks as u64 {
            println!("tick {k}: {} MiB at most so far", peak_mib());
        }
    }
    let seconds = begin.elapsed().as_secs_f64();
    let cpu = cpu_seconds() - before;
    let (rate, of_core) = (steps as f64 / seconds, steps as f64 / cpu);
    println!(
        "{steps} node-steps in {seconds:.2} s on {threads} threads: {rate:.3e} per second, {of_core:.3e} per core and second"
    );
    println!("hash {}, largest |nu|/psi {}", network.hash(), network.findings().max_ratio);
}

/// Time that all threads of this process have had a core, s: other work on the machine does not count. Not a number where the system
/// does not say.
fn cpu_seconds() -> f64 {
    let of_thread = |entry: std::io::Result<std::fs::DirEntry>| {
        let text = std::fs::read_to_string(entry.ok()?.path().join("schedstat")).ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    };
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten();
    let ns: Vec<f64> = threads.filter_map(of_thread).collect();
    if ns.is_empty() { f64::NAN } else { ns.iter().sum::<f64>() / 1e9 }
}

/// Largest resident memory of this process so far, MiB; 0 where the system does not say.
fn peak_mib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<u64>().ok());
    kib.unwrap_or(0) / 1024
}
