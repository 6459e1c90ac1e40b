//! What may be said of a distance to the reference, which is off by something itself.

#[cfg(feature = "reference")]
use crate::reference::ReferenceSolution;
use serde::Serialize;

/// Distance to the continuous-time reference, in state units.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct ReferenceSummary {
    /// Over all nodes and ticks.
    pub max_error: f64,
    /// Over all nodes, at the end.
    pub final_error: f64,
    /// Whether the reference is near enough to the exact solution to stand for it. If not, no distance to it
    /// is judged.
    pub resolved: bool,
    /// How far the reference itself may be from the exact solution; `null` where it is not known to any
    /// bound.
    pub error_estimate: f64,
}

impl ReferenceSummary {
    /// No distance yet to this solution, with what is known of its own error. One without an estimate is not
    /// resolved.
    #[cfg(feature = "reference")]
    #[must_use]
    pub fn beside(solution: &ReferenceSolution) -> Self {
        let (resolved, error_estimate) = match &solution.estimate {
            Some(estimate) => (estimate.resolved(), estimate.error),
            None => (false, f64::NAN),
        };
        Self { max_error: 0.0, final_error: 0.0, resolved, error_estimate }
    }

    /// The largest error, to be compared with `limit` (state units); `None` where the reference is too far
    /// from the exact solution to say on which side of it the error is.
    pub fn measured(&self, limit: f64) -> Option<f64> {
        let below = self.max_error + self.error_estimate < limit;
        let above = self.max_error - self.error_estimate >= limit;
        (self.resolved && (below || above)).then_some(self.max_error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn summary(max_error: f64, resolved: bool, error_estimate: f64) -> ReferenceSummary {
        ReferenceSummary { max_error, final_error: 0.0, resolved, error_estimate }
    }

    #[test]
    fn an_error_is_measured_where_the_reference_is_exact_enough_to_say() {
        assert_eq!(summary(0.5, true, 0.1).measured(1.0), Some(0.5));
        assert_eq!(summary(2.0, true, 0.1).measured(1.0), Some(2.0));
        for (max_error, error_estimate) in
            [(0.95, 0.1), (1.05, 0.1), (0.0, 2.0), (0.5, f64::NAN), (f64::NAN, 0.1)]
        {
            assert_eq!(summary(max_error, true, error_estimate).measured(1.0), None);
        }
        assert_eq!(summary(0.0, false, 0.0).measured(1.0), None);
    }

    #[test]
    fn a_reference_that_nobody_has_estimated_is_not_resolved() {
        assert!(!ReferenceSummary::default().resolved);
    }
}
