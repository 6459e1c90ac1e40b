//! What lies between a bus and one receiver of one sender (`[[link]]`): after the bus has brought a frame, the link may lose it, read it
//! wrong, let it come later, after the next one, or twice.
//!
//! Each link has one stream of random numbers for each of these, so that one of them does not move the others.

use super::Traffic;
use super::loss::Loser;
use crate::random::{self, Purpose};
use crate::scenario::{Does, LinkSettings, LinkSpec, Spell};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;
use std::ops::Range;

/// A frame on a link.
pub trait Payload: Clone {
    /// Flips one of its bits: the one that `choose` gives, below their number.
    fn flip(&mut self, choose: impl FnOnce(usize) -> usize);
}

/// Flips bit `at` of bytes, counted from the first.
pub fn flip_bit(bytes: &mut [u8], at: usize) {
    if let Some(byte) = bytes.get_mut(at / 8) {
        *byte ^= 1 << (at % 8);
    }
}

/// The links that do something.
#[derive(Clone, Debug)]
pub struct Links<P> {
    links: BTreeMap<(usize, usize), Link<P>>,
    /// By time of arrival (ns), then in the order in which they came: sender, receiver, frame.
    late: BTreeMap<(u64, u64), (usize, usize, P)>,
    order: u64,
}

#[derive(Clone, Debug)]
struct Link<P> {
    settings: LinkSettings,
    loser: Loser,
    jitter: Pcg64,
    order: Pcg64,
    copies: Pcg64,
    bits: Pcg64,
    /// A frame that comes after the next one.
    held: Option<P>,
    /// What events do to it.
    spells: Vec<OnLink>,
}

/// What an event does to a link for a while.
#[derive(Clone, Debug)]
struct OnLink {
    /// Time, ns.
    during: Range<u64>,
    does: Doer,
}

#[derive(Clone, Debug)]
enum Doer {
    Lose(Loser),
    Corrupt(f64, Pcg64),
    Hold,
}

impl OnLink {
    fn new(seed: u64, Spell { from, to, event, during, does }: &Spell) -> Self {
        // An event has its own stream on each link.
        let stream = |purpose| random::stream(seed, purpose, number(*from, *to) + ((*event as u64) << 14));
        let does = match *does {
            Does::Lose(loss) => Doer::Lose(Loser::new(loss, stream(Purpose::EventLoss))),
            Does::Corrupt(probability) => Doer::Corrupt(probability, stream(Purpose::EventBits)),
            Does::Hold => Doer::Hold,
        };
        Self { during: during.clone(), does }
    }
}

/// The streams of a link are numbered by both ends; an id has seven bits.
pub fn number(from: usize, to: usize) -> u64 {
    (from * 128 + to) as u64
}

impl<P: Payload> Link<P> {
    fn new(seed: u64, &LinkSpec { from, to, settings }: &LinkSpec) -> Self {
        let stream = |purpose| random::stream(seed, purpose, number(from, to));
        Self {
            settings,
            loser: Loser::new(settings.loss, stream(Purpose::LinkLoss)),
            jitter: stream(Purpose::LinkJitter),
            order: stream(Purpose::LinkOrder),
            copies: stream(Purpose::LinkCopies),
            bits: stream(Purpose::LinkBits),
            held: None,
            spells: Vec::new(),
        }
    }

    /// What events do to a frame at `now` (ns): false where it is lost.
    fn bear(&mut self, now: u64, frame: &mut P, traffic: &mut Traffic) -> bool {
        let mut is_lost = false;
        for spell in self.spells.iter_mut().filter(|spell| spell.during.contains(&now)) {
            match &mut spell.does {
                // Each draws for each frame, so that one does not move the others.
                Doer::Lose(loser) => is_lost |= loser.loses(),
                Doer::Corrupt(probability, stream) => {
                    if random::happens(stream, *probability) {
                        frame.flip(|bits| random::below(stream, bits));
                        traffic.corrupted += 1;
                    }
                }
                Doer::Hold => {}
            }
        }
        traffic.lost += u64::from(is_lost);
        !is_lost
    }

