//! Inputs stay within the bound that the designer has given, and within what an actuator can do.

use super::Broken;
use super::commits::Adoptions;
use sim_host::judge::Moment;
use sim_host::presence::Presence;
use sim_host::scenario::Scenario;

/// What f32 rounds away.
const ROOM: f64 = 1e-5;
/// Ticks by which one with a clock of its own may be away from that of the network.
const AWAY: u64 = 2;

pub(super) fn within_bounds(
    scenario: &Scenario,
    moment: &Moment<'_>,
    adoptions: &Adoptions<'_>,
) -> Result<(), Broken> {
    let components = scenario.components();
    for (index, u) in moment.u.chunks(components).enumerate() {
        // An actuator that fails does what it does.
        if moment.presence.get(index) != Some(&Presence::Ran) || scenario.has_plant(index) {
            continue;
        }
        // With a clock of its own a node adopts a little earlier or later.
        let either = if scenario.clocks.is_empty() { 0 } else { AWAY };
        let at = |k| adoptions.node_at(index, k).and_then(|node| node.limits);
        let all = (f64::NEG_INFINITY, f64::INFINITY);
        let [before, after] = [at(moment.k.saturating_sub(either)), at(moment.k + either)]
            .map(|limits| limits.map_or(all, |limits| (limits.low, limits.high)));
        let (low, high) = (before.0.min(after.0), before.1.max(after.1));
        let most = scenario.u_max.unwrap_or(f64::INFINITY);
        let is_beyond = |u: &&f64| {
            let room = ROOM * u.abs();
            **u > high.min(most) + room || **u < low.max(-most) - room
        };
        if let Some(&u) = u.iter().find(is_beyond) {
            return Err(Broken::Input(moment.k, index, u));
        }
    }
    Ok(())
}
