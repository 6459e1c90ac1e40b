//! Graph, coupling, gain, funnel and the field that nodes have where they say nothing else.

use super::Dice;
use super::agents;

/// The lines that a world cannot do without.
pub(super) fn law(dice: &mut Dice, nodes: usize, components: usize, number: u64) -> Vec<String> {
    let kind = match components {
        1 => dice.one(&[
            "node-wise",
            "node-wise",
            "node-wise",
            "node-wise",
            "edge-wise",
            "edge-wise",
            "max-gain",
            "linear",
            "lambda-tracker",
            "none",
        ]),
        _ => dice.one(&["node-wise", "element-wise", "max-gain", "edge-wise"]),
    };
    let mut lines = vec![
        format!("seed = {number}"),
        format!("graph = {}", graph(dice, nodes)),
        format!("coupling.kind = \"{kind}\""),
        format!("coupling.gain = {}", gain(dice, kind)),
        format!("coupling.funnel = {}", funnel(dice)),
        format!("agent.dynamics = {}", agents::field(dice, components)),
    ];
    if kind == "lambda-tracker" {
        lines.push(format!("coupling.eta = {}", dice.between(0.05, 0.3)));
    }
    if components > 1 {
        lines.push(format!("agent.state = {:?}", vec![0.0; components]));
    }
    lines
}

fn graph(dice: &mut Dice, nodes: usize) -> String {
    let kind = dice.one(&[
        "ring",
        "ring",
        "path",
        "star",
        "complete",
        "random-regular",
        "grid",
        "torus",
        "ring-lattice",
        "erdos-renyi",
        "edges",
    ]);
    let rest = match kind {
        "random-regular" => format!("nodes = {}, degree = 3", nodes + nodes % 2),
        "grid" => format!("nodes = {nodes}, columns = {}", 2 + dice.below(2)),
        "torus" => "nodes = 9, columns = 3".to_owned(),
        "ring-lattice" => format!("nodes = {nodes}, degree = 4"),
        "erdos-renyi" => format!("nodes = {nodes}, probability = {}", dice.between(0.4, 0.9)),
        "edges" => format!("nodes = {nodes}, edges = [{}]", edges(dice, nodes)),
        _ => format!("nodes = {nodes}"),
    };
    let weight = match kind {
        "edges" => String::new(),
        _ if dice.is(0.15) => format!(", weight = {}", dice.between(0.3, 2.0)),
        _ => String::new(),
    };
    format!("{{ kind = \"{kind}\", {rest}{weight} }}")
}

/// A path with weights, and perhaps an edge from its first node to its last one.
fn edges(dice: &mut Dice, nodes: usize) -> String {
    let mut edges: Vec<_> =
        (1..nodes).map(|id| format!("[{id}, {}, {}]", id + 1, dice.between(0.3, 2.0))).collect();
    if dice.is(0.5) {
        edges.push(format!("[1, {nodes}]"));
    }
    edges.join(", ")
}

fn gain(dice: &mut Dice, coupling: &str) -> String {
    if matches!(coupling, "linear" | "lambda-tracker") {
        return format!("{{ kind = \"linear\", slope = {} }}", dice.between(0.5, 20.0));
    }
    match dice.below(8) {
        0 | 1 => "{ kind = \"logarithmic\", scale = 1.0 }".to_owned(),
        2 => "{ kind = \"algebraic\", scale = 1.0 }".to_owned(),
        3 => format!("{{ kind = \"locally-linear\", bound = {} }}", dice.between(5.0, 40.0)),
        4 => "{ kind = \"median\", eta = 0.1, eps = 0.1 }".to_owned(),
        _ => format!("{{ kind = \"reciprocal\", scale = {} }}", dice.between(0.3, 3.0)),
    }
}

fn funnel(dice: &mut Dice) -> String {
    let end = dice.between(0.1, 1.0);
    let factor = if dice.is(0.1) { format!(", factor = {}", dice.between(0.7, 2.0)) } else { String::new() };
    match dice.below(10) {
        0..=2 => format!("{{ kind = \"constant\", width = {end}{factor} }}"),
        3 => format!("{{ kind = \"reciprocal-time\", scale = {end}{factor} }}"),
        4 => format!(
            "{{ kind = \"finite-time\", start = {}, at = \"{}ms\", power = 2.0{factor} }}",
            end * 4.0,
            2_000 + dice.below(4_000)
        ),
        5 => format!(
            "{{ kind = \"schedule\", start = {}, at = \"{}ms\", eps = 0.1, then = {{ kind = \"constant\", width = {end} }}{factor} }}",
            end * 4.0,
            100 + dice.below(400)
        ),
        _ => format!(
            "{{ kind = \"exponential\", start = {}, end = {end}, rate = {}{factor} }}",
            end * 4.0,
            dice.between(0.5, 5.0)
        ),
    }
}
