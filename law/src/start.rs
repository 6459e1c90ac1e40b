//! Slow start (law.md 7): what throws a node out at a start is the inputs of its neighbours, which all begin
//! at once. In ticks that are short for the fields, and as long as ever for the nodes, none is thrown far
//! before the others answer.

/// Parts of a tick that pass for the fields and the funnels in each of the first ticks.
pub const PARTS: u32 = 8;
/// Time for which the law stays damped, in multiples of the slow ticks, in network time.
const DAMPED: u32 = 10;

/// Pace of network time, which also sets the constants of the law.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pace {
    /// An eighth of `T` passes in a tick; `theta` = 1, three quarters of the damping, `g` = 0.
    Slow,
    /// `T` passes in a tick; the same constants.
    Damped,
    /// Law (**) as it is.
    #[default]
    Usual,
}

/// A slow start. Ticks are counted as ever, `k` from 0; network time is `k T / 8` until `n T`, and then goes
/// on by `T` per tick.
///
/// ```
/// use funnelnet_law::start::{Pace, SlowStart};
/// // 10 ms at a tick of 1 ms: 80 ticks for the first 10 ms, and 70 ticks more than without for ever.
/// let start = SlowStart::new(10);
/// assert_eq!((start.slow_ticks(), start.behind()), (80, 70));
/// assert_eq!((start.pace(79), start.pace(80), start.pace(170)), (Pace::Slow, Pace::Damped, Pace::Usual));
/// assert_eq!(start.network_tick(80), 10);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SlowStart {
    ticks: u16,
}

impl SlowStart {
    /// Slow start of `ticks` ticks of network time; 0 is none.
    #[must_use]
    pub const fn new(ticks: u16) -> Self {
        Self { ticks }
    }

    /// Length in ticks of network time.
    #[must_use]
    pub const fn ticks(self) -> u16 {
        self.ticks
    }

    /// Whether there is no slow start.
    #[inline]
    #[must_use]
    pub const fn is_none(self) -> bool {
        self.ticks == 0
    }

    /// Number of slow ticks, in each of which an eighth of a tick passes.
    #[must_use]
    pub const fn slow_ticks(self) -> u32 {
        PARTS * self.ticks as u32
    }

    /// Ticks by which network time is behind the count of ticks after a slow start.
    #[must_use]
    pub const fn behind(self) -> u32 {
        (PARTS - 1) * self.ticks as u32
    }

    /// First tick of the law without its slow start.
    #[must_use]
    pub const fn end(self) -> u32 {
        DAMPED * self.ticks as u32 + self.behind()
    }

    /// The pace of tick `k`.
    #[must_use]
    pub const fn pace(self, k: u32) -> Pace {
        if k < self.slow_ticks() {
            Pace::Slow
        } else if k < self.end() {
            Pace::Damped
        } else {
            Pace::Usual
        }
    }

    /// Network time of tick `k` in ticks, once the slow ones are over.
    #[must_use]
    pub const fn network_tick(self, k: u32) -> u32 {
        k.wrapping_sub(self.behind())
    }

    /// Network time of tick `k` in eighths of a tick.
    #[must_use]
    pub const fn eighths(self, k: u64) -> u64 {
        if k < self.slow_ticks() as u64 { k } else { (k - self.behind() as u64) * PARTS as u64 }
    }
}
