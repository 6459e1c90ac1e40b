//! How much do the figures of Example 3 depend on its random constants, which the paper does not publish?
//!
//! Usage: `draws [COUNT]`: runs the narrow scenarios with COUNT random draws of the constants and prints the
//! smallest, median and largest reference error per graph. From the root of the repository.
#![allow(clippy::expect_used)]

use sim_host::interrupt::Interrupt;
use sim_host::random::{Purpose, stream, uniform};
use sim_host::run::{Fidelity, RunOptions, Verbosity, execute};
use sim_host::scenario::{NodeSpec, Scenario};
use std::f64::consts::TAU;
use std::path::Path;

fn options() -> RunOptions {
    RunOptions {
        on: Fidelity::Loopback,
        out: None,
        every_ticks: None,
        json: None,
        junit: None,
        image: "".into(),
        bench: None,
        bus_logs: Default::default(),
        mcap: false,
        verbosity: Verbosity::Quiet,
        interrupt: Interrupt::default(),
        repeat: String::new(),
    }
}

/// delta in [-0.3, 0.3], m1 and m2 in [0, 1], phases in [0, 2 pi).
fn draw(node: &mut NodeSpec, seed: u64) {
    let mut generator = stream(seed, Purpose::Graph, u64::from(node.id));
    let mut unit = || uniform(&mut generator);
    let Some(field) = node.dynamics.affine_mut() else { return };
    field.slope[0] = -1.0 + 0.6 * (unit() - 0.5);
    for sine in field.sines.iter_mut().skip(1) {
        sine.amplitude = 10.0 * unit();
        sine.phase = TAU * unit();
    }
}

fn main() {
    let count: u64 = std::env::args().nth(1).map_or(20, |text| text.parse().expect("COUNT: a whole number"));
    println!(
        "| graph | draws | smallest | median | largest | above 5e-3 | largest ratio |\n|---|---:|---:|---:|---:|---:|---:|"
    );
    for graph in ["ring", "path", "star", "complete"] {
        let path = format!("scenarios/narrow-{graph}.toml");
        let scenario = Scenario::load(Path::new(&path), &[]).expect("a valid scenario");
        let run = |seed| {
            let mut scenario = scenario.clone();
            scenario.nodes.iter_mut().for_each(|node| draw(node, seed));
            let summary = execute(&scenario, &options()).expect("a run");
            let error = summary.reference.map_or(f64::NAN, |reference| reference.max_error);
            (error, summary.funnel.map_or(f64::NAN, |funnel| funnel.max_ratio))
        };
        let results: Vec<_> = (0..count).map(run).collect();
        let mut errors: Vec<_> = results.iter().map(|result| result.0).collect();
        errors.sort_by(f64::total_cmp);
        let pick = |share: f64| {
            errors.get(((errors.len() - 1) as f64 * share) as usize).copied().unwrap_or(f64::NAN)
        };
        let above = errors.iter().filter(|&&error| error >= 5e-3).count();
        let ratio = results.iter().map(|result| result.1).fold(0.0, f64::max);
        println!(
            "| {graph} | {count} | {:.1e} | {:.1e} | {:.1e} | {above} | {ratio:.3} |",
            pick(0.0),
            pick(0.5),
            pick(1.0)
        );
    }
}
