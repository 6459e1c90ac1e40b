//! The data of a plot.

use std::ops::Range;

use crate::extremes::larger;
use crate::judge::Worst;
use crate::record::Row;

use super::PlotError;
use super::envelope::{Envelope, Sample};
use super::losses::Losses;
use super::marks::{Kind, Mark};
use super::style::NODES;
use super::text::plain;

/// The recorded rows of a run, by node, as plots need them: however many they are, it keeps no more than
/// their envelopes.
#[derive(Debug, Clone, Default)]
pub struct Trace {
    title: String,
    unit: Option<String>,
    /// Components of a state; 0 means 1.
    components: usize,
    rows: u64,
    /// First and last time, in seconds.
    span: (f64, f64),
    /// One per node and component.
    nodes: Vec<Recorded>,
    /// `xi` and the blended dynamics, by component, from a value on.
    predictions: Vec<(f64, Envelope<2>)>,
    /// Spread, its bound, and the error to `xi`.
    agreement: Envelope<3>,
    /// Bound of the spread for a widest funnel of 1; not known where there is none.
    bound: Option<f64>,
    /// Largest spread at any tick, and that at the end, where they are known.
    spread: Option<(f64, f64)>,
    marks: Vec<Mark>,
    losses: Losses,
}

/// What is kept of one component of one node: state, true term, its funnel, both as the node believes them,
/// both ratios, and the input.
#[derive(Debug, Clone, Default)]
struct Recorded {
    /// Its first state, from which on the others are kept: far from zero f32 would have too few digits.
    base: f64,
    curves: Envelope<8>,
    /// What is true at the rows.
    rows: Worst,
    /// What is true at all ticks, where that is known.
    ticks: Option<Worst>,
}

/// What is drawn.
pub(super) struct Drawn {
    pub(super) title: String,
    unit: Option<String>,
    components: usize,
    /// First and last time, in seconds.
    pub(super) span: Range<f64>,
    /// One per node and component.
    pub(super) nodes: Vec<Node>,
    /// By component.
    pub(super) xi: Vec<Vec<(f64, f64)>>,
    /// By component.
    pub(super) blended: Vec<Vec<(f64, f64)>>,
    /// The largest distance of two nodes, over time.
    pub(super) spread: Vec<(f64, f64)>,
    /// Its bound.
    pub(super) bound: Vec<(f64, f64)>,
    /// The largest distance of a node to `xi`.
    pub(super) error: Vec<(f64, f64)>,
    /// Largest spread at any tick, and that at the end, where they are known.
    pub(super) of_all_ticks: Option<(f64, f64)>,
    pub(super) marks: Vec<Mark>,
    pub(super) losses: Losses,
}

/// What is drawn of the nodes. What is not has no points: a picture needs no more memory than its curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// States, and how wide the funnels are.
    States,
    /// Inputs, and the states that nodes stopped with.
    Inputs,
    /// What they have come to, one by one: their curves are looked at one after the other ([`Trace::node`]).
    Funnels,
    /// What they have come to together.
    Together,
}

impl Wanted {
    /// Whether a curve of [`Recorded`] is drawn.
    fn has(self, curve: usize) -> bool {
        match self {
            Self::States => [X, PSI].contains(&curve),
            Self::Inputs => [X, U].contains(&curve),
            Self::Funnels | Self::Together => false,
        }
    }
}

/// Places of the curves of [`Recorded`].
const X: usize = 0;
const PSI: usize = 2;
const U: usize = 7;

/// The curves of one component of one node.
#[derive(Debug, Clone, Default)]
pub(super) struct Node {
    pub(super) id: usize,
    /// The component, from 0.
    pub(super) component: usize,
    /// What a legend calls it.
    pub(super) label: String,
    /// Times of all that follow, in seconds.
    pub(super) t: Vec<f64>,
    pub(super) x: Vec<f64>,
    /// The true diffusive term, and the scenario's funnel.
    pub(super) nu: Vec<f64>,
    pub(super) psi: Vec<f64>,
    /// The same as the node believes them.
    pub(super) own_nu: Vec<f64>,
    pub(super) own_psi: Vec<f64>,
    /// The true ratio, and that which the node believes; NaN where one is not known.
    pub(super) ratio: Vec<f64>,
    pub(super) own_ratio: Vec<f64>,
    /// The input that it applies.
    pub(super) u: Vec<f64>,
    rows: Worst,
    ticks: Option<Worst>,
}

