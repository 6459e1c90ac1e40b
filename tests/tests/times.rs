//! What a row is of: with rounds, and with a slow start, in which network time is not the count of ticks
//! (law.md 5 and 7).
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use sim_host::check::check;
use sim_host::record::Row;
use sim_host::run::{Fidelity, Outcome};
use sim_host::scenario::{Expect, Override, Scenario};
use system_tests::{repository, run, scenario};

fn nearly(left: f64, right: f64, error: f64) -> bool {
    (left - right).abs() < error
}

/// Each row's states follow from those of the row before it by its inputs, held, and steps of `step` s of the
/// fields.
fn rows_follow(scenario: &Scenario, rows: &[Row], step: f64) {
    for pair in rows.windows(2) {
        let [row, next] = pair else { continue };
        let steps = ((next.t - row.t) / step).round();
        for (index, node) in scenario.nodes.iter().enumerate() {
            let (mut x, u) = (row.x[index], row.u[index]);
            for part in 0..steps as u32 {
                let t = row.t + f64::from(part) * step;
                let middle = x + 0.5 * step * (node.dynamics.value(t, x) + u);
                x += step * (node.dynamics.value(t + 0.5 * step, middle) + u);
            }
            assert!(
                nearly(next.x[index], x, 2e-6),
                "node {} at {} s: {} {x}",
                index + 1,
                next.t,
                next.x[index]
            );
        }
    }
}

/// True terms are those of the states of the same row.
fn terms_are_those_of_the_states(scenario: &Scenario, rows: &[Row]) {
    for row in rows {
        for (found, nu) in row.true_nu.iter().zip(scenario.graph.diffusive_terms(&row.x)) {
            assert!(nearly(*found, nu, 1e-9), "{} s: {found} {nu}", row.t);
        }
    }
}

/// Inputs, believed terms and funnels of a row between two rounds are held; states and true terms are not.
#[test]
fn with_rounds_there_is_a_row_at_each_tick() {
    let scenario = scenario("narrow-ring.toml", &["time.duration=1s", "time.round=4ms"]);
    let rows = run(&scenario, Fidelity::Loopback).rows;
    let times: Vec<f64> = rows.iter().map(|row| row.t).collect();
    assert_eq!(times, (0..=1_000).map(|k| f64::from(k) / 1e3).collect::<Vec<_>>());
    terms_are_those_of_the_states(&scenario, &rows);
    rows_follow(&scenario, &rows, 1e-3);
    for round in rows.chunks(4) {
        let [first, rest @ ..] = round else { continue };
        for row in rest {
            assert_eq!((&row.u, &row.nu, &row.psi), (&first.u, &first.nu, &first.psi));
            assert!(row.x != first.x && row.asked_psi != first.asked_psi, "{row:?}");
        }
    }
}

/// The hash is of what nodes say, at rounds; the figures of a run are of every tick.
#[test]
fn what_happens_between_two_rounds_is_judged() {
    let outcome = |round: &str, every: u64| {
        let expect = Expect { reference_error: Some(1.0), ..Expect::default() };
        let scenario = Scenario { expect, ..scenario("narrow-ring.toml", &["time.duration=6s", round]) };
        let outcome = run(&scenario, Fidelity::Loopback);
        let ratio = |row: &Row| {
            let ratios = row.true_nu.iter().zip(&row.asked_psi).map(|(nu, psi)| nu.abs() / psi);
            ratios.fold(0.0, f64::max)
        };
        let at_rounds = outcome.rows.iter().step_by(every as usize).map(ratio).fold(0.0, f64::max);
        let most = outcome.rows.iter().map(ratio).fold(0.0, f64::max);
        let judged = outcome.judge(&scenario, Fidelity::Loopback);
        assert_eq!(judged.funnel.unwrap().max_ratio, most, "{round}");
        (most, at_rounds, judged.reference.unwrap().max_error)
    };
    let of = |ms: u64| outcome(&format!("time.round={ms}ms"), ms);
    let all: Vec<_> = [2, 3, 5, 8, 10].map(|ms| (ms, of(ms))).into_iter().collect();
    println!("rounds in ms: ratio, at rounds, error: {all:?}");
    assert!(all.iter().any(|(_, (most, at_rounds, _))| most > at_rounds), "{all:?}");
}

/// Eighths of a millisecond until 10 ms, then milliseconds.
fn network_times(end_ms: u32) -> Vec<f64> {
    let slow = (0..80).map(|k| f64::from(k) / 8e3);
    slow.chain((10..=end_ms).map(|ms| f64::from(ms) / 1e3)).collect()
}

