//! Worlds by chance: a scenario as lines, of which all but the first ones may be left out.

use rand_pcg::Pcg64;
use sim_host::random::{self, Purpose};
use sim_host::scenario::Scenario;
use std::fmt::Write as _;
use std::path::Path;

/// A scenario as lines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct World {
    /// What there has to be: graph, law, fields.
    pub needed: Vec<String>,
    /// What may be left out: guards, buses, links, clocks, nodes, events.
    pub optional: Vec<String>,
    /// Length of the run, ms.
    pub lasts_ms: u64,
}

impl World {
    /// The scenario's text. Keys come before tables.
    #[must_use]
    pub fn text(&self) -> String {
        let mut text = format!("version = 1\ntime.tick = \"1ms\"\ntime.duration = \"{}ms\"\n", self.lasts_ms);
        let lines = self.needed.iter().chain(&self.optional);
        let (tables, keys): (Vec<&String>, Vec<&String>) = lines.partition(|line| line.starts_with("[["));
        for line in keys.into_iter().chain(tables) {
            text += line;
            text.push('\n');
        }
        text
    }

    /// The scenario, or why it is refused.
    ///
    /// # Errors
    /// The reader's words.
    pub fn scenario(&self) -> Result<Scenario, String> {
        Scenario::parse(&self.text(), Path::new("campaign.toml"), &[]).map_err(|errors| errors.to_string())
    }

    /// The same network without what disturbs it.
    #[must_use]
    pub fn undisturbed(&self) -> Self {
        let calm = |line: &&String| {
            !line.starts_with("[[event]]") && !line.starts_with("[[link]]") && !line.starts_with("bus")
        };
        Self { optional: self.optional.iter().filter(calm).cloned().collect(), ..self.clone() }
    }
}

/// What draws numbers.
pub(super) struct Dice(Pcg64);

impl Dice {
    /// Those of a number.
    pub(super) fn of(number: u64) -> Self {
        Self(random::stream(number, Purpose::Graph, 0))
    }

    pub(super) fn below(&mut self, n: usize) -> usize {
        random::below(&mut self.0, n)
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        // Three digits, so that a text says it all.
        ((low + (high - low) * random::uniform(&mut self.0)) * 1e3).round() / 1e3
    }

    fn is(&mut self, probability: f64) -> bool {
        random::uniform(&mut self.0) < probability
    }

    fn one<'a>(&mut self, list: &[&'a str]) -> &'a str {
        list[self.below(list.len())]
    }

    /// The id of a node.
    pub(super) fn id(&mut self, nodes: usize) -> usize {
        1 + self.below(nodes)
    }
}

/// The world of a number. What the reader refuses is left out, from the end on.
#[must_use]
pub fn draw(number: u64) -> World {
    let mut dice = Dice::of(number);
    let nodes = 3 + dice.below(7);
    let mut world = World { needed: law(&mut dice, nodes, number), optional: Vec::new(), lasts_ms: 2_500 };
    for id in 1..=nodes {
        world.optional.push(node(&mut dice, id));
    }
    world.optional.extend(settings(&mut dice));
    world.optional.extend(bus(&mut dice, nodes));
    for _ in 0..dice.below(7).saturating_sub(2) {
        world.optional.push(event(&mut dice, nodes));
    }
    without_what_is_refused(world)
}

/// An event may change nothing, a link may not be there: the reader says so, and that line goes.
fn without_what_is_refused(mut world: World) -> World {
    let all = std::mem::take(&mut world.optional);
    for line in all {
        world.optional.push(line);
        if world.scenario().is_err() {
            world.optional.pop();
        }
    }
    world
}

