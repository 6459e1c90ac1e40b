//! The longest tick that keeps a scenario inside its funnels, found by following the law at one tick after
//! the other.
//!
//! The formula for the excess (law.md 2, theorem 2) is first order in a narrow funnel. In a wide one it names
//! ticks that are far too long.

use super::subject::Subject;
use crate::extremes::{larger, smaller};
use crate::sampled;
use crate::scenario::{Scenario, TimeSpec};
use funnelnet_law::start::SlowStart;

/// From one tick to the next.
const STEP: f64 = 1.2;
/// The most ticks that are tried.
const MOST: usize = 40;
/// Halvings of the last step.
const HALVINGS: usize = 4;
/// A tick that is so many times shorter than the formula names is surely none that leaves a funnel.
const FAR: f64 = 8.0;
/// Hundredths of the work of a run that one tick may take.
const SHARE: usize = 12;

/// It, in s; none where that is not followed here. `estimate` is what the formula says, `most` what is not
/// asked for, s.
pub(super) fn by_law(subject: &Subject<'_>, estimate: f64, most: f64) -> Option<f64> {
    let scenario = subject.scenario;
    let now = scenario.time.tick_s();
    subject.followed.as_ref()?;
    if scenario.time.round > 1
        || !scenario.time.start.is_none()
        || !sampled::hears_perfectly(scenario)
        || !scenario.events.is_empty()
    {
        return None;
    }
    // Upwards from where the law surely keeps its funnels: the first tick that does not is the end, whatever
    // longer ones do.
    let mut low = if subject.keeps() { larger(now, estimate / FAR) } else { smaller(now, estimate) / 2.0 };
    let mut tries = 0;
    while !keeps(subject, low)? {
        (low, tries) = (low / 2.0, tries + 1);
        if tries > HALVINGS {
            return None;
        }
    }
    for _ in 0..MOST {
        let high = low * STEP;
        if high > most {
            return Some(low);
        }
        if !keeps(subject, high)? {
            return halved(subject, low, high);
        }
        low = high;
    }
    Some(low)
}

fn halved(subject: &Subject<'_>, mut low: f64, mut high: f64) -> Option<f64> {
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if keeps(subject, middle)? { low = middle } else { high = middle }
    }
    Some(low)
}

/// Whether the law keeps its funnels at a tick (s); none where following that is not cheap.
fn keeps(subject: &Subject<'_>, tick: f64) -> Option<bool> {
    let tick_ns = (tick * 1e9) as u64;
    let ticks = ((subject.scenario.time.end_s() * 1e9) as u64).checked_div(tick_ns)?.max(1);
    let time = TimeSpec { tick_ns, ticks, round: 1, start: SlowStart::default() };
    // Its windows count ticks of the scenario's.
    let mut scenario = Scenario { time, ..subject.scenario.clone() };
    scenario.expect.windows.clear();
    if !sampled::is_cheap(&scenario, SHARE) {
        return None;
    }
    let followed = sampled::follow_to_breach(&scenario, &subject.degrees)?;
    Some(followed.lost.is_none() && followed.worst.ratio < 1.0)
}
