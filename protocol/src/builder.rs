//! A node's configuration, field by field, with defaults for what most nodes leave as it is.

use crate::config::{
    Breach, ConfigError, ConfigField, Coupling, EdgeConfig, Field, Funnel, Gain, HeardLimits, Limits,
    MAX_COMPONENTS, MAX_NEIGHBOURS, NodeConfig, Program, Shape, Sine, TickSource, TimeRules, Tuning,
};
use funnelnet_law::range::LARGEST;
use heapless::Vec;

/// Builds a [`NodeConfig`]; made by [`NodeConfig::builder`].
///
/// ```
/// use funnelnet_protocol::NodeConfig;
/// use funnelnet_protocol::config::{Field, Shape};
///
/// let config = NodeConfig::builder(1, 1_000_000)
///     .field(Field::scalar(-1.0, 3.0, []))
///     .funnel(Shape::Exponential { start: 40.0, end: 2.0, rate: 1.0 })
///     .edge(2, 1.0)
///     .build()?;
/// assert_eq!(config.neighbours.len(), 1);
/// # Ok::<(), funnelnet_protocol::config::ConfigError>(())
/// ```
#[derive(Clone, Debug)]
#[must_use]
pub struct NodeBuilder {
    config: NodeConfig,
    error: Option<ConfigError>,
}

impl NodeConfig {
    /// Starts the configuration of node `id` (1 to 127) at tick period `tick_ns` (ns).
    ///
    /// Unless it is told otherwise, the node has one component that starts at 0 and does not move by itself,
    /// no neighbours, node-wise coupling with the reciprocal gain of scale 1 in a funnel of width 1; it rides
    /// through breaches, ticks by its own timer, extrapolates a silent neighbour for 10 ticks, and sends no
    /// telemetry.
    pub fn builder(id: u8, tick_ns: u32) -> NodeBuilder {
        let config = NodeConfig {
            id,
            tick_ns,
            initial_state: [0.0].into_iter().collect(),
            state_limit: LARGEST as f32,
            field: Field { slope: [0.0].into_iter().collect(), offset: Vec::new(), sines: Vec::new() },
            coupling: Coupling::NodeWise,
            gain: Gain::default(),
            funnel: Shape::Constant { width: 1.0 }.into(),
            extrapolate_ticks: 10,
            ..NodeConfig::empty()
        };
        NodeBuilder { config, error: None }
    }
}

impl EdgeConfig {
    /// The edge to neighbour `id` (1 to 127) of weight `weight`. With edge-wise coupling it has to know the
    /// neighbour's number of edges as well: [`EdgeConfig::edges`].
    #[must_use]
    pub const fn new(id: u8, weight: f32) -> Self {
        Self { id, weight, edges: 1 }
    }
}

impl NodeBuilder {
    /// Sets what makes the node tick.
    pub fn tick_source(mut self, source: TickSource) -> Self {
        self.config.tick_source = source;
        self
    }

    /// Sets the initial state by component, state units.
    pub fn state(mut self, state: impl IntoIterator<Item = f32>) -> Self {
        self.config.initial_state.clear();
        for x in state {
            if self.config.initial_state.push(x).is_err() {
                self.too_much(ConfigField::Components, MAX_COMPONENTS);
            }
        }
        self
    }

    /// Sets the largest `|x|` that the node accepts, state units.
    pub fn state_limit(mut self, limit: f32) -> Self {
        self.config.state_limit = limit;
        self
    }

    /// Sets the node's own vector field.
    pub fn field(mut self, field: Field<f32>) -> Self {
        self.config.field = field;
        self
    }

    /// Sets the node's own vector field to a program, which reads these sinusoids.
    pub fn program(mut self, program: Program<f32>, waves: impl IntoIterator<Item = Sine<f32>>) -> Self {
        self.config.field = Field::scalar(0.0, 0.0, waves);
        self.config.field.offset.clear();
        self.config.program = program;
        self
    }

    /// Sets the limits of the input.
    pub fn limits(mut self, limits: Limits) -> Self {
        self.config.limits = limits;
        self
    }

    /// Sets the coupling.
    pub fn coupling(mut self, coupling: Coupling<f32>) -> Self {
        self.config.coupling = coupling;
        self
    }

    /// Sets the gain.
    pub fn gain(mut self, gain: impl Into<Gain<f32>>) -> Self {
        self.config.gain = gain.into();
        self
    }

    /// Sets the funnel: a shape, or one with a factor.
    pub fn funnel(mut self, funnel: impl Into<Funnel<f32>>) -> Self {
        self.config.funnel = funnel.into();
        self
    }

    /// Sets what the node does outside its funnel.
    pub fn on_breach(mut self, breach: Breach<f32>) -> Self {
        self.config.on_breach = breach;
        self
    }

    /// Adds an edge to neighbour `id` of weight `weight`.
    pub fn edge(self, id: u8, weight: f32) -> Self {
        self.edges([EdgeConfig::new(id, weight)])
    }

    /// Adds edges.
    pub fn edges(mut self, edges: impl IntoIterator<Item = EdgeConfig>) -> Self {
        for edge in edges {
            if self.config.neighbours.push(edge).is_err() {
                self.too_much(ConfigField::Entries, MAX_NEIGHBOURS);
            }
        }
        self
    }

    /// Sets for how many ticks a silent neighbour is extrapolated.
    pub fn extrapolate_ticks(mut self, ticks: u8) -> Self {
        self.config.extrapolate_ticks = ticks;
        self
    }

    /// Sets the ticks between telemetry frames; 0 is none.
    pub fn telemetry_every(mut self, ticks: u32) -> Self {
        self.config.telemetry_every = ticks;
        self
    }

    /// Stops the node when so many neighbours are lost at the same time; 0 never does.
    pub fn lost_neighbours(mut self, count: u8) -> Self {
        self.config.lost_neighbours = count;
        self
    }

    /// Stops a running node that ticks by SYNC and has heard none for so long, ns; 0 never does.
    pub fn holdover_ns(mut self, holdover_ns: u64) -> Self {
        self.config.holdover_ns = holdover_ns;
        self
    }

    /// Sets the limits of what is taken of a neighbour's states.
    pub fn heard(mut self, limits: HeardLimits) -> Self {
        self.config.heard = limits;
        self
    }

    /// Sets how the node keeps time with others.
    pub fn time(mut self, rules: TimeRules) -> Self {
        self.config.time = rules;
        self
    }

    /// Sets the law's own numbers.
    pub fn tuning(mut self, tuning: Tuning) -> Self {
        self.config.tuning = tuning;
        self
    }

    /// Gives the configuration. Its ranges are checked by whoever uses it (`funnelnet_node::Params::new`).
    ///
    /// # Errors
    /// More components or edges than a configuration has room for.
    pub fn build(mut self) -> Result<NodeConfig, ConfigError> {
        if self.config.field.offset.is_empty() {
            self.config.field.offset = self.config.initial_state.iter().map(|_| 0.0).collect();
        }
        match self.error {
            Some(error) => Err(error),
            None => Ok(self.config),
        }
    }

    fn too_much(&mut self, field: ConfigField, room: usize) {
        let (found, high) = (room as f64 + 1.0, room as f64);
        self.error.get_or_insert(ConfigError::OutOfRange { field, index: 0, found, low: 0.0, high });
    }
}
