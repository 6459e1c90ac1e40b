//! Helpers that the system tests share.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use sim_host::interrupt::Interrupt;
use sim_host::record::Row;
use sim_host::run::{Fidelity, Outcome, RunOptions, Verbosity, simulate};
use sim_host::scenario::{Expect, Override, Scenario};
use std::path::{Path, PathBuf};

pub mod board;
pub mod campaign;
pub mod lockstep;
pub mod outage;
pub mod world;

/// A path in the repository.
pub fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// The firmware image; fails with the command that builds it.
pub fn image() -> PathBuf {
    let path = repository("firmware/target/thumbv7em-none-eabihf/release/mps2_an386");
    assert!(path.is_file(), "no firmware image at {}: ./ci.sh firmware", path.display());
    path
}

/// A scenario of `scenarios/` with `settings` (`section.key=value`) in place of the file's, and nothing expected of it.
pub fn scenario(name: &str, settings: &[&str]) -> Scenario {
    let overrides: Vec<_> = settings.iter().map(|text| Override::parse(text).unwrap()).collect();
    let loaded = Scenario::load(&repository("scenarios").join(name), &overrides);
    let scenario = loaded.unwrap_or_else(|errors| panic!("{errors}"));
    Scenario { expect: Expect::default(), ..scenario }
}

/// Options of a quiet run that records every tick.
pub fn options(on: Fidelity) -> RunOptions {
    RunOptions {
        on,
        out: None,
        every_ticks: Some(1),
        json: None,
        junit: None,
        image: match on {
            Fidelity::Emulator => image(),
            Fidelity::Loopback | Fidelity::Reference | Fidelity::Bench => PathBuf::new(),
        },
        bench: None,
        bus_logs: Default::default(),
        mcap: false,
        verbosity: Verbosity::Quiet,
        interrupt: Interrupt::default(),
        repeat: String::new(),
    }
}

/// Runs `scenario` and gives every tick of it.
pub fn run(scenario: &Scenario, on: Fidelity) -> Outcome {
    simulate(scenario, &options(on)).unwrap_or_else(|error| panic!("{on}: {error}"))
}

/// Fails at the first value that differs, by name, tick and node: what a hash cannot tell.
pub fn assert_same_rows(left: &[Row], right: &[Row]) {
    for (k, (left, right)) in left.iter().zip(right).enumerate() {
        let columns = [
            ("x", &left.x, &right.x),
            ("nu", &left.nu, &right.nu),
            ("psi", &left.psi, &right.psi),
            ("u", &left.u, &right.u),
        ];
        for (name, left, right) in columns {
            assert_eq!(left.len(), right.len());
            for (node, (left, right)) in left.iter().zip(right).enumerate() {
                let same = left.to_bits() == right.to_bits();
                assert!(same, "{name} of node {} at tick {k}: {left} and {right}", node + 1);
            }
        }
    }
    assert_eq!(left.len(), right.len(), "rows");
}

/// Five nodes that differ in everything that a scenario can give them: gain, funnel factor, weights, degree.
pub fn heterogeneous(duration: &str) -> Scenario {
    let duration = format!("time.duration={duration}");
    scenario(
        "five-agents.toml",
        &[
            &duration,
            r#"graph={kind="edges",nodes=5,edges=[[1,2,0.5],[2,3,2.0],[3,4],[4,5,0.25],[2,5,1.75]]}"#,
            "coupling.funnel.end=0.1",
            "coupling.funnel.rate=8.0",
            r#"node.2.gain={kind="logarithmic",scale=1.5}"#,
            "node.3.gain={scale=0.7}",
            "node.4.funnel={factor=1.9}",
            "node.5.dynamics.offset=-0.3",
        ],
    )
}
