//! Guards, policies, bounds, rounds, and limits of what is heard.

use super::Dice;

/// Lines, each of which a world can do without.
pub(super) fn settings(dice: &mut Dice) -> Vec<String> {
    let mut lines = Vec::new();
    let mut add = |is_there: bool, line: String| {
        if is_there {
            lines.push(line);
        }
    };
    add(dice.is(0.3), "coupling.guard = 0.1".to_owned());
    add(dice.is(0.2), "time.slow_start = \"10ms\"".to_owned());
    add(dice.is(0.06), format!("time.round = \"{}ms\"", dice.one(&["2", "4", "5"])));
    add(dice.is(0.2), format!("agent.noise = {}", dice.between(0.001, 0.01)));
    add(dice.is(0.2), "agent.compute = \"100us\"".to_owned());
    let breach = ["\"ride\"", "\"stop\"", "{ kind = \"reopen\", margin = 1.5, rate = 2.0 }"];
    add(dice.is(0.15), format!("coupling.on_breach = {}", dice.one(&breach)));
    add(dice.is(0.1), "safety.lost_neighbours = 2".to_owned());
    add(dice.is(0.1), format!("coupling.damping = {}", dice.one(&["\"graph\"", "1.8", "3.0", "4.0"])));
    add(dice.is(0.1), format!("coupling.u_max = {}", dice.between(10.0, 60.0)));
    add(dice.is(0.1), format!("coupling.floor = {}", dice.one(&["\"f32\"", "0.001", "0.2"])));
    let limit = dice.between(8.0, 40.0);
    add(dice.is(0.1), format!("agent.limits = {{ low = -{limit}, high = {limit} }}"));
    lines
}

/// Limits of what is heard, most of them as the book says that they should be: above the bound of the inputs and what fields do beside it.
pub(super) fn heard(dice: &mut Dice) -> Vec<String> {
    let bound = dice.between(10.0, 40.0);
    let beside = if dice.is(0.8) { dice.between(8.0, 25.0) } else { dice.between(0.0, 8.0) };
    let mut lines = vec![
        format!("coupling.u_max = {bound}"),
        // In three digits, as all that is drawn.
        format!("safety.heard_rate = {:.3}", bound + beside),
    ];
    if dice.is(0.6) {
        lines.push(format!("safety.heard_limit = {}", dice.between(4.0, 12.0)));
    }
    if dice.is(0.4) {
        lines.push(format!("safety.drop_after = {}", 1 + dice.below(20)));
    }
    lines
}
