//! What the sampled law does, as far as it was followed.

use serde_json::json;

use super::cures::cause;
use super::subject::Subject;
use super::text::plural;
use super::{Advice, Finding, Status, extremes, figure};
use crate::sampled::{Followed, Worst};
use crate::scenario::{Breach, LARGEST_RUN, Scenario};

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
    if !subject.is_promised() {
        return unpromised(found, subject, followed);
    }
    if !inside {
        return advised(
            found,
            Status::Warn,
            &format!("node {} leaves its funnel{}", worst.node + 1, cause(subject, followed)),
            subject,
        );
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

/// A baseline: what it does is known, and it has promised nothing.
fn unpromised(found: Finding, subject: &Subject<'_>, followed: &Followed) -> Finding {
    let status = match followed.whole && followed.worst.ratio < 1.0 {
        true => Status::Ok,
        false => Status::Note,
    };
    let what = match subject.scenario.coupling.keeps_funnels() {
        true => "a linear gain".to_owned(),
        false => format!("{} coupling", subject.scenario.coupling.kind()),
    };
    let advice = format!("{what} promises no funnel: its ratio is counted in a run, and nothing more");
    found.advise(status, advice)
}

/// Whether the start is closer to the funnel's edge than the fields ask for.
fn tight(subject: &Subject<'_>, followed: &Followed) -> bool {
    let calm = followed.start.ratio < subject.calm_start();
    !calm
}

/// With what cures it, where something was found that does.
fn advised(found: Finding, status: Status, why: &str, subject: &Subject<'_>) -> Finding {
    let advice = Advice::new(why.to_owned());
    let advice = match subject.cure() {
        Some(cure) => advice.with(cure),
        None => Advice::new(format!(
            "{why}; nothing that was tried keeps the funnel (shorter ticks, rounds, damping, wider funnels): look at fields, noise and loss"
        )),
    };
    Finding { status, advice: Some(advice), ..found }
}

/// Where the law is not followed.
fn none_here(scenario: &Scenario) -> Finding {
    let (kind, nodes) = (scenario.coupling.kind(), scenario.nodes.len());
    let text = match nodes > LARGEST_RUN {
        true => format!("not followed for {nodes} nodes: {LARGEST_RUN} at most"),
        // Edge-wise, and what both ends believe of an edge is not one thing.
        false => format!(
            "not followed for {kind} coupling of states with {} on a bus that loses or delays, with noise, or with a slow start: what a run does \
             is not known before it",
            plural(scenario.components(), "component")
        ),
    };
    let values = json!({ "coupling": kind, "nodes": nodes });
    Finding::new("sampled", "Sampled law", text, values).stands(Status::NotChecked)
}
