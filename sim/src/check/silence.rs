//! How often a receiver hears nothing of some of its senders for so long, where frames get lost.
//!
//! The losses of a receiver are a chain of two states (Gilbert 1960, Elliott 1963), which moves with each frame. So the
//! probability that all frames of some senders are lost in a window is a product of matrices along its frames.

use crate::extremes::larger;
use crate::scenario::Loss;
use funnelnet_law::math;

/// Lossy links that count together at one receiver. What more of them lose could only make silence rarer.
const MOST_LINKS: usize = 8;
/// Choices of senders that are looked at one by one. More of them count as the most silent one.
const MOST_CHOICES: u64 = 500;

/// What one receiver hears in a step.
pub(super) struct Receiver {
    /// What it loses of all that it hears.
    pub loss: Loss,
    /// What the link loses besides, by sender, in the order in which they send.
    pub links: Vec<Loss>,
    /// Frames of each sender in a step. The first one counts.
    pub frames: u32,
    /// Frames of others in a step.
    pub others: u32,
}

/// How often something begins in a step, at least and at most.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Rate {
    pub low: f64,
    pub high: f64,
}

impl Rate {
    pub fn plus(self, other: Self) -> Self {
        Self { low: self.low + other.low, high: self.high + other.high }
    }

    pub fn times(self, factor: f64) -> Self {
        Self { low: self.low * factor, high: self.high * factor }
    }
}

impl Receiver {
    /// How often `count` of the senders begin to be silent for `steps` steps at the same time. At least as often as those
    /// of whom most gets lost, and at most as often as all choices of so many senders together.
    pub fn silences(&self, count: usize, steps: u32) -> Rate {
        if count == 0 || count > self.links.len() {
            return Rate::default();
        }
        let mut senders: Vec<usize> = (0..self.links.len()).collect();
        senders.sort_by(|&a, &b| self.links[b].mean().total_cmp(&self.links[a].mean()));
        let low = self.begins(&senders[..count], steps);
        let choices = choices(senders.len(), count);
        // All choices are alike but for the places of their frames in a step.
        let is_alike = self.links.iter().all(Loss::is_none);
        let high = match choices {
            Some(few) if few <= MOST_CHOICES && !is_alike => {
                let mut sum = 0.0;
                for_each_choice(senders.len(), count, &mut |choice| sum += self.begins(choice, steps));
                sum
            }
            _ => low * choices.map_or(f64::INFINITY, |choices| choices as f64),
        };
        Rate { low, high: larger(low, high) }
    }

    /// How often the silence of all these senders begins to last `steps` steps: they were silent so long, and not for
    /// a step more.
    fn begins(&self, senders: &[usize], steps: u32) -> f64 {
        let more = self.all_lost(senders, steps + 1);
        larger(0.0, self.all_lost(senders, steps) - more)
    }

    /// Probability that nothing is heard of these senders in `steps` steps.
    fn all_lost(&self, senders: &[usize], steps: u32) -> f64 {
        let lossy = |&&sender: &&usize| !self.links[sender].is_none();
        let linked: Vec<usize> = senders.iter().filter(lossy).take(MOST_LINKS).copied().collect();
        let mut states = States::new(self.loss, linked.iter().map(|&sender| self.links[sender]));
        for _ in 0..steps {
            states.pass(0, self.others);
            for sender in 0..self.links.len() {
                if senders.contains(&sender) {
                    let link = linked.iter().position(|&at| at == sender).map(|at| at + 1);
                    states.lose(link);
                    states.pass(0, self.frames);
                    link.into_iter().for_each(|link| states.pass(link, self.frames));
                } else {
                    states.pass(0, self.frames);
                }
            }
        }
        states.sum()
    }
}

/// How often in a step a receiver takes a SYNC and then none for `steps` steps, where a step has one SYNC, and `others` frames before it.
/// It takes one if it has heard the one before as well: that one is what a SYNC tells the time of.
pub(super) fn sync_losses(loss: Loss, others: u32, steps: u32) -> f64 {
    let next = |mut states: States, is_heard: bool| {
        states.pass(0, others);
        if is_heard {
            states.hear()
        } else {
            states.lose(None)
        }
        states.pass(0, 1);
        states
    };
    let mut heard = next(next(States::new(loss, std::iter::empty()), true), true);
    let mut lost = heard.times(0.0);
    for _ in 0..steps {
        // After one that was heard, another one would be taken.
        let is_lost = next(heard.plus(&lost), false);
        heard = next(lost, true);
        lost = is_lost;
    }
    heard.sum() + lost.sum()
}