fn law(dice: &mut Dice, nodes: usize, number: u64) -> Vec<String> {
    let graph = dice.one(&["ring", "path", "star", "complete", "random-regular"]);
    let graph = match graph {
        "random-regular" if nodes > 3 => {
            format!("{{ kind = \"{graph}\", nodes = {}, degree = 3 }}", nodes + nodes % 2)
        }
        "random-regular" => format!("{{ kind = \"ring\", nodes = {nodes} }}"),
        _ => format!("{{ kind = \"{graph}\", nodes = {nodes} }}"),
    };
    let kind = dice.one(&["node-wise", "node-wise", "node-wise", "edge-wise", "max-gain"]);
    let gain = match dice.below(4) {
        0 => "{ kind = \"logarithmic\", scale = 1.0 }".to_owned(),
        1 => "{ kind = \"algebraic\", scale = 1.0 }".to_owned(),
        _ => format!("{{ kind = \"reciprocal\", scale = {} }}", dice.between(0.3, 3.0)),
    };
    let end = dice.between(0.1, 1.0);
    let funnel = match dice.below(3) {
        0 => format!("{{ kind = \"constant\", width = {end} }}"),
        _ => format!(
            "{{ kind = \"exponential\", start = {}, end = {end}, rate = {} }}",
            end * 4.0,
            dice.between(0.5, 5.0)
        ),
    };
    vec![
        format!("seed = {number}"),
        format!("graph = {graph}"),
        format!("coupling.kind = \"{kind}\""),
        format!("coupling.gain = {gain}"),
        format!("coupling.funnel = {funnel}"),
        format!("agent.dynamics = {{ kind = \"affine\", slope = {} }}", dice.between(-2.0, 0.0)),
    ]
}

