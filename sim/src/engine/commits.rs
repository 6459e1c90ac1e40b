//! Configurations that nodes adopt while they run, as on a board: staged before the start, and committed at a tick
//! (protocol/README.md, "Commit"). The engine is the storage, and the host whose commit is never lost.

use funnelnet_law::field::VectorField;
use funnelnet_node::node::adopt::Lasting;
use funnelnet_node::{Node, Params, Phase};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::EdgeConfig;
use funnelnet_protocol::message::TickStamp;
use funnelnet_protocol::refusal::Refusal;

/// Ticks by which a host tells a node to commit before the tick that it names.
pub const TOLD_AHEAD: u32 = 8;

/// What is staged in the nodes of an engine.
pub struct Commits<V> {
    /// By index.
    nodes: Vec<Option<Waiting<V>>>,
    /// Indices of those that were told to commit, and have gone on as they were.
    missed: Vec<usize>,
}

/// What is staged in one node.
struct Waiting<V> {
    tick: u32,
    lasting: Lasting,
    params: Params<f32, V>,
    edges: Vec<EdgeConfig>,
    /// The node as it is after power-on, once that is stored.
    fresh: Node<f32, V>,
    phase: Stage,
}

#[derive(Clone, Copy, PartialEq)]
enum Stage {
    Staged,
    /// The power failed, and took with it what was staged.
    Lost,
    /// The commit has come.
    Told,
    /// There is nothing to be done any more.
    Over,
}

impl<V: VectorField<f32> + Clone> Commits<V> {
    /// Of so many nodes, in which nothing is staged yet.
    #[must_use]
    pub fn new(nodes: usize) -> Self {
        Self { nodes: (0..nodes).map(|_| None).collect(), missed: Vec::new() }
    }

    /// Stages what a node makes of `config` at `tick`; `fresh` is the node as it is after power-on with it.
    pub fn stage(
        &mut self,
        index: usize,
        tick: u32,
        (config, params): (&NodeConfig, Params<f32, V>),
        fresh: Node<f32, V>,
    ) {
        let (lasting, edges) = (Lasting::of(config), config.neighbours.to_vec());
        if let Some(slot) = self.nodes.get_mut(index) {
            *slot = Some(Waiting { tick, lasting, params, edges, fresh, phase: Stage::Staged });
        }
    }

    /// Indices of nodes that were told to commit, and have gone on as they were.
    pub(super) fn missed(&self) -> &[usize] {
        &self.missed
    }

    /// The power of a node fails. What it has adopted is stored for good.
    pub(super) fn power_off(&mut self, index: usize) {
        if let Some(Some(waiting)) = self.nodes.get_mut(index)
            && waiting.phase != Stage::Over
        {
            waiting.phase = Stage::Lost;
        }
    }

    /// Does what an app does once its node has nothing more to say: hands it the commit, and what is staged when it asks
    /// for that. Gives whether the node has asked, and what it is after power-on from then on.
    #[cold]
    pub(super) fn attend(&mut self, index: usize, node: &mut Node<f32, V>) -> (bool, Option<Node<f32, V>>) {
        let Some(Some(waiting)) = self.nodes.get_mut(index) else { return (false, None) };
        let is_time = node.tick().saturating_add(TOLD_AHEAD) >= waiting.tick;
        if node.phase() != Phase::Running || waiting.phase == Stage::Over || !is_time {
            return (false, None);
        }
        let told = match waiting.phase {
            Stage::Staged => node.commit_at(TickStamp::low(waiting.tick, 16), waiting.lasting),
            Stage::Lost => {
                node.refuse(Refusal::Phase);
                Err(Refusal::Phase)
            }
            Stage::Told | Stage::Over => Ok(()),
        };
        waiting.phase = Stage::Told;
        if told.is_err() {
            waiting.phase = Stage::Over;
            self.missed.push(index);
            return (false, None);
        }
        if !node.take_commit() {
            return (false, None);
        }
        waiting.phase = Stage::Over;
        if node.adopt(waiting.params.clone(), &waiting.edges).is_err() {
            self.missed.push(index);
            return (true, None);
        }
        (true, Some(waiting.fresh.clone()))
    }
}
