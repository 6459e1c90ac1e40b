//! Limits of what nodes take of each other, against what honest ones say.

use serde_json::json;

use super::subject::Subject;
use super::text::plural;
use super::{Finding, Status, figure, largest};

use crate::sampled::{self, Bounds};
use crate::scenario::{Change, EventKind, Scenario, Step, format_duration};

/// Noise of two states in a row that goes beyond this many standard deviations is not waited for.
const DEVIATIONS: f64 = 6.0;
/// What is advised, over what is needed.
const ROOM: f64 = 1.5;

/// What there is to say; nothing where there is no such limit.
pub(super) fn finding(subject: &Subject<'_>) -> Option<Finding> {
    let scenario = subject.scenario;
    let safety = scenario.safety;
    if safety.heard_limit.is_none() && safety.heard_rate.is_none() {
        return None;
    }
    let new = |text, values| Finding::new("heard", "What is heard", text, values);
    let Some(followed) = sampled::undisturbed(scenario) else {
        let text =
            "how fast honest nodes move is not known for this law, or for a run of this length".to_owned();
        let found = new(text, json!({}));
        return Some(match short_restart(scenario).or_else(|| drawn_restart(scenario)) {
            Some(advice) => found.advise(Status::Warn, advice),
            None => found.stands(Status::NotChecked),
        });
    };
    let tick = scenario.time.tick_s();
    let noise = largest(scenario.nodes.iter().map(|node| node.noise)).1;
    let jitter = DEVIATIONS * 2.0_f64.sqrt() * noise / tick;
    let (rate, far) = (followed.slope + jitter, followed.far);
    let mut text = format!("honest states change by up to {} per second undisturbed", figure(rate));
    if let Some(limit) = safety.heard_rate {
        text += &format!(
            "; {} is taken. A jump of more than {} is not, and one of more than {} drops the edge",
            figure(limit),
            figure(limit * tick),
            figure(limit * tick * f64::from(safety.drop_after))
        );
    }
    let values = json!({
        "rate": rate, "heard_rate": safety.heard_rate, "largest": far, "heard_limit": safety.heard_limit,
        "drop_after": safety.drop_after,
    });
    let found = new(text, values);
    let then = "honest states are not taken then, and their edges are dropped";
    if safety.heard_rate.is_some_and(|limit| limit < rate) {
        let advice = format!("{then}; let safety.heard_rate be {} or more", figure(ROOM * rate));
        return Some(found.advise(Status::Warn, advice).set("safety.heard_rate", figure(ROOM * rate)));
    }
    // What a node does beside its input.
    let (bound, rest) = (Bounds::of(scenario).input, followed.field + jitter);
    if let Some((limit, bound)) = safety.heard_rate.zip(bound).filter(|(limit, bound)| *limit < bound + rest)
    {
        let below = if rest < limit {
            format!("coupling.u_max be below {}, or ", figure(limit - rest))
        } else {
            String::new()
        };
        let advice = format!(
            "after an event inputs reach {}, and fields and noise {}: honest nodes may be faster than what is taken, and edges between \
             them can be dropped; let {below}safety.heard_rate be more than {}",
            figure(bound),
            figure(rest),
            figure(bound + rest)
        );
        return Some(found.advise(Status::Warn, advice));
    }
    if safety.heard_limit.is_some_and(|limit| limit < far) {
        let advice = format!("states reach {}; {then}; let safety.heard_limit be larger", figure(far));
        return Some(found.advise(Status::Warn, advice).set("safety.heard_limit", figure(ROOM * far)));
    }
    Some(match short_restart(scenario).or_else(|| drawn_restart(scenario)) {
        Some(advice) => found.advise(Status::Warn, advice),
        None => found,
    })
}

/// What there is to say of a node that is off for no longer than its neighbours extrapolate it. It says that it starts anew;
/// a neighbour to which that frame does not come holds its state against what it was, from which it may be too far.
fn short_restart(scenario: &Scenario) -> Option<String> {
    let safety = scenario.safety;
    if safety.heard_rate.is_none() || safety.drop_after == 0 || !loses_frames(scenario) {
        return None;
    }
    let longest = u64::from(Bounds::of(scenario).extrapolate);
    let course = scenario.course();
    let steps = course.steps();
    let restart = |(place, step): (usize, &Step)| {
        // Who is told to stop says so.
        let Change::Off { node, told: false } = step.change else { return None };
        let back = steps.get(place..)?.iter().find(|later| later.change == Change::On { node })?;
        let tick = |step: &Step| scenario.time.first_tick(step.at_ns);
        let ticks = tick(back) - tick(step);
        (1..=longest).contains(&ticks).then_some((scenario.nodes.get(node)?.id, step.at_ns, ticks))
    };
    let (id, at_ns, ticks) = steps.iter().enumerate().find_map(restart)?;
    Some(format!(
        "node {id} is off for {} at {}, and its neighbours extrapolate it for {longest}. Where the frame is lost by which it says \
         that it starts anew, and it comes back far from where it was, they drop its edges, to the end if it is not off again for \
         longer; let it be off for more than {}",
        plural(ticks as usize, "tick"),
        format_duration(at_ns),
        plural(longest as usize, "tick")
    ))
}

/// Whether a frame may not come. Events that lose frames count whenever they happen.
fn loses_frames(scenario: &Scenario) -> bool {
    let bus = &scenario.bus;
    let of_links =
        scenario.links.iter().any(|link| !link.settings.loss.is_none() || link.settings.corrupt > 0.0);
    !bus.loss.is_none() || of_links || scenario.events.iter().any(|event| event_loses_frames(event.kind))
}

fn event_loses_frames(kind: EventKind) -> bool {
    let is_of_links =
        matches!(kind, EventKind::Partition | EventKind::Burst | EventKind::Corrupt | EventKind::Hold);
    is_of_links || kind.is_of_wires()
}

/// The same of what `[faults]` may draw, whatever this seed has drawn.
fn drawn_restart(scenario: &Scenario) -> Option<String> {
    let safety = scenario.safety;
    let shortest_ns = scenario.shortest_bounce_ns?;
    if safety.heard_rate.is_none() || safety.drop_after == 0 || !loses_frames(scenario) {
        return None;
    }
    let longest = u64::from(Bounds::of(scenario).extrapolate);
    // Whole ticks, wherever between two of them it begins.
    let ticks = shortest_ns / scenario.time.tick_ns;
    (ticks <= longest).then(|| {
        format!(
            "with some seed [faults] has a node off for {}, and its neighbours extrapolate it for {longest} ticks. Where the frame is lost \
             by which it says that it starts anew, and it comes back far from where it was, they drop its edges; let faults.shortest be \
             {} or more, or leave bounce out of faults.kinds",
            format_duration(shortest_ns),
            format_duration((longest + 1) * scenario.time.tick_ns)
        )
    })
}
