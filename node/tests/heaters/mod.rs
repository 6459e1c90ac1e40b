//! Heaters with losses on a path of sampled nodes: the plants are integrated finely, and their nodes know
//! them badly.

use funnelnet_law::VectorField;
use funnelnet_node::{InputRange, Model, Output, PlantSetup, Session};
use funnelnet_protocol::config::{ConfigError, EdgeConfig, Funnel, Gain, NodeConfig, Shape, TickSource};
use funnelnet_protocol::message::{Command, Component, Message, NodeId, Target, TickStamp};
use funnelnet_protocol::serial::Frame;
use funnelnet_protocol::service::Identity;

/// Tick period, s.
pub const TICK_S: f64 = 0.1;
/// Steps of a plant per tick.
const FINE: u32 = 20;

/// `x' = -loss (x - 15) + power + u`: a body at temperature `x` (degrees C) in a room of 15.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Heater {
    /// 1/s.
    pub loss: f64,
    /// K/s.
    pub power: f64,
    /// Degrees C.
    pub x: f64,
    /// What the actuator does, K/s.
    pub u: f64,
}

impl Heater {
    fn rate(&self, x: f64) -> f64 {
        -self.loss * (x - 15.0) + self.power
    }

    /// Where it ends without an input, degrees C.
    pub fn alone(&self) -> f64 {
        15.0 + self.power / self.loss
    }

    /// One tick.
    pub fn advance(&mut self) {
        for _ in 0..FINE {
            self.x += TICK_S / f64::from(FINE) * (self.rate(self.x) + self.u);
        }
    }
}

/// What a node knows of its heater.
#[derive(Clone, Debug)]
pub struct Known {
    pub heater: Heater,
    pub plant: PlantSetup,
}

impl Known {
    /// 30 % wrong about the losses and 20 % about the power.
    pub fn badly(heater: Heater) -> Self {
        let heater = Heater { loss: 1.3 * heater.loss, power: 0.8 * heater.power, ..heater };
        let input = InputRange::new(-100.0, 100.0).unwrap();
        Self { heater, plant: PlantSetup::new([input], 3) }
    }
}

impl Model for Known {
    type Field = Heater;

    fn field(&self, _: &NodeConfig, _: f64) -> Result<Heater, ConfigError> {
        Ok(self.heater)
    }

    fn plant(&self) -> Option<PlantSetup> {
        Some(self.plant.clone())
    }
}

impl VectorField<f32> for Heater {
    fn at(&self, _: u64, x: f32) -> f32 {
        self.rate(f64::from(x)) as f32
    }
}

pub fn id(number: u8) -> NodeId {
    NodeId::new(number).unwrap()
}

pub fn state(source: u8, tick: u32, x: f32) -> Message {
    Message::State { source: id(source), component: Component::FIRST, tick: TickStamp::full(tick), x }
}

pub fn sync(marked: u32) -> Message {
    Message::Sync { source: None, previous_tick: TickStamp::low(marked.wrapping_sub(1), 24), phase_us: 0 }
}

pub fn command(command: Command) -> Message {
    Message::Ctrl { target: Target::All, command, arg: 0, at_tick: 0 }
}

/// A node with the neighbours `others`, all edges of weight 1.
pub fn config(own: u8, others: &[u8]) -> NodeConfig {
    let edge = |&id: &u8| EdgeConfig { id, weight: 1.0, edges: 2 };
    NodeConfig::builder(own, (TICK_S * 1e9) as u32)
        .tick_source(TickSource::Sync)
        .state([15.0])
        .state_limit(200.0)
        .gain(Gain::Reciprocal { scale: 0.3 })
        .funnel(Shape::Exponential { start: 60.0, end: 0.5, rate: 0.1 })
        .edges(others.iter().map(edge))
        .extrapolate_ticks(3)
        .build()
        .unwrap()
}

pub fn constant(width: f32) -> Funnel<f32> {
    Funnel { factor: 1.0, shape: Shape::Constant { width } }
}

/// A configured session whose program has started.
pub fn session<M: Model>(model: M, config: NodeConfig) -> Session<M> {
    let mut session = Session::with_model(
        Identity { wire_version: 1, firmware: [0; 3], id: 0, uid: 0, ..Identity::default() },
        model,
    );
    assert_eq!(session.poll(0), Some(Output::Safe), "at the start of the program");
    *session.config_buffer() = Some(config);
    session.restore().unwrap();
    session
}

pub fn tell<M: Model>(session: &mut Session<M>, message: Message) {
    session.on_frame(Ok(Frame::RealTime(message)), 0);
}

/// A network of heaters in lockstep.
pub struct Heaters {
    pub plants: Vec<Heater>,
    pub sessions: Vec<Session<Known>>,
    /// Nodes (by index) whose sensor fails.
    pub blind: Vec<usize>,
    /// What the apps were asked to do, but for what goes to the link.
    pub asked: Vec<(usize, Output)>,
    pub tick: u32,
}

impl Heaters {
    /// A path of nodes 1, 2, ..., started.
    pub fn path(plants: Vec<Heater>, configure: impl Fn(NodeConfig) -> NodeConfig) -> Self {
        let last = plants.len() as u8;
        let neighbours = |id: u8| [id - 1, id + 1].into_iter().filter(|&id| id >= 1 && id <= last).collect();
        let node = |(&heater, id): (&Heater, u8)| {
            let others: Vec<_> = neighbours(id);
            session(Known::badly(heater), configure(config(id, &others)))
        };
        let sessions = plants.iter().zip(1..).map(node).collect();
        let mut heaters = Self { plants, sessions, blind: Vec::new(), asked: Vec::new(), tick: 0 };
        heaters.tell_all(command(Command::Start));
        heaters
    }

    pub fn run(&mut self, ticks: u32) {
        for _ in 0..ticks {
            self.tell_all(sync(self.tick));
            self.plants.iter_mut().for_each(Heater::advance);
            self.tick += 1;
        }
    }

    /// Largest difference of two temperatures, K.
    pub fn spread(&self) -> f64 {
        let x = self.plants.iter().map(|plant| plant.x);
        x.clone().fold(f64::MIN, f64::max) - x.fold(f64::MAX, f64::min)
    }

    /// All hear it at the same time; what they say then arrives before anything else.
    pub fn tell_all(&mut self, message: Message) {
        self.sessions.iter_mut().for_each(|session| tell(session, message));
        let said: Vec<_> = (0..self.sessions.len()).flat_map(|index| self.drain(index)).collect();
        for (source, message) in said {
            for (index, session) in self.sessions.iter_mut().enumerate().filter(|&(index, _)| index != source)
            {
                let near = index.abs_diff(source) == 1;
                if near {
                    tell(session, message);
                }
            }
        }
    }

    /// The app of one node.
    fn drain(&mut self, index: usize) -> Vec<(usize, Message)> {
        let (session, plant) = (&mut self.sessions[index], &mut self.plants[index]);
        let mut said = Vec::new();
        while let Some(output) = session.poll(0) {
            match output {
                Output::Sample if self.blind.contains(&index) => session.sample_failed(),
                Output::Sample => session.measured(&[plant.x as f32]),
                Output::Actuate => plant.u = f64::from(session.inputs()[0]),
                Output::Send(message) => {
                    said.push((index, message));
                    continue;
                }
                Output::Safe => plant.u = 0.0,
                _ => {}
            }
            self.asked.push((index, output));
        }
        said
    }
}
