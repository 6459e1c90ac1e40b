//! Edges that fall silent and come back (law.md 9): the shipped nodes behind the engine, on a bus of which
//! single links fail, judged by true states.
//!
//! "Today" is the law before the second edition, on the same nodes: law (*), no bounded input, a silent
//! neighbour extrapolated for ten ticks, no input once all edges are gone. Rounding, first tick, floor and
//! how a node joins are those of the shipped node in both, but that a newcomer waited for nothing.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]
#![allow(
    clippy::approx_constant,
    reason = "phases are drawn from about a turn; another bound would draw others than those of the note"
)]

use funnelnet_law::field::PreparedField;
use funnelnet_law::law::node_wise::{Constants, NodeWise};
use funnelnet_law::math::Real;
use funnelnet_node::{Event, Node, Params};
use funnelnet_protocol::can::{self, CanFrame};
use funnelnet_protocol::config::{Coupling, NodeConfig, TickSource};
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use rand_pcg::Pcg64;
use sim_host::bus::{Medium, Traffic};
use sim_host::configure::{Drive, listeners, node_configs};
use sim_host::engine::{Engine, World};
use sim_host::random::{self, Purpose};
use sim_host::scenario::Scenario;
use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::path::Path;
use std::rc::Rc;

/// Ticks before anything happens; what they show is not judged.
pub const SETTLING: u64 = 2_500;
/// Ticks from there to a cut or a restart.
const BEFORE: u64 = 500;
const TICK_NS: u64 = 1_000_000;
/// Ticks for which the law before the second edition extrapolates.
const TODAY_EXTRAPOLATES: u8 = 10;

/// What happens to the edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outage {
    /// Nothing.
    None,
    /// Each edge is silent for 50 ticks every 3 s, both ways, each at a time of its own: a cable that
    /// wobbles.
    Wobble,
    /// Each way of each edge loses bursts of 20 ticks on average, a tenth of the time.
    Bursts,
    /// The network falls into two halves for so many ticks.
    Halves(u64),
    /// A node crashes, is off for so many ticks, and joins.
    Restart(u64),
    /// The same, but it is told to stop, and says goodbye; before the second edition nobody did.
    Leave(u64),
}

impl Outage {
    /// Ticks of a run, what is not judged included.
    #[must_use]
    pub fn ticks(self) -> u64 {
        SETTLING
            + match self {
                Self::None | Self::Wobble => 6_000,
                Self::Bursts => 3_000,
                Self::Halves(ticks) | Self::Restart(ticks) | Self::Leave(ticks) => BEFORE + ticks + 1_500,
            }
    }

    /// The tick at which it is over, where it is one thing that happens once.
    #[must_use]
    pub fn end(self) -> Option<u64> {
        match self {
            Self::None | Self::Wobble | Self::Bursts => None,
            Self::Halves(ticks) | Self::Restart(ticks) | Self::Leave(ticks) => {
                Some(SETTLING + BEFORE + ticks)
            }
        }
    }
}

/// A network: graph, width of the funnel at the end, and the draw of states, fields and of what happens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// `ring`, `path` or `star` of eleven, or `complete` of five.
    pub graph: &'static str,
    /// State units.
    pub psi: f64,
    /// The draw.
    pub seed: u64,
}

impl Case {
    fn edges(&self) -> (usize, Vec<(usize, usize)>) {
        match self.graph {
            // With two chords: a ring of eleven falls apart too easily.
            "ring" => (11, (0..11).map(|i| (i, (i + 1) % 11)).chain([(0, 5), (2, 8)]).collect()),
            "path" => (11, (0..10).map(|i| (i, i + 1)).collect()),
            "star" => (11, (1..11).map(|i| (0, i)).collect()),
            _ => (5, (0..5).flat_map(|i| (0..i).map(move |j| (j, i))).collect()),
        }
    }

    /// The node that restarts, by index: one with as many edges as any.
    fn restarts(&self) -> usize {
        match self.graph {
            "ring" => 5,
            "path" | "star" => 3,
            _ => 0,
        }
    }

