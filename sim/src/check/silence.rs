//! How often a receiver hears nothing of some of its senders for so long, where frames get lost.
//!
//! The losses of a receiver are a chain of two states (Gilbert 1960, Elliott 1963), which moves with each frame and begins in the
//! good one. So the probability that all frames of some senders are lost in a window is a product of matrices along its frames.

use crate::extremes::larger;
use crate::scenario::Loss;
use funnelnet_law::math;
use funnelnet_node::neighbour::WINDOW_BACK;

/// Links with bursts that count together at one receiver that loses by itself, too. More of them count as always silent.
const MOST_CHAINS: usize = 6;
/// Choices of senders that are looked at one by one. Where there are more, each counts as the most silent one.
const MOST_CHOICES: u64 = 100;

/// What one receiver hears in a step.
#[derive(PartialEq)]
pub(super) struct Receiver {
    /// What it loses of all that it hears.
    pub loss: Loss,
    /// By sender, in the order in which they send.
    pub senders: Vec<Sender>,
    /// Frames of each sender in a step. The first one counts.
    pub frames: u32,
    /// Steps in which nothing is heard before a sender counts as silent.
    pub patience: u32,
}

/// Steps after which a frame that has not come is no longer taken.
pub(super) const TAKEN: usize = WINDOW_BACK as usize + 1;

/// A sender as a receiver hears it.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct Sender {
    /// What the link loses besides.
    pub link: Loss,
    /// Probability that a frame is still on its way in the step in which it is sent, in the next one, and so on; that of the last one stays.
    pub on_its_way: [f64; TAKEN],
}

impl Sender {
    /// One whose frames come at once.
    pub const fn prompt(link: Loss) -> Self {
        Self { link, on_its_way: [0.0; TAKEN] }
    }

    fn on_its_way(&self, age: u32) -> f64 {
        self.on_its_way.get(age as usize).or(self.on_its_way.last()).copied().unwrap_or(0.0)
    }
}

/// How much is to be expected of something in a run, at least and at most: `exp(-hazard)` is the probability that it never happens.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Hazard {
    pub low: f64,
    pub high: f64,
}

impl Hazard {
    pub fn plus(self, other: Self) -> Self {
        Self { low: self.low + other.low, high: self.high + other.high }
    }

    /// That of so many that are alike.
    pub fn times(self, low: usize, high: usize) -> Self {
        // What is certain for none of them is no hazard.
        let of = |count: usize, hazard: f64| if count == 0 { 0.0 } else { count as f64 * hazard };
        Self { low: of(low, self.low), high: of(high, self.high) }
    }
}

/// That of something that is there at the beginning with a probability of `first`, and begins `later` times afterwards.
fn hazard(first: f64, later: f64) -> f64 {
    larger(0.0, later) - math::ln_1p(-first.clamp(0.0, 1.0))
}

impl Receiver {
    /// That `count` of the senders are silent at the same time in a run of so many steps. At least as those of whom most gets
    /// lost, and at most as all choices of so many senders together.
    pub fn silences(&self, count: usize, run: u64) -> Hazard {
        if count == 0 || count > self.senders.len() {
            return Hazard::default();
        }
        let loss = |sender: &usize| self.senders.get(*sender).map_or(0.0, |sender| sender.link.mean());
        let mut senders: Vec<usize> = (0..self.senders.len()).collect();
        senders.sort_by(|a, b| loss(b).total_cmp(&loss(a)));
        let worst = senders.get(..count).unwrap_or_default();
        let (mut most, mut sum) = (0.0, 0.0);
        match choices(senders.len(), count) {
            Some(few) if few <= MOST_CHOICES => for_each_choice(senders.len(), count, &mut |choice| {
                let hazard = self.silence(choice, run);
                (most, sum) = (larger(most, hazard), sum + hazard);
            }),
            more => {
                most = self.silence(worst, run);
                sum = if most > 0.0 { most * more.map_or(f64::INFINITY, |more| more as f64) } else { 0.0 };
            }
        }
        let low = if self.is_whole(worst) { most } else { 0.0 };
        Hazard { low, high: larger(low, sum) }
    }

