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

/// Settings of a network that nothing disturbs, which `check` follows to its end: all that it has to know of, and bounds that are reached.
pub(super) fn calm(dice: &mut Dice) -> Vec<String> {
    let mut lines = Vec::new();
    let mut add = |is_there: bool, line: String| {
        if is_there {
            lines.push(line);
        }
    };
    add(dice.is(0.5), format!("coupling.guard = {}", dice.between(0.05, 0.4)));
    add(dice.is(0.4), format!("time.slow_start = \"{}ms\"", 5 + dice.below(40)));
    add(dice.is(0.3), format!("time.round = \"{}ms\"", dice.one(&["2", "5", "10"])));
    add(dice.is(0.3), format!("coupling.damping = {}", dice.one(&["\"graph\"", "1.8", "3.0", "4.0"])));
    add(dice.is(0.4), format!("coupling.u_max = {}", dice.between(0.3, 6.0)));
    let limit = dice.between(0.3, 6.0);
    add(dice.is(0.3), format!("agent.limits = {{ low = -{limit}, high = {} }}", dice.between(0.3, 6.0)));
    lines
}

/// Limits of what is heard: most of them above the bound of the inputs and what fields do beside it, as the book says that they should be,
/// and many not far above.
pub(super) struct Limits {
    /// State units / s.
    pub rate: Option<f64>,
    /// State units.
    pub limit: Option<f64>,
    bound: f64,
    drop_after: Option<usize>,
}

impl Limits {
    pub(super) fn drawn(dice: &mut Dice) -> Self {
        let bound = dice.between(2.0, 30.0);
        let beside = if dice.is(0.4) { dice.between(8.0, 25.0) } else { dice.between(0.5, 8.0) };
        // In three digits, as all that is drawn.
        let rate = dice.is(0.85).then_some(((bound + beside) * 1e3).round() / 1e3);
        let limit = (rate.is_none() || dice.is(0.6)).then(|| dice.between(1.5, 10.0));
        let drop_after = dice.is(0.4).then(|| 1 + dice.below(20));
        Self { rate, limit, bound, drop_after }
    }

    pub(super) fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!("coupling.u_max = {}", self.bound)];
        lines.extend(self.rate.map(|rate| format!("safety.heard_rate = {rate}")));
        lines.extend(self.limit.map(|limit| format!("safety.heard_limit = {limit}")));
        lines.extend(self.drop_after.map(|states| format!("safety.drop_after = {states}")));
        lines
    }
}
