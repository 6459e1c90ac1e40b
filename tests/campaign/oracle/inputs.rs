//! Inputs stay within the bound that the designer has given, and within what an actuator can do.

use super::Broken;
use sim_host::judge::Moment;
use sim_host::presence::Presence;
use sim_host::scenario::Scenario;

/// What f32 rounds away.
const ROOM: f64 = 1e-5;

pub(super) fn within_bounds(scenario: &Scenario, moment: &Moment<'_>) -> Result<(), Broken> {
    let components = scenario.components();
    for (index, u) in moment.u.chunks(components).enumerate() {
        // An actuator that fails does what it does.
        if moment.presence.get(index) != Some(&Presence::Ran) || scenario.has_plant(index) {
            continue;
        }
        let limits = scenario.node_at(index, moment.k).and_then(|node| node.limits);
        let (low, high) =
            limits.map_or((f64::NEG_INFINITY, f64::INFINITY), |limits| (limits.low, limits.high));
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