impl Node {
    /// The curves of the `index`-th entry of a row, as far as they are drawn.
    fn new(index: usize, components: usize, recorded: &Recorded, is_drawn: impl Fn(usize) -> bool) -> Self {
        let (id, component) = (index / components + 1, index % components);
        let label = if components == 1 { format!("node {id}") } else { format!("node {id}, x{component}") };
        let column = |curve: usize| -> Vec<f64> {
            let base = if curve == X { recorded.base } else { 0.0 };
            let values = recorded.curves.samples().map(|sample| base + f64::from(sample.values[curve]));
            if is_drawn(curve) { values.collect() } else { Vec::new() }
        };
        Self {
            id,
            component,
            label,
            t: recorded.curves.samples().filter(|_| is_drawn(X)).map(|sample| sample.t).collect(),
            x: column(X),
            nu: column(1),
            psi: column(PSI),
            own_nu: column(3),
            own_psi: column(4),
            ratio: column(5),
            own_ratio: column(6),
            u: column(U),
            rows: recorded.rows,
            ticks: recorded.ticks,
        }
    }

    /// What came of it, and whether that is over all ticks rather than over the rows.
    pub(super) fn worst(&self) -> (Worst, bool) {
        (self.ticks.unwrap_or(self.rows), self.ticks.is_some())
    }

    /// Whether a row shows a breach.
    pub(super) fn is_outside_at_a_row(&self) -> bool {
        self.rows.breaches > 0
    }
}

/// As the judge has it: zero in a funnel that has closed is at its boundary.
fn ratio(nu: f64, psi: f64) -> f64 {
    if nu == 0.0 && psi == 0.0 { 1.0 } else { nu / psi }
}

/// The largest distance of two nodes that are known, in the component in which it is largest; NaN where fewer
/// than two are.
fn spread(x: &[f64], components: usize) -> f64 {
    let apart = |component: usize| {
        let states = || x.iter().skip(component).step_by(components).copied().filter(|x| !x.is_nan());
        states().fold(f64::NEG_INFINITY, f64::max) - states().fold(f64::INFINITY, f64::min)
    };
    let known = x.iter().step_by(components).filter(|x| !x.is_nan()).count();
    if known > 1 { (0..components).map(apart).fold(0.0, larger) } else { f64::NAN }
}

