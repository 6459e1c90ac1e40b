//! How long a frame waits at the worst: the analysis of fixed priorities without preemption (Davis, Burns,
//! Bril, Lukkien: Controller Area Network schedulability analysis: refuted, revisited and revised, Real-Time
//! Systems 35, 2007).

use crate::frame::Id;
use crate::rate::Timing;

/// Frames of one identifier that come again and again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    /// Time on the bus of the longest of them, from the start of frame to the end of the intermission, ns.
    pub time: u64,
    /// Shortest time from one to the next, ns.
    pub period: u64,
}

/// Bits of a data frame with as many stuff bits as there can be, intermission included: classic, of so many
/// bytes.
pub fn longest_classic(id: Id, bytes: u32) -> u32 {
    let (plain, stuffed) = stretches(id, bytes);
    plain + (stuffed - 1) / 4
}

/// The same with none.
pub fn shortest_classic(id: Id, bytes: u32) -> u32 {
    stretches(id, bytes).0
}

/// All bits, and those among them that are stuffed.
fn stretches(id: Id, bytes: u32) -> (u32, u32) {
    match id {
        Id::Base(_) => (47 + 8 * bytes, 34 + 8 * bytes),
        Id::Extended(_) => (67 + 8 * bytes, 54 + 8 * bytes),
    }
}

/// Most frames of one stream that are looked at in one busy period.
const MOST_FRAMES: u64 = 10_000;

/// Longest time from when a frame is ready to the end of its intermission, ns, for each of `streams`, the
/// most urgent first. `None` where the bus does not carry it: it waits longer and longer. Frames have no
/// jitter, no errors, and a transmit buffer each.
#[must_use]
pub fn longest(streams: &[Stream], timing: Timing) -> Vec<Option<u64>> {
    let bit = timing.nominal().bit_ns();
    (0..streams.len()).map(|at| of(streams, at, bit)).collect()
}

fn of(streams: &[Stream], at: usize, bit: u64) -> Option<u64> {
    let (urgent, rest) = streams.split_at(at);
    let (own, rest) = rest.split_first()?;
    // A frame that is less urgent may have just begun.
    let blocking = rest.iter().map(|other| other.time).max().unwrap_or(0);
    let load: f64 = urgent.iter().chain([own]).map(|stream| stream.time as f64 / stream.period as f64).sum();
    if load > 1.0 {
        return None;
    }
    // From the begin of a time in which the bus is never free for a less urgent frame to its end: equation
    // (3.7).
    let busy = settle(blocking + own.time, |busy| {
        let frames = urgent.iter().chain([own]).map(|stream| busy.div_ceil(stream.period) * stream.time);
        blocking + frames.sum::<u64>()
    })?;
    let frames = busy.div_ceil(own.period);
    // Its first frame is not always the one that waits longest.
    let response = |frame: u64| {
        let before = blocking + frame * own.time;
        let queueing = settle(before, |queueing| {
            let frames = urgent.iter().map(|stream| (queueing + bit).div_ceil(stream.period) * stream.time);
            before + frames.sum::<u64>()
        })?;
        Some((queueing + own.time).saturating_sub(frame * own.period))
    };
    (frames <= MOST_FRAMES).then(|| (0..frames).map(response).max()?)?
}

/// Most steps to a fixed point.
const MOST_STEPS: usize = 100_000;

/// The smallest fixed point of a growing function from `first` on, if it comes soon.
fn settle(first: u64, next: impl Fn(u64) -> u64) -> Option<u64> {
    let mut value = first;
    for _ in 0..MOST_STEPS {
        let now = next(value);
        if now == value {
            return Some(value);
        }
        value = now;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rate::BitRate;

    fn timing() -> Timing {
        Timing::classic(BitRate::new(125_000, 875).unwrap())
    }

    /// The example with which Davis et al. refute the older analysis (their Table 2): at 125 kbit/s three
    /// messages of 135 bits with periods of 2.5, 3.5 and 3.5 ms. The second frame of the last one waits
    /// longer than the first.
    #[test]
    fn the_second_frame_may_wait_longer_than_the_first() {
        let stream = |period| Stream { time: 1_000_000, period };
        let streams = [2_500_000, 3_500_000, 3_500_000].map(stream);
        // One bit of the paper's example is nothing here.
        let fast = Timing::classic(BitRate::new(1_000_000, 875).unwrap());
        let times: Vec<_> =
            longest(&streams, fast).into_iter().map(|time| time.map(|ns| ns / 10_000)).collect();
        assert_eq!(times, [Some(200), Some(300), Some(350)]);
    }

    #[test]
    fn a_bus_that_is_too_full_carries_only_the_urgent_ones() {
        let streams = [Stream { time: 600_000, period: 1_000_000 }; 3];
        assert_eq!(longest(&streams, timing()), [Some(1_200_000), None, None]);
        assert_eq!(longest(&[], timing()), []);
        assert_eq!(longest(&streams[..1], timing()), [Some(600_000)]);
    }

    #[test]
    fn lengths_are_those_of_the_worst_case() {
        assert_eq!((longest_classic(Id::Base(1), 8), shortest_classic(Id::Base(1), 8)), (135, 111));
        assert_eq!((longest_classic(Id::Extended(1), 8), shortest_classic(Id::Extended(1), 8)), (160, 131));
        assert_eq!(longest_classic(Id::Base(1), 5), 105);
    }
}