    /// Its scenario for so many ticks.
    fn scenario(&self, outage: Outage, edition: Edition) -> Scenario {
        let mut draw = random::stream(self.seed, Purpose::Graph, 0);
        let (nodes, edges) = self.edges();
        let mut uniform = |width: f64| width * random::uniform(&mut draw);
        let node = |index: usize| {
            let (slope, state) = (-1.25 + uniform(0.5), -1.0 + uniform(2.0));
            let (slow, fast) = ((uniform(10.0), uniform(6.28)), (uniform(10.0), uniform(6.28)));
            format!(
                "[[node]]\nid = {}\nstate = {state}\ndynamics = {{ kind = \"affine\", slope = {slope}, sines = [\
                 {{ amplitude = 10.0, frequency = 1.0 }}, {{ amplitude = {}, frequency = 0.1, phase = {} }}, \
                 {{ amplitude = {}, frequency = 10.0, phase = {} }}] }}\n",
                index + 1,
                slow.0,
                slow.1,
                fast.0,
                fast.1
            )
        };
        let nodes_text: String = (0..nodes).map(node).collect();
        let edges: Vec<_> = edges.iter().map(|(a, b)| format!("[{}, {}]", a + 1, b + 1)).collect();
        let (goes, node) = (SETTLING + BEFORE, self.restarts() + 1);
        let event = match outage {
            Outage::Leave(ticks) if edition != Edition::Today => format!(
                "event = [{{ at = \"{goes}ms\", kind = \"leave\", node = {node} }}, \
                 {{ at = \"{}ms\", kind = \"join\", node = {node} }}]\n",
                goes + ticks
            ),
            Outage::Restart(ticks) | Outage::Leave(ticks) => format!(
                "event = [{{ at = \"{goes}ms\", kind = \"bounce\", node = {node}, for = \"{ticks}ms\" }}]\n"
            ),
            _ => String::new(),
        };
        let text = format!(
            "version = 1\nseed = {}\n{event}[time]\ntick = \"1ms\"\nduration = \"{}ms\"\n\
             [graph]\nkind = \"edges\"\nnodes = {nodes}\nedges = [{}]\n\
             [coupling]\nkind = \"node-wise\"\ngain = {{ kind = \"reciprocal\", scale = 1.0 }}\n\
             funnel = {{ kind = \"exponential\", start = {}, end = {}, rate = 4.0 }}\n\
             [agent]\ndynamics = {{ kind = \"affine\" }}\n{nodes_text}",
            self.seed,
            outage.ticks(),
            edges.join(", "),
            20.0 + self.psi,
            self.psi
        );
        Scenario::parse(&text, Path::new("outage.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}"))
    }
}

/// What a run comes to, after it has settled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Node-ticks.
    pub node_ticks: u64,
    /// Of them truly outside.
    pub outside: u64,
    /// Of these, those after the end of an outage that ends.
    pub outside_after: u64,
    /// The largest true ratio.
    pub ratio: f64,
    /// The largest input, state units / s; before it has settled, too.
    pub input: f64,
    /// Ticks from the end of the outage to the last one at which a node is outside.
    pub after: u64,
}

impl Seen {
    /// Share of node-ticks outside.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.outside as f64 / self.node_ticks as f64
    }
}

/// Which law runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edition {
    /// That before the second edition.
    Today,
    /// The shipped one.
    Second,
    /// The shipped one, where a silent neighbour is extrapolated for so many ticks.
    Extrapolating(u8),
}

/// Runs a case.
#[must_use]
pub fn run(case: &Case, outage: Outage, edition: Edition) -> Seen {
    let scenario = case.scenario(outage, edition);
    let configs = |tick_source| configs(&scenario, tick_source, edition);
    let (timed, synced) = (configs(TickSource::Timer), configs(TickSource::Sync));
    let bus = Failing::new(case, &scenario, outage);
    let carried = Rc::clone(&bus.carried);
    let mut engine = Engine::new(nodes(&timed, edition), bus);
    if !scenario.events.is_empty() {
        let fresh = nodes(&synced, edition);
        engine = engine.with_world(World::new(&scenario.course(), TICK_NS, listeners(&scenario), fresh));
    }
    let mut today = Today { configs: timed, carried, alone: vec![false; scenario.nodes.len()] };
    engine.start();
    let mut judge = Judge::new(&scenario, outage);
    for k in 0..=scenario.time.ticks {
        if edition == Edition::Today && scenario.events.is_empty() {
            today.forget_inputs_of_who_is_alone(&mut engine, k);
        }
        engine.advance().unwrap();
        let said = engine.take_events();
        judge.tick(k, &engine, said.into_iter().map(|said| (said.node, said.event)));
    }
    judge.seen
}

