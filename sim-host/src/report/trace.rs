//! The data of a plot.

use std::ops::Range;

use crate::judge::Worst;
use crate::record::Row;

use super::PlotError;
use super::marks::{Kind, Mark};
use super::text::plain;

/// The recorded rows of a run, by node, as plots need them.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    pub(super) title: String,
    unit: Option<String>,
    pub(super) t: Vec<f64>,
    /// Components of a state; 0 means 1.
    components: usize,
    /// One per node and component.
    pub(super) nodes: Vec<Node>,
    /// By component.
    pub(super) xi: Vec<Vec<f64>>,
    /// By component.
    pub(super) blended: Vec<Vec<f64>>,
    pub(super) marks: Vec<Mark>,
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
    /// The true diffusive term, and the scenario's funnel.
    pub(super) nu: Vec<f64>,
    pub(super) psi: Vec<f64>,
    /// The same as the node believes them.
    pub(super) own_nu: Vec<f64>,
    pub(super) own_psi: Vec<f64>,
    /// What is true at the rows.
    rows: Worst,
    /// What is true at all ticks, where that is known.
    ticks: Option<Worst>,
}

impl Node {
    /// The curves of the `index`-th entry of a row.
    fn new(index: usize, components: usize) -> Self {
        let (id, component) = (index / components + 1, index % components);
        let label = if components == 1 { format!("node {id}") } else { format!("node {id}, x{component}") };
        Self { id, component, label, ..Self::default() }
    }

    /// What came of it, and whether that is over all ticks rather than over the rows.
    pub(super) fn worst(&self) -> (Worst, bool) {
        (self.ticks.unwrap_or(self.rows), self.ticks.is_some())
    }

    /// Whether a row shows a breach.
    pub(super) fn is_outside_at_a_row(&self) -> bool {
        self.rows.breaches > 0
    }

    /// The true ratio at row `k`; NaN where it is not known.
    pub(super) fn ratio(&self, k: usize) -> f64 {
        ratio(self.nu[k], self.psi[k])
    }
}

/// As the judge has it: zero in a funnel that has closed is at its boundary.
pub(super) fn ratio(nu: f64, psi: f64) -> f64 {
    if nu == 0.0 && psi == 0.0 { 1.0 } else { nu / psi }
}

impl Trace {
    /// An empty trace; `title` heads the plots.
    pub fn new(title: impl AsRef<str>) -> Self {
        Self { title: plain(title.as_ref()), ..Self::default() }
    }

    /// With states of this many components.
    #[must_use]
    pub fn with_components(self, components: usize) -> Self {
        Self { components, ..self }
    }

    /// With states in this unit.
    #[must_use]
    pub fn with_unit(self, unit: Option<&str>) -> Self {
        Self { unit: unit.map(plain), ..self }
    }

    /// Whether the unit of the states is known.
    pub(super) fn has_unit(&self) -> bool {
        self.unit.is_some()
    }

    /// `what` with its unit, for an axis.
    pub(super) fn axis(&self, what: &str) -> String {
        match &self.unit {
            Some(unit) => format!("{what} ({unit})"),
            None => format!("{what} in state units"),
        }
    }

    /// Components of a state.
    pub(super) fn components(&self) -> usize {
        self.components.max(1)
    }