/// Number of ways to choose `count` of so many; none where they are more than a number has.
fn choices(of: usize, count: usize) -> Option<u64> {
    let count = count.min(of - count.min(of));
    (0..count as u64).try_fold(1_u64, |ways, at| Some(ways.checked_mul(of as u64 - at)? / (at + 1)))
}

fn for_each_choice(of: usize, count: usize, each: &mut impl FnMut(&[usize])) {
    let mut choice: Vec<usize> = (0..count).collect();
    loop {
        each(&choice);
        // The last one that can move on, and those behind it right after it.
        let Some(at) = (0..count).rev().find(|&at| choice[at] < of - count + at) else { return };
        choice[at] += 1;
        (at + 1..count).for_each(|later| choice[later] = choice[later - 1] + 1);
    }
}

/// The chains of a receiver (the first one) and of some links, and the probability of each joint state: bit `k` of an index is
/// set where chain `k` is in its bad state.
#[derive(Clone)]
struct States {
    chains: Vec<Loss>,
    weights: Vec<f64>,
}

impl States {
    /// As it is in the long run.
    fn new(own: Loss, links: impl Iterator<Item = Loss>) -> Self {
        let chains: Vec<Loss> = std::iter::once(own).chain(links).collect();
        let weight = |state: usize| {
            let of = |(at, chain): (usize, &Loss)| {
                let bad = chain.to_bad / (chain.to_bad + chain.to_good);
                if state >> at & 1 == 1 { bad } else { 1.0 - bad }
            };
            chains.iter().enumerate().map(of).product()
        };
        let weights = (0..1_usize << chains.len()).map(weight).collect();
        Self { chains, weights }
    }

    fn sum(&self) -> f64 {
        self.weights.iter().sum()
    }

    fn times(&self, factor: f64) -> Self {
        let weights = self.weights.iter().map(|weight| factor * weight).collect();
        Self { weights, chains: self.chains.clone() }
    }

    fn plus(&self, other: &Self) -> Self {
        let weights = self.weights.iter().zip(&other.weights).map(|(a, b)| a + b).collect();
        Self { weights, chains: self.chains.clone() }
    }

    /// A frame is lost at the receiver, or on the link before it.
    fn lose(&mut self, link: Option<usize>) {
        let Self { chains, weights } = self;
        let lost = |at: usize, state: usize| {
            let chain = chains.get(at).copied().unwrap_or(Loss::NONE);
            if state >> at & 1 == 1 { chain.bad } else { chain.good }
        };
        for (state, weight) in weights.iter_mut().enumerate() {
            let heard = 1.0 - lost(0, state);
            let lost_on_link = link.map_or(0.0, |link| lost(link, state));
            *weight *= lost(0, state) + heard * lost_on_link;
        }
    }

    /// A frame is heard.
    fn hear(&mut self) {
        let Some(&Loss { good, bad, .. }) = self.chains.first() else { return };
        for (state, weight) in self.weights.iter_mut().enumerate() {
            *weight *= 1.0 - if state & 1 == 1 { bad } else { good };
        }
    }

