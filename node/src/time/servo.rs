//! Bends a map by observations: at an instant of the own clock the time master's clock showed this.
//!
//! A filter of second order with a memory that grows: its gains are those of a straight line through all
//! observations (`2 (2n - 1) / (n (n + 1))`, `6 / (n (n + 1))`), until they reach the ones that stay, 0.3 and
//! 0.05. What is to be made up for is slewed over one period.
//!
//! Stamps of lines are not those of controllers: a computer, a driver or a program in between makes them late,
//! now more and now less, and never early. So of every few such observations the one that came soonest counts,
//! two of them say nothing of the rate, and the gains are the last ones from the beginning.

use super::map::{LARGEST_RATE, Map, ONE, bounded};

/// Gain of the phase that stays, in parts of 2^16: 0.3.
const PHASE_GAIN: i64 = 19_661;
/// Gain of the rate that stays: 0.05.
const RATE_GAIN: i64 = 3_277;
/// Observations from which on the gains stay.
const SETTLED: i64 = 11;
/// Observations that count where one comes after a much longer time than those before it: its rate says more
/// than theirs.
const AFTER_A_PAUSE: i64 = 2;
/// How much longer that is.
const PAUSE: u64 = 4;
/// An observation that is so far from what the last three say is left out once, ns.
const OUTLIER_NS: i64 = 100_000;
/// The largest offset that is slewed when the first two observations have come, ns. What is beyond it is
/// stepped over: once.
const STEP_NS: i64 = 50_000;
/// What two observations may differ by beside 500 ppm, at the join, ns.
const JITTER_NS: i64 = 100_000;
/// Observations with jitter of which one counts.
const SIEVE: u8 = 4;

/// An instant by both clocks, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Instant {
    own: u64,
    network: u64,
}

/// Outcome of an observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// It is the first of two that make a join.
    First,
    /// The map follows the time master from now on.
    Joined,
    /// The map was bent.
    Bent,
    /// It does not agree with those before it, and was left out.
    LeftOut,
    /// It waits for others, of which the best one counts.
    Kept,
}

/// Servo that bends a map by observations.
#[derive(Clone, Debug)]
pub struct Servo {
    map: Map,
    /// The last three observations of one master, the newest last.
    seen: [Option<Instant>; 3],
    /// Observations so far, as far as the gains need it.
    count: i64,
    /// Time between the last two, ns.
    period: u64,
    joined: bool,
    /// How late stamps may be, ns; 0 for those of controllers.
    jitter: i64,
    /// The best observation since the last one that counted, and how many there were.
    best: Option<Instant>,
    tried: u8,
}

impl Servo {
    /// A servo that has observed nothing, and a map by which both clocks run alike; stamps may be late by
    /// `jitter` (ns), or are those of controllers (0).
    #[must_use]
    pub const fn new(map: Map, jitter: u64) -> Self {
        let jitter = if jitter > i64::MAX as u64 { i64::MAX } else { jitter as i64 };
        Self { map, seen: [None; 3], count: 0, period: 0, joined: false, jitter, best: None, tried: 0 }
    }

    /// The map.
    #[must_use]
    pub const fn map(&self) -> &Map {
        &self.map
    }

    /// Whether the map has followed a time master.
    #[must_use]
    pub const fn has_joined(&self) -> bool {
        self.joined
    }

    /// Whether its gains have reached their final values.
    #[must_use]
    pub const fn is_settled(&self) -> bool {
        self.joined && self.count >= SETTLED
    }

    /// Forgets the observations of another master; the rate stays, since the own clock has not changed.
    pub fn turn_to_another(&mut self) {
        self.seen = [None; 3];
        (self.best, self.tried) = (None, 0);
    }

    /// Time by which the network's clock is ahead of the map at `now`, by an observation and the rate so far,
    /// ns.
    #[must_use]
    pub fn offset(&self, own: u64, network: u64, now: u64) -> i64 {
        self.offset_of(Instant { own, network }, now)
    }

    /// Takes an observation: when the own clock showed `own`, that of the network showed `network` (ns).
    /// `now` is the time of the own clock at which that is known.
    pub fn observe(&mut self, own: u64, network: u64, now: u64) -> Taken {
        match self.sieve(Instant { own, network }, now) {
            Some(best) => self.take(best, now),
            None => Taken::Kept,
        }
    }

    /// The observation that counts, if there is one now: without jitter, and before the join, each does.
    fn sieve(&mut self, new: Instant, now: u64) -> Option<Instant> {
        if self.jitter == 0 || !self.joined {
            return Some(new);
        }
        let best = match self.best {
            // Of two the one by which the network's clock is further on has come sooner.
            Some(best) if self.offset_of(best, now) >= self.offset_of(new, now) => best,
            _ => new,
        };
        (self.best, self.tried) = (Some(best), self.tried + 1);
        if self.tried < SIEVE {
            return None;
        }
        self.tried = 0;
        self.best.take()
    }

