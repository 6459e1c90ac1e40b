//! Policy for the watchdog of a node, which earns that it is fed: a function of what it has done, and of
//! nothing else.
//!
//! A node that runs by its own timer earns it by a completed tick; one that has nothing to do, by waiting for
//! it. A tick that is due and has not run is never fed over, so that a loop that comes round without doing
//! its work is reset.

/// Period at which a waiting loop must come round to feed, ns. A watchdog's period has to be a few times as
/// long.
pub const FEED_EVERY_NS: u64 = 500_000_000;

/// Progress of a node: what it has done, and what it waits for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Ticks that it has completed, modulo 2^32: not the tick number, which SYNC moves on over ticks that
    /// never ran.
    pub completed: u32,
    /// Whether a tick has to run now, or waits for its sample.
    pub is_due: bool,
    /// Time at which the node's own timer makes it tick next, ns; `None` where others decide that.
    pub next: Option<u64>,
}

/// Policy that decides when to feed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Policy {
    completed: u32,
}

impl Policy {
    /// Whether the watchdog is to be fed at `now` (ns).
    pub fn may_feed(&mut self, progress: Progress, now: u64) -> bool {
        let has_ticked = progress.completed != self.completed;
        self.completed = progress.completed;
        if has_ticked {
            return true;
        }
        // With a tick that is that far away there is time to wait; a clock that stands still comes no nearer,
        // and is not fed.
        let waits = progress.next.is_none_or(|next| next > now.saturating_add(FEED_EVERY_NS));
        waits && !progress.is_due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    fn progress(completed: u32, is_due: bool, next: Option<u64>) -> Progress {
        Progress { completed, is_due, next }
    }

    #[test]
    fn a_node_that_waits_for_others_is_fed_by_its_loop() {
        let mut policy = Policy::default();
        assert!((0..5).all(|n| policy.may_feed(progress(0, false, None), n * MS)));
    }

    #[test]
    fn a_tick_that_is_due_is_not_fed_over() {
        let mut policy = Policy::default();
        assert!((0..5).all(|n| !policy.may_feed(progress(0, true, None), n * MS)));
        assert!(policy.may_feed(progress(1, true, None), 5 * MS), "the one before has run");
        assert!(!policy.may_feed(progress(1, true, None), 6 * MS));
    }

    #[test]
    fn with_its_own_timer_only_a_completed_tick_counts() {
        let mut policy = Policy::default();
        assert!(!policy.may_feed(progress(0, false, Some(MS)), 0));
        assert!(policy.may_feed(progress(1, false, Some(2 * MS)), MS));
        // A loop that comes round on frames while its clock stands still.
        assert!((0..5).all(|_| !policy.may_feed(progress(1, false, Some(2 * MS)), MS)));
        assert!(policy.may_feed(progress(2, false, Some(3 * MS)), 2 * MS));
    }

    #[test]
    fn a_start_or_a_tick_that_is_far_away_is_waited_for() {
        let mut policy = Policy::default();
        let far = progress(0, false, Some(3_000 * MS));
        assert!(policy.may_feed(far, 0) && policy.may_feed(far, 2_499 * MS));
        assert!(!policy.may_feed(far, 2_500 * MS));
    }
}
