//! What a run's predictions and its reference are worth, as the summary says it.

use super::testing::options;
use super::{Fidelity, Outcome, RunOptions, simulate};
use crate::record::{Expectation, Summary};
use crate::scenario::{Override, Scenario};
use std::path::Path;

fn five_agents(sets: &[&str]) -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    Scenario::load(&path, &sets).unwrap()
}

fn outcome(scenario: &Scenario, on: Fidelity, every_ticks: Option<u64>) -> Outcome {
    simulate(scenario, &RunOptions { every_ticks, ..options(on) }).unwrap()
}

fn summary(scenario: &Scenario, on: Fidelity, every_ticks: Option<u64>) -> Summary {
    outcome(scenario, on, every_ticks).judge(scenario, on)
}

fn judged<'s>(summary: &'s Summary, name: &str) -> &'s Expectation {
    summary.expect.iter().find(|expectation| expectation.name == name).unwrap()
}

/// Three nodes of one field, `slope x + sin(2 t)`, from the one state from which it stays bounded: any error
/// grows by `e^(slope t)`.
fn balanced(slope: f64, expect: &str, sets: &[&str]) -> Scenario {
    let text = format!(
        r#"
version = 1
time = {{ tick = "10ms", duration = "30s" }}
graph = {{ kind = "path", nodes = 3 }}
[coupling]
kind = "node-wise"
gain = {{ kind = "reciprocal", scale = 1.0 }}
funnel = {{ kind = "exponential", start = 40.0, end = 2.0, rate = 1.0 }}
[agent]
state = {:?}
dynamics = {{ kind = "affine", slope = {slope:?}, sines = [{{ amplitude = 1.0, frequency = 2.0 }}] }}
[expect]
{expect}
"#,
        -2.0 / (slope * slope + 4.0)
    );
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    Scenario::parse(&text, Path::new("balanced.toml"), &sets).unwrap()
}

/// Loopback would refuse [sync] on this bus, too.
#[test]
fn emulators_that_refuse_time_masters_name_the_bench() {
    let refused = |set: &str| {
        let error = simulate(&five_agents(&[set]), &options(Fidelity::Emulator)).unwrap_err();
        error.to_string()
    };
    let error = refused("sync.masters=[1]");
    assert!(error.contains("bench with clock = \"own\"") && !error.contains("--on loopback"), "{error}");
    assert!(refused("clock.drift_ppm=10").contains("--on loopback"));
}

#[test]
fn no_output_option_changes_a_figure_of_the_verdict() {
    // 7 and 500 ticks do not go into the run, and no row but the first is on a peak of the ratios.
    let sets = ["time.duration=3001ms", "expect.emergent_error=100", "node.2.funnel={rate=0.7}"];
    let scenario = five_agents(&sets);
    for on in [Fidelity::Loopback, Fidelity::Reference] {
        let by_default = summary(&scenario, on, None);
        for every in [1, 7, 500, 3001] {
            assert_eq!(summary(&scenario, on, Some(every)), by_default, "{on}, every {every} ticks");
        }
    }
}

#[test]
fn rows_have_the_same_predictions_however_many_there_are() {
    let scenario = five_agents(&["time.duration=1s", "time.tick=5ms"]);
    let all = outcome(&scenario, Fidelity::Loopback, Some(1));
    let some = outcome(&scenario, Fidelity::Loopback, Some(3));
    for (index, row) in some.rows.iter().enumerate() {
        // The last tick has a row of its own.
        let same = &all.rows[(3 * index).min(all.rows.len() - 1)];
        assert_eq!((row.t, &row.xi, &row.blended), (same.t, &same.xi, &same.blended));
    }
}

#[test]
fn a_prediction_that_is_not_resolved_passes_no_expectation() {
    let expect = "emergent_error = 1e9\nblended_error = 1e9";
    let fast = "node.1.dynamics={sines=[{amplitude=1e-3,frequency=1e6}]}";
    let found = summary(&balanced(-1.0, expect, &[fast]), Fidelity::Loopback, None);
    let emergent = found.emergent.as_ref().unwrap();
    assert!(
        emergent.unresolved.as_ref().is_some_and(|why| why.contains("steps would resolve")),
        "{emergent:?}"
    );
    assert_eq!((emergent.final_error, emergent.blended_error), (None, None));
    for name in ["emergent_error", "blended_error"] {
        assert_eq!((judged(&found, name).value, judged(&found, name).pass), (None, false));
    }
    let found = summary(&balanced(-1.0, expect, &[]), Fidelity::Loopback, None);
    assert!(judged(&found, "emergent_error").pass && found.emergent.unwrap().unresolved.is_none());
}

#[test]
fn a_reference_that_is_not_resolved_passes_no_expectation() {
    for on in [Fidelity::Reference, Fidelity::Loopback] {
        let found = summary(&balanced(1.0, "reference_error = 1e9", &[]), on, None);
        let reference = found.reference.unwrap();
        assert!(!reference.resolved && reference.error_estimate > 1e3, "{reference:?}");
        assert_eq!(
            (judged(&found, "reference_error").value, judged(&found, "reference_error").pass),
            (None, false)
        );
        let found = summary(&balanced(0.3, "reference_error = 1e9", &[]), on, None);
        let reference = found.reference.unwrap();
        assert!(reference.resolved && reference.error_estimate < 1e-4, "{reference:?}");
        assert!(judged(&found, "reference_error").pass, "{on}");
    }
}

#[test]
fn a_reference_says_no_more_than_its_own_error_allows() {
    // Off by some 3e-5 itself: below 1e-2, and not known to be below 1e-5.
    for (limit, value) in [("reference_error = 1e-2", Some(0.0)), ("reference_error = 1e-5", None)] {
        let found = summary(&balanced(0.3, limit, &[]), Fidelity::Reference, None);
        assert_eq!(judged(&found, "reference_error").value, value, "{:?}", found.reference);
    }
}
