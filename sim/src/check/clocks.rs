//! Clocks of nodes: how far they come apart, with SYNC and without, and what breaks then.

use serde_json::json;

use super::{Finding, Status, about, bus, figure};
use crate::engine::clock::Clock;
use crate::extremes::{larger, smaller};
use crate::scenario::{Scenario, SyncSpec, format_duration};
use funnelnet_node::neighbour::WINDOW_AHEAD;
use funnelnet_node::time::largest_jitter;

/// The largest rate that a node learns, and the steepest slew, s per s: 200 ppm (map.rs of the node).
const LEARNT: f64 = 200e-6;
/// A change within a step that is so much larger is a jump, of which no rate is learnt.
const JUMP: f64 = 10.0;
/// Steps that are looked at, at most.
const MOST_STEPS: u64 = 20_000;

/// Time from one SYNC to the next, ns: whole ticks, as a master sends them.
pub(super) fn period_ns(scenario: &Scenario, sync: &SyncSpec) -> u64 {
    let tick_ns = scenario.time.tick_ns;
    (sync.period_ns / tick_ns).max(1) * tick_ns
}

/// What there is to say; nothing where all nodes have one clock, and on a bus where runs have but one.
pub(super) fn finding(scenario: &Scenario) -> Option<Finding> {
    if !scenario.bus.model.is_can()
        || scenario.clocks.is_empty()
        || scenario.clocks.len() < scenario.nodes.len()
    {
        return None;
    }
    let apart = Apart::over(scenario);
    let Seen { by, at, ahead, behind } = apart.most;
    let kept = match &scenario.sync {
        Some(sync) => {
            format!("SYNC every {} keeps them together", format_duration(period_ns(scenario, sync)))
        }
        None => "nothing keeps them together".to_owned(),
    };
    let how_far = match by > 0.0 {
        true => format!(": nodes {ahead} and {behind} are {} s apart at {} s", about(by), figure(at)),
        false => String::new(),
    };
    let text = format!("{kept}{how_far}. All else here takes clocks to be right");
    let from = |seen: &Option<Seen>| seen.as_ref().map(|seen| seen.at);
    let values = json!({
        "skew_s": by, "t": at, "late_from_s": from(&apart.late), "deaf_from_s": from(&apart.deaf),
        "fastest_ppm": apart.fastest.by * 1e6, "lost_from_s": from(&apart.lost),
    });
    Some(judge(Finding::new("clocks", "Clocks", text, values), scenario, &apart))
}

fn judge(found: Finding, scenario: &Scenario, apart: &Apart) -> Finding {
    let is_kept = scenario.sync.is_some();
    let cure = if is_kept { "" } else { "; let a time master keep them ([sync]), or let the run be shorter" };
    if let Some(Seen { by, at, ahead: node, .. }) = apart.lost {
        let advice = format!(
            "node {node} and its time master come apart by {} s at once, at {} s; that is too far for SYNC: the node follows none from then on",
            about(by),
            figure(at)
        );
        return found.advise(Status::Warn, advice);
    }
    if let Some(Seen { at, ahead, behind, .. }) = apart.deaf {
        let advice = format!(
            "from {} s on node {ahead} is more than {WINDOW_AHEAD} ticks ahead of node {behind}, which takes no state of it then{cure}",
            figure(at)
        );
        // What a time master keeps comes together again.
        return found.advise(if is_kept { Status::Warn } else { Status::Fail }, advice);
    }
    if let Some(Seen { at, ahead, behind, .. }) = apart.late {
        let advice = format!(
            "from {} s on states of node {behind} come a tick late at node {ahead}, which extrapolates them{cure}",
            figure(at)
        );
        return found.advise(Status::Warn, advice);
    }
    let Seen { by, ahead: node, .. } = apart.fastest;
    if by > LEARNT {
        let advice = format!(
            "the clock of node {node} is {} ppm away from that of the time master; a node learns {} ppm at most, and stays away by what is left",
            about(by * 1e6),
            figure(LEARNT * 1e6)
        );
        return found.advise(Status::Note, advice);
    }
    found
}

/// How far two clocks are apart, s, or how much faster one is, s per s; when, s; ids of the nodes.
#[derive(Clone, Copy, Default)]
struct Seen {
    by: f64,
    at: f64,
    ahead: usize,
    behind: usize,
}

/// What happens in a run, each for the first time but for the largest.
#[derive(Default)]
struct Apart {
    /// The farthest that any two clocks are apart.
    most: Seen,
    /// A state of a neighbour comes a tick late.
    late: Option<Seen>,
    /// A neighbour is too far ahead.
    deaf: Option<Seen>,
    /// A jump that is too large to be made up for.
    lost: Option<Seen>,
    /// The largest rate against that of the time master.
    fastest: Seen,
}

