//! `sim-host check`: what can be said about a scenario without running it.
//!
//! The paper's assumptions and bounds (named in the README), the limits of the sampled law in f32 (law.md
//! section 4), what the emergent dynamics predict, what the sampled law itself does in f64, and whether that
//! is what the scenario expects.

mod actuators;
mod assumptions;
mod bounds;
mod bus;
mod bus_off;
mod capacity;
mod clocks;
mod cures;
mod events;
mod expectations;
mod followed;
mod forecast;
mod heard;
mod kick;
mod large;
mod limits;
mod longest;
mod lost;
mod nodes;
mod noise;
mod predictions;
mod premises;
mod resonance;
mod shorter;
mod silence;
mod start;
mod stops;
mod subject;
mod text;
mod widths;

use serde::Serialize;
use serde_json::Value;

use crate::bus::table::BusTable;
use crate::extremes::{beyond, extremes};
use crate::scenario::{LARGEST_RUN, Scenario, format_duration};
use forecast::Forecast;
use funnelnet_law::math;
use funnelnet_law::range::{LARGEST, SHORTEST_TICK_NS};
pub use large::check_large;
pub use nodes::NodeRow;
use subject::Subject;

/// Status of a finding.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Status {
    /// It holds.
    Ok,
    /// For information.
    Note,
    /// Nothing is known of it here.
    NotChecked,
    /// A breach is predicted, or a start, a loss, noise or rounding is past its limit.
    Warn,
    /// The scenario cannot do what it is meant to.
    Fail,
}

/// Advice: what to change.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Advice {
    /// Text for people.
    pub text: String,
    /// Setting for programs, where one would do.
    #[serde(flatten)]
    pub setting: Option<Setting>,
    /// Settings that have to be made with it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub also: Vec<Setting>,
}

impl Advice {
    fn new(text: String) -> Self {
        Self { text, setting: None, also: Vec::new() }
    }

    /// Every setting that it comes to, in the order in which they belong together.
    pub fn settings(&self) -> impl Iterator<Item = &Setting> {
        self.setting.iter().chain(&self.also)
    }
}

/// One value of a scenario, as `--set` takes it: `key=value`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Setting {
    /// `section.key`.
    pub key: String,
    /// TOML, or a bare string.
    pub value: String,
}

/// One thing that was checked.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    /// A stable name for machines.
    pub name: &'static str,
    /// Name of what was checked, for people.
    pub title: &'static str,
    /// Status.
    pub status: Status,
    /// Finding in words, for people.
    pub text: String,
    /// Advice, where something is to be changed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub advice: Option<Advice>,
    /// The figures, in SI units.
    pub values: Value,
}

impl Finding {
    fn new(name: &'static str, title: &'static str, text: String, values: Value) -> Self {
        Self { name, title, status: Status::Ok, text, advice: None, values }
    }

    /// The same, standing otherwise.
    fn stands(self, status: Status) -> Self {
        Self { status, ..self }
    }

    /// The same, standing otherwise, with what to change.
    fn advise(self, status: Status, advice: String) -> Self {
        Self { status, advice: Some(Advice::new(advice)), ..self }
    }

    /// The same, with the setting that its advice comes to.
    fn set(self, key: impl Into<String>, value: impl Into<String>) -> Self {
        let setting = Some(Setting { key: key.into(), value: value.into() });
        Self { advice: self.advice.map(|advice| Advice { setting, ..advice }), ..self }
    }
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
    /// The figures of every node, by index.
    pub per_node: Vec<NodeRow>,
    /// Whether no finding failed; warnings do not count.
    pub pass: bool,
    /// The bus as it is computed, for the text; the finding `bus` has it, too.
    #[serde(skip)]
    pub bus: Option<BusTable>,
}

impl Report {
    /// Number of findings with this status.
    #[must_use]
    pub fn count(&self, status: Status) -> usize {
        self.findings.iter().filter(|finding| finding.status == status).count()
    }
}

