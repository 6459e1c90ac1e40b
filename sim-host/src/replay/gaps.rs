//! When a bus was free: then what waits is sent, so that what was not sent is missing.

use funnelnet_can_bus::length::INTERMISSION;
use funnelnet_can_bus::{Length, Record, Timing};
use std::collections::VecDeque;

/// Times of a log are cut to microseconds.
const CUT_NS: u64 = 1000;
/// Gaps that are kept: those of some ticks.
const KEPT: usize = 256;

/// The last times at which a simulated bus was free.
#[derive(Debug)]
pub struct Gaps {
    timing: Timing,
    /// End of the last intermission, ns.
    free: u64,
    /// An error since then: that the bus was busy with it is not in the log.
    error: bool,
    gaps: VecDeque<(u64, u64)>,
}

impl Gaps {
    /// A bus of which nothing was heard.
    pub fn new(timing: Timing) -> Self {
        Self { timing, free: 0, error: false, gaps: VecDeque::with_capacity(KEPT) }
    }

    /// Takes the next record; its time is that of the sample point of the last bit before the intermission.
    pub fn take(&mut self, record: &Record) {
        let rate = self.timing.nominal();
        let Some((frame, passive)) = record.frame() else {
            self.error = true;
            return;
        };
        let free = record.at + u64::from(INTERMISSION + 1) * rate.bit_ns() - rate.sample_ns();
        let start = free.saturating_sub(Length::of(&frame, passive).ns(self.timing));
        let error = std::mem::take(&mut self.error);
        if start > self.free + 2 * CUT_NS && !error {
            if self.gaps.len() == KEPT {
                self.gaps.pop_front();
            }
            self.gaps.push_back((self.free, start));
        }
        self.free = free;
    }

    /// Whether it was free at some time between `from` and `to`, ns.
    pub fn was_free(&self, from: u64, to: u64) -> bool {
        let (from, to) = (from + 2 * CUT_NS, to.saturating_sub(2 * CUT_NS));
        self.gaps.iter().any(|&(begin, end)| begin.max(from) < end.min(to))
    }
}
