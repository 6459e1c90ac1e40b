//! What stops healthy nodes: neighbours, or SYNC, that lost frames keep silent for too long.

use serde_json::json;

use super::silence::{Rate, Receiver, sync_losses};
use super::stops::Share;
use super::text::plural;
use super::{Finding, Status};
use crate::sampled::Bounds;
use crate::scenario::{Loss, Scenario, format_duration};

/// SYNC in a row that are missed, at least where one that is lost shall stop nobody: it is not there, and the next one cannot be taken.
const ONE_LOST: u32 = 3;
/// SYNC in a row beyond which nobody looks.
const MOST_MISSED: u32 = 200;

/// What there is to say; nothing where no frame is lost, and where silence stops nobody.
pub(super) fn findings(scenario: &Scenario) -> impl Iterator<Item = Finding> {
    lost_neighbours(scenario).into_iter().chain(lost_sync(scenario))
}

/// Losses against the number of neighbours that may be silent at the same time.
fn lost_neighbours(scenario: &Scenario) -> Option<Finding> {
    let count = usize::from(scenario.safety.lost_neighbours);
    if count == 0
        || scenario.bus.loss.is_none() && scenario.links.iter().all(|link| link.settings.loss.is_none())
    {
        return None;
    }
    let (extrapolated, late) = (u32::from(Bounds::NONE.extrapolate), ticks_late(scenario));
    let steps = (extrapolated + 1).saturating_sub(late).max(1);
    let receivers = receivers(scenario);
    let ticks = scenario.time.ticks as f64;
    let stops_with = |count: usize| all(&receivers, |receiver| receiver.silences(count, steps)).times(ticks);
    let stops = stops_with(count);
    let share = Share::of(stops);
    let text = format!(
        "a node stops where {} {} silent for more than {extrapolated} ticks at once; lost frames alone make that so in {share}",
        plural(count, "neighbour"),
        if count == 1 { "is" } else { "are" }
    );
    let values = json!({
        "lost_neighbours": count, "ticks": extrapolated, "stops": stops.high, "stops_at_least": stops.low,
        "share": share.high, "share_at_least": share.low,
    });
    let found = Finding::new("lost-neighbours", "Lost neighbours", text, values);
    let status = share.status();
    if status == Status::Ok {
        return Some(found);
    }
    let most = receivers.iter().map(|(receiver, _)| receiver.links.len()).max().unwrap_or(0);
    let enough = (count + 1..=most).find(|&more| Share::of(stops_with(more)).status() == Status::Ok);
    let why = "healthy nodes stop then (FAULT 6), and their neighbours lose them";
    Some(match enough {
        Some(more) => found
            .advise(status, format!("{why}; let safety.lost_neighbours be {more}"))
            .set("safety.lost_neighbours", more.to_string()),
        None => {
            let advice = "no number of neighbours is silent seldom enough: let safety.lost_neighbours be 0, or let fewer frames get lost";
            found.advise(status, format!("{why}; {advice}"))
        }
    })
}

/// Losses against the time for which a node goes on without SYNC.
fn lost_sync(scenario: &Scenario) -> Option<Finding> {
    let (sync, holdover_ns) = (scenario.sync.as_ref()?, scenario.safety.holdover_ns?);
    let (loss, period_ns) = (scenario.bus.loss, sync.period_ns);
    // Only there do runs have clocks. No link loses a SYNC.
    if !scenario.bus.model.is_can() || loss.is_none() && holdover_ns > period_ns {
        return None;
    }
    let periods = scenario.time.ticks as f64 * scenario.time.tick_ns as f64 / period_ns as f64;
    // A node that may be master leads rather than stops, but for what makes it take none that it hears.
    let nodes = scenario.nodes.len() as f64;
    let (least, most) = (nodes - sync.masters.len() as f64, nodes - 1.0);
    let busiest = receivers(scenario).iter().map(|(receiver, _)| receiver.links.len()).max().unwrap_or(0);
    let frames = (busiest * scenario.components()) as u64 * (period_ns / scenario.time.tick_ns);
    let others = u32::try_from(frames).unwrap_or(u32::MAX);
    let share_of = |missed: u32| {
        let begins = sync_losses(loss, others, missed) * periods;
        Share::of(Rate { low: begins * least, high: begins * most })
    };
    // Those that a node can do without: the next one is too late.
    let missed = u32::try_from((holdover_ns - 1) / period_ns).unwrap_or(u32::MAX).min(MOST_MISSED);
    let share = share_of(missed);
    let longer = (missed.max(ONE_LOST)..=MOST_MISSED).find(|&more| share_of(more).status() == Status::Ok);
    let longer = longer.map(|more| format_duration(period_ns.saturating_mul(u64::from(more) + 1)));
    let text = format!(
        "a node stops {} after the last SYNC that it could take, and takes one if it has heard the one before, too; one comes every {}; \
         lost frames alone make nodes stop in {share}",
        format_duration(holdover_ns),
        format_duration(period_ns)
    );
    let values = json!({
        "holdover_s": holdover_ns as f64 / 1e9, "period_s": period_ns as f64 / 1e9, "missed": missed,
        "share": share.high, "share_at_least": share.low,
    });
    let found = Finding::new("lost-sync", "Lost SYNC", text, values);
    let status = share.status();
    if status == Status::Ok {
        return Some(found);
    }
    let why = "healthy nodes stop then (FAULT 7)";
    Some(match longer {
        Some(longer) => found
            .advise(status, format!("{why}; let safety.holdover be {longer} or more"))
            .set("safety.holdover", longer),
        None => {
            found.advise(status, format!("{why}; let sync.period be shorter, or let fewer frames get lost"))
        }
    })
}

/// What every node hears in a tick, and the indices of those that hear alike.
fn receivers(scenario: &Scenario) -> Vec<(Receiver, Vec<usize>)> {
    let frames = scenario.components() as u32;
    let mut found: Vec<(Receiver, Vec<usize>)> = Vec::new();
    for index in 0..scenario.nodes.len() {
        let link_from = |from: usize| {
            let is = |link: &&crate::scenario::LinkSpec| (link.from, link.to) == (from, index);
            scenario.links.iter().find(is).map_or(Loss::NONE, |link| link.settings.loss)
        };
        let links: Vec<Loss> =
            scenario.graph.neighbours(index).into_iter().map(|(from, _)| link_from(from)).collect();
        match found.iter_mut().find(|(receiver, _)| receiver.links == links) {
            Some((_, alike)) => alike.push(index),
            None => found.push((Receiver { loss: scenario.bus.loss, links, frames, others: 0 }, vec![index])),
        }
    }
    found
}

fn all(receivers: &[(Receiver, Vec<usize>)], rate: impl Fn(&Receiver) -> Rate) -> Rate {
    let of = |(receiver, alike): &(Receiver, Vec<usize>)| rate(receiver).times(alike.len() as f64);
    receivers.iter().map(of).fold(Rate::default(), Rate::plus)
}

/// Ticks by which what is heard is old, about.
fn ticks_late(scenario: &Scenario) -> u32 {
    let delay = scenario.bus.latency_ns.saturating_add(scenario.bus.jitter_ns / 2);
    u32::try_from(delay / scenario.time.tick_ns).unwrap_or(u32::MAX)
}