/// Checks a scenario. It has been validated, so the graph is connected and every node starts inside its
/// funnel.
#[must_use]
pub fn check(scenario: &Scenario) -> Report {
    let subject = Subject::of(scenario);
    let mut findings = assumptions::findings(&subject);
    findings.extend(start::findings(&subject));
    findings.extend(kick::finding(&subject));
    match &subject.forecast {
        Some(forecast) => {
            findings.extend(limits::findings(&subject, forecast));
            findings.extend(predictions::findings(&subject, forecast));
            findings.extend(resonance::finding(&subject, forecast));
            if !forecast.grid.reaches(scenario) {
                findings.iter_mut().for_each(|finding| partial(finding, forecast));
            }
        }
        None => findings.extend([limits::speed(&subject), predictions::none_here(&subject)]),
    }
    findings.push(followed::finding(&subject));
    findings.extend(actuators::finding(&subject));
    findings.extend(noise::finding(&subject));
    findings.extend(bus::findings(&subject));
    findings.extend(bus_off::finding(scenario));
    findings.extend(clocks::finding(scenario));
    findings.extend(lost::findings(scenario));
    findings.extend(bounds::finding(&subject));
    findings.extend(heard::finding(&subject));
    findings.extend(expectations::findings(&subject));
    cures::take_back(scenario, &mut findings);
    cures::settle(&subject, &mut findings);
    premises::lower(&subject, &mut findings);
    findings.extend(events::finding(scenario));
    events::unsettle(scenario, &mut findings);
    findings.push(capacity::finding(scenario));
    findings.extend(size(scenario));
    findings.extend(time_masters(scenario));
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
        per_node: nodes::rows(&subject),
        bus: bus::table(scenario),
    }
}

/// Part of the narrowest funnel that one exchange per tick takes, by the formula: `narrowest` over `psi_min`
/// of the finding `narrowest-funnel`. `None` where the motion is not predicted. For who asks of thousands of
/// scenarios: the law itself is not followed.
#[must_use]
pub fn taken_of_narrowest(scenario: &Scenario) -> Option<f64> {
    let subject = Subject::by_formula(scenario);
    subject.forecast.as_ref().map(|forecast| limits::taken_of_narrowest(&subject, forecast))
}

/// Findings that rest on the motion that is predicted.
const ALONG_XI: [&str; 7] =
    ["fields", "emergent", "narrowest-funnel", "resolution", "margin", "input", "linear-part"];

/// What holds along a part of the run is not found to hold.
fn partial(finding: &mut Finding, forecast: &Forecast) {
    if finding.status == Status::Ok && ALONG_XI.contains(&finding.name) {
        finding.status = Status::Note;
        let text = format!("looked at up to {} s only", figure(forecast.grid.end()));
        finding.advice = Some(Advice::new(text));
    }
}

/// A scenario that can be checked, but not run.
fn size(scenario: &Scenario) -> Option<Finding> {
    let nodes = scenario.nodes.len();
    let text = format!(
        "{nodes} nodes can be checked, not run: an id is 7 bits on the wire and 0 means all, which leaves {LARGEST_RUN}"
    );
    let values = serde_json::json!({ "nodes": nodes, "largest_run": LARGEST_RUN });
    (nodes > LARGEST_RUN).then(|| Finding::new("size", "Size", text, values).stands(Status::Note))
}

/// A scenario that can be checked, and run on a bench alone.
fn time_masters(scenario: &Scenario) -> Option<Finding> {
    let text = "[sync] on this bus is only for a bench with clock = \"own\": run refuses it, and here clocks are taken to be right".to_owned();
    let masters = &scenario.sync.as_ref().filter(|_| !scenario.bus.model.is_can())?.masters;
    let values = serde_json::json!({ "masters": masters });
    Some(Finding::new("time-masters", "Time masters", text, values).stands(Status::Note))
}

/// Index and value of the largest, or of the first that is not a number; index 0 where there is none.
fn largest(values: impl IntoIterator<Item = f64>) -> (usize, f64) {
    let first = (0, f64::NEG_INFINITY);
    values.into_iter().enumerate().fold(
        first,
        |best, (index, value)| {
            if beyond(value, best.1) { (index, value) } else { best }
        },
    )
}

/// Four significant digits.
fn figure(value: f64) -> String {
    crate::number_format::significant(value, 4)
}

/// Two significant digits, for what is only known to about.
fn about(value: f64) -> String {
    crate::number_format::significant(value, 2)
}

/// `low to high`, or the one value that both are.
fn range(low: f64, high: f64) -> String {
    let (low, high) = (figure(low), figure(high));
    if low == high { low } else { format!("{low} to {high}") }
}

/// The tick of so many seconds as a scenario has it, with two digits and not longer; none where no node takes
/// one that short.
fn tick_of(seconds: f64) -> Option<String> {
    let ns = tick_ns_of(seconds);
    (seconds.is_finite() && ns >= u64::from(SHORTEST_TICK_NS)).then(|| format_duration(ns))
}

/// A width, or the parameter of a gain, as advice names it; none where no node takes it.
fn width_of(width: f64) -> Option<String> {
    (width > 0.0 && width <= LARGEST).then(|| about(width))
}

/// The same in ns.
fn tick_ns_of(seconds: f64) -> u64 {
    let ns = seconds * 1e9;
    let unit = math::exp10((math::log10(ns).floor() - 1.0).max(0.0));
    ((ns / unit).floor() * unit).max(1.0) as u64
}

fn share(part: f64) -> String {
    format!("{} %", about(100.0 * part))
}

#[cfg(test)]
mod tests;
