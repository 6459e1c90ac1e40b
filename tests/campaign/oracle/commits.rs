//! Who was on from the start to the tick adopts what was staged, and nobody else does.

use super::Broken;
use funnelnet_node::Event;
use sim_host::bus::Medium;
use sim_host::engine::{Engine, NodeEvent};
use sim_host::presence::Presence;
use sim_host::scenario::{NodeSpec, Scenario};

/// Who has said that it has adopted something.
pub(super) struct Adoptions<'a> {
    scenario: &'a Scenario,
    /// By index.
    has_adopted: Vec<bool>,
    /// It has stopped by itself, and adopts nothing meanwhile.
    has_stopped: Vec<bool>,
}

impl<'a> Adoptions<'a> {
    pub(super) fn of(scenario: &'a Scenario) -> Self {
        let nodes = scenario.nodes.len();
        Self { scenario, has_adopted: vec![false; nodes], has_stopped: vec![false; nodes] }
    }

    /// Takes what nodes have told: nobody adopts what is not staged in it, or for another tick.
    pub(super) fn take(&mut self, presence: &[Presence], told: &[NodeEvent]) -> Result<(), Broken> {
        for (stopped, presence) in self.has_stopped.iter_mut().zip(presence) {
            *stopped |= *presence == Presence::Stopped;
        }
        for told in told {
            let Event::Adopted { tick } = told.event else { continue };
            let staged = self.scenario.staged.get(told.node).and_then(Option::as_ref);
            if staged.is_none_or(|staged| staged.tick != u64::from(tick)) {
                return Err(Broken::Adopted(told.node));
            }
            self.has_adopted[told.node] = true;
        }
        Ok(())
    }

    /// The node with this index as it has said that it is at tick `k`.
    pub(super) fn node_at(&self, index: usize, k: u64) -> Option<&'a NodeSpec> {
        match self.has_adopted.get(index)? {
            true => self.scenario.node_at(index, k),
            false => self.scenario.nodes.get(index),
        }
    }
}

/// Gives how many nodes were judged.
pub(super) fn adopted<M: Medium>(
    scenario: &Scenario,
    engine: &Engine<M>,
    adoptions: &Adoptions<'_>,
) -> Result<u64, Broken> {
    let absences = scenario.course().absences(&scenario.time);
    let presence = engine.presence(scenario.time.ticks);
    let mut judged = 0;
    for (index, staged) in scenario.staged.iter().enumerate() {
        // One that is not there at the end has not been told, or has forgotten.
        let Some(staged) = staged.as_ref().filter(|_| presence.get(index) == Some(&Presence::Ran)) else {
            continue;
        };
        let mut own = absences.iter().filter(|absence| absence.node == index);
        // It adopts at the end of the tick before: one that goes right then may have done so, or not.
        if own.clone().any(|absence| absence.from_tick.abs_diff(staged.tick) <= 1) {
            continue;
        }
        // One that has come waits for a time master, perhaps for ever.
        if engine.nodes().get(index).is_none_or(|node| u64::from(node.tick()) < staged.tick) {
            continue;
        }
        let was_off = own.any(|absence| absence.from_tick < staged.tick);
        if adoptions.has_stopped.get(index) == Some(&true) {
            continue;
        }
        let has_adopted = adoptions.has_adopted.get(index) == Some(&true);
        if engine.missed().contains(&index) != was_off || has_adopted == was_off {
            return Err(Broken::Adopted(index));
        }
        judged += 1;
    }
    Ok(judged)
}
