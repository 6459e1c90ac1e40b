//! What stops healthy nodes: neighbours, or SYNC, that lost and late frames keep silent for too long.

use serde_json::json;

use super::silence::{Hazard, Receiver, Sender, TAKEN, sync_losses};
use super::stops::Share;
use super::text::plural;
use super::{Finding, Status, bus, clocks};
use crate::sampled::Bounds;
use crate::scenario::{BusModel, LinkSettings, Loss, Scenario, SyncSpec, format_duration};

/// SYNC in a row that are missed, at least where one that is lost shall stop nobody: it is not there, and the next one cannot be taken.
const ONE_LOST: u32 = 3;
/// SYNC in a row beyond which nobody looks.
const MOST_MISSED: u32 = 200;
/// SYNC of a master that is new, and how much faster they come (keeper.rs of the node).
const QUICK: u32 = 16;
const QUICKER: u32 = 8;
/// Periods of silence after which a node that may be master leads, in quarters.
const PATIENCE: u64 = 11;
/// How far clocks are apart before they have learnt their rates, s per s.
const DRIFT: f64 = 200e-6;

/// What there is to say; nothing where no frame is lost or late, and where silence stops nobody.
pub(super) fn findings(scenario: &Scenario) -> impl Iterator<Item = Finding> {
    lost_neighbours(scenario).into_iter().chain(lost_sync(scenario))
}

/// Losses against the number of neighbours that may be silent at the same time.
fn lost_neighbours(scenario: &Scenario) -> Option<Finding> {
    let count = usize::from(scenario.safety.lost_neighbours);
    let receivers = receivers(scenario);
    let extrapolated = u32::from(Bounds::NONE.extrapolate);
    let is_quiet = |receiver: &Receiver| {
        receiver.loss.is_none() && receiver.senders.iter().all(|sender| *sender == Sender::prompt(Loss::NONE))
    };
    if count == 0 || receivers.iter().all(|(receiver, _)| is_quiet(receiver)) {
        return None;
    }
    let most = receivers.iter().map(|(receiver, _)| receiver.senders.len()).max().unwrap_or(0);
    let share_of = |count: usize| {
        let of = |(receiver, nodes): &(Receiver, usize)| {
            receiver.silences(count, scenario.time.ticks).times(*nodes, *nodes)
        };
        Share::of(receivers.iter().map(of).fold(Hazard::default(), Hazard::plus))
    };
    let share = share_of(count);
    let neighbours = plural(count, "neighbour");
    let text = match count > most {
        true => format!("no node has {neighbours}: none stops, however many are silent"),
        false => format!(
            "a node stops where {neighbours} {} silent for more than {extrapolated} ticks at once; frames that are lost or late alone make that so \
             in {share}",
            if count == 1 { "is" } else { "are" }
        ),
    };
    let values = json!({
        "lost_neighbours": count, "ticks": extrapolated, "share": share.high, "share_at_least": share.low,
    });
    let found = Finding::new("lost-neighbours", "Lost neighbours", text, values);
    let status = share.status();
    if status == Status::Ok {
        // Frames that wait too long for a busy bus are in no figure here.
        return Some(if bus::is_late(scenario) { found.stands(Status::NotChecked) } else { found });
    }
    // Each time twice as many more, since each is a long sum where links differ.
    let more = std::iter::successors(Some(1), |more| Some(2 * more)).map(|more| count + more);
    let enough = more.take_while(|more| *more <= most).find(|&more| share_of(more).status() == Status::Ok);
    let why = "healthy nodes stop then (FAULT 6), and their neighbours lose them";
    Some(match enough {
        Some(more) => found
            .advise(status, format!("{why}; let safety.lost_neighbours be {more}"))
            .set("safety.lost_neighbours", more.to_string()),
        None => {
            let advice = "no number of neighbours that was tried is silent seldom enough: let safety.lost_neighbours be 0, or fewer frames be lost or late";
            found.advise(status, format!("{why}; {advice}"))
        }
    })
}

/// What every node hears in a tick, and how many hear alike.
fn receivers(scenario: &Scenario) -> Vec<(Receiver, usize)> {
    // CAN FD has room for all components in one frame.
    let frames = if scenario.bus.model == BusModel::CanFd { 1 } else { scenario.components() as u32 };
    let of_bus = Delay { shortest_ns: scenario.bus.latency_ns, width_ns: scenario.bus.jitter_ns };
    let mut found: Vec<(Receiver, usize)> = Vec::new();
    for index in 0..scenario.nodes.len() {
        let link_from = |from: usize| {
            let is = |link: &&crate::scenario::LinkSpec| (link.from, link.to) == (from, index);
            scenario.links.iter().find(is).map_or_else(LinkSettings::default, |link| link.settings)
        };
        let sender = |(from, _): (usize, f64)| {
            let link = link_from(from);
            let delay = of_bus.plus(Delay { shortest_ns: link.latency_ns, width_ns: link.jitter_ns });
            Sender { link: link.loss, on_its_way: delay.on_its_way(scenario.time.tick_ns) }
        };
        let senders = scenario.graph.neighbours(index).into_iter().map(sender).collect();
        let patience = u32::from(Bounds::NONE.extrapolate) + 1;
        let receiver = Receiver { loss: scenario.bus.loss, senders, frames, patience };
        match found.iter_mut().find(|(known, _)| *known == receiver) {
            Some((_, alike)) => *alike += 1,
            None => found.push((receiver, 1)),
        }
    }
    found
}