/// The largest distance of a node that is known to `xi`; NaN where that, or every node, is not known.
fn error(x: &[f64], xi: &[f64]) -> f64 {
    let apart = x.iter().zip(xi.iter().cycle()).map(|(x, xi)| (x - xi).abs());
    let known = apart.filter(|distance| !distance.is_nan());
    known.fold(f64::NAN, f64::max)
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

    /// With the bound of the spread for a widest funnel of 1.
    #[must_use]
    pub fn with_bound(self, bound: f64) -> Self {
        Self { bound: Some(bound), ..self }
    }

    /// Whether there is something to draw: rows at two times or more.
    #[must_use]
    pub fn has_span(&self) -> bool {
        self.span.0 < self.span.1
    }

    /// Appends a row. All rows of a trace have the same number of nodes; what a shorter row lacks is not
    /// drawn. A row without true terms has only one kind, and these are the true ones.
    pub fn push(&mut self, row: &Row) {
        if self.rows == 0 {
            let finite = |value: f64| if value.is_finite() { value } else { 0.0 };
            let recorded = |&x: &f64| Recorded { base: finite(x), ..Recorded::default() };
            self.nodes = row.x.iter().map(recorded).collect();
            let base = |component: usize| finite(row.xi.get(component).copied().unwrap_or(0.0));
            self.predictions =
                (0..self.components.max(1)).map(|component| (base(component), Envelope::default())).collect();
            self.span = (row.t, row.t);
        }
        self.rows += 1;
        self.span.1 = row.t;
        let entry = |table: &[f64], at: usize| table.get(at).copied().unwrap_or(f64::NAN);
        for (component, (base, prediction)) in self.predictions.iter_mut().enumerate() {
            let values = [entry(&row.xi, component), entry(&row.blended, component)];
            prediction.push(Sample::at(row.t, values.map(|value| value - *base)));
        }
        let judged = !row.true_nu.is_empty();
        let (nu, psi) = if judged { (&row.true_nu, &row.asked_psi) } else { (&row.nu, &row.psi) };
        // Where every state is known, a term is not a number for an infinite one; for finite ones it may be
        // that of a node without neighbours.
        let known = row.x.iter().all(|x| !x.is_nan()) && row.x.iter().any(|x| x.is_infinite());
        for (at, node) in self.nodes.iter_mut().enumerate() {
            let [x, nu, psi] = [&row.x, nu, psi].map(|table| entry(table, at));
            let (own_nu, own_psi) = (entry(&row.nu, at), entry(&row.psi, at));
            let (ratio, own_ratio) = (ratio(nu, psi), ratio(own_nu, own_psi));
            let values = [x - node.base, nu, psi, own_nu, own_psi, ratio, own_ratio, entry(&row.u, at)];
            node.curves.push(Sample::at(row.t, values));
            node.rows.take((known || !ratio.is_nan()).then_some(ratio.abs()));
        }
        let widest = psi.iter().copied().fold(0.0, larger);
        // It is that of the whole graph.
        let is_whole = row.x.iter().all(|x| !x.is_nan());
        let bound = self.bound.filter(|_| is_whole).map_or(f64::NAN, |bound| bound * widest);
        let components = self.components.max(1);
        let values = [spread(&row.x, components), bound, error(&row.x, &row.xi)];
        self.agreement.push(Sample::at(row.t, values));
        self.losses.push(row.t, row.lost);
    }

    /// The largest spread at any tick, and that at the end, state units.
    pub fn spread(&mut self, largest: f64, last: f64) {
        self.spread = Some((largest, last));
    }

    /// What came of each node and component over all ticks, by index and then by component; else it is what
    /// the rows show.
    pub fn judged(&mut self, worst: &[Worst]) {
        for (node, worst) in self.nodes.iter_mut().zip(worst) {
            node.ticks = Some(*worst);
        }
    }

    /// Node `id` stopped or was away from `from_s` on; where it came back, until `to_s`. Its curves end
    /// there. Of several stops of a node the first is shown. What belongs to no node has the id 0.
    pub fn mark(&mut self, id: usize, from_s: f64, to_s: Option<f64>, kind: Kind) {
        let mark = Mark { id, from: from_s, to: to_s, kind };
        let first = self.marks.iter_mut().find(|m| m.id == id && m.kind == kind && kind == Kind::Stopped);
        match first {
            Some(first) if first.from <= mark.from => {}
            Some(first) => *first = mark,
            None => self.marks.push(mark),
        }
    }

    /// What there is to draw for a picture of what is `wanted`.
    ///
    /// # Errors
    /// [`PlotError`] if there are rows at fewer than two times.
    pub(super) fn drawn(&self, wanted: Wanted) -> Result<Drawn, PlotError> {
        if !self.has_span() {
            return Err(PlotError::new("it needs rows at two times or more"));
        }
        let components = self.components.max(1);
        let node = |(index, recorded): (usize, &Recorded)| {
            Node::new(index, components, recorded, |curve| wanted.has(curve))
        };
        let prediction = |curve: usize| {
            let points = |(base, of): &(f64, Envelope<2>)| {
                of.samples().map(|s| (s.t, base + f64::from(s.values[curve]))).collect()
            };
            self.predictions.iter().filter(|_| wanted == Wanted::States).map(points).collect()
        };
        let agreement = |curve: usize| {
            let samples = self.agreement.samples().filter(|_| wanted == Wanted::Together);
            samples.map(|s| (s.t, f64::from(s.values[curve]))).collect()
        };
        Ok(Drawn {
            spread: agreement(0),
            bound: agreement(1),
            error: agreement(2),
            of_all_ticks: self.spread,
            title: self.title.clone(),
            unit: self.unit.clone(),
            components,
            span: self.span.0..self.span.1,
            nodes: self.nodes.iter().enumerate().map(node).collect(),
            xi: prediction(0),
            blended: prediction(1),
            marks: self.marks.clone(),
            losses: self.losses.clone(),
        })
    }

    /// All curves of one component of one node, by their place in a row.
    pub(super) fn node(&self, index: usize) -> Option<Node> {
        Some(Node::new(index, self.components.max(1), self.nodes.get(index)?, |_| true))
    }

    /// Places of the nodes and components that came nearest to the boundary, as many as are shown each by
    /// itself.
    pub(super) fn urgent(&self) -> Vec<usize> {
        let urgency = |index: &usize| match self.nodes[*index].worst() {
            // What is not a number comes before any number, and what is not known at all before what is known
            // to be inside.
            worst if worst.max_ratio.is_nan() => f64::INFINITY,
            worst if worst.judged == 0 => 1.0,
            worst => worst.max_ratio,
        };
        let mut all: Vec<usize> = (0..self.nodes.len()).collect();
        all.sort_by(|a, b| urgency(b).total_cmp(&urgency(a)));
        all.truncate(NODES);
        all.sort_unstable();
        all
    }
}