/// What the nodes of a scenario are told; the bounds are those of a network that something may disturb.
#[must_use]
pub fn configs(scenario: &Scenario, tick_source: TickSource, edition: Edition) -> Vec<NodeConfig> {
    let drive = Drive { tick_source, telemetry_every: 0, is_simulated: false };
    let mut configs = node_configs(scenario, drive).unwrap();
    match edition {
        Edition::Today => configs.iter_mut().for_each(forget_bounds),
        Edition::Second => {}
        Edition::Extrapolating(ticks) => {
            configs.iter_mut().for_each(|config| config.extrapolate_ticks = ticks);
        }
    }
    configs
}

/// The nodes of some configurations.
#[must_use]
pub fn nodes<F: Real>(configs: &[NodeConfig], edition: Edition) -> Vec<Node<F>> {
    configs.iter().map(|config| Node::new(params(config, edition), &config.neighbours)).collect()
}

fn forget_bounds(config: &mut NodeConfig) {
    config.extrapolate_ticks = TODAY_EXTRAPOLATES;
    (config.tuning.input_limit, config.tuning.slope_limit) = (0.0, 0.0);
}

fn params<F: Real>(config: &NodeConfig, edition: Edition) -> Params<F> {
    let mut params = Params::new(config).unwrap();
    if edition == Edition::Today {
        params.newcomer_patience = 0;
        let degree = config.neighbours.iter().map(|edge| f64::from(edge.weight)).sum();
        let period = config.period_ns() as f64 * 1e-9;
        params.law = NodeWise::with(params.law.gain, period, degree, Constants::WITHOUT_LOOK_BACK);
    }
    params
}

/// The tick of the last state that each way of an edge has carried, by sender and receiver.
type Carried = Rc<RefCell<BTreeMap<(usize, usize), u64>>>;

/// Has a node without edges lose its input at once, as before the second edition: by a coupling of none for
/// as long. The node that restarts is never without edges once it has joined.
struct Today {
    configs: Vec<NodeConfig>,
    carried: Carried,
    alone: Vec<bool>,
}

impl Today {
    fn forget_inputs_of_who_is_alone(&mut self, engine: &mut Engine<Failing, PreparedField<f32>>, k: u64) {
        for (index, config) in self.configs.iter().enumerate() {
            let carried = self.carried.borrow();
            let age = |id: u8| carried.get(&(usize::from(id) - 1, index)).map_or(0, |last| k - last);
            let alone = config.neighbours.iter().all(|edge| age(edge.id) > u64::from(TODAY_EXTRAPOLATES));
            if std::mem::replace(&mut self.alone[index], alone) != alone {
                let coupling = if alone { Coupling::None } else { Coupling::NodeWise };
                let config = NodeConfig { coupling, ..config.clone() };
                let node = engine.node_mut(index).unwrap();
                node.adopt(params(&config, Edition::Today), &config.neighbours).unwrap();
            }
        }
    }
}

/// A bus without delay, of which single links fail.
struct Failing {
    outage: Outage,
    listeners: Vec<Vec<usize>>,
    flights: VecDeque<(u64, usize, CanFrame)>,
    links: BTreeMap<(usize, usize), Link>,
    carried: Carried,
    traffic: Traffic,
}

/// One way of an edge.
struct Link {
    /// Ticks by which its wobble is shifted, the same both ways.
    phase: u64,
    /// Its ends are in different halves.
    is_between: bool,
    is_bad: bool,
    draw: Pcg64,
}

/// Ticks of a wobble, and from one to the next.
const WOBBLE: (u64, u64) = (50, 3_000);
/// Probabilities that a good link turns bad at a tick, and that a bad one turns good: bad for a tenth of the
/// time, 20 ticks on average.
const TO_BAD: f64 = 1.0 / 180.0;
const TO_GOOD: f64 = 1.0 / 20.0;

impl Failing {
    fn new(case: &Case, scenario: &Scenario, outage: Outage) -> Self {
        let (nodes, edges) = case.edges();
        let half = |node: usize| node >= nodes.div_ceil(2);
        let mut phases = random::stream(case.seed, Purpose::Jitter, 0);
        let mut links = BTreeMap::new();
        for (index, (a, b)) in edges.into_iter().enumerate() {
            let phase = random::below(&mut phases, WOBBLE.1 as usize) as u64;
            for (way, from, to) in [(0, a, b), (1, b, a)] {
                let draw = random::stream(case.seed, Purpose::Loss, 2 * index as u64 + way);
                let link = Link { phase, is_between: half(from) != half(to), is_bad: false, draw };
                links.insert((from, to), link);
            }
        }
        let listeners = listeners(scenario);
        let (flights, carried, traffic) = (VecDeque::new(), Carried::default(), Traffic::default());
        Self { outage, listeners, flights, links, carried, traffic }
    }

