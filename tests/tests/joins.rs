//! law.md 9: a node comes to a network that runs, far from where the others are, with a plant that it cannot
//! set, or without one. Every state through the bytes of a frame; the plant is the node's own field in f64.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_node::{Action, Event, InputRange, Node, Params, PlantSetup};
use funnelnet_protocol::can;
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::message::{Command, JOIN, Message, Target, TickStamp};
use sim_host::configure::{Drive, listeners, node_configs};
use sim_host::scenario::Scenario;
use system_tests::scenario;

const TICK_NS: u64 = 1_000_000;
/// How long a newcomer is watched, ticks.
const WATCHED: u64 = 3_000;
/// Ticks after it has spoken for which the others are judged without its edges.
const AFTER: u64 = 100;
/// By index; on the ring its neighbours are 1 and 3.
const NEWCOMER: usize = 2;
/// What the actuator of its plant can do, state units / s.
const ACTUATOR: f64 = 300.0;

/// Five agents on a ring.
struct World {
    scenario: Scenario,
    nodes: Vec<Node>,
    /// When the newcomer comes, ticks.
    comes: u64,
    /// Where the newcomer's plant is; none where it has no plant.
    plant: Option<f64>,
    input: f64,
    speaks: bool,
    frames: Vec<(usize, Message)>,
}

/// What came of it.
#[derive(Debug)]
struct Joined {
    /// Ticks from when it came to when it spoke.
    spoke: u64,
    /// The largest true ratio of the others from when it came to a tenth of a second after it has spoken,
    /// without its edges.
    others: f64,
    /// The same with its edges from when it speaks on, for as long as it is watched: a node at the mean of
    /// its neighbours pulls them together.
    with_edges: f64,
    /// Its largest input, state units / s.
    input: f64,
    /// Its bound as a node, state units / s.
    bound: f64,
    /// Ticks after it came from which everybody is inside.
    inside: u64,
}

impl World {
    fn new(end: f64, comes: u64, plant: bool) -> Self {
        let ticks = format!("time.duration={}ms", comes + WATCHED);
        let funnel = [format!("coupling.funnel.end={end}"), format!("coupling.funnel.start={}", 38.0 + end)];
        let sets = [ticks.as_str(), &funnel[0], &funnel[1], "coupling.funnel.rate=4.0"];
        let scenario = scenario("narrow-ring.toml", &sets);
        let configs = |tick_source| {
            let drive = Drive { tick_source, telemetry_every: 0, is_simulated: false };
            node_configs(&scenario, drive).unwrap()
        };
        let (timed, synced) = (configs(TickSource::Timer), configs(TickSource::Sync));
        let node = |index: usize| {
            let config = if index == NEWCOMER { &synced[index] } else { &timed[index] };
            let mut params = Params::new(config).unwrap();
            if plant && index == NEWCOMER {
                let range = InputRange::new(-ACTUATOR as f32, ACTUATOR as f32).unwrap();
                params = params.with_plant(PlantSetup::new([range], 2)).unwrap();
            }
            Node::new(params, &config.neighbours)
        };
        let nodes = (0..timed.len()).map(node).collect();
        let plant = plant.then_some(0.0);
        Self { scenario, nodes, comes, plant, input: 0.0, speaks: false, frames: Vec::new() }
    }

    /// Makes a newcomer of one that waits for no time at which its coming is no jump.
    fn impatient(&mut self) {
        let drive = Drive { tick_source: TickSource::Sync, telemetry_every: 0, is_simulated: false };
        let config = &node_configs(&self.scenario, drive).unwrap()[NEWCOMER];
        let params = Params { newcomer_patience: 0, ..Params::new(config).unwrap() };
        self.nodes[NEWCOMER] = Node::new(params, &config.neighbours);
    }

    /// Gives a message to the nodes that it is for.
    fn deliver(&mut self, now: u64, is_here: bool) {
        let listeners = listeners(&self.scenario);
        for (from, message) in std::mem::take(&mut self.frames) {
            let frame = can::encode(&message);
            let heard = can::decode(frame.id(), frame.data()).unwrap();
            for &to in listeners[from].iter().filter(|&&to| is_here || to != NEWCOMER) {
                // A newcomer refuses states before it knows the tick.
                let _ = self.nodes[to].on_message(&heard, now);
            }
        }
    }

    fn poll(&mut self, index: usize, now: u64) {
        while let Some(action) = self.nodes[index].poll(now) {
            match action {
                Action::Send(message) => self.frames.push((index, message)),
                Action::Sample => self.nodes[index].measured(&[self.plant.unwrap() as f32]),
                Action::Report(Event::Joins { .. }) => self.speaks = true,
                Action::Report(Event::Fault(code)) => panic!("node {} stopped: {code:?}", index + 1),
                Action::Report(_) | Action::Actuate | Action::Safe => {}
            }
        }
    }

