//! The world around the nodes of an engine, as events change it: who is on, and which links are cut.
//!
//! A node that comes has a blank memory: it is what its stored configuration makes of it. It does not know
//! the tick, so it ticks by SYNC, as a board does that joins a network. The engine gives it one at every
//! tick, without loss or delay, and a partition does not cut it: it stands for a host, not for a neighbour.

use super::field::SimField;
use crate::scenario::{Change, Course};
use funnelnet_law::field::VectorField;
use funnelnet_node::Node;
use std::collections::BTreeSet;

/// Who is on and which links are cut, and what happens to them next.
pub struct World<V = SimField> {
    /// Engine time (ns) and change, in the order of time.
    steps: Vec<(u64, Change)>,
    /// Index of the next one.
    next: usize,
    tick_ns: u64,
    /// Tick that comes next.
    tick: u64,
    on: Vec<bool>,
    /// Nodes that have come during the run.
    came: Vec<bool>,
    cut: BTreeSet<(usize, usize)>,
    /// Neighbours of each node, by index.
    neighbours: Vec<Vec<usize>>,
    /// Each node as it is after power-on, with SYNC as its tick source.
    fresh: Vec<Node<f32, V>>,
}

impl<V: VectorField<f32> + Clone> World<V> {
    /// The world of a `course` of events over `neighbours`, by index. `fresh` are the nodes as they are after
    /// power-on.
    #[must_use]
    pub fn new(course: &Course, tick_ns: u64, neighbours: Vec<Vec<usize>>, fresh: Vec<Node<f32, V>>) -> Self {
        // Tick 0 comes a period after the start, when the announced states have arrived. What happens at the
        // start comes before it.
        let engine_time = |at_ns: u64| if at_ns == 0 { 0 } else { at_ns.saturating_add(tick_ns) };
        Self {
            steps: course.steps().iter().map(|step| (engine_time(step.at_ns), step.change)).collect(),
            next: 0,
            tick_ns,
            tick: 0,
            on: (0..fresh.len()).map(|node| !course.begins_absent(node)).collect(),
            came: vec![false; fresh.len()],
            cut: BTreeSet::new(),
            neighbours,
            fresh,
        }
    }

    /// The next tick and its engine time, ns.
    pub(super) fn next_tick(&mut self) -> (u64, u64) {
        let tick = self.tick;
        self.tick += 1;
        (tick, (tick + 1).saturating_mul(self.tick_ns))
    }

    /// Time of the next change, ns.
    pub(super) fn next_change(&self) -> Option<u64> {
        self.steps.get(self.next).map(|&(at, _)| at)
    }

    /// Takes the next change of those at the time `at`, ns.
    pub(super) fn take_change(&mut self, at: u64) -> Option<Change> {
        let &(_, change) = self.steps.get(self.next).filter(|step| step.0 == at)?;
        self.next += 1;
        Some(change)
    }

    /// Makes a change.
    pub(super) fn make(&mut self, change: Change) {
        match change {
            Change::Off { node, .. } => self.switch(node, false),
            Change::On { node } => self.switch(node, true),
            Change::Cut(a, b) => drop(self.cut.insert((a, b))),
            Change::Mend(a, b) => drop(self.cut.remove(&(a, b))),
        }
    }

    fn switch(&mut self, node: usize, on: bool) {
        if let (Some(is_on), Some(came)) = (self.on.get_mut(node), self.came.get_mut(node)) {
            (*is_on, *came) = (on, on);
        }
    }

    /// Whether a node is on.
    #[must_use]
    pub fn is_on(&self, node: usize) -> bool {
        self.on.get(node) == Some(&true)
    }

    /// Whether a node is on and has come during the run, so that it ticks by SYNC.
    pub(super) fn ticks_by_sync(&self, node: usize) -> bool {
        self.came.get(node) == Some(&true)
    }

    /// Whether the link between two nodes is cut.
    #[must_use]
    pub fn is_cut(&self, a: usize, b: usize) -> bool {
        self.cut.contains(&(a.min(b), a.max(b)))
    }

    /// Who hears the frames of each node now, by index. What a node has sent before it went off is on its
    /// way.
    pub(super) fn listeners(&self) -> Vec<Vec<usize>> {
        let hears = |from: usize, &to: &usize| self.is_on(to) && !self.is_cut(from, to);
        let of =
            |(from, list): (usize, &Vec<usize>)| list.iter().copied().filter(|to| hears(from, to)).collect();
        self.neighbours.iter().enumerate().map(of).collect()
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