fn slowly(settings: &[&str], expect: Expect) -> (Scenario, Outcome) {
    let sets = [&["time.duration=2s", "time.slow_start=10ms"], settings].concat();
    let scenario = Scenario { expect, ..scenario("narrow-ring.toml", &sets) };
    let outcome = run(&scenario, Fidelity::Loopback);
    (scenario, outcome)
}

#[test]
fn with_a_slow_start_rows_are_of_network_time() {
    let expect = Expect { reference_error: Some(1.0), ..Expect::default() };
    let (scenario, outcome) = slowly(&[], expect);
    let times: Vec<f64> = outcome.rows.iter().map(|row| row.t).collect();
    assert_eq!(times, network_times(2_000));
    terms_are_those_of_the_states(&scenario, &outcome.rows);
    rows_follow(&scenario, &outcome.rows[..81], 0.125e-3);
    rows_follow(&scenario, &outcome.rows[80..], 1e-3);
    let summary = outcome.judge(&scenario, Fidelity::Loopback);
    assert_eq!(summary.ticks, 2_070);
    let (funnel, reference) = (summary.funnel.unwrap(), summary.reference.unwrap());
    // The reference begins as ever: it knows network time only.
    assert!(funnel.max_ratio < 1.0 && reference.max_error < 1e-2, "{funnel:?} {reference:?}");
}

#[test]
fn with_rounds_a_slow_start_is_one_of_rounds() {
    let (scenario, outcome) = slowly(&["time.round=2ms"], Expect::default());
    let rows = outcome.rows;
    assert_eq!((rows[2].t, rows[78].t, rows[80].t, rows[82].t), (0.25e-3, 9.75e-3, 10e-3, 12e-3));
    assert_eq!((rows[1].t, rows[81].t), (0.125e-3, 11e-3));
    assert_eq!(rows.last().unwrap().t, 2.0);
    rows_follow(&scenario, &rows[..81], 0.125e-3);
    rows_follow(&scenario, &rows[80..], 1e-3);
}

#[test]
fn events_happen_at_network_time() {
    let path = repository("scenarios/narrow-ring.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let events = "event = [{ at = '5ms', kind = 'partition', link = [1, 2] }, { at = '20ms', kind = 'repair', link = [1, 2] }, \
                  { at = '30ms', kind = 'crash', node = 3 }]";
    let sets = ["time.duration=2s", "time.slow_start=10ms"];
    let sets = sets.map(|set| Override::parse(set).unwrap());
    let scenario = Scenario::parse(&format!("{events}\n{text}"), &path, &sets).unwrap();
    let scenario = Scenario { expect: Expect::default(), ..scenario };
    let outcome = run(&scenario, Fidelity::Loopback);
    let gone = outcome.rows.iter().find(|row| row.x[2].is_nan()).unwrap();
    assert_eq!(gone.t, 0.03);
    let (calm, rows) = (slowly(&[], Expect::default()).1.rows, outcome.rows);
    let first = calm.iter().zip(&rows).find(|(calm, row)| calm.u[0] != row.u[0]).unwrap();
    // The state of 5 ms is the last that node 1 hears; it takes that of the next tick for granted, and its
    // law looks back no more.
    assert!(nearly(first.0.t, 5e-3, 0.26e-3), "{}", first.0.t);
}

/// `check` follows the same law in f64.
#[test]
fn the_slow_start_that_is_followed_is_that_of_the_run() {
    for settings in [&["coupling.guard=0.1"][..], &["bus.loss=0.05"], &["time.round=2ms"]] {
        let (scenario, outcome) = slowly(settings, Expect::default());
        let judged = outcome.judge(&scenario, Fidelity::Loopback).funnel.unwrap().max_ratio;
        let found = check(&scenario).findings.into_iter().find(|found| found.name == "sampled").unwrap();
        let ratio = found.values["ratio"].as_f64().unwrap();
        assert!(nearly(ratio, judged, 5e-3), "{settings:?}: {ratio} {judged}");
        let (low, high) =
            outcome.last.iter().fold((f64::MAX, f64::MIN), |(low, high), &x| (low.min(x), high.max(x)));
        assert!(
            nearly(found.values["spread"].as_f64().unwrap(), high - low, 1e-4),
            "{settings:?}: {found:?}"
        );
    }
}
