//! Worlds by chance: a scenario as lines, of which all but the first ones may be left out.

mod agents;
mod bus;
mod event;
mod faults;
mod law;
mod settings;

use super::dice::Dice;
use sim_host::scenario::Scenario;
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
}

/// What is known of a network while the rest is drawn.
struct Net {
    nodes: usize,
    /// Ids, the lower one first.
    edges: Vec<(usize, usize)>,
    /// Components of a state.
    components: usize,
    /// `bus.model`.
    bus: &'static str,
    /// Nodes have clocks of their own.
    clocks: bool,
    /// A time master keeps them together.
    sync: bool,
}

impl Net {
    /// The two ends of an edge.
    fn edge(&self, dice: &mut Dice) -> (usize, usize) {
        let (a, b) = self.edges[dice.below(self.edges.len())];
        if dice.is(0.5) { (a, b) } else { (b, a) }
    }
}

/// Length of a run, ms. All is over 800 ms before the end, and 1,000 ms where nodes have to learn the time first.
const LASTS_MS: u64 = 2_500;
const WITH_CLOCKS_MS: u64 = 2_800;

/// The world of a number. What the reader refuses is left out, line by line.
#[must_use]
pub fn draw(number: u64) -> World {
    let mut dice = Dice::of(number);
    // What `check` follows is a network that nothing disturbs.
    let is_calm = dice.is(0.12);
    let (mut world, mut net) = networks(&mut dice, number, if is_calm { 0.3 } else { 0.1 });
    world.optional.extend(agents::nodes(&mut dice, &net, &world.needed));
    if is_calm {
        world.optional.extend(settings::calm(&mut dice));
        return without_what_is_refused(world);
    }
    let is_limited = dice.is(0.2);
    // Of what is disturbed in many ways at once less is promised.
    let is_plain = dice.is(if is_limited { 0.7 } else { 0.4 });
    if !is_plain {
        world.optional.extend(settings::settings(&mut dice));
        world.optional.extend(bus::bus(&mut dice, &mut net));
        world.optional.extend(bus::clocks(&mut dice, &mut net));
    }
    if net.clocks {
        world.lasts_ms = WITH_CLOCKS_MS;
    }
    if is_limited {
        let limits = settings::Limits::drawn(&mut dice);
        world.optional.extend(limits.lines());
        world.optional.extend(event::lie_and_new_start(&mut dice, &net, &limits));
    }
    if dice.is(0.1) {
        world.optional.push(faults::faults(&mut dice, &net));
    }
    for _ in 0..dice.below(7).saturating_sub(2) {
        world.optional.push(event::event(&mut dice, &net));
    }
    if net.clocks && dice.is(0.5) {
        world.optional.push(event::of_clocks(&mut dice, &net));
    }
    without_what_is_refused(world)
}

/// Law, graph and fields that the reader takes: some gains suit some couplings, and some graphs fall apart. `vectors` is how many have states
/// of two components.
fn networks(dice: &mut Dice, number: u64, vectors: f64) -> (World, Net) {
    loop {
        let nodes = 3 + dice.below(7);
        let components = if dice.is(vectors) { 2 } else { 1 };
        let needed = law::law(dice, nodes, components, number);
        let world = World { needed, optional: Vec::new(), lasts_ms: LASTS_MS };
        if let Ok(scenario) = world.scenario() {
            let edges = scenario.graph.edges.iter().map(|edge| (edge.a + 1, edge.b + 1)).collect();
            let nodes = scenario.graph.nodes;
            return (world, Net { nodes, edges, components, bus: "ideal", clocks: false, sync: false });
        }
    }
}

/// An event may change nothing, a setting may not suit another one: the reader says so, and that line goes.
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