    /// When frames that events hold back at `now` are let go, ns.
    fn let_go(&self, now: u64) -> u64 {
        let holds = |spell: &&OnLink| matches!(spell.does, Doer::Hold) && spell.during.contains(&now);
        self.spells.iter().filter(holds).map(|spell| spell.during.end).max().unwrap_or(now)
    }

    /// Delay of a frame, ns.
    fn delay(&mut self) -> u64 {
        let extra = match self.settings.jitter_ns as usize {
            0 => 0,
            bound => random::below(&mut self.jitter, bound) as u64,
        };
        self.settings.latency_ns.saturating_add(extra)
    }

    /// What comes of a frame: nothing, or so many frames, in order.
    fn pass(&mut self, frame: &P, traffic: &mut Traffic) -> [Option<P>; 3] {
        if self.loser.loses() {
            traffic.lost += 1;
            return [None, None, None];
        }
        let mut frame = frame.clone();
        if random::happens(&mut self.bits, self.settings.corrupt) {
            let stream = &mut self.bits;
            frame.flip(|bits| random::below(stream, bits));
            traffic.corrupted += 1;
        }
        let is_overtaken = random::happens(&mut self.order, self.settings.reorder);
        if is_overtaken && self.held.is_none() {
            traffic.reordered += 1;
            self.held = Some(frame);
            return [None, None, None];
        }
        let copy = random::happens(&mut self.copies, self.settings.duplicate).then(|| frame.clone());
        traffic.duplicated += u64::from(copy.is_some());
        [Some(frame), copy, self.held.take()]
    }
}

impl<P: Payload> Links<P> {
    /// The links of a scenario, and what its events do to them; none where there is none.
    pub fn of(seed: u64, specs: &[LinkSpec], spells: &[Spell]) -> Option<Self> {
        let mut links: BTreeMap<_, _> =
            specs.iter().map(|spec| ((spec.from, spec.to), Link::new(seed, spec))).collect();
        for spell in spells {
            let &Spell { from, to, .. } = spell;
            let plain = || Link::new(seed, &LinkSpec { from, to, settings: LinkSettings::default() });
            links.entry((from, to)).or_insert_with(plain).spells.push(OnLink::new(seed, spell));
        }
        (!links.is_empty()).then_some(Self { links, late: BTreeMap::new(), order: 0 })
    }

    /// Takes a frame of `from` that the bus brings to `to` at `now` (ns). What is heard at once goes to `receive`.
    pub fn pass(
        &mut self,
        now: u64,
        (from, to): (usize, usize),
        frame: &P,
        traffic: &mut Traffic,
        mut receive: impl FnMut(&P),
    ) {
        let Some(link) = self.links.get_mut(&(from, to)) else { return receive(frame) };
        let mut frame = frame.clone();
        if !link.spells.is_empty() && !link.bear(now, &mut frame, traffic) {
            return;
        }
        let held = if link.spells.is_empty() { 0 } else { link.let_go(now) - now };
        for frame in link.pass(&frame, traffic).into_iter().flatten() {
            match link.delay().max(held) {
                0 => receive(&frame),
                delay => {
                    self.late.insert((now.saturating_add(delay), self.order), (from, to, frame));
                    self.order += 1;
                }
            }
        }
    }

    /// When the next late frame arrives, ns.
    pub fn next_at(&self) -> Option<u64> {
        self.late.first_key_value().map(|(&(at, _), _)| at)
    }

