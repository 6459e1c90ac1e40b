//! What nodes of one kind share: law, floor, funnel, limits. There are few kinds, since they differ by what a
//! scenario writes down and by the degree.

use crate::engine::SimField;
use crate::scenario::{Funnel, LargeScenario};
use funnelnet_law::floor::Floor;
use funnelnet_law::funnel::{SampledFunnel, Widths};
use funnelnet_law::gain::{Gain, Reciprocal};
use funnelnet_law::law::node_wise::NodeWise;
use funnelnet_node::InputRange;

/// One kind.
#[derive(Clone, Debug)]
pub(super) struct Kind<G> {
    pub law: NodeWise<f32, G>,
    pub floor: Floor<f32>,
    /// The same for who judges by true states.
    pub judged_floor: Floor<f64>,
    /// Place of its funnel.
    pub funnel: usize,
    pub limits: Option<InputRange>,
    /// Place of its field, where that is an expression.
    pub expression: Option<usize>,
}

/// All kinds. The gain that most networks have is worth a loop of its own; the bits are the same.
#[derive(Clone, Debug)]
pub(super) enum Kinds {
    Reciprocal(Vec<Kind<Reciprocal<f32>>>),
    Any(Vec<Kind<Gain<f32>>>),
}

impl Kinds {
    pub fn new(kinds: Vec<Kind<Gain<f32>>>) -> Self {
        let reciprocal = |kind: &Kind<Gain<f32>>| match kind.law.gain {
            Gain::Reciprocal { scale } => {
                let Kind { law, floor, judged_floor, funnel, limits, expression } = kind.clone();
                let law = law.with_gain(Reciprocal { scale });
                Some(Kind { law, floor, judged_floor, funnel, limits, expression })
            }
            _ => None,
        };
        match kinds.iter().map(reciprocal).collect() {
            Some(all) => Self::Reciprocal(all),
            None => Self::Any(kinds),
        }
    }
}

/// A funnel as nodes sample it, and as the scenario draws it.
#[derive(Clone, Debug)]
pub(super) struct FunnelPair {
    pub sampled: SampledFunnel<f32>,
    pub drawn: Funnel<f64>,
}

/// Widths of one funnel at a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Width {
    /// What nodes use, before their floor.
    pub widths: Widths<f32>,
    /// What they are judged by, before the floor of f32 where that is accepted.
    pub judged: f64,
}

impl FunnelPair {
    pub fn at(&self, k: u32, scenario: &LargeScenario) -> Width {
        let judged = self.drawn.width(scenario.time.at_s(k.into()));
        Width { widths: self.sampled.widths(k), judged }
    }
}

/// What all nodes share.
#[derive(Clone, Debug)]
pub(super) struct Shared {
    /// Tick period, s.
    pub tick: f32,
    pub guard: funnelnet_law::funnel::Guard<f32>,
    pub input_limit: f32,
    pub state_limit: f32,
    /// Whether there is any coupling.
    pub is_coupled: bool,
    /// Whether the floor of f32 is accepted.
    pub accepts_f32: bool,
    pub expressions: Vec<SimField>,
}
