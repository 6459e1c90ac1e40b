//! A shorter tick, or a shorter round, that a scenario takes: its duration has to be a whole number of them.

use super::{Finding, tick_ns_of};
use crate::scenario::{Scenario, format_duration};
use funnelnet_node::params::SHORTEST_TICK_NS;

/// Parts into which a tick is cut at most.
const MOST_PARTS: u64 = 10_000;

/// With the setting that makes the law decide every `seconds` or more often, where there is one.
pub(super) fn set(found: Finding, scenario: &Scenario, seconds: f64) -> Finding {
    // What is not a number is not a time.
    let is_time = seconds > 0.0 && seconds.is_finite();
    if !is_time {
        return found;
    }
    let setting = if scenario.time.round == 1 { tick(scenario, seconds) } else { round(scenario, seconds) };
    match setting {
        Some((key, ns)) => found.set(key, format_duration(ns)),
        None => found,
    }
}

/// The longest tick up to `seconds`: one of two digits, or else a whole part of the present one.
fn tick(scenario: &Scenario, seconds: f64) -> Option<(&'static str, u64)> {
    let time = scenario.time;
    let plain = tick_ns_of(seconds);
    let whole = |ns: &u64| *ns >= u64::from(SHORTEST_TICK_NS);
    let slow_start_ns = time.tick_ns.saturating_mul(time.start.ticks().into());
    if [time.end_ns(), slow_start_ns].iter().all(|ns| ns.is_multiple_of(plain)) && whole(&plain) {
        return Some(("time.tick", plain));
    }
    let fewest = (time.tick_s() / seconds).ceil().max(1.0) as u64;
    let parts =
        (fewest..fewest.saturating_add(MOST_PARTS)).find(|parts| time.tick_ns.is_multiple_of(*parts))?;
    Some(("time.tick", time.tick_ns / parts)).filter(|(_, ns)| whole(ns))
}

/// The longest round up to `seconds`.
fn round(scenario: &Scenario, seconds: f64) -> Option<(&'static str, u64)> {
    let time = scenario.time;
    let round = u64::from(time.round);
    let step_ns = time.tick_ns / round;
    let steps = time.ticks.saturating_mul(round);
    let most = ((seconds * 1e9) as u64 / step_ns).min(round);
    let whole = (1..=most).rev().find(|steps_of| steps.is_multiple_of(*steps_of))?;
    Some(("time.round", whole * step_ns))
}