    /// Appends a row. All rows of a trace have the same number of nodes; what a shorter row lacks is not
    /// drawn. A row without true terms has only one kind, and these are the true ones.
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
        let judged = !row.true_nu.is_empty();
        let (nu, psi) = if judged { (&row.true_nu, &row.asked_psi) } else { (&row.nu, &row.psi) };
        // Where every state is known, so is every term.
        let known = row.x.iter().all(|x| !x.is_nan());
        for (i, node) in self.nodes.iter_mut().enumerate() {
            let at = |table: &[f64]| table.get(i).copied().unwrap_or(f64::NAN);
            node.x.push(at(&row.x));
            node.nu.push(at(nu));
            node.psi.push(at(psi));
            node.own_nu.push(at(&row.nu));
            node.own_psi.push(at(&row.psi));
            let ratio = ratio(at(nu), at(psi)).abs();
            node.rows.take((known || !ratio.is_nan()).then_some(ratio));
        }
    }

    /// What came of each node and component over all ticks, by index and then by component; else it is what the rows show.
    pub fn judged(&mut self, worst: &[Worst]) {
        for (node, worst) in self.nodes.iter_mut().zip(worst) {
            node.ticks = Some(*worst);
        }
    }

    /// Node `id` stopped or was away from `from_s` on; where it came back, until `to_s`. Its curves end there. Of several stops of a
    /// node the first is shown. What belongs to no node has the id 0.
    pub fn mark(&mut self, id: usize, from_s: f64, to_s: Option<f64>, kind: Kind) {
        let mark = Mark { id, from: from_s, to: to_s, kind };
        let first = self.marks.iter_mut().find(|m| m.id == id && m.kind == kind && kind == Kind::Stopped);
        match first {
            Some(first) if first.from <= mark.from => {}
            Some(first) => *first = mark,
            None => self.marks.push(mark),
        }
    }

    /// The marks of node `id`.
    pub(super) fn marks_of(&self, id: usize) -> impl Iterator<Item = &Mark> {
        self.marks.iter().filter(move |mark| mark.id == id)
    }

    /// The points of a curve of `node` with these `values`; NaN where it is stopped or away.
    pub(super) fn points(&self, node: &Node, values: &[f64]) -> Vec<(f64, f64)> {
        let marks: Vec<&Mark> = self.marks_of(node.id).collect();
        let hide = |(&t, &y): (&f64, &f64)| (t, if marks.iter().any(|m| m.hides(t)) { f64::NAN } else { y });
        self.t.iter().zip(values).map(hide).collect()
    }

    /// The points of the states of `node`, up to its stop, which may be between two rows.
    pub(super) fn states(&self, node: &Node) -> Vec<(f64, f64)> {
        let mut points = self.points(node, &node.x);
        if let Some(end) = self.stop(node) {
            let at = points.partition_point(|p| p.0 < end.0);
            if points.get(at).is_none_or(|p| p.0 > end.0) {
                points.insert(at, end);
            }
        }
        points
    }

    /// When `node` stopped, and its state there, where it is known.
    pub(super) fn stop(&self, node: &Node) -> Option<(f64, f64)> {
        let mark = self.marks_of(node.id).find(|mark| mark.kind == Kind::Stopped)?;
        let after = self.t.partition_point(|&t| t < mark.from);
        // What it stopped with stays.
        let x = node.x.get(after).or(node.x.last()).copied().filter(|x| !x.is_nan())?;
        Some((mark.from, x))
    }

    /// First and last time, in seconds.
    pub(super) fn span(&self) -> Result<Range<f64>, PlotError> {
        match (self.t.first(), self.t.last()) {
            (Some(&first), Some(&last)) if last > first => Ok(first..last),
            _ => Err(PlotError::new("it needs rows at two times or more")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// States 0, 1, 2, ... of one node at the times 0, 1, 2, ...
    fn ramp(rows: usize, last: f64) -> Trace {
        let mut trace = Trace::new("ramp");
        for k in 0..rows {
            trace.push(&Row { t: k as f64, x: vec![(k as f64).min(last)], ..Row::default() });
        }
        trace
    }

    fn known(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        points.iter().copied().filter(|p| !p.1.is_nan()).collect()
    }

    #[test]
    fn a_curve_ends_where_its_node_stops_between_two_rows() {
        let mut trace = ramp(6, 2.5);
        trace.mark(1, 3.7, None, Kind::Stopped);
        trace.mark(1, 2.5, None, Kind::Stopped);
        let points = known(&trace.states(&trace.nodes[0]));
        assert_eq!(points, [(0.0, 0.0), (1.0, 1.0), (2.0, 2.0), (2.5, 2.5)]);
    }

    #[test]
    fn nothing_is_drawn_of_an_absence_even_where_a_row_has_a_value() {
        let mut trace = ramp(6, 9.0);
        trace.mark(1, 1.5, Some(4.0), Kind::Away);
        let points = known(&trace.states(&trace.nodes[0]));
        assert_eq!(points, [(0.0, 0.0), (1.0, 1.0), (4.0, 4.0), (5.0, 5.0)]);
    }

    #[test]
    fn a_term_that_is_not_a_number_is_told_from_one_that_is_not_known() {
        let mut trace = Trace::new("");
        let row = |t, x: [f64; 2]| Row {
            t,
            x: x.to_vec(),
            true_nu: vec![x[1] - x[0], f64::NAN],
            asked_psi: vec![2.0; 2],
            ..Row::default()
        };
        trace.push(&row(0.0, [0.0, 1.0]));
        trace.push(&row(1.0, [0.0, f64::NAN]));
        assert_eq!(trace.nodes[0].worst().0, Worst { max_ratio: 0.5, breaches: 0, unknown: 1, judged: 1 });
        trace.push(&row(2.0, [f64::INFINITY, f64::INFINITY]));
        let worst = trace.nodes[0].worst().0;
        assert!(worst.max_ratio.is_nan() && worst.breaches == 1, "{worst:?}");
    }
}
