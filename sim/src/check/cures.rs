//! Cures, tried before they are advised: the scenario is read again with the setting in it, and the law
//! followed.
//!
//! A longer round, more damping or a shorter tick help on paper. Whether they do here only the law says: at
//! 40 % loss more damping is worse than none on a star, and rounds that are long enough for every frame may
//! be too long for the funnel.

use super::subject::Subject;
use super::{Advice, Finding, Setting, Status, figure};
use crate::extremes::{larger, largest};
use crate::sampled::{self, Followed, hears_perfectly};
use crate::scenario::{Override, Scenario, format_duration};
use funnelnet_node::params::{LONGEST_ROUND, SHORTEST_TICK_NS};

/// Parts into which a tick is cut, in the order in which they are tried.
const PARTS: [u64; 10] = [2, 4, 5, 8, 10, 20, 25, 40, 50, 100];
/// How much wider a funnel is tried to be.
const WIDER: [f64; 12] = [1.25, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0];
/// Dampings that are tried where frames get lost.
const DAMPINGS: [f64; 4] = [3.0, 4.0, 6.0, 8.0];
/// A slow start, and the guard beside it, by which no random network left its funnel at the start (law.md 7).
const SLOW_START_NS: u64 = 10_000_000;
const SLOW_GUARD: f64 = 0.1;
/// A ratio that is so much lower than before counts as better.
const BETTER: f64 = 0.9;

/// Settings that keep every node inside its funnel, as the law says that was followed with them.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Cure {
    pub settings: Vec<Setting>,
    /// Up to when it was followed, s.
    pub until: f64,
}

impl Cure {
    /// What to set, for people.
    pub fn text(&self) -> String {
        let said: Vec<_> = self.settings.iter().map(Setting::said).collect();
        format!("with {} the law stays inside ({} s were followed)", said.join(" and "), figure(self.until))
    }
}

/// What a trial showed.
enum Shown {
    /// Every node stays inside.
    Keeps,
    /// The largest ratio is lower than before, and still not below 1.
    Helps(f64),
    /// It is not.
    Useless(f64),
    /// A scenario does not take it.
    Refused,
}

impl Setting {
    fn new(key: &str, value: String) -> Self {
        Self { key: key.to_owned(), value }
    }

    fn said(&self) -> String {
        format!("{} = {}", self.key, self.value)
    }
}

/// The scenario with other values in it, where it takes them.
fn with(scenario: &Scenario, settings: &[Setting]) -> Option<Scenario> {
    let overrides: Option<Vec<_>> =
        settings.iter().map(|set| Override::parse(&format!("{}={}", set.key, set.value)).ok()).collect();
    Scenario::parse(&scenario.as_run, &scenario.path, &overrides?).ok()
}

/// The first of what may cure a breach that does; none where nothing that was tried does.
pub(super) fn search(subject: &Subject<'_>) -> Option<Cure> {
    let left = subject.followed.as_ref().and_then(|followed| followed.left).unwrap_or(0.0);
    candidates(subject).into_iter().find_map(|settings| {
        let scenario = with(subject.scenario, &settings)?;
        let followed = sampled::follow_to_breach(&scenario, &subject.degrees)?;
        let keeps = stays(subject, &followed) && (followed.whole || followed.until > left);
        keeps.then_some(Cure { settings, until: followed.until })
    })
}

fn stays(subject: &Subject<'_>, followed: &Followed) -> bool {
    followed.lost.is_none()
        && followed.floored.is_none()
        && followed.worst.ratio < 1.0
        && followed.start.ratio < subject.calm_start()
}

/// What is tried, the least costly first.
fn candidates(subject: &Subject<'_>) -> Vec<Vec<Setting>> {
    let scenario = subject.scenario;
    let mut list = unclipped(subject);
    list.extend(slowly_started(subject));
    list.extend(damped(scenario).map(|set| vec![set]));
    list.extend(in_rounds(scenario));
    list.extend(shorter(scenario));
    list.extend(wider(scenario));
    list.extend(together(scenario));
    list
}

/// A bound on inputs that clips nothing.
fn unclipped(subject: &Subject<'_>) -> Vec<Vec<Setting>> {
    let needed = subject.scenario.u_max.and_then(|given| {
        let asked = sampled::undisturbed(subject.scenario)?.input;
        (given < asked).then(|| Setting::new("coupling.u_max", figure(12.0 * asked)))
    });
    needed.map(|set| vec![set]).into_iter().collect()
}

