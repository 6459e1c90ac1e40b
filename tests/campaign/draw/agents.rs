//! Fields, states, gains and funnels of nodes.

use super::{Dice, Net};
use std::fmt::Write as _;

/// Fields that no sum of a line and sines is.
const EXPRESSIONS: [&str; 4] =
    ["-x + 2*tanh(x) + sin(2*t)", "-x^3 + 0.5*cos(3*t)", "clamp(-2*x, -1, 1) + 0.3", "-0.5*x + abs(sin(t))"];

/// The field of nodes that say nothing else.
pub(super) fn field(dice: &mut Dice, components: usize) -> String {
    match dice.is(0.1) && components == 1 {
        true => format!("{{ kind = \"expression\", f = \"{}\" }}", dice.one(&EXPRESSIONS)),
        false => format!("{{ kind = \"affine\", slope = {} }}", dice.between(-2.0, 0.0)),
    }
}

/// What single nodes have: offsets and sines, and in some worlds states, and here and there a gain, a damping or limits of their own.
pub(super) fn nodes(dice: &mut Dice, net: &Net, needed: &[String]) -> Vec<String> {
    let is_affine = !needed.iter().any(|line| line.contains("\"expression\""));
    if is_affine && dice.is(0.07) {
        return vec![drawn_by_the_scenario(dice)];
    }
    let starts = dice.is(0.4);
    let differ = dice.is(0.1);
    (1..=net.nodes).map(|id| node(dice, (id, net.components), is_affine, (starts, differ))).collect()
}

/// In place of the numbers of this campaign those of the scenario's seed.
fn drawn_by_the_scenario(dice: &mut Dice) -> String {
    format!(
        "agent.random = {{ offset = {{ uniform = [-1.0, 1.0] }}, slope = {{ uniform = [-2.0, {}] }} }}",
        dice.between(-1.0, 0.0)
    )
}

fn node(
    dice: &mut Dice,
    (id, components): (usize, usize),
    is_affine: bool,
    (starts, differs): (bool, bool),
) -> String {
    let mut line = format!("[[node]]\nid = {id}");
    let value = |low: f64, high: f64, dice: &mut Dice| match components {
        1 => format!("{:?}", dice.between(low, high)),
        _ => format!("{:?}", (0..components).map(|_| dice.between(low, high)).collect::<Vec<_>>()),
    };
    let offset = value(-1.0, 1.0, dice);
    if starts {
        let _written = write!(line, "\nstate = {}", value(-0.3, 0.3, dice));
    }
    if differs && dice.is(0.5) {
        let _written =
            write!(line, "\ngain = {{ kind = \"reciprocal\", scale = {} }}", dice.between(0.3, 3.0));
    }
    if differs && dice.is(0.3) {
        let _written = write!(line, "\nlimits = {{ low = -{0}, high = {0} }}", dice.between(8.0, 40.0));
    }
    let kind = if is_affine { "" } else { "kind = \"affine\", slope = -1.0, " };
    let _written = write!(line, "\ndynamics = {{ {kind}offset = {offset}");
    if dice.is(0.4) {
        let _written = write!(
            line,
            ", sines = [{{ amplitude = {}, frequency = {} }}]",
            dice.between(0.0, 1.0),
            dice.between(0.5, 10.0)
        );
    }
    line + " }"
}
