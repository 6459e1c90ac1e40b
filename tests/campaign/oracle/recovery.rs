//! From when on all have to be inside again.

use super::{is_promised, is_without};
use sim_host::check::{self, Status};
use sim_host::scenario::{Breach, BusSpec, Coupling, EventKind, Scenario};

/// Time after the last event until all are to be inside, beside the ticks for which a node that comes may wait before it speaks, ns.
const RECOVERY_NS: u64 = 200_000_000;
/// Those ticks.
const LISTENS: u64 = 500;
/// With clocks a node that comes has to learn the time first, from two SYNC, ns.
const LEARNS_NS: u64 = 300_000_000;

/// The tick from which all have to be inside: after the last event, where the network by itself is inside, says `check`, and nothing lasts.
pub(super) fn judged_from(scenario: &Scenario) -> Option<u64> {
    let last = scenario.events.iter().map(|event| event.end_ns()).max()?;
    if !is_mended(scenario) || is_lossy(scenario) || !keeps_funnels(scenario) {
        return None;
    }
    let learns_ns = if scenario.clocks.is_empty() { 0 } else { LEARNS_NS };
    let from = last.saturating_add(RECOVERY_NS + LISTENS * scenario.time.tick_ns + learns_ns);
    let from = scenario.time.first_tick(from);
    (from <= scenario.time.ticks && is_kept_without_events(scenario)).then_some(from)
}

/// Whether what events do is over in the end: nobody stays away, has another configuration, or another time.
fn is_mended(scenario: &Scenario) -> bool {
    let absences = scenario.course().absences(&scenario.time);
    let all_return = absences.iter().all(|absence| absence.to_tick.is_some());
    // A node that comes waits for SYNC first, and the only time master for ever.
    let finds_time = scenario.clocks.is_empty() || absences.is_empty() || is_led_throughout(scenario);
    let lasting = |kind| matches!(kind, EventKind::Impostor | EventKind::Set | EventKind::Clock);
    all_return && finds_time && !scenario.events.iter().any(|event| lasting(event.kind))
}

/// Whether the time masters are on and say so all the time.
fn is_led_throughout(scenario: &Scenario) -> bool {
    let absences = scenario.course().absences(&scenario.time);
    let mut masters = scenario.sync.iter().flat_map(|sync| &sync.masters);
    let is_silent = scenario.events.iter().any(|event| event.kind == EventKind::SyncLoss);
    let stays = |&id: &u16| !absences.iter().any(|absence| absence.node + 1 == usize::from(id));
    !is_silent && scenario.sync.is_some() && masters.all(stays)
}

fn is_lossy(scenario: &Scenario) -> bool {
    !scenario.bus.loss.is_none() || !scenario.links.is_empty()
}

/// Whether the law promises funnels at all.
pub(super) fn is_of_funnels(scenario: &Scenario) -> bool {
    let is_funnel = matches!(
        scenario.coupling,
        Coupling::NodeWise | Coupling::ElementWise | Coupling::MaxGain | Coupling::EdgeWise
    );
    is_funnel && scenario.nodes.iter().all(|node| node.gain.keeps_funnels())
}

/// Whether the law brings nodes back into the scenario's funnels, and stops none.
fn keeps_funnels(scenario: &Scenario) -> bool {
    let rides = scenario.on_breach == Breach::Ride && scenario.safety.lost_neighbours == 0;
    is_of_funnels(scenario) && rides && scenario.safety.holdover_ns.is_none()
}

/// Whether `check` promises it of the network alone, and warns of nothing on its bus.
fn is_kept_without_events(scenario: &Scenario) -> bool {
    let calm = Scenario { clocks: Vec::new(), sync: None, ..scenario.without_events() };
    let alone = Scenario { bus: BusSpec::default(), ..calm.clone() };
    is_promised(&check::check(&alone))
        && (calm.bus == BusSpec::default() || is_without(&check::check(&calm), &[Status::Warn, Status::Fail]))
}