/// A slow start, where the start alone throws a node out: it costs some real time once, and nothing later
/// (law.md 7).
fn slowly_started(subject: &Subject<'_>) -> Vec<Vec<Setting>> {
    let time = subject.scenario.time;
    let is_the_start = |followed: &Followed| match followed.left {
        Some(t) => t <= sampled::START,
        // It has come close to it, and nowhere else.
        None => followed.start.ratio >= subject.calm_start(),
    };
    if !time.start.is_none() || !subject.followed.as_ref().is_some_and(is_the_start) {
        return Vec::new();
    }
    let start_ns = SLOW_START_NS.next_multiple_of(time.tick_ns);
    let slowly = Setting::new("time.slow_start", format_duration(start_ns));
    let guarded =
        (subject.scenario.guard == 0.0).then(|| Setting::new("coupling.guard", format!("{SLOW_GUARD:?}")));
    let with_guard = guarded.map(|guard| vec![slowly.clone(), guard]);
    [vec![slowly]].into_iter().chain(with_guard).collect()
}

/// More damping, for a bus that loses frames.
fn damped(scenario: &Scenario) -> impl Iterator<Item = Setting> {
    let now = largest(0.0, scenario.nodes.iter().map(|node| node.damping));
    let lossy = !scenario.bus.loss.is_none();
    let more = DAMPINGS.into_iter().filter(move |damping| lossy && *damping > now);
    more.map(|damping| Setting::new("coupling.damping", format!("{damping:?}")))
}

/// Rounds by which every frame has come, of shorter ticks as well, and with more damping where frames get
/// lost too.
fn in_rounds(scenario: &Scenario) -> Vec<Vec<Setting>> {
    let (bus, time) = (&scenario.bus, scenario.time);
    let delay = bus.latency_ns.saturating_add(bus.jitter_ns);
    if delay < time.tick_ns {
        return Vec::new();
    }
    let (step, run) = (time.tick_ns / u64::from(time.round), time.ticks.saturating_mul(time.tick_ns));
    let mut list = Vec::new();
    for parts in [1, 2, 4, 5, 10] {
        let tick = step / parts;
        if !step.is_multiple_of(parts) || tick < u64::from(SHORTEST_TICK_NS) {
            continue;
        }
        let whole = |steps: &u64| run.is_multiple_of(steps * tick);
        let Some(steps) = (delay / tick + 1..=u64::from(LONGEST_ROUND)).find(whole) else { continue };
        let mut settings = vec![Setting::new("time.round", format_duration(steps * tick))];
        if parts > 1 {
            settings.push(Setting::new("time.tick", format_duration(tick)));
        }
        let more = damped(scenario).map(|set| [settings.as_slice(), &[set]].concat());
        let more: Vec<_> = more.collect();
        list.push(settings);
        list.extend(more);
    }
    list
}

/// Shorter ticks, where a frame still comes within one.
fn shorter(scenario: &Scenario) -> impl Iterator<Item = Vec<Setting>> {
    let (bus, time) = (&scenario.bus, scenario.time);
    let delay = bus.latency_ns.saturating_add(bus.jitter_ns);
    let ticks = PARTS.into_iter().filter(move |parts| time.round == 1 && time.tick_ns.is_multiple_of(*parts));
    let ticks = ticks.map(move |parts| time.tick_ns / parts);
    let ticks = ticks.filter(move |&tick| tick >= u64::from(SHORTEST_TICK_NS) && delay < tick);
    ticks.map(|tick| vec![Setting::new("time.tick", format_duration(tick))])
}

/// A wider funnel for all, where one number is that of all.
fn wider(scenario: &Scenario) -> Vec<Vec<Setting>> {
    let factor = scenario.nodes.first().map_or(1.0, |node| node.funnel.factor);
    let alike = scenario.nodes.iter().all(|node| node.funnel.factor.total_cmp(&factor).is_eq());
    let times = WIDER.into_iter().filter(|_| alike);
    times.map(|times| vec![Setting::new("coupling.funnel.factor", figure(factor * times))]).collect()
}

/// Several of these at once, where inputs are so large that a node settles at the very edge: with a gain that
/// is less steep there.
fn together(scenario: &Scenario) -> Vec<Vec<Setting>> {
    let scale = scenario.nodes.first().and_then(|node| {
        let (parameter, value) = node.gain.parameters().next()?;
        (parameter.name == "scale").then_some(value)
    });
    let alike = scenario.nodes.windows(2).all(|pair| pair[0].gain == pair[1].gain);
    let less_steep = |times: f64| {
        let value = scale.filter(|_| alike)?;
        Some(Setting::new("coupling.gain.scale", figure(value * times)))
    };
    let ticks: Vec<_> = shorter(scenario).collect();
    // A quarter, a tenth, and a fiftieth.
    let ticks = [1, 4, 8].into_iter().filter_map(|index| ticks.get(index));
    let ticks: Vec<Vec<Setting>> = std::iter::once(Vec::new()).chain(ticks.cloned()).collect();
    let wider = wider(scenario);
    // Twice, ten, and a hundred times as wide.
    let wider = [2, 5, 8].into_iter().filter_map(|index| wider.get(index));
    let wider: Vec<Vec<Setting>> = std::iter::once(Vec::new()).chain(wider.cloned()).collect();
    let gains = [1.0, 5.0, 30.0];
    let mut list = Vec::new();
    for times in gains {
        for width in &wider {
            for tick in &ticks {
                let gain = if times > 1.0 { less_steep(times).into_iter().collect() } else { Vec::new() };
                let settings = [width.as_slice(), tick, &gain].concat();
                // One alone was tried before, but for a gain.
                if settings.len() > 1 || !gain.is_empty() {
                    list.push(settings);
                }
            }
        }
    }
    list
}

