//! What the sampled law in f32 cannot do (law.md 4).

use serde_json::{Value, json};

use super::forecast::Forecast;
use super::subject::Subject;
use super::{Finding, Status, about, figure, kick, largest, share, tick_of, width_of};
use super::{longest, shorter};
use crate::scenario::{Dynamics, format_duration};
use crate::{emergent, extremes, extremes::smaller};

/// Part of the longest tick that is advised.
const SAFE: f64 = 0.8;
/// Angle or decay within one tick that is fast: the node's midpoint step is then off by some 2 %.
pub(super) const FAST: f64 = 0.5;
/// Angle within one tick beyond which a sine looks like a slower one, rad.
pub(super) const ALIASED: f64 = std::f64::consts::PI;
/// Decay within one tick from which the node's midpoint step grows instead.
pub(super) const UNSTABLE: f64 = 2.0;

pub(super) fn findings(subject: &Subject<'_>, forecast: &Forecast) -> Vec<Finding> {
    let mut found = vec![narrowest(subject, forecast), speed(subject), resolution(subject, forecast)];
    found.extend(margin(forecast));
    found
}

/// Part of the narrowest funnel that one exchange per tick takes at the node where that is most, by the
/// formula alone.
pub(super) fn taken_of_narrowest(subject: &Subject<'_>, forecast: &Forecast) -> f64 {
    let index = tightest(forecast);
    forecast.nodes[index].floor / subject.narrowest(index)
}

/// Index of the node whose funnel has the least room for an exchange per tick.
fn tightest(forecast: &Forecast) -> usize {
    largest(forecast.nodes.iter().map(|node| node.taken)).0
}

/// One exchange per tick adds `theta c T^2 d |d/dt (f_em - f_i)| / psi` to the steady ratio (law.md 2,
/// theorem 2). The sum of the sizes is predicted, and what holds follows from it.
fn narrowest(subject: &Subject<'_>, forecast: &Forecast) -> Finding {
    let index = tightest(forecast);
    let (_, ratio) = largest(forecast.nodes.iter().map(|node| node.ratio));
    let seen = &forecast.nodes[index];
    let floor = if seen.taken == 0.0 { 0.0 } else { seen.taken * seen.taken_of };
    let (name, node) = (format_duration(subject.scenario.time.tick_ns), index + 1);
    let found = Longest::of(subject, seen.taken);
    let (longest, by_formula) = (found.map(|found| found.seconds), found.map(|found| found.by_formula));
    // What is not a number is said.
    let holds = match floor == f64::INFINITY {
        true => format!("{name} holds no funnel"),
        false => format!("{name} holds funnels down to about {}", about(floor)),
    };
    let most = match longest.and_then(tick_of) {
        Some(_) => format!("the longest tick for this scenario is about {} s", about(longest.unwrap_or(0.0))),
        None => "no tick that a node takes holds this one".to_owned(),
    };
    let text = match longest {
        None => {
            format!("{name} holds any funnel once the states have met: no field drifts from the emergent one")
        }
        Some(_) if seen.taken == 0.0 => {
            format!(
                "{name} holds any funnel once the states have met: no field drifts from the emergent one; {most}"
            )
        }
        Some(_) => format!(
            "once the states have met, |nu|/psi is predicted to be {} at most; {holds} at node {node} (the tightest), where psi is {} at t = {} s; \
             {most}",
            about(ratio),
            figure(seen.taken_of),
            figure(seen.taken_at)
        ),
    };
    let values = json!({
        "node": node, "narrowest": seen.floor, "psi_min": subject.narrowest(index), "predicted_ratio": ratio,
        "share": seen.taken, "t": seen.taken_at, "longest_tick_s": longest,
        "longest_tick_by_formula_s": by_formula,
    });
    let found = Finding::new("narrowest-funnel", "Tick", text, values);
    if seen.taken < 1.0 {
        return found;
    }
    if subject.keeps() {
        let advice = "this adds up sizes; the law itself, followed over the whole run, stays inside (below)";
        return found.advise(Status::Note, advice.to_owned());
    }
    let seconds = SAFE * longest.unwrap_or(0.0);
    let tick = tick_of(seconds).map(|tick| format!("use a tick of {tick} or less"));
    let psi = width_of(floor / SAFE).map(|psi| format!("let psi be {psi} or more there"));
    let ways: Vec<_> = tick.into_iter().chain(psi).collect();
    let advice = match ways.is_empty() {
        true => "|nu| leaves the funnel whatever the tick: it has closed, or the steady ratio alone fills it; let psi end wider, or raise the \
                 gain's scale"
            .to_owned(),
        false => format!("|nu| may leave the funnel; {}", ways.join(", or ")),
    };
    shorter::set(found.advise(Status::Warn, advice), subject.scenario, seconds)
}

/// The longest tick that leaves room in the funnel, resolves the fields, and does not throw the start out, s.
#[derive(Clone, Copy)]
struct Longest {
    by_formula: f64,
    /// By following the law where that is cheap, else the same.
    seconds: f64,
}

