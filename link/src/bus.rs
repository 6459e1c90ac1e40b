//! A CAN controller's error state (ISO 11898-1): what is reported, and how a node comes back from bus-off.
//!
//! A controller that goes bus-off has failed to send 32 times in a row: a fault of its own, its transceiver
//! or the bus. Coming back at once, again and again, disturbs the others as often. So it waits first, twice
//! as long each time, until it has stayed on the bus for [`STABLE_MS`].

/// First wait before a restart, ms.
pub const FIRST_WAIT_MS: u64 = 100;
/// Longest wait before a restart, ms.
pub const LONGEST_WAIT_MS: u64 = 10_000;
/// Time on the bus after which waits begin with the first one again, ms.
pub const STABLE_MS: u64 = 10_000;
/// Longest time that a restart may take, ms: 128 times 11 recessive bits are 70 ms at 20 kbit/s. After it the
/// restart has failed, or the controller went bus-off again before anybody looked.
pub const RESTART_MS: u64 = 200;

/// What a controller says of itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BusState {
    /// It takes part fully.
    #[default]
    Active,
    /// It takes part, and marks errors passively: an error counter is above 127.
    Passive,
    /// It takes no part: its transmit error counter is above 255.
    Off,
}

/// A change that is worth reporting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Change {
    /// Error-active again.
    Active,
    /// Error-passive.
    Passive,
    /// Off the bus. The node must make its output safe.
    Off {
        /// How often so far; stays at the largest number.
        count: u16,
        /// Wait before the restart, ms.
        wait_ms: u64,
    },
    /// On the bus again.
    Back,
}

/// What the driver shall do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Nothing but report this change, if there is one.
    Report(Option<Change>),
    /// Drop every frame that waits, and report this change.
    Silence(Change),
    /// Begin the recovery: 128 times 11 recessive bits.
    Restart,
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    On { since: u64 },
    Waiting { until: u64 },
    Restarting { since: u64 },
}

/// Follows the error state of one controller.
#[derive(Debug)]
pub struct Bus {
    phase: Phase,
    state: BusState,
    wait_ms: u64,
    offs: u16,
}

impl Default for Bus {
    fn default() -> Self {
        Self::new()
    }
}

impl Bus {
    /// A controller that has just been started, error-active.
    pub const fn new() -> Self {
        Self { phase: Phase::On { since: 0 }, state: BusState::Active, wait_ms: FIRST_WAIT_MS, offs: 0 }
    }

    /// How often the controller went off the bus.
    pub fn offs(&self) -> u16 {
        self.offs
    }

    /// The state as last reported.
    pub fn state(&self) -> BusState {
        self.state
    }

    /// Whether the controller may be given frames.
    pub fn is_on(&self) -> bool {
        matches!(self.phase, Phase::On { .. })
    }

    /// Takes a reading of the controller at `now` (ms, never going back). Call it every few milliseconds:
    /// embassy's drivers wake nobody for a change of the error state.
    pub fn observe(&mut self, reading: BusState, now: u64) -> Step {
        match (self.phase, reading) {
            (Phase::On { since }, BusState::Off) => self.go_off(now, now.saturating_sub(since) >= STABLE_MS),
            (Phase::On { .. }, _) => Step::Report(self.follow(reading)),
            (Phase::Waiting { until }, _) if now >= until => {
                self.phase = Phase::Restarting { since: now };
                Step::Restart
            }
            (Phase::Waiting { .. }, _) => Step::Report(None),
            (Phase::Restarting { since }, BusState::Off) if now.saturating_sub(since) >= RESTART_MS => {
                self.go_off(now, false)
            }
            (Phase::Restarting { .. }, BusState::Off) => Step::Report(None),
            (Phase::Restarting { .. }, _) => {
                self.phase = Phase::On { since: now };
                self.state = reading;
                Step::Report(Some(Change::Back))
            }
        }
    }

    fn follow(&mut self, reading: BusState) -> Option<Change> {
        let before = core::mem::replace(&mut self.state, reading);
        match reading {
            _ if reading == before => None,
            BusState::Passive => Some(Change::Passive),
            _ => Some(Change::Active),
        }
    }

