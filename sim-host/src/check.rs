//! `sim-host check`: what can be said about a scenario without running it.
//!
//! The paper's assumptions and bounds (named in the README), and the limits of the sampled law in f32
//! (LAW.md section 4).

mod capacity;
mod forecast;

use std::fmt;

use serde::Serialize;
use serde_json::{Value, json};

use crate::emergent::EmergentTrajectory;
use crate::scenario::{
    BusModel, CouplingKind, FunnelSpec, GainSpec, NodeSpec, NormalisedSpec, Scenario, format_duration,
    initial_ratios,
};
use forecast::Forecast;
use funnel_core::math;
use funnel_core::params::FLOOR_ULPS;

/// Share of the funnel that the floor of the tick may take up before it is warned about: the floor is known
/// only to "about" (LAW.md 4, where a share of 1 meant leaving the funnel by a factor of two).
const TIGHT: f64 = 0.5;

/// How a finding stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// It holds.
    Ok,
    /// For information.
    Note,
    /// It runs, but a guarantee is weaker than it looks.
    Warn,
    /// The scenario cannot do what it is meant to.
    Fail,
}

/// One thing that was checked.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// A stable name for machines.
    pub name: &'static str,
    /// How it stands.
    pub status: Status,
    /// What was found, for people.
    pub text: String,
    /// What to change, where something is to be changed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub advice: Option<String>,
    /// The figures, in SI units.
    pub values: Value,
}

/// Everything that was checked. `Display` is the text for people, `Serialize` the form for machines.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// The scenario's title.
    pub scenario: String,
    /// The file.
    pub path: String,
    /// The root seed.
    pub seed: u64,
    /// Number of nodes.
    pub nodes: usize,
    /// Number of edges.
    pub edges: usize,
    /// Tick in seconds.
    pub tick_s: f64,
    /// Number of ticks.
    pub ticks: u64,
    /// The findings, assumptions first.
    pub findings: Vec<Finding>,
    /// No finding failed; warnings do not count.
    pub pass: bool,
}

/// Checks a scenario. It has been validated, so the graph is connected and every node starts inside its
/// funnel.
#[must_use]
pub fn check(scenario: &Scenario) -> Report {
    let mut findings = vec![graph(scenario), fields(scenario), funnels(scenario), gains(scenario)];
    match unpredicted(scenario) {
        None => {
            let forecast = Forecast::of(scenario);
            findings.extend([
                emergent(scenario),
                start(scenario),
                sync_bound(scenario, &forecast),
                narrowest(scenario, &forecast),
                resolution(scenario, &forecast),
            ]);
            findings.extend(margin(scenario, &forecast));
        }
        Some(note) => findings.extend([start(scenario), note]),
    }
    findings.extend(bus(scenario));
    findings.push(capacity::finding(scenario));
    Report {
        scenario: scenario.title.clone(),
        path: scenario.path.display().to_string(),
        seed: scenario.seed,
        nodes: scenario.graph.nodes,
        edges: scenario.graph.edges.len(),
        tick_s: scenario.time.tick_s(),
        ticks: scenario.time.ticks,
        pass: findings.iter().all(|finding| finding.status != Status::Fail),
        findings,
    }
}

fn finding(name: &'static str, status: Status, text: String, values: Value) -> Finding {
    Finding { name, status, text, advice: None, values }
}

/// What the predictions about the motion do not cover: they are those of the paper's law for scalar states.
fn unpredicted(scenario: &Scenario) -> Option<Finding> {
    let (coupling, components) = (scenario.coupling, scenario.components());
    let scalar =
        matches!(coupling, CouplingKind::NodeWise | CouplingKind::ElementWise | CouplingKind::MaxGain);
    if components == 1
        && scalar
        && !scenario.nodes.iter().any(|node| matches!(node.gain, GainSpec::Linear { .. }))
    {
        return None;
    }
    let promise = match coupling.keeps_funnels() {
        true => "",
        false => "; the law promises no funnel, so that ratios and breaches are counted and nothing more",
    };
    let text = format!(
        "Predictions: none here for {} coupling of states with {}: neither contraction, bounds, nor what tick and f32 can hold{promise}",
        coupling.name(),
        plural(components, "component")
    );
    let values = json!({ "coupling": coupling.name(), "components": components });
    Some(finding("predictions", Status::Note, text, values))
}

