//! One event of each kind at a random place and time, on three graphs: what the book says of a kind is counted.

use super::dice::Dice;
use funnelnet_sim::judge::Recovered;
use funnelnet_sim::{Scenario, Simulation};
use std::path::Path;

/// Graphs, as the file has them.
pub const GRAPHS: [(&str, &str); 3] = [
    ("ring", "{ kind = \"ring\", nodes = 6 }"),
    ("star", "{ kind = \"star\", nodes = 6 }"),
    ("random, degree 3", "{ kind = \"random-regular\", nodes = 8, degree = 3 }"),
];

/// A network that keeps its funnel by itself, with time to come together before the event (half a second), and a second after its end.
const NETWORK: &str = r#"version = 1
time = { tick = "1ms", duration = "2300ms" }
coupling.kind = "node-wise"
coupling.gain = { kind = "reciprocal", scale = 1.0 }
coupling.funnel = { kind = "exponential", start = 8.0, end = 0.2, rate = 12.0 }
agent.dynamics = { kind = "affine", slope = -0.5 }
expect = { recovered_within = "1s" }
"#;

/// What can happen: its name in the book's table, the bus that it is tried on, and the lines of the event.
pub struct Kind {
    /// As the table calls it.
    pub name: &'static str,
    /// `bus.model`.
    pub bus: &'static str,
    /// Lines of the scenario beside the event.
    pub settings: &'static str,
    /// Whether the book says that it may stop a node for good.
    pub may_stop: bool,
    event: fn(&mut Place) -> String,
}

/// Where and when an event happens.
struct Place {
    dice: Dice,
    nodes: usize,
    node: usize,
    /// A neighbour of the node.
    other: usize,
    at_ms: usize,
    lasts_ms: usize,
}

impl Place {
    fn node_for(&self, kind: &str, rest: &str) -> String {
        format!("kind = \"{kind}\"\nnode = {}\nfor = \"{}ms\"\n{rest}", self.node, self.lasts_ms)
    }

    fn link_for(&self, kind: &str, rest: &str) -> String {
        let Self { node, other, lasts_ms, .. } = self;
        format!("kind = \"{kind}\"\nlink = [{node}, {other}]\nfor = \"{lasts_ms}ms\"\n{rest}")
    }

    fn all_for(&self, kind: &str, rest: &str) -> String {
        format!("kind = \"{kind}\"\nfor = \"{}ms\"\n{rest}", self.lasts_ms)
    }

    /// A second event when the first one has lasted.
    fn then(&self, first: &str, second: &str) -> String {
        format!("{first}\n[[event]]\nat = \"{}ms\"\n{second}", self.at_ms + self.lasts_ms)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.dice.between(low, high)
    }
}

const CLOCKS: &str = "clock.drift_ppm = 50.0\nsync.period = \"100ms\"\n";
const TWO_MASTERS: &str = "clock.drift_ppm = 50.0\nsync = { period = \"100ms\", masters = [1, 2] }\n";