    fn go_off(&mut self, now: u64, stable: bool) -> Step {
        if stable {
            self.wait_ms = FIRST_WAIT_MS;
        }
        let wait_ms = self.wait_ms;
        self.wait_ms = (wait_ms * 2).min(LONGEST_WAIT_MS);
        self.offs = self.offs.saturating_add(1);
        self.state = BusState::Off;
        self.phase = Phase::Waiting { until: now + wait_ms };
        Step::Silence(Change::Off { count: self.offs, wait_ms })
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::vec::Vec;

    /// A controller behind the state machine, which goes bus-off again `after` ms on the bus; time in ms.
    struct Bench {
        bus: Bus,
        now: u64,
        reading: BusState,
        seen: Vec<(u64, Step)>,
    }

    impl Bench {
        fn new() -> Self {
            Self { bus: Bus::new(), now: 0, reading: BusState::Active, seen: Vec::new() }
        }

        /// Observes every millisecond; a restart works after two.
        fn run(&mut self, ms: u64, restart_works: bool) {
            for _ in 0..ms {
                self.now += 1;
                let step = self.bus.observe(self.reading, self.now);
                if step != Step::Report(None) {
                    self.seen.push((self.now, step));
                }
                if step == Step::Restart && restart_works {
                    self.reading = BusState::Active;
                }
            }
        }

        fn waits(&self) -> Vec<u64> {
            let wait = |&(_, step): &(u64, Step)| match step {
                Step::Silence(Change::Off { wait_ms, .. }) => Some(wait_ms),
                _ => None,
            };
            self.seen.iter().filter_map(wait).collect()
        }
    }

    #[test]
    fn passive_and_active_are_each_reported_once() {
        let mut bench = Bench::new();
        for reading in [BusState::Passive, BusState::Active] {
            bench.reading = reading;
            bench.run(5, true);
        }
        let changes = [Change::Passive, Change::Active].map(|change| Step::Report(Some(change)));
        assert_eq!(bench.seen.iter().map(|&(_, step)| step).collect::<Vec<_>>(), changes);
    }

    #[test]
    fn bus_off_waits_then_restarts_then_comes_back() {
        let mut bench = Bench::new();
        bench.reading = BusState::Off;
        bench.run(FIRST_WAIT_MS, true);
        assert!(!bench.bus.is_on());
        bench.run(2, true);
        let off = Change::Off { count: 1, wait_ms: FIRST_WAIT_MS };
        let back = Step::Report(Some(Change::Back));
        let restart = 1 + FIRST_WAIT_MS;
        assert_eq!(bench.seen, [(1, Step::Silence(off)), (restart, Step::Restart), (restart + 1, back)]);
        assert!(bench.bus.is_on());
    }

    #[test]
    fn waits_double_up_to_the_longest_and_start_anew_after_a_stable_time() {
        let mut bench = Bench::new();
        for _ in 0..9 {
            bench.reading = BusState::Off;
            bench.run(LONGEST_WAIT_MS + 3, true);
            bench.run(STABLE_MS / 2, true);
            // The first waits are short, and the rest of the run would count as stable time.
            bench.bus.phase = Phase::On { since: bench.now };
        }
        assert_eq!(bench.waits(), [100, 200, 400, 800, 1600, 3200, 6400, 10_000, 10_000]);
        bench.run(STABLE_MS, true);
        bench.reading = BusState::Off;
        bench.run(1, true);
        assert_eq!(bench.waits().last(), Some(&FIRST_WAIT_MS));
        assert_eq!(bench.bus.offs(), 10);
    }

    #[test]
    fn a_restart_that_fails_is_tried_again_later() {
        let mut bench = Bench::new();
        bench.reading = BusState::Off;
        bench.run(FIRST_WAIT_MS + RESTART_MS + 2 * FIRST_WAIT_MS + 2, false);
        assert_eq!(bench.waits(), [FIRST_WAIT_MS, 2 * FIRST_WAIT_MS]);
        assert_eq!(bench.seen.iter().filter(|(_, step)| *step == Step::Restart).count(), 2);
    }
}
