//! What the sampled law does, as far as it was followed.

use serde_json::json;

use super::sampled::{self, Followed, Worst};
use super::subject::Subject;
use super::text::plural;
use super::{Finding, Status, extremes, figure};
use crate::extremes::larger;
use crate::scenario::{Breach, LARGEST_RUN, Scenario, TimeSpec, format_duration};
use funnelnet_law::range::SHORTEST_TICK_NS;
use funnelnet_law::start::SlowStart;

/// Ratio in the first tenth of a second from which on it is warned about, where the law settles lower than that.
const TIGHT_START: f64 = 0.95;
/// How far a start is above what the law settles at, at least, to count as tight.
const ABOVE_STEADY: f64 = 0.02;

pub(super) fn finding(subject: &Subject<'_>) -> Finding {
    let Some(followed) = &subject.followed else { return none_here(subject.scenario) };
    let (found, worst) = (said(subject, followed), followed.worst);
    if let Some(t) = followed.lost {
        let why = format!("the law runs away within {} s, and so will the run", figure(t));
        return advised(found, Status::Fail, &why, subject);
    }
    if let Some((node, t)) = followed.floored {
        let why = format!(
            "from t = {} s on node {} cannot resolve its funnel in f32 and keeps a wider one, which coupling.floor does not accept: a run fails; \
             say floor = \"f32\" if that is meant, or let psi end wider",
            figure(t),
            node + 1
        );
        return found.advise(Status::Fail, why).set("coupling.floor", "f32".to_owned());
    }
    let inside = worst.ratio < 1.0;
    if !inside && subject.scenario.on_breach == Breach::Stop {
        let why = format!("node {} leaves its funnel, and on_breach stops it", worst.node + 1);
        return advised(found, Status::Fail, &why, subject);
    }
    if !inside {
        return advised(found, Status::Warn, &format!("node {} leaves its funnel", worst.node + 1), subject);
    }
    if tight(subject, followed) {
        let why = format!("node {} comes close to leaving its funnel at the start", followed.start.node + 1);
        return advised(found, Status::Warn, &why, subject);
    }
    match followed.whole {
        true => found,
        false => found.stands(Status::Note),
    }
}

fn said(subject: &Subject<'_>, followed: &Followed) -> Finding {
    let Followed { worst, start, .. } = followed;
    let how_far = match followed.whole {
        true => "the whole run".to_owned(),
        false => format!("of {} s", figure(subject.scenario.time.end_s())),
    };
    let text = format!(
        "followed in f64 for {} s ({how_far}): |nu|/psi is {} at most, at node {} (t = {} s), and {} within the first tenth of a second",
        figure(followed.until),
        figure(worst.ratio),
        worst.node + 1,
        figure(worst.t),
        figure(start.ratio)
    );
    let (low, high) = extremes(followed.last.iter().copied());
    let spread = (subject.scenario.components() == 1).then_some(high - low);
    let of = |worst: &Worst| json!({ "ratio": worst.ratio, "node": worst.node + 1, "t": worst.t });
    let values = json!({
        "ratio": worst.ratio, "node": worst.node + 1, "t": worst.t, "start": of(start), "until": followed.until,
        "whole": followed.whole, "largest_input": followed.input, "lost_at": followed.lost, "spread": spread,
    });
    Finding::new("sampled", "Sampled law", text, values)
}

/// Whether the start is closer to the funnel's edge than the fields ask for.
fn tight(subject: &Subject<'_>, followed: &Followed) -> bool {
    let steady = subject.forecast.as_ref().map_or(0.0, |forecast| {
        let ratios = forecast.nodes.iter().map(|node| 1.0 - node.margin);
        crate::extremes::largest(0.0, ratios)
    });
    let calm = followed.start.ratio < larger(TIGHT_START, steady + ABOVE_STEADY);
    !calm
}

/// The tick, of a half and a quarter of the scenario's, that keeps every node inside: for as long at least as it takes to leave the funnel now.
fn better(subject: &Subject<'_>) -> Option<String> {
    let TimeSpec { tick_ns, ticks, round, start } = subject.scenario.time;
    if round > 1 {
        // A shorter round is a matter of the bus as well.
        return None;
    }
    let left = subject.followed.as_ref().and_then(|followed| followed.left).unwrap_or(0.0);
    let allowed =
        |parts: &u64| tick_ns.is_multiple_of(*parts) && tick_ns / parts >= u64::from(SHORTEST_TICK_NS);
    [2, 4].into_iter().filter(allowed).find_map(|parts| {
        let start = SlowStart::new(start.ticks().saturating_mul(parts as u16));
        let time = TimeSpec { tick_ns: tick_ns / parts, ticks: ticks.saturating_mul(parts), round, start };
        let scenario = Scenario { time, ..subject.scenario.clone() };
        let followed = sampled::follow(&scenario, &subject.degrees)?;
        let inside = followed.lost.is_none() && followed.worst.ratio < 1.0 && followed.until > left;
        inside.then(|| format_duration(time.tick_ns))
    })
}

/// With the shorter tick that cures it, where one was found.
fn advised(found: Finding, status: Status, why: &str, subject: &Subject<'_>) -> Finding {
    match better(subject) {
        Some(tick) => found
            .advise(
                status,
                format!("{why}; with a tick of {tick} it stays inside, as far as that was followed"),
            )
            .set("time.tick", tick),
        None => {
            let cure =
                "no tick that was tried cures it: widen the funnel, or look at fields, noise, loss and delay";
            found.advise(status, format!("{why}; {cure}"))
        }
    }
}

/// Where the law is not followed.
fn none_here(scenario: &Scenario) -> Finding {
    let (kind, nodes) = (scenario.coupling.kind(), scenario.nodes.len());
    let text = match nodes > LARGEST_RUN {
        true => format!("not followed for {nodes} nodes: {LARGEST_RUN} at most"),
        false => format!(
            "not followed for {kind} coupling of states with {}: what a run does is not known before it",
            plural(scenario.components(), "component")
        ),
    };
    let values = json!({ "coupling": kind, "nodes": nodes });
    Finding::new("sampled", "Sampled law", text, values).stands(Status::NotChecked)
}
