//! The data of a plot.

use crate::record::Row;

use super::PlotError;

/// The recorded rows of a run, by node, as plots need them.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    pub(super) title: String,
    pub(super) t: Vec<f64>,
    pub(super) nodes: Vec<Node>,
    pub(super) xi: Vec<f64>,
    pub(super) blended: Vec<f64>,
}

/// One node's curves.
#[derive(Debug, Clone, Default)]
pub(super) struct Node {
    pub(super) id: usize,
    pub(super) x: Vec<f64>,
    pub(super) nu: Vec<f64>,
    pub(super) psi: Vec<f64>,
    /// `nu / psi`, the largest magnitude.
    pub(super) worst: f64,
}

impl Trace {
    /// An empty trace; `title` heads the plots.
    pub fn new(title: impl Into<String>) -> Self {
        Self { title: title.into(), ..Self::default() }
    }

    /// Appends a row. All rows of a trace have the same number of nodes; what a shorter row lacks is not
    /// drawn.
    pub fn push(&mut self, row: &Row) {
        if self.nodes.is_empty() {
            self.nodes = (1..=row.x.len()).map(|id| Node { id, ..Node::default() }).collect();
        }
        self.t.push(row.t);
        self.xi.push(row.xi.unwrap_or(f64::NAN));
        self.blended.push(row.blended.unwrap_or(f64::NAN));
        for (i, node) in self.nodes.iter_mut().enumerate() {
            let at = |table: &[f64]| table.get(i).copied().unwrap_or(f64::NAN);
            let (nu, psi) = (at(&row.nu), at(&row.psi));
            node.x.push(at(&row.x));
            node.nu.push(nu);
            node.psi.push(psi);
            node.worst = node.worst.max((nu / psi).abs());
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