    /// Takes the late frame that arrives next: when, from which node, to which node.
    pub fn take_late(&mut self) -> Option<(u64, usize, usize, P)> {
        self.late.pop_first().map(|((at, _), (from, to, frame))| (at, from, to, frame))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Loss;

    impl Payload for u32 {
        fn flip(&mut self, choose: impl FnOnce(usize) -> usize) {
            *self ^= 1 << choose(32);
        }
    }

    /// Frames 0, 1, ... of node 0 to node 1, one each 100 ns: when each arrives, and what it is.
    fn passed(settings: LinkSettings, frames: u32) -> (Vec<(u64, u32)>, Traffic) {
        let mut links = Links::of(9, &[LinkSpec { from: 0, to: 1, settings }], &[]).unwrap();
        let (mut got, mut traffic) = (Vec::new(), Traffic::default());
        for frame in 0..frames {
            let now = 100 * u64::from(frame);
            while links.next_at().is_some_and(|at| at <= now) {
                let (at, _, _, frame) = links.take_late().unwrap();
                got.push((at, frame));
            }
            links.pass(now, (0, 1), &frame, &mut traffic, |&frame| got.push((now, frame)));
        }
        got.extend(std::iter::from_fn(|| links.take_late()).map(|(at, _, _, frame)| (at, frame)));
        (got, traffic)
    }

    #[test]
    fn a_link_without_settings_is_none_and_other_pairs_are_not_touched() {
        assert!(Links::<u32>::of(1, &[], &[]).is_none());
        let settings = LinkSettings { loss: Loss::independent(1.0), ..LinkSettings::default() };
        let mut links = Links::of(1, &[LinkSpec { from: 0, to: 1, settings }], &[]).unwrap();
        let (mut got, mut traffic) = (Vec::new(), Traffic::default());
        for pair in [(0, 1), (1, 0), (0, 2)] {
            links.pass(0, pair, &7, &mut traffic, |_| got.push(pair));
        }
        assert_eq!((got, traffic.lost), (vec![(1, 0), (0, 2)], 1));
    }

    #[test]
    fn latency_delays_and_jitter_stays_within_its_bound() {
        let settings = LinkSettings { latency_ns: 250, jitter_ns: 50, ..LinkSettings::default() };
        let (got, _) = passed(settings, 1000);
        let delays: Vec<u64> = got.iter().map(|&(at, frame)| at - 100 * u64::from(frame)).collect();
        assert!(delays.iter().all(|delay| (250..300).contains(delay)));
        assert!(delays.iter().any(|delay| *delay < 255) && delays.iter().any(|delay| *delay >= 295));
    }

    #[test]
    fn a_frame_that_is_overtaken_comes_right_after_the_next_one_and_none_is_lost() {
        let (got, traffic) = passed(LinkSettings { reorder: 0.2, ..LinkSettings::default() }, 10_000);
        let frames: Vec<u32> = got.iter().map(|&(_, frame)| frame).collect();
        let back = frames.windows(2).filter(|pair| pair[1] < pair[0]).count() as u64;
        assert!(frames.windows(2).all(|pair| pair[1] > pair[0] || pair[1] + 1 == pair[0]));
        // The last one may still be held.
        assert!(traffic.reordered - back <= 1 && frames.len() >= 9_999, "{back} {traffic:?}");
        // No frame is held while another is: 0.2 / 1.2 of them.
        assert!((back as f64 / 10_000.0 - 1.0 / 6.0).abs() < 0.01, "{back}");
    }

    #[test]
    fn copies_come_twice_and_disturbed_frames_differ_in_one_bit() {
        let settings = LinkSettings { duplicate: 0.25, corrupt: 0.1, ..LinkSettings::default() };
        let (got, traffic) = passed(settings, 10_000);
        assert_eq!(got.len() as u64, 10_000 + traffic.duplicated);
        assert!((traffic.duplicated as f64 / 10_000.0 - 0.25).abs() < 0.02);
        let wrong = |&&(at, frame): &&(u64, u32)| (frame ^ (at / 100) as u32).count_ones() == 1;
        let wrong = got.iter().filter(wrong).count() as f64;
        assert!((wrong / 12_500.0 - 0.1).abs() < 0.01, "{wrong}");
        assert!(got.iter().all(|&(at, frame)| (frame ^ (at / 100) as u32).count_ones() <= 1));
    }

    /// One purpose, one stream: what one key does is the same whatever the others say.
    #[test]
    fn settings_do_not_move_each_other() {
        let lossy = LinkSettings { loss: Loss::independent(0.3), ..LinkSettings::default() };
        let both = LinkSettings { duplicate: 0.5, corrupt: 0.5, jitter_ns: 90, ..lossy };
        let times = |settings| {
            let mut heard: Vec<u64> = passed(settings, 500).0.into_iter().map(|(at, _)| at / 100).collect();
            heard.dedup();
            heard
        };
        assert_eq!(times(lossy), times(both));
        assert_eq!(passed(both, 500), passed(both, 500));
    }
}