/// Assumption 1.
fn graph(scenario: &Scenario) -> Finding {
    let spectrum = scenario.graph.spectrum();
    let lambda2 = spectrum.get(1).copied().unwrap_or(0.0);
    let lambda_max = spectrum.last().copied().unwrap_or(0.0);
    let degrees: Vec<_> = (0..scenario.graph.nodes).map(|i| scenario.graph.degree(i)).collect();
    let (low, high) = extremes(&degrees);
    let text = format!(
        "Assumption 1: the graph is undirected and connected; lambda2 = {}, lambda_max = {}, \
         degrees {} to {}",
        figure(lambda2),
        figure(lambda_max),
        figure(low),
        figure(high)
    );
    finding(
        "graph",
        Status::Ok,
        text,
        json!({ "lambda2": lambda2, "lambda_max": lambda_max, "degree": degrees }),
    )
}

/// Assumptions 2 and 4: affine fields are globally Lipschitz, so nothing escapes in finite time.
fn fields(scenario: &Scenario) -> Finding {
    let lipschitz = scenario.nodes.iter().map(|node| node.dynamics.lipschitz()).fold(0.0, f64::max);
    let text = format!(
        "Assumptions 2 and 4: the fields are affine, Lipschitz with {}/s, so no state escapes in finite time",
        figure(lipschitz)
    );
    finding("fields", Status::Ok, text, json!({ "lipschitz": lipschitz }))
}

/// The largest slope `|psi'|` of a funnel (state units / s); infinite where the funnel has none.
fn steepest(funnel: &FunnelSpec) -> f64 {
    match *funnel {
        FunnelSpec::Exponential { start, end, rate, factor } => factor * rate * (start - end).abs(),
        FunnelSpec::Constant { .. } => 0.0,
        FunnelSpec::ReciprocalTime { .. } => f64::INFINITY,
        FunnelSpec::FiniteTime { start, at_ns, power, factor } if power >= 1.0 => {
            factor * start * power / (at_ns as f64 * 1e-9)
        }
        FunnelSpec::FiniteTime { .. } => f64::INFINITY,
        FunnelSpec::Schedule { start, at_ns, eps, then, factor } => {
            let at = at_ns as f64 * 1e-9;
            let first = start.max(eps * then.width(at)) / at * math::ln(start / (eps * then.width(at))).abs();
            let later = match then {
                NormalisedSpec::Constant { .. } => 0.0,
                NormalisedSpec::Exponential { start, end, rate } => {
                    eps * rate * (start - end).abs() * math::exp(-rate * at)
                }
            };
            factor * first.max(later)
        }
    }
}

/// Assumption 3, the funnels.
fn funnels(scenario: &Scenario) -> Finding {
    let end = scenario.time.end_s();
    let bound = scenario.widest_funnel(0.0).max(scenario.widest_funnel(end));
    let theta = scenario.nodes.iter().map(|node| steepest(&node.funnel)).fold(0.0, f64::max);
    let text = format!(
        "Assumption 3: 0 < psi <= {} and |psi'| <= {}/s; at the end psi is {} at most",
        figure(bound),
        figure(theta),
        figure(scenario.widest_funnel(end))
    );
    let values =
        json!({ "psi_bound": bound, "psi_slope_bound": theta, "psi_end": scenario.widest_funnel(end) });
    finding("funnels", Status::Ok, text, values)
}