impl Apart {
    /// Goes through the run, from one SYNC to the next, or in short parts of it.
    fn over(scenario: &Scenario) -> Self {
        let end_ns = scenario.time.ticks.saturating_mul(scenario.time.tick_ns);
        let period_ns = scenario.sync.as_ref().map_or(1, |sync| period_ns(scenario, sync));
        let steps = (end_ns / period_ns).clamp(1, MOST_STEPS);
        let step_ns = end_ns / steps;
        let mut course = Course::new(scenario, step_ns);
        // Nodes that tick at other times wait for each other now and then only.
        let frame = bus::frame_ns(scenario) as f64;
        let mut apart = Self::default();
        for n in 1..=steps {
            course.advance(n * step_ns, &mut apart);
            apart.see(scenario, &course.ahead, (n * step_ns) as f64 * 1e-9, frame);
        }
        apart
    }

    /// Looks at what clocks are ahead by (ns) at `at` (s), where states are on their way for `frame` (ns).
    fn see(&mut self, scenario: &Scenario, ahead: &[f64], at: f64, frame: f64) {
        let tick = scenario.time.tick_ns as f64;
        for edge in &scenario.graph.edges {
            let by = ahead[edge.a] - ahead[edge.b];
            let (first, second) = if by > 0.0 { (edge.a, edge.b) } else { (edge.b, edge.a) };
            let seen = Some(Seen { by: by.abs() * 1e-9, at, ahead: first + 1, behind: second + 1 });
            self.late = self.late.or(seen.filter(|_| by.abs() >= tick - frame));
            self.deaf = self.deaf.or(seen.filter(|_| by.abs() > f64::from(WINDOW_AHEAD) * tick + frame));
        }
        let extreme = |pick: fn(f64, f64) -> f64, from: f64| ahead.iter().copied().fold(from, pick);
        let (low, high) = (extreme(smaller, f64::INFINITY), extreme(larger, f64::NEG_INFINITY));
        let by = (high - low) * 1e-9;
        if by > self.most.by {
            let id = |of: f64| {
                ahead.iter().position(|ahead| ahead.total_cmp(&of).is_eq()).map_or(0, |index| index + 1)
            };
            self.most = Seen { by, at, ahead: id(high), behind: id(low) };
        }
    }
}

/// Clocks on their way.
struct Course {
    clocks: Vec<Clock>,
    /// What each shows, ns.
    shown: Vec<u64>,
    /// By how much what each node takes for the time of the network is ahead, ns.
    ahead: Vec<f64>,
    /// Whether it follows the time master.
    follows: Vec<bool>,
    master: Option<usize>,
    /// A step, what a node learns of a rate in it, and what it no longer makes up for, ns.
    step: f64,
    learnt: f64,
    limit: f64,
}

impl Course {
    fn new(scenario: &Scenario, step_ns: u64) -> Self {
        let sync = scenario.sync.as_ref();
        let master =
            sync.and_then(|sync| sync.masters.iter().min()).map(|&id| usize::from(id).saturating_sub(1));
        let clock = |(index, spec)| Clock::new(spec, scenario.seed, index);
        let count = scenario.clocks.len();
        let shortest = sync.map_or(0, |sync| largest_jitter(sync.period_ns, scenario.time.tick_ns));
        Self {
            clocks: scenario.clocks.iter().enumerate().map(clock).collect(),
            shown: vec![0; count],
            // With SYNC it is stepped over when the first two have come.
            ahead: scenario
                .clocks
                .iter()
                .map(|spec| if sync.is_some() { 0.0 } else { spec.offset_ns as f64 })
                .collect(),
            follows: (0..count).map(|index| master.is_some_and(|master| master != index)).collect(),
            master,
            step: step_ns as f64,
            learnt: LEARNT * step_ns as f64,
            // Two SYNC that are so far apart might be taken for each other (keeper.rs of the node).
            limit: 2.0 * shortest as f64,
        }
    }

    /// Goes on to `to_ns`, and notes what SYNC cannot make up for.
    fn advance(&mut self, to_ns: u64, apart: &mut Apart) {
        let passed = |(clock, shown): (&mut Clock, &mut u64)| {
            let now = clock.shows(to_ns);
            now as f64 - std::mem::replace(shown, now) as f64
        };
        let passed: Vec<f64> = self.clocks.iter_mut().zip(&mut self.shown).map(passed).collect();
        let right = self.master.and_then(|master| passed.get(master)).copied().unwrap_or(self.step);
        let at = to_ns as f64 * 1e-9;
        for (index, passed) in passed.into_iter().enumerate() {
            let faster = passed - right;
            self.ahead[index] += faster;
            if !self.follows[index] {
                continue;
            }
            let seen = |by: f64| Seen { by, at, ahead: index + 1, behind: index + 1 };
            if faster.abs() >= self.limit {
                self.follows[index] = false;
                apart.lost = apart.lost.or(Some(seen(faster.abs() * 1e-9)));
                continue;
            }
            let rate = if faster.abs() > JUMP * self.learnt { 0.0 } else { faster };
            if rate.abs() > apart.fastest.by * self.step {
                apart.fastest = seen(rate.abs() / self.step);
            }
            self.ahead[index] -= rate.clamp(-self.learnt, self.learnt);
            self.ahead[index] -= self.ahead[index].clamp(-self.learnt, self.learnt);
        }
    }
}
