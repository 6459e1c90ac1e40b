//! What a bus that loses, delays or disturbs makes of the states: each node hears its neighbours as law.md 5
//! has it.

use super::Bounds;
use super::member::Member;
use crate::bus::loss::Loser;
use crate::noise::Noise;
use crate::random::{self, Purpose};
use crate::scenario::Scenario;
use funnelnet_law::start::PARTS;
use funnelnet_node::neighbour::WINDOW_BACK;
use rand_pcg::Pcg64;

/// What one node has heard of one component of a neighbour.
#[derive(Clone, Copy, Default)]
struct Ear {
    /// The tick that the value is of; none before the first, and after the edge was given up.
    tick: Option<u64>,
    value: f64,
    increment: f64,
    /// Nothing was heard before.
    is_new: bool,
}

impl Ear {
    fn hear(&mut self, tick: u64, value: f64) {
        match self.tick {
            None => *self = Self { tick: Some(tick), value, increment: 0.0, is_new: true },
            Some(before) if tick > before => {
                let increment = (value - self.value) / (tick - before) as f64;
                *self = Self { tick: Some(tick), value, increment, is_new: self.is_new };
            }
            // What comes too late says nothing new.
            Some(_) => {}
        }
    }
}

/// One end of an edge.
struct End {
    at: usize,
    weight: f64,
    ears: Vec<Ear>,
}

/// A frame under way: when it is heard, of what tick it is, and what it says of which node.
struct Frame {
    heard: u64,
    tick: u64,
    from: usize,
    component: usize,
    value: f64,
}

/// The bus of a scenario.
pub(super) struct Bus<'s> {
    scenario: &'s Scenario,
    /// Ticks for which a silent neighbour is extrapolated, and by how much in each at most (state units).
    extrapolate: u64,
    slope: f64,
    /// Empty where the bus is perfect.
    ends: Vec<End>,
    /// The ends that hear each node, by index.
    listeners: Vec<Vec<usize>>,
    frames: Vec<Frame>,
    noise: Noise,
    jitter: Vec<Pcg64>,
    loss: Vec<Loser>,
}

impl<'s> Bus<'s> {
    /// Whether everything comes at once and as it was sent.
    pub fn is_perfect(scenario: &Scenario) -> bool {
        let bus = &scenario.bus;
        let in_time = bus.latency_ns.saturating_add(bus.jitter_ns) <= scenario.time.tick_ns
            && bus.latency_ns < scenario.time.tick_ns;
        in_time && bus.loss.is_none() && scenario.nodes.iter().all(|node| node.noise == 0.0)
    }

    pub fn new(scenario: &'s Scenario, bounds: Bounds) -> Self {
        let stream = |purpose, node| random::stream(scenario.seed, purpose, node);
        let nodes = 0..scenario.nodes.len() as u64;
        let loser = |node| Loser::new(scenario.bus.loss, stream(Purpose::Loss, node));
        let mut bus = Self {
            scenario,
            extrapolate: bounds.extrapolate.into(),
            slope: bounds.slope.unwrap_or(f64::INFINITY) * scenario.time.tick_s(),
            ends: Vec::new(),
            listeners: vec![Vec::new(); scenario.nodes.len()],
            frames: Vec::new(),
            noise: Noise::of(scenario),
            jitter: nodes.clone().map(|node| stream(Purpose::Jitter, node)).collect(),
            loss: nodes.map(loser).collect(),
        };
        if !Self::is_perfect(scenario) {
            for edge in &scenario.graph.edges {
                bus.connect(edge.a, edge.b, edge.weight);
                bus.connect(edge.b, edge.a, edge.weight);
            }
        }
        bus
    }

    fn connect(&mut self, at: usize, from: usize, weight: f64) {
        self.listeners[from].push(self.ends.len());
        let ears = vec![Ear::default(); self.scenario.components()];
        self.ends.push(End { at, weight, ears });
    }

    /// From now on a tick lasts as long as eight did.
    pub fn stretch(&mut self) {
        for ear in self.ends.iter_mut().flat_map(|end| &mut end.ears) {
            ear.increment *= f64::from(PARTS);
        }
    }

    /// The states of tick `k` go out; what is heard by then is what the nodes believe in.
    pub fn carry(&mut self, k: u64, members: &mut [Member<'_>]) {
        if self.ends.is_empty() {
            return;
        }
        self.send(k, members);
        self.deliver(k);
        for member in members.iter_mut() {
            for part in &mut member.parts {
                (part.nu, part.dnu, part.is_disturbed) = (0.0, 0.0, false);
            }
        }
        for end in &mut self.ends {
            for (part, ear) in members[end.at].parts.iter_mut().zip(&mut end.ears) {
                part.is_disturbed |= std::mem::take(&mut ear.is_new);
                let Some(tick) = ear.tick else { continue };
                let age = k - tick;
                part.is_disturbed |= age > 0;
                if age > self.extrapolate {
                    ear.tick = None;
                    continue;
                }
                let increment =
                    if age == 0 { ear.increment } else { ear.increment.clamp(-self.slope, self.slope) };
                part.nu += end.weight * (ear.value + age as f64 * increment - part.x);
                part.dnu += end.weight * (increment - part.dx);
            }
        }
        for member in members.iter_mut().filter(|member| member.parts.iter().any(|part| part.is_disturbed)) {
            member.parts.iter_mut().for_each(|part| part.memory.disturb());
        }
    }

    fn send(&mut self, k: u64, members: &[Member<'_>]) {
        let (bus, tick_ns) = (&self.scenario.bus, self.scenario.time.tick_ns);
        for (from, member) in members.iter().enumerate() {
            for (component, part) in member.parts.iter().enumerate() {
                let more = match bus.jitter_ns {
                    0 => 0.0,
                    width => width as f64 * random::uniform(&mut self.jitter[from]),
                };
                let late = bus.latency_ns.saturating_add(more as u64) / tick_ns;
                // In f32 only where there is noise: rounding is not followed.
                let value = match self.noise.is_none() {
                    true => part.x,
                    false => f64::from(self.noise.measure(from, part.x as f32)),
                };
                if late <= u64::from(WINDOW_BACK) {
                    self.frames.push(Frame { heard: k + late, tick: k, from, component, value });
                }
            }
        }
    }

    fn deliver(&mut self, k: u64) {
        let mut frames = std::mem::take(&mut self.frames);
        frames.retain(|frame| {
            let due = frame.heard <= k;
            if due {
                self.hear(frame);
            }
            !due
        });
        self.frames = frames;
    }

    fn hear(&mut self, frame: &Frame) {
        for &end in &self.listeners[frame.from] {
            let end = &mut self.ends[end];
            if !self.loss[end.at].loses() {
                end.ears[frame.component].hear(frame.tick, frame.value);
            }
        }
    }
}