/// Takes settings back that a scenario does not take, whatever finding has them.
pub(super) fn take_back(scenario: &Scenario, findings: &mut [Finding]) {
    for advice in findings.iter_mut().filter_map(|finding| finding.advice.as_mut()) {
        let settings: Vec<_> = advice.settings().cloned().collect();
        if !settings.is_empty() && with(scenario, &settings).is_none() {
            (advice.setting, advice.also) = (None, Vec::new());
        }
    }
}

/// Tries what the findings advise. Advice that does not help is taken back, and what does is put in its
/// place, where anything does.
pub(super) fn settle(subject: &Subject<'_>, findings: &mut [Finding]) {
    let is_open = |finding: &&mut Finding| {
        matches!(finding.status, Status::Warn | Status::Fail)
            && !SETTLED.contains(&finding.name)
            && finding.advice.as_ref().is_some_and(|advice| advice.setting.is_some())
    };
    for finding in findings.iter_mut().filter(is_open) {
        let Some(advice) = finding.advice.take() else { continue };
        finding.advice = Some(match &subject.followed {
            Some(now) => tried(subject, now, advice),
            None => Advice {
                text: format!("{} (not tried: the law is not followed here)", advice.text),
                ..advice
            },
        });
    }
}

/// Findings whose advice was found by following the law, or is about what is not followed: who stops.
const SETTLED: [&str; 3] = ["sampled", "lost-neighbours", "lost-sync"];

fn tried(subject: &Subject<'_>, now: &Followed, advice: Advice) -> Advice {
    let Some(setting) = advice.setting.clone() else { return advice };
    match show(subject, now, std::slice::from_ref(&setting)) {
        Shown::Keeps => Advice {
            text: format!("{} (tried: the law, followed with it, stays inside)", advice.text),
            ..advice
        },
        Shown::Helps(ratio) => {
            let text = format!("{} (tried: |nu|/psi is still {})", advice.text, figure(ratio));
            instead(subject, Advice { text, ..advice })
        }
        Shown::Useless(ratio) => {
            let then = if ratio.is_finite() { figure(ratio) } else { "without bound".to_owned() };
            let why = advice.text.split(';').next().unwrap_or_default();
            let text = format!(
                "{why}; {} was tried and does not help: |nu|/psi is {then} with it, {} without",
                setting.said(),
                figure(now.worst.ratio)
            );
            instead(subject, Advice { text, setting: None, also: Vec::new() })
        }
        Shown::Refused => instead(subject, Advice { setting: None, ..advice }),
    }
}

/// With the cure that was found, or saying that none was.
fn instead(subject: &Subject<'_>, advice: Advice) -> Advice {
    match subject.cure() {
        Some(cure) => advice.with(cure),
        None => {
            Advice { text: format!("{}; nothing that was tried keeps the funnel", advice.text), ..advice }
        }
    }
}

impl Advice {
    /// The same with a cure that was tried.
    pub(super) fn with(self, cure: &Cure) -> Self {
        let text = format!("{}; {}", self.text, cure.text());
        let mut settings = cure.settings.iter().cloned();
        Self { text, setting: settings.next(), also: settings.collect() }
    }
}

fn show(subject: &Subject<'_>, now: &Followed, settings: &[Setting]) -> Shown {
    let Some(scenario) = with(subject.scenario, settings) else { return Shown::Refused };
    let Some(then) = sampled::follow(&scenario, &subject.degrees) else { return Shown::Refused };
    let of = |followed: &Followed| match followed.lost {
        Some(_) => f64::INFINITY,
        None => followed.worst.ratio,
    };
    // A shorter tick is followed for less time, and must not seem better for that.
    let far = larger(now.left.unwrap_or(0.0), now.worst.t);
    let compared = then.whole || then.until >= far;
    match (of(now), of(&then)) {
        (_, ratio) if ratio < 1.0 && compared => Shown::Keeps,
        (before, ratio) if ratio < BETTER * before && compared => Shown::Helps(ratio),
        (_, ratio) => Shown::Useless(ratio),
    }
}

/// Why the law leaves its funnel, where that is known without a trial.
pub(super) fn cause(subject: &Subject<'_>, followed: &Followed) -> &'static str {
    match followed.left {
        Some(t) if t <= sampled::START && hears_perfectly(subject.scenario) => {
            " at the start, which is the cause: a slow start, a shorter tick or a wider funnel at the beginning, not later"
        }
        _ => "",
    }
}