impl Recorded {
    /// What came of it: of all ticks where that is known, else of the rows.
    fn worst(&self) -> Worst {
        self.ticks.unwrap_or(self.rows)
    }
}

impl Drawn {
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

    /// The same for what changes by it in a second.
    pub(super) fn axis_per_second(&self, what: &str) -> String {
        match &self.unit {
            Some(unit) => format!("{what} ({unit}/s)"),
            None => format!("{what} in state units / s"),
        }
    }

    /// Components of a state.
    pub(super) fn components(&self) -> usize {
        self.components
    }

    /// The marks of node `id`.
    pub(super) fn marks_of(&self, id: usize) -> impl Iterator<Item = &Mark> {
        self.marks.iter().filter(move |mark| mark.id == id)
    }

    /// The points of a curve of `node` with these `values`; NaN where it is stopped or away.
    pub(super) fn points(&self, node: &Node, values: &[f64]) -> Vec<(f64, f64)> {
        let marks: Vec<&Mark> = self.marks_of(node.id).collect();
        let hide = |(&t, &y): (&f64, &f64)| (t, if marks.iter().any(|m| m.hides(t)) { f64::NAN } else { y });
        node.t.iter().zip(values).map(hide).collect()
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

    /// The points of the inputs of `node`. What it applied last it has applied until it stopped.
    pub(super) fn inputs(&self, node: &Node) -> Vec<(f64, f64)> {
        let mut points = self.points(node, &node.u);
        if let Some(end) = self.last_input(node) {
            let at = points.partition_point(|p| p.0 < end.0);
            match points.get_mut(at).filter(|p| p.0 == end.0) {
                Some(point) => *point = end,
                None => points.insert(at, end),
            }
        }
        points
    }

    /// When `node` stopped, and what it applied last.
    pub(super) fn last_input(&self, node: &Node) -> Option<(f64, f64)> {
        let mark = self.marks_of(node.id).find(|mark| mark.kind == Kind::Stopped)?;
        let before = node.t.partition_point(|&t| t <= mark.from);
        let last = node.u.get(..before)?.iter().rev().copied().find(|u| !u.is_nan())?;
        Some((mark.from, last))
    }

    /// When `node` stopped, and its state there, where it is known.
    pub(super) fn stop(&self, node: &Node) -> Option<(f64, f64)> {
        let mark = self.marks_of(node.id).find(|mark| mark.kind == Kind::Stopped)?;
        let after = node.t.partition_point(|&t| t < mark.from);
        // What it stopped with stays.
        let x = node.x.get(after).or(node.x.last()).copied().filter(|x| !x.is_nan())?;
        Some((mark.from, x))
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

    /// The known points of the states of the node.
    fn states(trace: &Trace) -> Vec<(f64, f64)> {
        let drawn = trace.drawn(Wanted::States).unwrap();
        drawn.states(&drawn.nodes[0]).into_iter().filter(|p| !p.1.is_nan()).collect()
    }

    #[test]
    fn a_curve_ends_where_its_node_stops_between_two_rows() {
        let mut trace = ramp(6, 2.5);
        trace.mark(1, 3.7, None, Kind::Stopped);
        trace.mark(1, 2.5, None, Kind::Stopped);
        let points = states(&trace);
        assert_eq!(points, [(0.0, 0.0), (1.0, 1.0), (2.0, 2.0), (2.5, 2.5)]);
    }

    #[test]
    fn nothing_is_drawn_of_an_absence_even_where_a_row_has_a_value() {
        let mut trace = ramp(6, 9.0);
        trace.mark(1, 1.5, Some(4.0), Kind::Away);
        let points = states(&trace);
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
        let worst = |trace: &Trace| trace.drawn(Wanted::Together).unwrap().nodes[0].worst().0;
        trace.push(&row(0.0, [0.0, 1.0]));
        trace.push(&row(1.0, [0.0, f64::NAN]));
        assert_eq!(worst(&trace), Worst { max_ratio: 0.5, breaches: 0, unknown: 1, uncoupled: 0, judged: 1 });
        trace.push(&row(2.0, [f64::INFINITY, f64::INFINITY]));
        let worst = worst(&trace);
        assert!(worst.max_ratio.is_nan() && worst.breaches == 1, "{worst:?}");
    }
}
