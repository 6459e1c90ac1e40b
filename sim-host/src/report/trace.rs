//! The data of a plot.

use crate::extremes::larger;
use crate::record::Row;

use super::PlotError;

/// The recorded rows of a run, by node, as plots need them.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    pub(super) title: String,
    pub(super) t: Vec<f64>,
    /// Components of a state; 0 means 1.
    components: usize,
    /// One per node and component.
    pub(super) nodes: Vec<Node>,
    /// By component.
    pub(super) xi: Vec<Vec<f64>>,
    /// By component.
    pub(super) blended: Vec<Vec<f64>>,
}

/// The curves of one component of one node.
#[derive(Debug, Clone, Default)]
pub(super) struct Node {
    pub(super) id: usize,
    /// The component, from 0.
    pub(super) component: usize,
    /// What a legend calls it.
    pub(super) label: String,
    pub(super) x: Vec<f64>,
    pub(super) nu: Vec<f64>,
    pub(super) psi: Vec<f64>,
    /// `nu / psi`, the largest magnitude; not a number where one is not.
    pub(super) worst: f64,
}

impl Node {
    /// The curves of the `index`-th entry of a row.
    fn new(index: usize, components: usize) -> Self {
        let (id, component) = (index / components + 1, index % components);
        let label = if components == 1 { format!("node {id}") } else { format!("node {id}, x{component}") };
        Self { id, component, label, ..Self::default() }
    }
}

impl Trace {
    /// An empty trace; `title` heads the plots.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), ..Self::default() }
    }

    /// With states of this many components.
    pub fn with_components(self, components: usize) -> Self {
        Self { components, ..self }
    }

    /// Components of a state.
    pub(super) fn components(&self) -> usize {
        self.components.max(1)
    }

    /// Appends a row. All rows of a trace have the same number of nodes; what a shorter row lacks is not
    /// drawn.
    pub fn push(&mut self, row: &Row) {
        if self.nodes.is_empty() {
            self.nodes = (0..row.x.len()).map(|index| Node::new(index, self.components())).collect();
            self.xi = vec![Vec::new(); self.components()];
            self.blended = self.xi.clone();
        }
        self.t.push(row.t);
        for (curves, values) in [(&mut self.xi, &row.xi), (&mut self.blended, &row.blended)] {
            for (component, curve) in curves.iter_mut().enumerate() {
                curve.push(values.get(component).copied().unwrap_or(f64::NAN));
            }
        }
        for (i, node) in self.nodes.iter_mut().enumerate() {
            let at = |table: &[f64]| table.get(i).copied().unwrap_or(f64::NAN);
            let (nu, psi) = (at(&row.nu), at(&row.psi));
            node.x.push(at(&row.x));
            node.nu.push(nu);
            node.psi.push(psi);
            node.worst = larger(node.worst, (nu / psi).abs());
        }
    }

    /// First and last time, in seconds.
    pub(super) fn span(&self) -> Result<(f64, f64), PlotError> {
        match (self.t.first(), self.t.last()) {
            (Some(&first), Some(&last)) if last > first => Ok((first, last)),
            _ => Err(PlotError::new("it needs rows at two times or more")),
        }
    }
}