/// All kinds of events of the book's page of faults.
pub const KINDS: [Kind; 33] = [
    kind("crash", "ideal", |place| format!("kind = \"crash\"\nnode = {}", place.node)),
    kind("leave", "ideal", |place| format!("kind = \"leave\"\nnode = {}", place.node)),
    kind("bounce", "ideal", |place| place.node_for("bounce", "")),
    kind("join", "ideal", |place| {
        let node = place.node;
        place.then(&format!("kind = \"leave\"\nnode = {node}"), &format!("kind = \"join\"\nnode = {node}"))
    }),
    kind("partition, of a link", "ideal", |place| {
        let link = format!("link = [{}, {}]", place.node, place.other);
        place.then(&format!("kind = \"partition\"\n{link}"), &format!("kind = \"repair\"\n{link}"))
    }),
    kind("partition, in halves", "ideal", |place| {
        let ids: Vec<_> = (1..=place.nodes).collect();
        let (left, right) = ids.split_at(place.nodes / 2);
        place.then(&format!("kind = \"partition\"\ngroups = [{left:?}, {right:?}]"), "kind = \"repair\"")
    }),
    kind("burst, of half the frames", "ideal", |place| place.all_for("burst", "loss = 0.5")),
    kind("burst, of all frames", "ideal", |place| place.all_for("burst", "loss = 1.0")),
    kind("corrupt, on the ideal bus", "ideal", |place| place.link_for("corrupt", "probability = 0.05")),
    kind("corrupt, on CAN", "can", |place| place.link_for("corrupt", "probability = 0.05")),
    kind("hold", "ideal", |place| place.link_for("hold", "")),
    stopping(kind("noise, one bit in 1,000", "can", |place| place.all_for("noise", "bit_errors = 1e-3"))),
    stopping(kind("noise, one bit in 50", "can", |place| place.all_for("noise", "bit_errors = 0.02"))),
    kind("cut", "can", |place| place.node_for("cut", "")),
    stopping(kind("short", "can", |place| {
        format!("kind = \"short\"\nfor = \"{}us\"", 10 * (1 + place.dice.below(1_000)))
    })),
    kind("babble", "can", |place| place.node_for("babble", "")),
    kind("liar, a constant", "ideal", |place| {
        let value = place.between(-5.0, 5.0);
        place.node_for("liar", &format!("constant = {value:?}"))
    }),
    kind("liar, a ramp", "ideal", |place| {
        let slope = place.between(-5.0, 5.0);
        place.node_for("liar", &format!("ramp = {slope:?}"))
    }),
    kind("replayer", "ideal", |place| {
        let age = 1 + place.dice.below(450);
        place.node_for("replayer", &format!("age = \"{age}ms\""))
    }),
    stopping(kind("impostor", "ideal", |place| {
        let value = place.between(-2.0, 2.0);
        place.node_for("impostor", &format!("as = {}\noffset = {value:?}", place.other))
    })),
    kind("sensor, an offset", "ideal", |place| {
        // One in two thousand is no fault, which the reader refuses.
        let value = Some(place.between(-1.0, 1.0)).filter(|value| value.abs() > 0.0).unwrap_or(0.001);
        place.node_for("sensor", &format!("offset = {value:?}"))
    }),
    kind("sensor, stuck", "ideal", |place| place.node_for("sensor", "ramp = 0.0")),
    stopping(kind("sensor, half the samples", "ideal", |place| place.node_for("sensor", "loss = 0.5"))),
    kind("actuator, dead", "ideal", |place| place.node_for("actuator", "effectiveness = 0.0")),
    kind("actuator, limited", "ideal", |place| {
        let limit = place.between(0.1, 1.0);
        place.node_for("actuator", &format!("limit = {limit:?}"))
    }),
    kind("actuator, stuck", "ideal", |place| place.node_for("actuator", "ramp = 0.0")),
    Kind {
        name: "clock, a jump of up to a tick",
        bus: "can",
        settings: CLOCKS,
        may_stop: false,
        event: |place| {
            let (node, us) = (place.node, 1 + place.dice.below(1_000));
            format!("kind = \"clock\"\nnode = {node}\nby = \"{us}us\"")
        },
    },
    Kind {
        name: "clock, another drift",
        bus: "can",
        settings: CLOCKS,
        may_stop: false,
        event: |place| {
            let (node, ppm) = (place.node, place.between(-100.0, 100.0));
            format!("kind = \"clock\"\nnode = {node}\ndrift_ppm = {ppm:?}")
        },
    },
    Kind {
        name: "crash, of the time master",
        bus: "can",
        settings: TWO_MASTERS,
        may_stop: false,
        event: |_| "kind = \"crash\"\nnode = 1".to_owned(),
    },
    Kind {
        name: "bounce, of the time master",
        bus: "can",
        settings: TWO_MASTERS,
        may_stop: false,
        event: |place| format!("kind = \"bounce\"\nnode = 1\nfor = \"{}ms\"", place.lasts_ms),
    },
    kind("set, a narrower funnel", "ideal", |place| {
        let end = place.between(0.05, 0.15);
        format!("kind = \"set\"\nkey = \"coupling.funnel.end\"\nvalue = {end:?}")
    }),
    kind("set, another load", "ideal", |place| {
        let (node, offset) = (place.node, place.between(-2.0, 2.0));
        format!("kind = \"set\"\nnode = {node}\nkey = \"agent.dynamics.offset\"\nvalue = {offset:?}")
    }),
    Kind {
        name: "sync-loss",
        bus: "can",
        settings: CLOCKS,
        may_stop: false,
        event: |place| format!("kind = \"sync-loss\"\nfor = \"{}ms\"", place.lasts_ms),
    },
];

