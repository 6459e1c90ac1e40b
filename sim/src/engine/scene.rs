//! Who is on and which links are cut, as events change it; nodes by index.
//!
//! It knows no node. Who has the nodes switches them: the engine those in this program, a host those on its lines.

use crate::scenario::{Change, Course};
use std::collections::BTreeSet;

/// Who is on and which links are cut, and what happens to them next.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Engine time (ns) and change, in the order of time.
    steps: Vec<(u64, Change)>,
    /// Index of the next one.
    next: usize,
    on: Vec<bool>,
    /// Nodes that have come during the run.
    came: Vec<bool>,
    cut: BTreeSet<(usize, usize)>,
    /// Neighbours of each node, by index.
    neighbours: Vec<Vec<usize>>,
}

impl Scene {
    /// The scene of a `course` of events over `neighbours`, by index.
    #[must_use]
    pub fn new(course: &Course, tick_ns: u64, neighbours: Vec<Vec<usize>>) -> Self {
        // Tick 0 comes a period after the start, when the announced states have arrived. What happens at the
        // start comes before it.
        let engine_time = |at_ns: u64| if at_ns == 0 { 0 } else { at_ns.saturating_add(tick_ns) };
        let nodes = neighbours.len();
        Self {
            steps: course.steps().iter().map(|step| (engine_time(step.at_ns), step.change)).collect(),
            next: 0,
            on: (0..nodes).map(|node| !course.begins_absent(node)).collect(),
            came: vec![false; nodes],
            cut: BTreeSet::new(),
            neighbours,
        }
    }

    /// Time of the next change, ns.
    #[must_use]
    pub fn next_change(&self) -> Option<u64> {
        self.steps.get(self.next).map(|&(at, _)| at)
    }

    /// Takes the next change of those at the time `at`, ns.
    pub fn take_change(&mut self, at: u64) -> Option<Change> {
        let &(_, change) = self.steps.get(self.next).filter(|step| step.0 == at)?;
        self.next += 1;
        Some(change)
    }

    /// Makes a change.
    pub fn make(&mut self, change: Change) {
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

    /// Whether a node is on and has come during the run.
    #[must_use]
    pub fn has_come(&self, node: usize) -> bool {
        self.came.get(node) == Some(&true)
    }

    /// Whether the link between two nodes is cut.
    #[must_use]
    pub fn is_cut(&self, a: usize, b: usize) -> bool {
        self.cut.contains(&(a.min(b), a.max(b)))
    }

    /// Whether two nodes are on, and can hear each other.
    #[must_use]
    pub fn are_joined(&self, a: usize, b: usize) -> bool {
        self.is_on(a) && self.is_on(b) && !self.is_cut(a, b)
    }

    /// Who hears the frames of each node now, by index. What a node has sent before it went off is on its
    /// way.
    #[must_use]
    pub fn listeners(&self) -> Vec<Vec<usize>> {
        let hears = |from: usize, &to: &usize| self.is_on(to) && !self.is_cut(from, to);
        let of =
            |(from, list): (usize, &Vec<usize>)| list.iter().copied().filter(|to| hears(from, to)).collect();
        self.neighbours.iter().enumerate().map(of).collect()
    }
}
