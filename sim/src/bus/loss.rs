//! Frames that get lost, each by itself or in runs.

use crate::random;
use crate::scenario::Loss;
use rand_pcg::Pcg64;

/// What decides which frames one receiver loses.
#[derive(Clone, Debug)]
pub struct Loser {
    loss: Loss,
    is_bad: bool,
    stream: Pcg64,
}

impl Loser {
    /// One that begins in the good state.
    pub fn new(loss: Loss, stream: Pcg64) -> Self {
        Self { loss, is_bad: false, stream }
    }

    /// Whether the next frame is lost.
    #[inline]
    pub fn loses(&mut self) -> bool {
        if self.loss.is_in_bursts() {
            self.loses_in_bursts()
        } else {
            random::happens(&mut self.stream, self.loss.good)
        }
    }

    fn loses_in_bursts(&mut self) -> bool {
        let Loss { good, bad, to_bad, to_good } = self.loss;
        let (lost, changes) = if self.is_bad { (bad, to_good) } else { (good, to_bad) };
        // Two draws for each frame, whatever the probabilities are: those of a frame do not depend on the
        // state.
        let is_lost = random::uniform(&mut self.stream) < lost;
        self.is_bad ^= random::uniform(&mut self.stream) < changes;
        is_lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Purpose;

    fn lost(loss: Loss, frames: usize) -> Vec<bool> {
        let mut loser = Loser::new(loss, random::stream(5, Purpose::Loss, 0));
        (0..frames).map(|_| loser.loses()).collect()
    }

    /// Runs of losses have the mean length 1 / to_good, and there are as many losses as the mean says.
    #[test]
    fn bursts_are_as_long_and_as_frequent_as_said() {
        let loss = Loss { good: 0.0, bad: 1.0, to_bad: 0.01, to_good: 0.2 };
        let lost = lost(loss, 400_000);
        let count = lost.iter().filter(|&&lost| lost).count() as f64;
        let runs = lost.windows(2).filter(|pair| !pair[0] && pair[1]).count() as f64;
        assert!((count / runs - 5.0).abs() < 0.2, "{}", count / runs);
        assert!((count / 400_000.0 - loss.mean()).abs() < 0.003, "{count} {}", loss.mean());
        assert!((loss.mean() - 1.0 / 21.0).abs() < 1e-12);
    }

    /// What independent losses of the same share would not show.
    #[test]
    fn independent_losses_make_no_bursts() {
        let lost = lost(Loss::independent(1.0 / 21.0), 400_000);
        let count = lost.iter().filter(|&&lost| lost).count() as f64;
        let runs = lost.windows(2).filter(|pair| !pair[0] && pair[1]).count() as f64;
        assert!((count / runs - 1.05).abs() < 0.02, "{}", count / runs);
    }

    #[test]
    fn both_states_may_lose() {
        let loss = Loss { good: 0.1, bad: 0.5, to_bad: 0.1, to_good: 0.1 };
        let count = lost(loss, 200_000).into_iter().filter(|&lost| lost).count() as f64;
        assert!((count / 200_000.0 - 0.3).abs() < 0.005, "{count}");
    }
}