/// How long frames are on their way: as long, and up to as much longer.
#[derive(Clone, Copy)]
struct Delay {
    shortest_ns: u64,
    width_ns: u64,
}

impl Delay {
    fn plus(self, other: Self) -> Self {
        Self {
            shortest_ns: self.shortest_ns.saturating_add(other.shortest_ns),
            width_ns: self.width_ns.saturating_add(other.width_ns),
        }
    }

    /// Probability that a frame is on its way for more than a tick, two ticks, and so on.
    fn on_its_way(self, tick_ns: u64) -> [f64; TAKEN] {
        let longer_than = |ns: u64| match self.shortest_ns.saturating_add(self.width_ns).saturating_sub(ns) {
            _ if self.shortest_ns >= ns => 1.0,
            0 => 0.0,
            beyond => beyond as f64 / self.width_ns as f64,
        };
        std::array::from_fn(|age| longer_than((age as u64 + 1).saturating_mul(tick_ns)))
    }
}

/// SYNC as nodes hear it.
struct Syncs {
    loss: Loss,
    period_ns: u64,
    /// By how much a SYNC may come later than a period after the last one, ns.
    late_ns: u64,
    /// Frames of others before each.
    others: u32,
    /// How many there are in the run.
    count: u64,
    /// Nodes that stop without, at least and at most.
    nodes: (usize, usize),
}

impl Syncs {
    fn of(scenario: &Scenario, sync: &SyncSpec, holdover_ns: u64) -> Self {
        let tick_ns = scenario.time.tick_ns;
        let period_ns = clocks::period_ns(scenario, sync);
        let hears = receivers(scenario)
            .iter()
            .map(|(receiver, _)| receiver.senders.len() * receiver.frames as usize)
            .max();
        let others = hears.unwrap_or(0) as u64 * (period_ns / tick_ns);
        let nodes = scenario.nodes.len();
        // Who may be master leads rather than stops, where it finds the master dead before.
        let followers = nodes.saturating_sub(sync.masters.len());
        let all = nodes.saturating_sub(1);
        let least = if holdover_ns < period_ns / 4 * PATIENCE { all } else { followers };
        Self {
            loss: scenario.bus.loss,
            period_ns,
            late_ns: 2 * bus::frame_ns(scenario) + (DRIFT * period_ns as f64) as u64,
            others: u32::try_from(others).unwrap_or(u32::MAX),
            count: scenario.time.ticks.saturating_mul(tick_ns) / period_ns,
            nodes: (least, all),
        }
    }

    /// Those that a node can do without: the next one is too late.
    fn missed(&self, holdover_ns: u64) -> u32 {
        u32::try_from(holdover_ns.saturating_sub(1) / self.period_ns).unwrap_or(u32::MAX).min(MOST_MISSED)
    }

    /// The share of the runs in which a node stops that can do without so many, at least and at most.
    fn share(&self, (most, least): (u32, u32)) -> Share {
        let hazard = |missed: u32| {
            let quick = if missed < 2 { QUICKER * missed } else { QUICK + missed - 2 };
            sync_losses(self.loss, self.others, (missed, quick), self.count)
        };
        let hazard = Hazard { low: hazard(most), high: hazard(least) };
        Share::of(hazard.times(self.nodes.0, self.nodes.1))
    }
}

/// Losses against the time for which a node goes on without SYNC.
fn lost_sync(scenario: &Scenario) -> Option<Finding> {
    let (sync, holdover_ns) = (scenario.sync.as_ref()?, scenario.safety.holdover_ns?);
    // Only there do runs have clocks. No link loses a SYNC.
    if !scenario.bus.model.is_can() {
        return None;
    }
    let syncs = Syncs::of(scenario, sync, holdover_ns);
    // The first that is taken is the third that is heard: two tell when the one before was on the wire.
    let first_ns =
        2 * (syncs.period_ns / u64::from(QUICKER) / scenario.time.tick_ns).max(1) * scenario.time.tick_ns;
    let missed = |holdover_ns: u64| if holdover_ns > first_ns { syncs.missed(holdover_ns) } else { 0 };
    let least = missed(holdover_ns.saturating_sub(syncs.late_ns));
    if syncs.loss.is_none() && least > 0 {
        return None;
    }
    // A holdover of a period is not kept, once the next one comes a little later than the last.
    let is_longer = holdover_ns > syncs.period_ns.max(first_ns);
    let most = if is_longer { missed(holdover_ns.saturating_add(syncs.late_ns)) } else { 0 };
    let share = syncs.share((most, least));
    let longer =
        (least.max(ONE_LOST)..=MOST_MISSED).find(|&more| syncs.share((more, more)).status() == Status::Ok);
    let longer = longer.map(|more| {
        format_duration(syncs.period_ns.saturating_mul(u64::from(more) + 1) + syncs.period_ns / 2)
    });
    let why = match least {
        0 => "the next one may come too late".to_owned(),
        _ => format!("lost frames alone make that so in {share}"),
    };
    let text = format!(
        "a node stops {} after the last SYNC that it took, and takes one if it has heard the one before, too; one comes every {}; {why}",
        format_duration(holdover_ns),
        format_duration(syncs.period_ns)
    );
    let values = json!({
        "holdover_s": holdover_ns as f64 / 1e9, "period_s": syncs.period_ns as f64 / 1e9, "missed": least,
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