    /// Whether no sender had to be taken for silent.
    fn is_whole(&self, senders: &[usize]) -> bool {
        self.loss.is_none() || self.bursty(senders).len() <= MOST_CHAINS
    }

    fn bursty(&self, senders: &[usize]) -> Vec<usize> {
        let is =
            |&&sender: &&usize| self.senders.get(sender).is_some_and(|sender| sender.link.is_in_bursts());
        senders.iter().filter(is).copied().collect()
    }

    /// That all of these are silent at the same time. Silence begins where it has lasted as long as is waited for, and not a step more.
    fn silence(&self, senders: &[usize], run: u64) -> f64 {
        let begins = run.saturating_sub(self.patience.into());
        let first = self.all_lost(senders, 0, 0);
        let sums =
            |more: u32, windows: u64| if windows == 0 { 0.0 } else { self.all_lost(senders, more, windows) };
        // From the second window on, less those that were silent before it.
        let later = sums(0, begins + 1) - first - sums(1, begins);
        hazard(first, later)
    }

    /// Probability that nothing is heard of these senders from the beginning on for as long as is waited for, and `more` steps; or its sum
    /// over windows that begin at each of the first so many steps.
    fn all_lost(&self, senders: &[usize], more: u32, windows: u64) -> f64 {
        if self.loss.is_none() {
            return self.all_lost_on_links(senders, more, windows);
        }
        let bursty: Vec<usize> = self.bursty(senders).into_iter().take(MOST_CHAINS).collect();
        let link = |&sender: &usize| self.senders.get(sender).map_or(Loss::NONE, |sender| sender.link);
        let mut states = States::new(self.loss, bursty.iter().map(link));
        let moves = |states: &mut States, times: u64| {
            states.pass(0, times * u64::from(self.frames) * self.senders.len() as u64);
            (1..=bursty.len()).for_each(|link| states.pass(link, times * u64::from(self.frames)));
        };
        states.sum_over(windows, &moves);
        // The oldest frame comes first.
        for age in (0..self.patience + more).rev() {
            for (index, sender) in self.senders.iter().enumerate() {
                let place = bursty.iter().position(|&at| at == index).map(|at| at + 1);
                // One beyond the chains that are followed may be silent by itself.
                let is_followed = place.is_some() || !sender.link.is_in_bursts();
                if is_followed && senders.contains(&index) {
                    let by_itself = if sender.link.is_in_bursts() { 0.0 } else { sender.link.good };
                    states.lose(place, by_itself, sender.on_its_way(age));
                }
                states.pass(0, self.frames.into());
                place.into_iter().for_each(|place| states.pass(place, self.frames.into()));
            }
        }
        states.sum()
    }

    /// The same where nothing but links lose: each by itself, so that the probabilities of the senders multiply.
    fn all_lost_on_links(&self, senders: &[usize], more: u32, windows: u64) -> f64 {
        let of = |sender: &Sender, from: u64| {
            let mut states = States::new(sender.link, std::iter::empty());
            states.pass(0, from * u64::from(self.frames));
            for age in (0..self.patience + more).rev() {
                states.lose(None, 0.0, sender.on_its_way(age));
                states.pass(0, self.frames.into());
            }
            states.sum()
        };
        let all = |from: u64| {
            senders
                .iter()
                .filter_map(|&sender| self.senders.get(sender))
                .map(|sender| of(sender, from))
                .product::<f64>()
        };
        match windows {
            0 | 1 => all(0),
            _ => sum_of_smooth(windows, all),
        }
    }
}

/// The sum of `of(0)` to `of(count - 1)` where that comes to rest: exactly for the first ones, and then by a few points between which it
/// is nearly straight.
fn sum_of_smooth(count: u64, of: impl Fn(u64) -> f64) -> f64 {
    const EXACT: u64 = 16;
    let mut sum: f64 = (0..count.min(EXACT)).map(&of).sum();
    let (mut from, mut before) = (EXACT, of(EXACT));
    while from < count {
        // An even number of steps, for what alternates.
        let to = (from + from / 16 * 2).min(count);
        let (last, odd) = (of(to), of(to - 1));
        let next = 0.5 * (last + odd);
        let mean = if from == EXACT { 0.5 * (before + of(EXACT + 1)) } else { before };
        sum += 0.5 * (mean + next) * (to - from) as f64;
        (from, before) = (to, next);
    }
    sum
}

