//! Who was on from the start to the tick adopts what was staged, and nobody else does.

use super::Broken;
use sim_host::bus::Medium;
use sim_host::engine::Engine;
use sim_host::presence::Presence;
use sim_host::scenario::Scenario;

/// Gives how many nodes were judged.
pub(super) fn adopted<M: Medium>(scenario: &Scenario, engine: &Engine<M>) -> Result<u64, Broken> {
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
        let was_off = own.any(|absence| absence.from_tick < staged.tick);
        if engine.missed().contains(&index) != was_off {
            return Err(Broken::Adopted(index));
        }
        judged += 1;
    }
    Ok(judged)
}
