//! What nodes have counted, over all of them.

use funnelnet_protocol::report::Counters;
use serde::Serialize;

/// Sums of what the nodes count, and the largest ratio that one of them reports. Whoever reads a verdict
/// reads these beside it: a guarantee that held by extrapolation only is worth less.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct CounterSummary {
    /// Ticks that a node believes to have spent outside its funnel.
    pub breaches: u64,
    /// The largest `|nu| / psi` that a node reports; `null` where one is not a number, or where no node has
    /// reported.
    pub max_ratio: Option<f64>,
    /// Node-ticks with the funnel at the floor of f32.
    pub floored: u64,
    /// Times that a node widened its own funnel.
    pub reopened: u64,
    /// Values of neighbours that had to be extrapolated.
    pub extrapolated: u64,
    /// Values that came after their tick had run.
    pub late: u64,
    /// Ticks that a node was moved on over without running them.
    pub skipped: u64,
    /// Edges that a node dropped for the silence of the neighbour.
    pub lost: u64,
    /// Edges that a node dropped since it could take no state of the neighbour (`safety.drop_after`).
    pub barred: u64,
    /// Announced weights that were not the node's own.
    pub weights_differ: u64,
    /// SYNCs that skipped ticks.
    pub sync_gaps: u64,
    /// Ticks that came a whole period late or more.
    pub overruns: u64,
    /// Ticks at which an actuator could not do what the law asked for.
    pub saturated: u64,
    /// Ticks at which the law asked for more than `coupling.u_max`.
    pub limited: u64,
    /// Samples of a plant that failed.
    pub coasted: u64,
    /// Times that a node's own field was not a finite number.
    pub field_not_finite: u64,
    /// CAN frames that came to a node and were lost there; of what a controller itself has lost, the
    /// occasions.
    pub frames_lost: u64,
    /// Errors that CAN controllers have found on the bus.
    pub bus_errors: u64,
    /// Times that a CAN controller went off the bus.
    pub bus_offs: u64,
    /// Overruns, noise and failures of serial lines, as nodes see them.
    pub line_errors: u64,
    /// Replies and telemetry that a node's service line had no time for.
    pub unsaid: u64,
    /// FAULT frames that did not stop their node.
    pub warnings: u64,
}

impl CounterSummary {
    /// The sums over `nodes`, with the `warnings` that were heard and the ratios that nodes reported.
    #[must_use]
    pub fn of(nodes: &[Counters], ratios: &[f32], warnings: u64) -> Self {
        let sum = |of: fn(&Counters) -> u32| nodes.iter().map(|counters| u64::from(of(counters))).sum();
        let ratios = ratios.iter().map(|&ratio| crate::number::shortest(ratio));
        Self {
            breaches: sum(|c| c.breaches),
            max_ratio: ratios.reduce(crate::extremes::larger),
            floored: sum(|c| c.floored),
            reopened: sum(|c| c.reopened),
            extrapolated: sum(|c| c.extrapolated),
            late: sum(|c| c.late),
            skipped: sum(|c| c.skipped),
            lost: sum(|c| c.neighbours_lost),
            barred: sum(|c| c.kept.edges),
            weights_differ: sum(|c| c.weights_differ),
            sync_gaps: sum(|c| c.sync_gaps),
            overruns: sum(|c| c.overruns),
            saturated: sum(|c| c.saturated),
            limited: sum(|c| c.limited),
            coasted: sum(|c| c.coasted),
            field_not_finite: sum(|c| c.field_not_finite),
            frames_lost: sum(|c| c.link.frames),
            bus_errors: sum(|c| c.link.bus_errors),
            bus_offs: sum(|c| c.link.bus_offs),
            line_errors: sum(|c| c.link.line_errors),
            unsaid: sum(|c| c.link.unsaid),
            warnings,
        }
    }

    /// Names and counts of what is not zero, for people.
    #[must_use]
    pub fn told(&self) -> String {
        let counts = [
            ("breaches", self.breaches),
            ("floored", self.floored),
            ("reopened", self.reopened),
            ("extrapolated", self.extrapolated),
            ("late", self.late),
            ("ticks skipped", self.skipped),
            ("lost", self.lost),
            ("edges barred", self.barred),
            ("weights that differ", self.weights_differ),
            ("SYNC gaps", self.sync_gaps),
            ("overruns", self.overruns),
            ("saturated", self.saturated),
            ("limited", self.limited),
            ("samples missed", self.coasted),
            ("fields not finite", self.field_not_finite),
            ("frames lost", self.frames_lost),
            ("bus errors", self.bus_errors),
            ("bus-offs", self.bus_offs),
            ("line errors", self.line_errors),
            ("unsaid", self.unsaid),
            ("warnings", self.warnings),
        ];
        let told: Vec<_> = counts
            .iter()
            .filter(|(_, count)| *count > 0)
            .map(|(name, count)| format!("{name} {count}"))
            .collect();
        if told.is_empty() { "nothing".to_owned() } else { told.join(", ") }
    }
}