fn node(dice: &mut Dice, id: usize) -> String {
    let mut line = format!("[[node]]\nid = {id}\ndynamics = {{ offset = {}", dice.between(-1.0, 1.0));
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

fn settings(dice: &mut Dice) -> Vec<String> {
    let mut lines = Vec::new();
    if dice.is(0.3) {
        lines.push("coupling.guard = 0.1".to_owned());
    }
    if dice.is(0.2) {
        lines.push("time.slow_start = \"10ms\"".to_owned());
    }
    if dice.is(0.2) {
        lines.push(format!("agent.noise = {}", dice.between(0.001, 0.01)));
    }
    if dice.is(0.2) {
        lines.push("agent.compute = \"100us\"".to_owned());
    }
    if dice.is(0.15) {
        lines.push(format!("coupling.on_breach = \"{}\"", dice.one(&["ride", "stop"])));
    }
    if dice.is(0.1) {
        lines.push("safety.lost_neighbours = 2".to_owned());
    }
    lines
}

fn bus(dice: &mut Dice, nodes: usize) -> Vec<String> {
    let mut lines = Vec::new();
    let model = dice.one(&["ideal", "ideal", "can", "can-fd", "uart"]);
    if model != "ideal" {
        lines.push(format!("bus.model = \"{model}\""));
    }
    if dice.is(0.2) {
        lines.push(format!("bus.loss = {}", dice.between(0.001, 0.1)));
    }
    if model.starts_with("can") && dice.is(0.3) {
        lines.push("bus.bit_errors = 1e-5".to_owned());
    }
    if dice.is(0.2) {
        let from = dice.id(nodes);
        lines.push(format!(
            "[[link]]\nbetween = [{from}, {}]\nloss = {}\njitter = \"{}us\"\nreorder = 0.01\nduplicate = 0.01",
            from % nodes + 1,
            dice.between(0.0, 0.2),
            dice.below(400)
        ));
    }
    if model.starts_with("can") && dice.is(0.3) {
        lines.push("clock.drift_ppm = 50.0\nsync.period = \"100ms\"".to_owned());
    }
    lines
}

/// All is over 800 ms before the end.
fn event(dice: &mut Dice, nodes: usize) -> String {
    let (at, lasts) = (300 + dice.below(1_000), 1 + dice.below(300));
    let node = dice.id(nodes);
    let link = format!("link = [{node}, {}]", node % nodes + 1);
    let said = match dice.below(3) {
        0 => format!("constant = {}", dice.between(-5.0, 5.0)),
        1 => format!("ramp = {}", dice.between(-5.0, 5.0)),
        _ => format!("offset = {}", dice.between(-2.0, 2.0)),
    };
    let half = nodes / 2;
    let ids = |range: std::ops::RangeInclusive<usize>| {
        range.map(|id| id.to_string()).collect::<Vec<_>>().join(", ")
    };
    let rest = match dice.below(19) {
        0 => format!("kind = \"bounce\"\nnode = {node}\nfor = \"{lasts}ms\""),
        1 => format!("kind = \"crash\"\nnode = {node}"),
        2 => format!("kind = \"leave\"\nnode = {node}"),
        3 => {
            let (groups, until) = (format!("[[{}], [{}]]", ids(1..=half), ids(half + 1..=nodes)), at + lasts);
            format!(
                "kind = \"partition\"\ngroups = {groups}\n[[event]]\nat = \"{until}ms\"\nkind = \"repair\""
            )
        }
        4 => format!("kind = \"burst\"\nfor = \"{lasts}ms\"\nloss = {}", dice.between(0.1, 1.0)),
        5 => format!(
            "kind = \"burst\"\n{link}\nfor = \"{lasts}ms\"\nloss = {{ to_bad = 0.05, to_good = 0.1 }}"
        ),
        6 => format!("kind = \"hold\"\n{link}\nfor = \"{lasts}ms\""),
        7 => format!(
            "kind = \"corrupt\"\n{link}\nfor = \"{lasts}ms\"\nprobability = {}",
            dice.between(0.01, 0.3)
        ),
        8 => format!("kind = \"noise\"\nfor = \"{lasts}ms\"\nbit_errors = {}", dice.between(0.001, 0.02)),
        9 => format!("kind = \"liar\"\nnode = {node}\nfor = \"{lasts}ms\"\n{said}"),
        10 => format!(
            "kind = \"replayer\"\nnode = {node}\nfor = \"{lasts}ms\"\nage = \"{}ms\"",
            1 + dice.below(300)
        ),
        11 => format!(
            "kind = \"impostor\"\nnode = {node}\nas = {}\nfor = \"{lasts}ms\"\n{said}",
            dice.id(nodes)
        ),
        12 => format!("kind = \"cut\"\nnode = {node}\nfor = \"{lasts}ms\""),
        13 => format!("kind = \"short\"\nfor = \"{}us\"", 100 + dice.below(5_000)),
        14 => format!("kind = \"babble\"\nnode = {node}\nfor = \"{lasts}ms\"\nid = {}", dice.below(2) * 2047),
        15 => {
            let fails = match dice.below(4) {
                0 => said,
                1 => format!("noise = {}", dice.between(0.01, 0.5)),
                2 => format!("loss = {}", dice.between(0.05, 0.5)),
                _ => format!("age = \"{}ms\"", 1 + dice.below(50)),
            };
            format!("kind = \"sensor\"\nnode = {node}\nfor = \"{lasts}ms\"\n{fails}")
        }
        16 => {
            let fails = match dice.below(4) {
                0 => format!("effectiveness = {}", dice.between(0.0, 0.9)),
                1 => format!("limit = {}", dice.between(0.1, 2.0)),
                2 => format!("constant = {}", dice.between(-5.0, 5.0)),
                _ => format!("ramp = {}", dice.between(-5.0, 5.0)),
            };
            format!("kind = \"actuator\"\nnode = {node}\nfor = \"{lasts}ms\"\n{fails}")
        }
        17 => {
            let (key, value) = match dice.below(4) {
                0 => ("coupling.gain", "{ kind = \"logarithmic\", scale = 2.0 }".to_owned()),
                1 => ("agent.limits", "{ low = -20.0, high = 20.0 }".to_owned()),
                2 => (
                    "agent.dynamics",
                    format!("{{ kind = \"affine\", slope = {} }}", dice.between(-2.0, 0.0)),
                ),
                _ => (
                    "coupling.funnel",
                    format!("{{ kind = \"constant\", width = {} }}", dice.between(0.1, 5.0)),
                ),
            };
            let of_one = if dice.is(0.5) { format!("node = {node}\n") } else { String::new() };
            format!("kind = \"set\"\n{of_one}key = \"{key}\"\nvalue = {value}")
        }
        _ => format!("kind = \"join\"\nnode = {node}"),
    };
    format!("[[event]]\nat = \"{at}ms\"\n{rest}")
}
