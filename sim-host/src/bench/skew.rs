//! How far apart in time nodes with clocks of their own run the same tick.

use crate::hub::Stamps;
use std::collections::VecDeque;
use std::time::Duration;

/// Ticks of which the end of a run consists.
const LAST: usize = 100;

/// The largest time between the first and the last node that sent what a tick came to.
///
/// As the host has read them, or by the time on their bus where they are on CAN, with the spread of the
/// start, the ways of the frames and what the host's system takes: all of this shortens the time that a frame
/// has to reach its tick.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Skew {
    /// The tick, and the time.
    pub largest: Option<(u64, Duration)>,
    /// Those of the last ticks.
    last: VecDeque<Duration>,
}

impl Skew {
    /// Takes the stamps of a tick; nodes that were lost or have stopped have none. One alone is not apart from anybody.
    pub fn tick(&mut self, k: u64, stamps: &[Stamps]) {
        let times = || stamps.iter().filter_map(|stamps| stamps.bus.or(stamps.state));
        if times().count() < 2 {
            return;
        }
        let (Some(first), Some(last)) = (times().min(), times().max()) else { return };
        let skew = last - first;
        if self.last.len() == LAST {
            self.last.pop_front();
        }
        self.last.push_back(skew);
        if self.largest.is_none_or(|(_, largest)| skew > largest) {
            self.largest = Some((k, skew));
        }
    }

    /// The median of the last hundred ticks: what a computer holds up now and then is not in it.
    #[must_use]
    pub fn at_the_end(&self) -> Option<Duration> {
        let mut last: Vec<_> = self.last.iter().copied().collect();
        last.sort_unstable();
        last.get(last.len() / 2).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_largest_and_those_who_said_nothing_have_none() {
        let at = |ms| Stamps { state: Some(Duration::from_millis(ms)), ..Stamps::default() };
        let mut skew = Skew::default();
        skew.tick(0, &[Stamps::default()]);
        skew.tick(0, &[at(5), Stamps::default()]);
        assert_eq!((skew.largest, skew.at_the_end()), (None, None));
        skew.tick(1, &[at(10), Stamps::default(), at(13)]);
        skew.tick(2, &[at(22), at(20), at(21)]);
        assert_eq!(skew.largest, Some((1, Duration::from_millis(3))));
        let end = skew.at_the_end();
        (3..200).for_each(|k| skew.tick(k, &[at(30), Stamps::default(), Stamps::default()]));
        assert_eq!(skew.at_the_end(), end, "of ticks of which one node alone has told");
    }
}
