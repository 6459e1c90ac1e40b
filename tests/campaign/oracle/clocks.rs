//! Clocks that a time master keeps are together.

use super::Broken;
use sim_host::engine::Skew;
use sim_host::scenario::{EventKind, EventSpec, Scenario};

/// What a stamp and the way of a SYNC may cost, ns.
const ROOM_NS: f64 = 20_000.0;
/// The same where nothing keeps SYNC away: so many bits, by which controllers stamp.
const QUIET_ROOM_BITS: f64 = 5.0;
/// Periods of SYNC for which clocks may run apart, in the same two cases.
const QUIET_PERIODS: u64 = 1;
const PERIODS: u64 = 8;

/// Gives whether they could be judged: a time master is there all the time, no SYNC is lost, and no clock jumps.
pub(super) fn together(scenario: &Scenario, skew: Option<Skew>) -> Result<bool, Broken> {
    let (Some(sync), Some(skew)) = (&scenario.sync, skew) else { return Ok(false) };
    let jumps = scenario.events.iter().any(|event| event.kind == EventKind::Clock)
        || scenario.clocks.iter().any(|clock| clock.offset_ns != 0 || !clock.jumps.is_empty());
    if jumps || !scenario.bus.loss.is_none() || !always_led(scenario) {
        return Ok(false);
    }
    // Ten standard deviations of what a rate wanders in the run.
    let wander = |ppb: u64| 10.0 * ppb as f64 * scenario.time.end_s().sqrt();
    let rates =
        scenario.clocks.iter().map(|clock| clock.drift_ppb.unsigned_abs() as f64 + wander(clock.wander_ppb));
    let fastest = rates.fold(0.0, f64::max) * 1e-9;
    let kept_away_ns = scenario.events.iter().map(darkness).sum::<u64>();
    // Another one leads within three periods of silence, and each that has come learns a rate in two.
    let bit_ns = 1e9 / f64::from(scenario.bus.bitrate);
    let (periods, room) = match kept_away_ns == 0 && scenario.course().absences(&scenario.time).is_empty() {
        true => (QUIET_PERIODS, QUIET_ROOM_BITS * bit_ns),
        false => (PERIODS, ROOM_NS),
    };
    let dark_ns = periods * sync.period_ns + kept_away_ns;
    if skew.worst_ns as f64 > 2.0 * fastest * dark_ns as f64 + room {
        return Err(Broken::Apart(skew.worst_ns));
    }
    Ok(true)
}

/// For how long an event may keep SYNC away, ns.
fn darkness(event: &EventSpec) -> u64 {
    match event.kind {
        EventKind::SyncLoss | EventKind::Noise | EventKind::Cut | EventKind::Short | EventKind::Babble => {
            event.lasts_ns
        }
        _ => 0,
    }
}

/// Whether one of the time masters is on at all times: those that come back when none is have a time of their own.
fn always_led(scenario: &Scenario) -> bool {
    let absences = scenario.course().absences(&scenario.time);
    let masters = || scenario.sync.iter().flat_map(|sync| &sync.masters);
    // One that comes back while nothing passes the bus hears nobody, and leads by a time of its own (book: faults).
    let comes_back = |&id: &u16| absences.iter().any(|absence| absence.node + 1 == usize::from(id));
    if masters().any(comes_back) && scenario.events.iter().any(|event| darkness(event) > 0) {
        return false;
    }
    masters().any(|&id| !absences.iter().any(|absence| absence.node + 1 == usize::from(id)))
}