    /// Whether a frame with the state of tick `k` gets through.
    fn carries(&mut self, from: usize, to: usize, k: u64) -> bool {
        let Some(link) = self.links.get_mut(&(from, to)).filter(|_| k > SETTLING) else { return true };
        match self.outage {
            Outage::None | Outage::Restart(_) | Outage::Leave(_) => true,
            Outage::Wobble => (k + link.phase) % WOBBLE.1 >= WOBBLE.0,
            Outage::Bursts => {
                let turns = random::happens(&mut link.draw, if link.is_bad { TO_GOOD } else { TO_BAD });
                link.is_bad ^= turns;
                !link.is_bad
            }
            Outage::Halves(ticks) => {
                let cut = SETTLING + BEFORE < k && k <= SETTLING + BEFORE + ticks;
                !(cut && link.is_between)
            }
        }
    }
}

impl Medium for Failing {
    fn send(&mut self, now: u64, sender: usize, message: &Message) {
        self.traffic.sent += 1;
        self.flights.push_back((now, sender, can::encode(message)));
    }

    fn next_arrival(&self) -> Option<u64> {
        self.flights.front().map(|flight| flight.0)
    }

    fn deliver(&mut self, mut receive: impl FnMut(usize, Result<Message, Refusal>)) {
        let Some((at, sender, frame)) = self.flights.pop_front() else { return };
        // A state is that of the tick which comes next.
        let k = at / TICK_NS;
        for to in self.listeners[sender].clone() {
            if self.carries(sender, to, k) {
                self.carried.borrow_mut().insert((sender, to), k);
                receive(to, can::decode(frame.id(), frame.data()));
            } else {
                self.traffic.lost += 1;
            }
        }
    }

    fn set_listeners(&mut self, listeners: Vec<Vec<usize>>) {
        self.listeners = listeners;
    }

    fn traffic(&self) -> Traffic {
        self.traffic
    }
}

/// Judges by the states that nodes have, and by the scenario's funnel. A node that is off, or only listens,
/// has no edges.
struct Judge<'s> {
    scenario: &'s Scenario,
    end: Option<u64>,
    listens: Vec<bool>,
    seen: Seen,
}

impl<'s> Judge<'s> {
    fn new(scenario: &'s Scenario, outage: Outage) -> Self {
        let seen = Seen { node_ticks: 0, outside: 0, outside_after: 0, ratio: 0.0, input: 0.0, after: 0 };
        Self { scenario, end: outage.end(), listens: vec![false; scenario.nodes.len()], seen }
    }

    fn tick(
        &mut self,
        k: u64,
        engine: &Engine<Failing, PreparedField<f32>>,
        said: impl Iterator<Item = (usize, Event)>,
    ) {
        for (node, event) in said {
            match event {
                Event::Listens { .. } => self.listens[node] = true,
                Event::Joins { .. } => self.listens[node] = false,
                Event::Fault(code) => panic!("node {} stopped: {code:?}", node + 1),
                _ => {}
            }
        }
        let seen = engine.observations();
        let is_member = |node: usize| engine.is_on(node) && !self.listens[node];
        let mut terms = vec![0.0; seen.len()];
        for edge in &self.scenario.graph.edges {
            if is_member(edge.a) && is_member(edge.b) {
                let term = edge.weight * (f64::from(seen[edge.b].x) - f64::from(seen[edge.a].x));
                terms[edge.a] += term;
                terms[edge.b] -= term;
            }
        }
        let t = self.scenario.time.at_s(k);
        for node in (0..seen.len()).filter(|&node| is_member(node)) {
            self.seen.input = self.seen.input.max(f64::from(seen[node].u.abs()));
            if k < SETTLING {
                continue;
            }
            let ratio = terms[node].abs() / self.scenario.nodes[node].funnel.width(t);
            self.seen.node_ticks += 1;
            self.seen.ratio = self.seen.ratio.max(ratio);
            if ratio >= 1.0 {
                self.seen.outside += 1;
                self.seen.outside_after += u64::from(self.end.is_some_and(|end| k >= end));
                self.seen.after = self.end.map_or(0, |end| k.saturating_sub(end));
            }
        }
    }
}