    /// The largest true ratios of the others, and of all, with the newcomer's edges or without.
    fn ratios(&self, k: u64, with_edges: bool) -> (f64, f64) {
        let x = |index: usize| match (index, self.plant) {
            (NEWCOMER, Some(x)) => x,
            _ => f64::from(self.nodes[index].observations()[0].x),
        };
        let mut terms = [0.0; 5];
        for edge in &self.scenario.graph.edges {
            if with_edges || (edge.a != NEWCOMER && edge.b != NEWCOMER) {
                let term = edge.weight * (x(edge.b) - x(edge.a));
                terms[edge.a] += term;
                terms[edge.b] -= term;
            }
        }
        let t = self.scenario.time.at_s(k);
        let ratio = |index: usize| terms[index].abs() / self.scenario.nodes[index].funnel.width(t);
        let others = (0..5).filter(|&index| index != NEWCOMER).map(ratio).fold(0.0, f64::max);
        (others, others.max(ratio(NEWCOMER)))
    }

    fn start(&mut self, index: usize, at_tick: u16, now: u64) {
        let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick };
        self.nodes[index].on_message(&start, now).unwrap();
        self.poll(index, now);
    }

    /// The newcomer comes 50 away from where the others are.
    fn run(mut self) -> Joined {
        let comes = self.comes;
        let bound = |world: &Self| {
            let drive = Drive { tick_source: TickSource::Sync, telemetry_every: 0, is_simulated: false };
            f64::from(node_configs(&world.scenario, drive).unwrap()[NEWCOMER].tuning.input_limit)
        };
        let bound = bound(&self);
        (0..5).filter(|&index| index != NEWCOMER).for_each(|index| self.start(index, 0, 0));
        let mut joined =
            Joined { spoke: u64::MAX, others: 0.0, with_edges: 0.0, input: 0.0, bound, inside: 0 };
        for k in 0..comes + WATCHED {
            let now = (k + 1) * TICK_NS;
            self.deliver(now, k >= comes);
            if k == comes {
                if let Some(x) = &mut self.plant {
                    *x = 50.0 + f64::from(self.nodes[0].observations()[0].x);
                }
                self.start(NEWCOMER, JOIN, now);
            }
            if k >= comes {
                let previous_tick = TickStamp::full(k as u32 - 1);
                let sync = Message::Sync { source: None, previous_tick, phase_us: 0 };
                self.nodes[NEWCOMER].on_message(&sync, now).unwrap();
            }
            let here = (0..5).filter(|&index| index != NEWCOMER || k >= comes);
            here.for_each(|index| self.poll(index, now));
            if k < comes {
                continue;
            }
            if self.speaks && joined.spoke == u64::MAX {
                joined.spoke = k - comes;
            }
            if k - comes < joined.spoke.saturating_add(AFTER) {
                joined.others = joined.others.max(self.ratios(k, false).0);
            }
            let (others, all) = self.ratios(k, self.speaks);
            joined.with_edges = joined.with_edges.max(others);
            let outside = all >= 1.0 || !self.speaks;
            joined.inside = if outside { k - comes + 1 } else { joined.inside };
            self.input = f64::from(self.nodes[NEWCOMER].observations()[0].u);
            joined.input = joined.input.max(self.input.abs());
            if let Some(x) = &mut self.plant {
                let field = |t: f64, x: f64| self.scenario.nodes[NEWCOMER].dynamics.value(t, x);
                let (t, half) = (k as f64 * 1e-3, 0.5e-3);
                let middle = *x + half * (field(t, *x) + self.input);
                *x += 1e-3 * (field(t + half, middle) + self.input);
            }
        }
        joined
    }
}

#[test]
fn a_plant_fifty_away_joins_within_what_its_actuator_can_do() {
    for end in [0.02, 0.2] {
        let joined = World::new(end, 3_000, true).run();
        println!("plant, psi {end}: {joined:?}");
        assert!(joined.others < 1.1, "{joined:?}");
        assert!(joined.input <= ACTUATOR.min(joined.bound), "{joined:?}");
        assert!(joined.inside < 3_000, "{joined:?}");
        // 50 away at 300 a second.
        assert!(joined.spoke > 100, "{joined:?}");
    }
}

/// It closes a path whose ends are several funnels apart at most times, and waits for one at which they are
/// not: its coming throws nobody out.
#[test]
fn a_virtual_node_joins_when_its_coming_is_no_jump() {
    for (end, comes) in [0.02, 0.2].into_iter().flat_map(|end| (0..8).map(move |n| (end, 2_700 + 330 * n))) {
        let joined = World::new(end, comes, false).run();
        println!("virtual, psi {end}, comes at {comes} ms: {joined:?}");
        assert!(joined.others < 1.1 && joined.inside < 600, "{joined:?}");
        assert!(joined.input <= joined.bound, "{joined:?}");
    }
}

/// The world in which the figures above would be those of a node that does not wait.
#[test]
fn a_virtual_node_that_does_not_wait_throws_its_neighbours_out() {
    let mut world = World::new(0.02, 3_000, false);
    world.impatient();
    let joined = world.run();
    println!("virtual, psi 0.02, waits for nothing: {joined:?}");
    assert!(joined.spoke == 1 && joined.others > 1.1 && joined.with_edges > 1.5, "{joined:?}");
}