impl Longest {
    /// None where any tick does.
    fn of(subject: &Subject<'_>, taken: f64) -> Option<Self> {
        let tick = subject.scenario.time.tick_s();
        let resolved = FAST / emergent::fastest(subject.scenario);
        let kicked = tick * kick::SMALL / kick::largest(subject.scenario).1;
        let some = taken != 0.0 || kicked.is_finite();
        let terms = [tick * taken.sqrt().recip(), resolved, kicked];
        let by_formula = terms.into_iter().fold(f64::INFINITY, smaller);
        some.then(|| Self {
            by_formula,
            seconds: longest::by_law(subject, by_formula, resolved).unwrap_or(by_formula),
        })
    }
}

/// The fields against the tick: the node advances its state by a midpoint step, so that it sees a sine once
/// per tick.
pub(super) fn speed(subject: &Subject<'_>) -> Finding {
    // In a round the field goes on tick by tick.
    let (nodes, tick) = (&subject.scenario.nodes, subject.scenario.time.step_s());
    let set = |found: Finding, needed: f64| match subject.scenario.time.round {
        1 => shorter::set(found, subject.scenario, needed),
        // The tick would have to fit into the round as well.
        _ => found,
    };
    let (steep, decay) = largest(nodes.iter().map(|node| tick * node.dynamics.steepness()));
    let (quick, angle) = largest(nodes.iter().map(|node| tick * node.dynamics.fastest_sine()));
    let text = format!(
        "in one tick a field decays or grows by {} (node {}) and turns by {} rad (node {}) at most",
        about(decay),
        steep + 1,
        about(angle),
        quick + 1
    );
    let values = json!({
        "tick_slope": decay, "slope_node": steep + 1, "tick_frequency": angle, "frequency_node": quick + 1,
    });
    let found = Finding::new("speed", "Fields and tick", text, values);
    let stiffest = extremes::largest(0.0, nodes.iter().map(|node| tick * stiffness(&node.dynamics)));
    let quickest = extremes::larger(decay, angle);
    if quickest <= FAST {
        return found;
    }
    let needed = tick * FAST / quickest;
    let advice = match tick_of(needed) {
        Some(tick) => format!("use a tick of {tick} or less"),
        None => "no tick that a node takes resolves it; let the field be slower".to_owned(),
    };
    if stiffest >= UNSTABLE {
        let why = format!(
            "T |df/dx| is {} at a node: its own step grows from {} on; {advice}",
            about(stiffest),
            figure(UNSTABLE)
        );
        return set(found.advise(Status::Fail, why), needed);
    }
    if angle > ALIASED {
        let why = format!(
            "the tick does not resolve a sine of {} rad per tick: node {} sees it once per tick, as a slower one or as a constant, \
             and its run differs from the prediction; {advice}",
            about(angle),
            quick + 1
        );
        return set(found.advise(Status::Note, why), needed);
    }
    set(found.advise(Status::Note, format!("fast for the node's midpoint step; {advice}")), needed)
}

/// How fast a field decays or turns by itself, 1/s. That of a matrix is its norm: what turns fast makes the
/// node's step grow as well.
pub(super) fn stiffness(field: &Dynamics) -> f64 {
    match field.affine() {
        Some(affine) if affine.slope.len() == 1 => -affine.slope(),
        Some(affine) => affine.lipschitz(),
        // Its steepest slope is not known to be one of the motion.
        None => 0.0,
    }
}

/// The f32 resolution of `nu` against the funnel.
fn resolution(subject: &Subject<'_>, forecast: &Forecast) -> Finding {
    let end = subject.scenario.time.end_s();
    let last: Vec<_> = subject.widths.at(end).collect();
    let (worst, _) = largest(forecast.resolution.iter().zip(&last).map(|(step, width)| step / width));
    let (step, width) = (forecast.resolution[worst], last[worst]);
    let text = format!(
        "|x| up to about {} floors the funnel at {} at node {}, where psi ends at {}",
        figure(forecast.largest_state),
        figure(step),
        worst + 1,
        figure(width)
    );
    let values = json!({
        "node": worst + 1, "resolution": step, "psi_end": width, "largest_state": forecast.largest_state,
    });
    let found = Finding::new("resolution", "f32", text, values);
    if step < width {
        return found;
    }
    let advice = format!(
        "below that nu has no digits left, so the node keeps its funnel there and reports it; end the run earlier, or let \
         psi end at {}",
        figure(2.0 * step)
    );
    found.advise(Status::Warn, advice)
}

/// The margin `1 - |s_i|` that the emergent dynamics leave while the funnel is at its floor, against the
/// rounding of `nu` there. `None` where no funnel reaches its floor.
fn margin(forecast: &Forecast) -> Option<Finding> {
    let tight = forecast.at_floor?;
    let text = format!(
        "at the floor of its funnel node {} settles {} inside it (t = {} s); rounding takes up to about {}",
        tight.index + 1,
        share(tight.margin),
        figure(tight.t),
        share(tight.needed)
    );
    let values: Value =
        json!({ "node": tight.index + 1, "margin": tight.margin, "rounding": tight.needed, "t": tight.t });
    let found = Finding::new("margin", "Margin at floor", text, values);
    if tight.margin >= tight.needed {
        return Some(found);
    }
    let advice = "|nu| may leave the floored funnel; raise the gain's scale, or let psi end above its floor";
    Some(found.advise(Status::Warn, advice.to_owned()))
}