    fn take(&mut self, new: Instant, now: u64) -> Taken {
        let Instant { own, network } = new;
        let last = self.seen[2].filter(|last| own > last.own);
        self.seen = [self.seen[1], self.seen[2], Some(new)];
        let Some(last) = last else {
            self.count = self.count.max(1);
            return Taken::First;
        };
        let passed = own - last.own;
        let fast = difference(network, last.network).saturating_sub(difference(own, last.own));
        if !self.joined {
            return self.join(new, passed, fast, now);
        }
        let offset = self.offset_of(new, now);
        if offset.saturating_sub(self.middle(now)).abs() > OUTLIER_NS.max(self.jitter) {
            return Taken::LeftOut;
        }
        let next = if self.jitter == 0 { now.saturating_sub(own) } else { passed };
        self.bend(offset, (passed, next), per(fast, ONE, passed), now);
        Taken::Bent
    }

    /// Joins by two observations that agree: `passed` ns apart by the own clock, and `fast` ns more by that
    /// of the network.
    fn join(&mut self, new: Instant, passed: u64, fast: i64, now: u64) -> Taken {
        let most = JITTER_NS.max(self.jitter);
        if fast.abs() > most.saturating_add(i64::try_from(passed / 2000).unwrap_or(i64::MAX)) {
            self.seen = [None, None, Some(new)];
            return Taken::LeftOut;
        }
        let rate = if self.jitter == 0 { bounded(per(fast, ONE, passed)) } else { self.map.rate() };
        self.map.bend(now, rate, 0, 0);
        let offset = self.offset_of(new, now);
        if offset.abs() > STEP_NS {
            self.map.step(now, offset);
        } else {
            self.map.bend(now, rate, per(offset, ONE, passed), passed);
        }
        (self.joined, self.count, self.period) = (true, 2, passed);
        Taken::Joined
    }

    /// What the network's clock is ahead of the map at `now`, by one observation and the rate so far, ns.
    #[inline(never)]
    fn offset_of(&self, seen: Instant, now: u64) -> i64 {
        let mut from = Map::new(seen.own, seen.network);
        from.bend(seen.own, self.map.rate(), 0, 0);
        difference(from.network(now), self.map.network(now))
    }

    /// The middle one of what the last three observations say.
    fn middle(&self, now: u64) -> i64 {
        let [a, b, c] = self.seen.map(|seen| seen.map(|seen| self.offset_of(seen, now)));
        match (a, b, c) {
            (Some(a), Some(b), Some(c)) => a.max(b).min(a.min(b).max(c)),
            // Of two nobody knows which one is wrong.
            (_, _, c) => c.unwrap_or(0),
        }
    }

    /// Makes up for `offset` until the next observation, which comes after `next` ns like this one; the last
    /// one was `passed` ns ago, and the network's clock has run by `seen` faster since then.
    fn bend(&mut self, offset: i64, (passed, next): (u64, u64), seen: i64, now: u64) {
        if passed > self.period.saturating_mul(PAUSE) {
            self.count = self.count.min(AFTER_A_PAUSE);
        }
        self.period = passed;
        self.count = (self.count + 1).min(SETTLED);
        let n = if self.jitter == 0 { self.count } else { SETTLED };
        let of_line = |times: i64| (times << 16).checked_div(n * (n + 1)).unwrap_or(0);
        let phase_gain = of_line(2 * (2 * n - 1)).max(PHASE_GAIN);
        let rate_gain = of_line(6).max(RATE_GAIN);
        let slew = per(offset, phase_gain << 16, next);
        let change = match self.jitter {
            // What takes the whole slew says nothing of the rate. It may be wrong by more than a slew all the same: two stamps of
            // whole microseconds that are 2 ms apart are up to 500 ppm off.
            0 if slew.abs() >= LARGEST_RATE => ((bounded(seen) - self.map.rate()) * rate_gain) >> 16,
            0 => per(offset, rate_gain << 16, passed),
            // Here it says the sign of it: jitter may have made the rate wrong by more than a slew.
            _ => (bounded(slew) * rate_gain).checked_div(phase_gain).unwrap_or(0),
        };
        let rate = self.map.rate().saturating_add(change);
        self.map.bend(now, rate, slew, next);
    }
}

/// `a - b`, ns.
fn difference(a: u64, b: u64) -> i64 {
    let difference = i128::from(a) - i128::from(b);
    i64::try_from(difference).unwrap_or(if difference < 0 { i64::MIN } else { i64::MAX })
}

/// `offset gain / passed`, as a rate.
// Once in an image.
#[inline(never)]
fn per(offset: i64, gain: i64, passed: u64) -> i64 {
    let rate = i128::from(offset) * i128::from(gain) / i128::from(passed.max(1));
    i64::try_from(rate).unwrap_or(if rate < 0 { i64::MIN } else { i64::MAX })
}
