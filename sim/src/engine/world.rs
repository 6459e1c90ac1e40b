//! The world around the nodes of an engine, as events change it.
//!
//! A node that comes has a blank memory: it is what its stored configuration makes of it. It does not know
//! the tick, so it ticks by SYNC, as a board does that joins a network. The engine gives it one at every
//! tick, without loss or delay, and a partition does not cut it: it stands for a host, not for a neighbour.

use super::field::SimField;
use super::scene::Scene;
use crate::scenario::Course;
use funnelnet_law::field::VectorField;
use funnelnet_node::Node;

/// Who is on and which links are cut, what happens to them next, and what nodes are made of anew.
pub struct World<V = SimField> {
    pub(super) scene: Scene,
    tick_ns: u64,
    /// Tick that comes next.
    tick: u64,
    /// Each node as it is after power-on, with SYNC as its tick source.
    fresh: Vec<Node<f32, V>>,
}

impl<V: VectorField<f32> + Clone> World<V> {
    /// The world of a `course` of events over `neighbours`, by index. `fresh` are the nodes as they are after
    /// power-on.
    #[must_use]
    pub fn new(course: &Course, tick_ns: u64, neighbours: Vec<Vec<usize>>, fresh: Vec<Node<f32, V>>) -> Self {
        Self { scene: Scene::new(course, tick_ns, neighbours), tick_ns, tick: 0, fresh }
    }

    /// The next tick and its engine time, ns.
    pub(super) fn next_tick(&mut self) -> (u64, u64) {
        let tick = self.tick;
        self.tick += 1;
        (tick, (tick + 1).saturating_mul(self.tick_ns))
    }

    /// Stores another configuration: what a node is after power-on.
    pub(super) fn store(&mut self, node: usize, fresh: Node<f32, V>) {
        if let Some(slot) = self.fresh.get_mut(node) {
            *slot = fresh;
        }
    }

    /// A node as it is after power-on.
    pub(super) fn fresh(&self, node: usize) -> Option<Node<f32, V>> {
        self.fresh.get(node).cloned()
    }
}