    /// So many frames pass a chain: it moves as often.
    fn pass(&mut self, at: usize, frames: u32) {
        let Some(&Loss { to_bad, to_good, .. }) = self.chains.get(at) else { return };
        let rest = math::pow(1.0 - to_bad - to_good, frames.into());
        let bad = to_bad / (to_bad + to_good);
        for state in 0..self.weights.len() {
            let other = state | 1 << at;
            if other == state {
                continue;
            }
            let (is_good, is_bad) = (self.weights[state], self.weights[other]);
            let both = is_good + is_bad;
            let left = rest * (is_bad - bad * both);
            self.weights[other] = bad * both + left;
            self.weights[state] = (1.0 - bad) * both - left;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::loss::Loser;
    use crate::random::{self, Purpose};

    const BURSTS: Loss = Loss { good: 0.0, bad: 1.0, to_bad: 0.01, to_good: 0.2 };

    fn close(a: f64, b: f64, to: f64) -> bool {
        (a - b).abs() <= to * b.abs()
    }

    /// `p^n (1 - p)`, once for each of the senders.
    #[test]
    fn independent_losses_are_powers() {
        let receiver =
            Receiver { loss: Loss::independent(0.1), links: vec![Loss::NONE; 3], frames: 1, others: 0 };
        let rate = receiver.silences(1, 4);
        assert!(close(rate.low, 0.9e-4, 1e-9) && close(rate.high, 2.7e-4, 1e-9), "{rate:?}");
        // Both of two, at the same time: not in the step before.
        let rate = receiver.silences(2, 4);
        assert!(
            close(rate.low, 1e-8 * (1.0 - 1e-2), 1e-9) && close(rate.high, 3.0 * rate.low, 1e-9),
            "{rate:?}"
        );
        assert_eq!(receiver.silences(4, 4), Rate::default());
        assert_eq!(receiver.silences(0, 4), Rate::default());
    }

    /// Losses of the bus and of a link add up.
    #[test]
    fn links_lose_besides() {
        let links = vec![Loss::independent(0.5), Loss::NONE];
        let receiver = Receiver { loss: Loss::independent(0.1), links, frames: 1, others: 5 };
        let both: f64 = 0.1 + 0.9 * 0.5;
        let rate = receiver.silences(1, 3);
        let of = |lost: f64| lost * lost * lost * (1.0 - lost);
        assert!(close(rate.low, of(both), 1e-9) && close(rate.high, of(both) + of(0.1), 1e-9), "{rate:?}");
    }

    /// What the bus itself does, counted.
    fn counted(receiver: &Receiver, count: usize, steps: u32) -> f64 {
        let mut own = Loser::new(receiver.loss, random::stream(7, Purpose::Loss, 0));
        let link =
            |(at, loss): (usize, &Loss)| Loser::new(*loss, random::stream(7, Purpose::LinkLoss, at as u64));
        let mut links: Vec<Loser> = receiver.links.iter().enumerate().map(link).collect();
        let mut silent = vec![0; links.len()];
        let (mut was, mut begun) = (false, 0);
        let tried = 2_000_000;
        for _ in 0..tried {
            (0..receiver.others).for_each(|_| _ = own.loses());
            for (link, silent) in links.iter_mut().zip(&mut silent) {
                for frame in 0..receiver.frames {
                    let lost = own.loses() | link.loses();
                    if frame == 0 {
                        *silent = if lost { *silent + 1 } else { 0 };
                    }
                }
            }
            let is = silent.iter().filter(|&&silent| silent >= steps).count() >= count;
            begun += u32::from(is && !was);
            was = is;
        }
        f64::from(begun) / f64::from(tried)
    }

    /// Bursts of a receiver are as long in frames as said, so that they silence all of its senders at once.
    #[test]
    fn bursts_silence_as_often_as_the_bus_has_it() {
        let on_link = Loss { good: 0.01, bad: 0.9, to_bad: 0.02, to_good: 0.1 };
        let quiet = Loss::NONE;
        let cases = [
            (BURSTS, vec![quiet, quiet], 1, 0, 2, 6),
            (BURSTS, vec![quiet, quiet], 2, 3, 1, 3),
            (BURSTS, vec![quiet; 4], 1, 0, 4, 3),
            (quiet, vec![on_link, quiet], 2, 0, 1, 5),
            (BURSTS, vec![on_link, on_link, quiet], 1, 0, 2, 4),
        ];
        for (loss, links, frames, others, count, steps) in cases {
            let receiver = Receiver { loss, links, frames, others };
            let (rate, seen) = (receiver.silences(count, steps), counted(&receiver, count, steps));
            assert!(seen > 1e-4, "{count} {steps}: {seen} says little");
            assert!((0.9 * rate.low..1.1 * rate.high).contains(&seen), "{count} {steps}: {seen} {rate:?}");
        }
        let one = Receiver { loss: BURSTS, links: vec![quiet, quiet], frames: 1, others: 0 };
        let rate = one.silences(2, 6);
        assert!(close(rate.high, rate.low, 1e-12), "one choice alone: {rate:?}");
    }

    /// `l` lost and `h` heard: of three, none is taken after `lll`, `llh` and `lhl` alone.
    #[test]
    fn a_lost_sync_costs_two() {
        let of = |steps| sync_losses(Loss::independent(0.1), 7, steps);
        let taken = 0.9 * 0.9;
        assert!(
            close(of(0), taken, 1e-9) && close(of(1), 0.1 * taken, 1e-9) && close(of(2), 0.1 * taken, 1e-9)
        );
        assert!(close(of(3), (0.1 * 0.1 + 0.1 * 0.9 * 0.1) * taken, 1e-9), "{}", of(3));
        assert_eq!(sync_losses(Loss::NONE, 7, 1), 0.0);
    }

    #[test]
    fn choices_are_counted() {
        assert_eq!(
            [choices(5, 2), choices(5, 5), choices(5, 0), choices(126, 63)],
            [Some(10), Some(1), Some(1), None]
        );
        let mut seen = Vec::new();
        for_each_choice(4, 2, &mut |choice| seen.push(choice.to_vec()));
        assert_eq!(seen, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]]);
    }
}