/// Assumption 3, the gains.
fn gains(scenario: &Scenario) -> Finding {
    let grows = |gain: &GainSpec| matches!(gain, GainSpec::Reciprocal { .. } | GainSpec::Logarithmic { .. });
    let mut names: Vec<_> = scenario.nodes.iter().map(|node| gain_name(&node.gain)).collect();
    names.sort_unstable();
    names.dedup();
    let holds = scenario.nodes.iter().all(|node| grows(&node.gain));
    let (status, what) = match holds {
        true => (Status::Ok, "are non-decreasing and unbounded at the funnel's edge"),
        false => (Status::Warn, "include one that is not known to be non-decreasing and unbounded"),
    };
    let text = format!("Assumption 3: the gains ({}) {what}", names.join(", "));
    finding("gains", status, text, json!({ "kinds": names }))
}

fn gain_name(gain: &GainSpec) -> &'static str {
    match gain {
        GainSpec::Reciprocal { .. } => "reciprocal",
        GainSpec::Logarithmic { .. } => "logarithmic",
        GainSpec::LocallyLinear { .. } => "locally-linear",
        GainSpec::Median { .. } => "median",
        GainSpec::Linear { .. } => "linear",
    }
}

/// Assumption 5 and the contraction that the prediction by the emergent dynamics rests on.
fn emergent(scenario: &Scenario) -> Finding {
    let slopes: Vec<_> = scenario.nodes.iter().map(|node| node.dynamics.slope()).collect();
    let (_, largest) = extremes(&slopes);
    let end = scenario.time.end_s();
    let ratio = |t: f64| {
        let widths: Vec<_> = scenario.nodes.iter().map(|node| node.funnel.width(t)).collect();
        let (low, high) = extremes(&widths);
        high / low
    };
    let spread = ratio(0.0).max(ratio(end));
    let values = json!({ "largest_slope": largest, "funnel_ratio_bound": spread });
    if largest < 0.0 {
        let text = format!(
            "Assumption 5: every field contracts by {}/s or more, so do the emergent dynamics; \
             funnels within a \
             factor of {}",
            figure(-largest),
            figure(spread)
        );
        return finding("emergent", Status::Ok, text, values);
    }
    let text = format!(
        "Assumption 5: a field with slope {}/s does not contract; whether the emergent dynamics do \
         is not decided \
         here",
        figure(largest)
    );
    let mut finding = finding("emergent", Status::Note, text, values);
    finding.advice =
        Some("trust emergent_error only where xi is seen to forget its initial value".to_owned());
    finding
}

/// The theorem's condition on the start.
fn start(scenario: &Scenario) -> Finding {
    let ratios = initial_ratios(scenario);
    let worst = ratios.iter().copied().fold(0.0, f64::max);
    let count = scenario.components();
    let node = ratios.iter().position(|ratio| *ratio == worst).map_or(1, |index| index / count + 1);
    let each: Vec<_> = ratios.iter().map(|ratio| figure(*ratio)).collect();
    let list =
        if each.len() <= 16 && count == 1 { format!(" (by id: {})", each.join(", ")) } else { String::new() };
    let text = format!("Start: |nu| / psi is {} at most, at node {node}{list}", figure(worst));
    finding("start", Status::Ok, text, json!({ "ratio": ratios, "worst": worst, "node": node }))
}

/// The paper's bound on the distance between any two states.
fn sync_bound(scenario: &Scenario, forecast: &Forecast) -> Finding {
    let widest = |t: f64| {
        let kept = |(index, node): (usize, &NodeSpec)| node.funnel.width(t).max(forecast.resolution(index));
        scenario.nodes.iter().enumerate().map(kept).fold(0.0, f64::max)
    };
    let [first, last] = [0.0, scenario.time.end_s()].map(|t| scenario.sync_bound(widest(t)));
    let text = format!(
        "Bound: |x_i - x_j| < 2 sqrt(N) / lambda2 max psi = {} at the start, {} at the end",
        figure(first),
        figure(last)
    );
    let mut found = finding("sync-bound", Status::Ok, text, json!({ "start": first, "end": last }));
    if let Some(limit) = scenario.expect.final_spread.filter(|limit| *limit < last) {
        found.status = Status::Note;
        let text = format!(
            "final_spread = {} asks for more than this bound promises; it may well hold",
            figure(limit)
        );
        found.advice = Some(text);
    }
    found
}

