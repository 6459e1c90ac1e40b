//! The clock of a node: which tick comes next, when it is due, and what becomes of ticks that were missed.

use super::Node;
use super::step::{Purpose, Step};
use crate::observe::{Event, Phase};
use crate::watchdog::Progress;
use funnelnet_law::field::VectorField;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::math::Real;
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::message::{FaultCode, TickStamp};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::count;

/// Late ticks that a virtual node makes up for at most, however late it comes; it skips those before them.
pub const CATCH_UP_LIMIT: u32 = 4;
/// Ticks that a SYNC may skip before it is taken for a stray one.
const SYNC_AHEAD: u32 = 1000;
/// The same before the first tick of a node that joins late: half of what the 24 bits of a SYNC can tell.
const JOIN_AHEAD: u32 = (1 << 23) - 1;

/// Time of the next tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Schedule {
    /// Not before a SYNC or a start.
    Wait,
    /// Now: a SYNC has come.
    Now,
    /// At this time, ns.
    At(u64),
}

/// Tick number and schedule of a node.
#[derive(Clone, Debug)]
pub(super) struct Clock {
    /// Tick that is computed next.
    pub tick: u32,
    pub schedule: Schedule,
    /// Time of the last SYNC that was taken, or of the start, ns.
    synced: u64,
    /// Ticks that this node was moved on over without running them, modulo 2^32.
    skipped: u32,
    /// The last tick of the timer came a whole period late or more.
    late: bool,
    /// Tick before whose law the node is given other parameters.
    pub commit: Option<u32>,
}

/// Whether a tick is due.
enum Due {
    No,
    Yes,
    /// Since this time, ns, a whole period ago or more.
    Late(u64),
}

impl Clock {
    /// A clock that stands before tick 0.
    pub fn new() -> Self {
        Self { tick: 0, schedule: Schedule::Wait, synced: 0, skipped: 0, late: false, commit: None }
    }

    /// Starts at `now` (ns), for a first tick `at_tick` periods after the one that the announced states need.
    pub fn start(&mut self, source: TickSource, at_tick: u16, tick_ns: u64, now: u64) {
        self.synced = now;
        self.schedule = match source {
            TickSource::Sync => Schedule::Wait,
            // One period for the announced initial states to arrive, then tick 0.
            TickSource::Timer => Schedule::At(now + (u64::from(at_tick) + 1) * tick_ns),
        };
    }

    /// Stops: neither a tick nor a commit is due any more.
    pub fn halt(&mut self) {
        self.schedule = Schedule::Wait;
        self.commit = None;
    }

    /// Whether the next tick is that of the commit, or later: SYNC may have skipped it.
    #[inline]
    pub fn commit_is_due(&self) -> bool {
        self.commit.is_some_and(|at| self.tick.wrapping_sub(at) as i32 >= 0)
    }

    /// Takes the tick that is due at `now` (ns), and sets the time of the next one.
    #[inline]
    fn take_due(&mut self, now: u64, tick_ns: u64) -> Due {
        match self.schedule {
            Schedule::Wait => Due::No,
            Schedule::Now => {
                self.schedule = Schedule::Wait;
                Due::Yes
            }
            Schedule::At(due) if now >= due => {
                let next = due + tick_ns;
                self.schedule = Schedule::At(next);
                if now >= next {
                    return Due::Late(due);
                }
                self.late = false;
                Due::Yes
            }
            Schedule::At(_) => Due::No,
        }
    }