/// That a receiver takes a SYNC and then none for `missed` of them, in so many of them, where it hears `others` frames before each. It
/// takes one if it has heard the one before as well: that one is what a SYNC tells the time of. The first ones come faster: where it
/// takes none of `quick`, it stops as well.
pub(super) fn sync_losses(loss: Loss, others: u32, (missed, quick): (u32, u32), syncs: u64) -> f64 {
    let next = |mut states: States, is_heard: bool| {
        states.pass(0, others.into());
        if is_heard {
            states.hear()
        } else {
            states.lose(None, 0.0, 0.0)
        }
        states.pass(0, 1);
        states
    };
    let untaken = |mut heard: States, mut lost: States, count: u32| {
        for _ in 0..count {
            // After one that was heard, another one would be taken.
            let is_lost = next(heard.plus(&lost), false);
            heard = next(lost, true);
            lost = is_lost;
        }
        heard.sum() + lost.sum()
    };
    let new = || States::new(loss, std::iter::empty());
    let mut begin = new();
    begin.sum_over(syncs.saturating_sub(u64::from(missed) + 1), &|states, times| {
        states.pass(0, times * (u64::from(others) + 1));
    });
    let taken = next(next(begin, true), true);
    let later = untaken(taken.clone(), taken.times(0.0), missed);
    let first = untaken(new().times(0.0), new(), quick);
    hazard(first, if syncs > u64::from(missed) { later } else { 0.0 })
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
    /// As they begin: all are good.
    fn new(own: Loss, links: impl Iterator<Item = Loss>) -> Self {
        let chains: Vec<Loss> = std::iter::once(own).chain(links).collect();
        let mut weights = vec![0.0; 1_usize << chains.len()];
        weights[0] = 1.0;
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

    /// Becomes the sum of what it is after 0, 1, ... and `count - 1` steps, where `moves` makes so many; stays where that is none.
    /// By halves: the second half is the first one, later.
    fn sum_over(&mut self, count: u64, moves: &impl Fn(&mut Self, u64)) {
        let begin = self.clone();
        let mut done = 1;
        for bit in (0..count.max(1).ilog2()).rev() {
            let mut second = self.clone();
            moves(&mut second, done);
            *self = self.plus(&second);
            done *= 2;
            if count >> bit & 1 == 1 {
                moves(self, 1);
                *self = self.plus(&begin);
                done += 1;
            }
        }
    }

    /// A frame is not heard: lost at the receiver, on the link before it or with this probability by itself, or with that one still on its way.
    fn lose(&mut self, link: Option<usize>, by_itself: f64, on_its_way: f64) {
        let Self { chains, weights } = self;
        let lost = |at: usize, state: usize| {
            let chain = chains.get(at).copied().unwrap_or(Loss::NONE);
            if state >> at & 1 == 1 { chain.bad } else { chain.good }
        };
        for (state, weight) in weights.iter_mut().enumerate() {
            let heard = 1.0 - lost(0, state);
            let lost_on_link = link.map_or(by_itself, |link| lost(link, state));
            *weight *= lost(0, state) + heard * (lost_on_link + (1.0 - lost_on_link) * on_its_way);
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
    fn pass(&mut self, at: usize, frames: u64) {
        let Some(&Loss { to_bad, to_good, .. }) = self.chains.get(at) else { return };
        if to_bad == 0.0 || frames == 0 {
            return;
        }
        let rest = math::pow(1.0 - to_bad - to_good, frames as f64);
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

    fn receiver(loss: Loss, links: &[Loss], frames: u32, patience: u32) -> Receiver {
        let senders = links.iter().map(|&link| Sender::prompt(link)).collect();
        Receiver { loss, senders, frames, patience }
    }

    /// In 104 steps: `p^4` in the first ones, and `p^4 (1 - p)` in each of 100 later, for each of the senders.
    #[test]
    fn independent_losses_are_powers() {
        let three = receiver(Loss::independent(0.1), &[Loss::NONE; 3], 1, 4);
        let of = |lost: f64, lasts: f64| -math::ln_1p(-lost) + 100.0 * lost * (1.0 - lasts);
        let one = of(1e-4, 0.1);
        let found = three.silences(1, 104);
        assert!(close(found.low, one, 1e-9) && close(found.high, 3.0 * one, 1e-9), "{found:?}");
        // Both of two, at the same time: not in the step before.
        let both = of(1e-8, 0.01);
        let found = three.silences(2, 104);
        assert!(close(found.low, both, 1e-6) && close(found.high, 3.0 * both, 1e-6), "{found:?}");
        assert_eq!([three.silences(4, 104), three.silences(0, 104)], [Hazard::default(); 2]);
    }

    /// Losses of the bus and of a link add up, whether the bus loses or not, and however many links lose.
    #[test]
    fn links_lose_besides() {
        let links = [Loss::independent(0.5), Loss::NONE];
        let of = |lost: f64| -math::ln_1p(-lost * lost * lost) + 100.0 * lost * lost * lost * (1.0 - lost);
        let found = receiver(Loss::independent(0.1), &links, 1, 3).silences(1, 103);
        assert!(close(found.low, of(0.55), 1e-9) && close(found.high, of(0.55) + of(0.1), 1e-9), "{found:?}");
        let found = receiver(Loss::NONE, &links, 1, 3).silences(1, 103);
        assert!(close(found.low, of(0.5), 1e-6) && close(found.high, of(0.5), 1e-6), "{found:?}");
        // Nearly always in the bad state: all twelve are silent nearly at once, on a bus that loses or not.
        let often = Loss { good: 0.0, bad: 1.0, to_bad: 0.5, to_good: 0.001 };
        for bus in [Loss::NONE, Loss::independent(0.001), Loss { to_bad: 1e-9, ..BURSTS }] {
            let found = receiver(bus, &[often; 12], 1, 3).silences(12, 1_000);
            assert!(found.high > 3.0, "{bus:?}: {found:?}");
        }
    }

    /// What never ends has begun with the run, and what begins late has not.
    #[test]
    fn the_begin_of_a_run_counts() {
        let always = receiver(Loss::independent(1.0), &[Loss::NONE], 1, 11).silences(1, 1_000);
        assert_eq!(always.low, f64::INFINITY);
        // Good at first, and bad half of the time after many runs.
        let slow = Loss { good: 0.0, bad: 1.0, to_bad: 1e-5, to_good: 1e-5 };
        let begins = 1_000.0 * 1e-5;
        let found = receiver(slow, &[Loss::NONE], 1, 11).silences(1, 1_000);
        assert!(close(found.low, begins, 0.02), "{found:?}");
        let found = receiver(Loss::NONE, &[slow], 1, 11).silences(1, 1_000);
        assert!(close(found.low, begins, 0.02), "{found:?}");
        // The second one of two is never heard.
        let alternates = Loss { good: 0.0, bad: 1.0, to_bad: 1.0, to_good: 1.0 };
        assert!(receiver(alternates, &[Loss::NONE; 2], 1, 11).silences(1, 1_000).high > 1e3);
    }

    /// How often the bus itself has it, and how often it was never so.
    fn counted(receiver: &Receiver, count: usize, run: u64) -> f64 {
        let tried = 400_000 / run;
        let never = (0..tried).filter(|&seed| {
            let mut own = Loser::new(receiver.loss, random::stream(seed, Purpose::Loss, 0));
            let link = |(at, sender): (usize, &Sender)| {
                Loser::new(sender.link, random::stream(seed, Purpose::LinkLoss, at as u64))
            };
            let mut links: Vec<Loser> = receiver.senders.iter().enumerate().map(link).collect();
            let mut silent = vec![0; links.len()];
            (0..run).all(|_| {
                for (link, silent) in links.iter_mut().zip(&mut silent) {
                    for frame in 0..receiver.frames {
                        let lost = own.loses() | link.loses();
                        if frame == 0 {
                            *silent = if lost { *silent + 1 } else { 0 };
                        }
                    }
                }
                let lost = silent.iter().filter(|&&silent| silent >= receiver.patience);
                lost.count() < count
            })
        });
        1.0 - never.count() as f64 / tried as f64
    }

    /// Bursts of a receiver are as long in frames as said, so that they silence all of its senders at once.
    #[test]
    fn bursts_silence_as_often_as_the_bus_has_it() {
        let on_link = Loss { good: 0.01, bad: 0.9, to_bad: 0.02, to_good: 0.1 };
        let slow = Loss { good: 0.0, bad: 1.0, to_bad: 0.001, to_good: 0.001 };
        let quiet = Loss::NONE;
        let cases = [
            (BURSTS, vec![quiet, quiet], 1, 2, 6),
            (BURSTS, vec![quiet, quiet], 2, 1, 3),
            (BURSTS, vec![quiet; 4], 1, 4, 3),
            (quiet, vec![on_link, quiet], 2, 1, 5),
            (BURSTS, vec![on_link, on_link, quiet], 1, 2, 4),
            (slow, vec![quiet, quiet], 1, 2, 11),
            (quiet, vec![slow, slow], 1, 2, 11),
        ];
        for (loss, links, frames, count, patience) in cases {
            let receiver = receiver(loss, &links, frames, patience);
            let (found, seen) = (receiver.silences(count, 200), counted(&receiver, count, 200));
            let share = |hazard: f64| 1.0 - math::exp(-hazard);
            let (low, high) = (share(found.low), share(found.high));
            assert!(
                (0.8 * low - 0.02..1.2 * high + 0.02).contains(&seen),
                "{count} {patience}: {seen}, {low} to {high}"
            );
        }
    }

    /// `l` lost and `h` heard: of three, none is taken after `lll`, `llh` and `lhl` alone.
    #[test]
    fn a_lost_sync_costs_two() {
        let of = |missed| {
            sync_losses(Loss::independent(0.1), 7, (missed, 1_000), 1_000 + u64::from(missed) + 1) / 1_000.0
        };
        let taken = 0.9 * 0.9;
        assert!(close(of(1), 0.1 * taken, 1e-9) && close(of(2), 0.1 * taken, 1e-9), "{} {}", of(1), of(2));
        assert!(close(of(3), (0.1 * 0.1 + 0.1 * 0.9 * 0.1) * taken, 1e-9), "{}", of(3));
        assert_eq!(sync_losses(Loss::NONE, 7, (1, 2), 1_000), 0.0);
        assert_eq!(sync_losses(Loss::independent(1.0), 7, (3, 20), 1_000), f64::INFINITY);
        assert_eq!(
            sync_losses(Loss { good: 0.0, bad: 1.0, to_bad: 1.0, to_good: 1.0 }, 2, (3, 20), 1_000),
            f64::INFINITY
        );
    }

    #[test]
    fn sums_are_those_of_each_step() {
        for count in [1, 2, 3, 7, 64, 1_001] {
            let mut all = States::new(BURSTS, std::iter::once(BURSTS));
            let one = all.clone();
            let moves = |states: &mut States, times: u64| (0..2).for_each(|at| states.pass(at, 3 * times));
            all.sum_over(count, &moves);
            let mut sum = one.times(0.0);
            for n in 0..count {
                let mut at = one.clone();
                moves(&mut at, n);
                sum = sum.plus(&at);
            }
            assert!(all.weights.iter().zip(&sum.weights).all(|(a, b)| close(*a, *b, 1e-9)), "{count}");
            let of = |n: u64| math::exp(-(n as f64) / 50.0);
            let each: f64 = (0..count).map(of).sum();
            assert!(close(sum_of_smooth(count, of), each, 1e-2), "{count}");
        }
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