/// LAW.md 4: one exchange per tick cannot hold a funnel narrower than `T^2 d max|d/dt (f_i - f_j)|`.
fn narrowest(scenario: &Scenario, forecast: &Forecast) -> Finding {
    let (mut worst, mut floor, mut width) = (0, 0.0, f64::INFINITY);
    let mut excess = 0.0;
    let end = scenario.time.end_s();
    for (index, node) in scenario.nodes.iter().enumerate() {
        let needed = forecast.floor(index);
        let offered = node.funnel.width(end).min(node.funnel.width(0.0));
        if needed / offered > excess || index == 0 {
            (worst, floor, width, excess) = (index, needed, offered, needed / offered);
        }
    }
    let tick = format_duration(scenario.time.tick_ns);
    let text = format!(
        "Tick: {tick} can hold funnels down to about {} at node {}, where psi falls to {}",
        figure(floor),
        worst + 1,
        figure(width)
    );
    let values = json!({ "node": worst + 1, "narrowest": floor, "psi_min": width });
    let mut found = finding("narrowest-funnel", Status::Ok, text, values);
    if excess >= TIGHT {
        found.status = Status::Warn;
        let tick = scenario.time.tick_s() / (2.0 * excess / TIGHT).sqrt();
        found.advice = Some(format!(
            "|nu| may leave the funnel; use a tick of {} s or less, or let psi end at {} or more",
            figure(tick),
            figure(2.0 * floor / TIGHT)
        ));
    }
    found
}

/// LAW.md 4: the f32 resolution of `nu` against the funnel.
fn resolution(scenario: &Scenario, forecast: &Forecast) -> Finding {
    let end = scenario.time.end_s();
    let relative = |index: &usize| forecast.resolution(*index) / scenario.nodes[*index].funnel.width(end);
    let worst = (0..scenario.nodes.len()).max_by(|a, b| relative(a).total_cmp(&relative(b))).unwrap_or(0);
    let (step, width) = (forecast.resolution(worst), scenario.nodes[worst].funnel.width(end));
    let text = format!(
        "f32: |x| up to about {} floors the funnel at {} at node {}, where psi ends at {}",
        figure(forecast.largest_state),
        figure(step),
        worst + 1,
        figure(width)
    );
    let largest = forecast.largest_state;
    let values = json!({ "node": worst + 1, "resolution": step, "psi_end": width, "largest_state": largest });
    let mut found = finding("resolution", Status::Ok, text, values);
    if step >= width {
        found.status = Status::Warn;
        found.advice = Some(format!(
            "below that nu has no digits left, so the node keeps its funnel there and reports it; end the \
             run earlier, or let psi end at {}",
            figure(2.0 * step)
        ));
    }
    found
}

/// How far the rounding of `nu` was seen to move it, in units of the last place of the largest state.
const ROUNDING_ULPS: f64 = 5.0;
/// Points in time at which the margin is looked at.
const MARGIN_SAMPLES: u64 = 500;

