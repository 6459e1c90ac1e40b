//! The worked example of the book, run as it is: three heaters that differ, behind the code that a node with
//! a plant has on a board.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use sim_host::run::{Fidelity, Outcome, RunOptions, simulate};
use sim_host::scenario::{Override, Scenario};
use system_tests::{options, repository};

/// Three emulated heaters with these settings.
fn run(settings: &[&str]) -> Outcome {
    let overrides: Vec<_> = settings.iter().map(|text| Override::parse(text).unwrap()).collect();
    let scenario = Scenario::load(&repository("firmware/heaters.toml"), &overrides).unwrap();
    let image = repository("firmware/target/thumbv7em-none-eabihf/release/heater_emulated");
    assert!(image.is_file(), "no firmware image at {}: ./ci.sh parity", image.display());
    simulate(&scenario, &RunOptions { image, ..options(Fidelity::Emulator) }).unwrap()
}

/// Largest difference of two temperatures at the end, K.
fn spread(outcome: &Outcome) -> f64 {
    let fold = |start, with: fn(f64, f64) -> f64| outcome.last.iter().copied().fold(start, with);
    fold(f64::MIN, f64::max) - fold(f64::MAX, f64::min)
}

#[test]
#[ignore = "needs QEMU and the firmware image: ./ci.sh parity"]
fn three_emulated_heaters_agree_within_their_funnel() {
    let together = run(&[]);
    assert!(together.max_ratio < 1.0, "|nu| / psi = {}", together.max_ratio);
    for (counters, id) in together.counters.iter().zip(1..) {
        assert_eq!((counters.ticks, counters.coasted, counters.breaches), (6001, 0, 0), "node {id}");
    }
    assert!(together.events.is_empty(), "{:?}", together.events);
    // They are heaters of their own: without the law they end elsewhere.
    let alone = run(&["coupling.kind=none", "time.duration=300s"]);
    assert!(spread(&alone) > 20.0 && spread(&together) < 1.5, "{:?} and {:?}", alone.last, together.last);
}