    /// When a node with this `holdover` (ns) stops unless another SYNC comes, ns.
    #[inline]
    fn held_until(&self, holdover: u64) -> u64 {
        self.synced.saturating_add(holdover)
    }
}

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    /// Ticks, or asks for the sample that a tick needs.
    pub(super) fn run_due_ticks(&mut self, now: u64) {
        for _ in 0..CATCH_UP_LIMIT {
            if self.step != Step::Idle || self.clock.commit_is_due() || !self.tick_is_due(now) {
                return;
            }
            match self.plant {
                Some(_) => self.step = Step::Ask(Purpose::Tick),
                None => self.run_tick(),
            }
        }
    }

    fn tick_is_due(&mut self, now: u64) -> bool {
        match self.clock.take_due(now, self.params.tick_ns) {
            Due::No => false,
            Due::Yes => true,
            Due::Late(due) => self.came_late(now, due),
        }
    }

    /// Counts a tick due at `due` (ns) that comes when the next one is due already, and moves on over those
    /// that can be run no more. Whether one is due then: not where that leads over the tick of a commit,
    /// which comes first.
    #[cold]
    fn came_late(&mut self, now: u64, due: u64) -> bool {
        count(&mut self.counters.overruns);
        if !self.clock.late {
            self.clock.late = true;
            self.outbox.report(Event::Overrun { tick: self.clock.tick });
        }
        let missed = self.beyond_making_up(now, due);
        self.skip(missed);
        let is_due = !self.clock.commit_is_due();
        let passed = u64::from(missed) + u64::from(is_due);
        self.clock.schedule = Schedule::At(due + passed * self.params.tick_ns);
        is_due
    }

    /// Ticks, from the one due at `due` (ns) on, that are not run any more at `now` (ns): those whose time is
    /// over. A plant cannot be measured in the past. A virtual node makes up for the last few: for all of a
    /// long sleep it would be away from its link and its watchdog, and meanwhile too far behind its
    /// neighbours to hear them.
    fn beyond_making_up(&self, now: u64, due: u64) -> u32 {
        let late_by = now.saturating_sub(due);
        let over =
            late_by.checked_div(self.params.tick_ns).map_or(0, |n| u32::try_from(n).unwrap_or(u32::MAX));
        let made_up = if self.plant.is_some() { 0 } else { CATCH_UP_LIMIT - 1 };
        over.saturating_sub(made_up)
    }

    /// Moves on over ticks that this node never runs.
    fn skip(&mut self, ticks: u32) {
        self.clock.tick = self.clock.tick.wrapping_add(ticks);
        self.clock.skipped = self.clock.skipped.wrapping_add(ticks);
        self.counters.skipped = self.counters.skipped.saturating_add(ticks);
    }

    /// Takes a SYNC, each of which marks one tick in sync mode: the one after `previous`. A repeated SYNC is
    /// a duplicate; a later one means that ticks were missed: the node follows the master's count and says
    /// how many.
    pub(super) fn on_sync(&mut self, previous: TickStamp, now: u64) -> Result<(), Refusal> {
        if self.params.tick_source != TickSource::Sync {
            return Ok(());
        }
        if self.phase != Phase::Running {
            return Err(Refusal::Phase);
        }
        // A tick that has not been run yet is overtaken; one that waits for its sample gives that to the new
        // one.
        let waits = self.tick_waits_for_sample();
        let overtakes = waits || self.clock.schedule == Schedule::Now;
        let due = self.clock.tick.wrapping_add(u32::from(overtakes));
        let ahead = if self.counters.ticks == 0 { JOIN_AHEAD } else { SYNC_AHEAD };
        let last = previous.rebuild(due.wrapping_sub(1), 0, ahead).ok_or(Refusal::TickWindow)?;
        let marked = last.wrapping_add(1);
        if overtakes || marked != self.clock.tick {
            let missed = marked.wrapping_sub(self.clock.tick);
            count(&mut self.counters.sync_gaps);
            self.outbox.report(Event::SyncGap { missed });
            self.skip(missed);
        }
        if !waits {
            self.clock.schedule = Schedule::Now;
        }
        self.clock.synced = now;
        Ok(())
    }

    /// When a running node that ticks by SYNC stops unless another one comes, ns.
    pub(super) fn held_until(&self) -> Option<u64> {
        let holdover = self.params.holdover_ns.filter(|_| self.phase == Phase::Running)?;
        Some(self.clock.held_until(holdover))
    }

    /// Stops a node whose time master is gone.
    pub(super) fn check_holdover(&mut self, now: u64) {
        if self.held_until().is_some_and(|until| now >= until) {
            let silent_ms = now.saturating_sub(self.clock.synced) / 1_000_000;
            self.fail(FaultCode::HOLDOVER, u16::try_from(silent_ms).unwrap_or(u16::MAX));
        }
    }

    /// Ticks that it has completed and waits for, for its watchdog.
    pub fn progress(&self) -> Progress {
        let next = match self.clock.schedule {
            Schedule::At(next) => Some(next),
            Schedule::Wait | Schedule::Now => None,
        };
        let samples = matches!(self.step, Step::Ask(_) | Step::Await(_));
        Progress {
            completed: self.clock.tick.wrapping_sub(self.clock.skipped),
            is_due: samples || self.clock.schedule == Schedule::Now,
            next,
        }
    }
}