/// The margin `1 - |s_i|` that the emergent dynamics leave while the funnel is at its floor, against the rounding of `nu`
/// there. `None` where no funnel reaches its floor.
fn margin(scenario: &Scenario, forecast: &Forecast) -> Option<Finding> {
    let mut xi = EmergentTrajectory::new(scenario)?;
    let (end, steps) = (scenario.time.end_s(), scenario.time.ticks.min(MARGIN_SAMPLES));
    let floored = |index: usize, t: f64| scenario.nodes[index].funnel.width(t) <= forecast.resolution(index);
    let mut tightest: Option<(f64, usize, f64, f64)> = None;
    for t in (0..=steps).map(|step| end * step as f64 / steps as f64) {
        let at_floor: Vec<_> = (0..scenario.nodes.len()).map(|index| floored(index, t)).collect();
        if !at_floor.contains(&true) {
            continue;
        }
        xi.advance(t);
        for (index, ratio) in xi.steady_ratios().enumerate().filter(|(index, _)| at_floor[*index]) {
            let needed = ROUNDING_ULPS / FLOOR_ULPS / scenario.nodes[index].funnel.factor();
            let margin = 1.0 - ratio.abs();
            if tightest.is_none_or(|(before, _, wanted, _)| margin / needed < before / wanted) {
                tightest = Some((margin, index, needed, t));
            }
        }
    }
    let (margin, index, needed, t) = tightest?;
    let text = format!(
        "Margin: at the floor of its funnel node {} settles {} inside it (t = {} s); rounding takes up to about {}",
        index + 1,
        share(margin),
        figure(t),
        share(needed)
    );
    let values = json!({ "node": index + 1, "margin": margin, "rounding": needed, "t": t });
    let mut found = finding("margin", Status::Ok, text, values);
    if margin < needed {
        found.status = Status::Warn;
        found.advice = Some(
            "|nu| may leave the floored funnel; raise the gain's scale, or let psi end above its floor"
                .to_owned(),
        );
    }
    Some(found)
}

fn share(part: f64) -> String {
    format!("{} %", figure(100.0 * part))
}

/// Delay of the bus against the tick.
fn bus(scenario: &Scenario) -> Option<Finding> {
    let bus = &scenario.bus;
    let delay = bus.latency_ns.saturating_add(bus.jitter_ns);
    if bus.loss == 0.0 && delay == 0 {
        return None;
    }
    let text = format!(
        "Bus: {} % of the frames lost per receiver, delay from {} to {}",
        figure(100.0 * bus.loss),
        format_duration(bus.latency_ns),
        format_duration(delay)
    );
    let (latency, jitter) = (bus.latency_ns as f64 * 1e-9, bus.jitter_ns as f64 * 1e-9);
    let values = json!({ "loss": bus.loss, "latency_s": latency, "jitter_s": jitter });
    let mut found = finding("bus", Status::Note, text, values);
    if delay >= scenario.time.tick_ns {
        found.status = Status::Warn;
        found.advice = Some(format!(
            "frames come a tick or more late, which a narrow funnel does not survive; keep the delay below the tick of {}",
            format_duration(scenario.time.tick_ns)
        ));
    }
    Some(found)
}

fn extremes(values: &[f64]) -> (f64, f64) {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    (low, values.iter().copied().fold(f64::NEG_INFINITY, f64::max))
}

/// Four significant digits.
fn figure(value: f64) -> String {
    crate::figure::figure(value, 4)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tick_ns = (self.tick_s * 1e9).round() as u64;
        writeln!(f, "{} ({})", self.scenario, self.path)?;
        writeln!(
            f,
            "{} nodes, {} edges, {} ticks of {}, seed {}",
            self.nodes,
            self.edges,
            self.ticks,
            format_duration(tick_ns),
            self.seed
        )?;
        for finding in &self.findings {
            let mark = match finding.status {
                Status::Ok => "ok  ",
                Status::Note => "note",
                Status::Warn => "WARN",
                Status::Fail => "FAIL",
            };
            write!(f, "\n  {mark}  {}", finding.text)?;
            if let Some(advice) = &finding.advice {
                write!(f, "\n        -> {advice}")?;
            }
        }
        let count = |status| self.findings.iter().filter(|finding| finding.status == status).count();
        let (warnings, failures) = (count(Status::Warn), count(Status::Fail));
        write!(f, "\n\n{} and {}", plural(warnings, "warning"), plural(failures, "failure"))
    }
}

fn plural(count: usize, word: &str) -> String {
    if count == 1 { format!("1 {word}") } else { format!("{count} {word}s") }
}

/// Whether the bus has a capacity that can be exceeded.
fn limited(model: BusModel) -> bool {
    model != BusModel::Ideal
}

#[cfg(test)]
mod tests;