const fn kind(name: &'static str, bus: &'static str, event: fn(&mut Place) -> String) -> Kind {
    Kind { name, bus, settings: "", may_stop: false, event }
}

const fn stopping(kind: Kind) -> Kind {
    Kind { may_stop: true, ..kind }
}

/// How a run went.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// The scenario.
    pub text: String,
    /// The largest ratio in the ticks of the event.
    pub ratio: f64,
    /// How all came back.
    pub recovery: Recovered,
    /// Nodes that stopped by themselves.
    pub stopped: usize,
    /// The largest input (state units / s).
    pub input: f64,
}

impl Run {
    /// Whether nobody was outside, ever.
    #[must_use]
    pub fn is_borne(&self) -> bool {
        self.ratio < 1.0
    }
}

/// One event of a kind on a graph, at a place and time that the number draws.
///
/// # Errors
/// The reader's or the simulation's words.
pub fn happen(kind: &Kind, graph: (&str, &str), number: u64) -> Result<Run, String> {
    let text = text(kind, graph, number);
    let scenario =
        Scenario::parse(&text, Path::new("kind.toml"), &[]).map_err(|errors| errors.to_string())?;
    let simulation = Simulation::new(&scenario).map_err(|refused| refused.to_string())?;
    let verdict = simulation.run();
    // An event that is made of two counts as one.
    let events = &verdict.findings.events;
    let ratio = events.iter().fold(0.0, |largest: f64, event| largest.max(event.during.max_ratio));
    let recovery = events.last().ok_or("no event was judged")?.recovery;
    let input = verdict.findings.max_input.unwrap_or(f64::NAN);
    Ok(Run { text, ratio, recovery, stopped: verdict.stops.len(), input })
}

fn text(kind: &Kind, (_, graph): (&str, &str), number: u64) -> String {
    let mut dice = Dice::of(number);
    let nodes = if graph.contains("random") { 8 } else { 6 };
    let mut text = format!("{NETWORK}seed = {number}\ngraph = {graph}\nbus.model = \"{}\"\n", kind.bus);
    text += kind.settings;
    for id in 1..=nodes {
        let (state, offset) = (dice.between(-1.0, 1.0), dice.between(-2.0, 2.0));
        text += &format!("[[node]]\nid = {id}\nstate = {state:?}\ndynamics = {{ offset = {offset:?} }}\n");
    }
    let node = dice.id(nodes);
    let other = neighbour(&mut dice, &text, node);
    let (at_ms, lasts_ms) = (500 + dice.below(500), 1 + dice.below(300));
    let mut place = Place { dice, nodes, node, other, at_ms, lasts_ms };
    let event = (kind.event)(&mut place);
    // What happens to a wire happens between two ticks, too.
    let within = if kind.bus == "can" { place.dice.below(1_000) } else { 0 };
    text += &format!("[[event]]\nat = \"{}us\"\n{event}\n", 1_000 * at_ms + within);
    text
}

/// A neighbour of a node; another node where the network cannot be read.
fn neighbour(dice: &mut Dice, text: &str, node: usize) -> usize {
    // Without an event there is nothing to come back from.
    let calm: String =
        text.lines().filter(|line| !line.starts_with("expect")).map(|line| format!("{line}\n")).collect();
    let scenario = Scenario::parse(&calm, Path::new("kind.toml"), &[]);
    let edges = scenario.map(|scenario| scenario.graph.edges).unwrap_or_default();
    let others: Vec<_> = edges
        .iter()
        .filter_map(|edge| match (edge.a + 1, edge.b + 1) {
            (a, b) if a == node => Some(b),
            (a, b) if b == node => Some(a),
            _ => None,
        })
        .collect();
    others.get(dice.below(others.len().max(1))).copied().unwrap_or(1)
}
