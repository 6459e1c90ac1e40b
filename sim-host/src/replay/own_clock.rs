//! A log of nodes that tick by their own clock. Nobody knows what a node had heard when it ticked: a frame
//! that the log has before a state may have waited in the node's inbox for longer. So every way to hear the
//! frames is followed in which the node sends what the log has.

use super::Entry;
use super::twin::{Twin, tick_of};
use funnelnet_link::Frame as _;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

/// Ways that are followed at once. Where a state hardly moves, its bits are equal for some time whatever was
/// heard; what rounding leaves is not, and decides later.
const WAYS: usize = 256;
/// Frames that may wait in a node's inbox: those of several ticks.
const INBOX: usize = 256;
/// States that may be missing between two of the log where each of their ticks may have come by itself. Where
/// more are, the node ran them at once: so a stamp that is wrong by many ticks is no long search, and no deep
/// one.
const MISSING: u32 = 8;
/// Steps that are tried for one frame of the log.
const TRIES: usize = 50_000;

/// All ways that lead to what the log has so far, the likeliest first.
pub struct OwnClock {
    first: Way,
    others: Vec<Way>,
    /// By identifier: the tick of the last state in the log.
    last: BTreeMap<u16, u32>,
}

/// A node that has heard some of the frames; the others wait.
#[derive(Clone)]
struct Way {
    twin: Twin,
    waiting: VecDeque<Rc<Entry>>,
    /// Ticks before which it left something waiting that it listens to: the fewer, the likelier.
    left: u32,
}

/// A frame of the node in the log.
#[derive(Clone, Copy)]
struct Wanted<'a> {
    id: u16,
    bytes: &'a [u8],
    fd: bool,
}

impl OwnClock {
    /// A node before its start.
    pub fn new(twin: Twin) -> Self {
        Self {
            first: Way { twin, waiting: VecDeque::new(), left: 0 },
            others: Vec::new(),
            last: BTreeMap::new(),
        }
    }

    /// Takes a frame of another node.
    pub fn hear(&mut self, entry: &Entry) {
        let entry = Rc::new(entry.clone());
        for way in std::iter::once(&mut self.first).chain(&mut self.others) {
            if way.waiting.len() >= INBOX
                && let Some(oldest) = way.waiting.pop_front()
            {
                way.twin.hear(&oldest, 0);
            }
            way.waiting.push_back(Rc::clone(&entry));
        }
    }

    /// Takes a frame of the node: tick of it, and states that came to nothing since the one before it, as
    /// newer ones took their place.
    ///
    /// # Errors
    /// The node sends no such frame, whatever it has heard: here it is as it should be at that tick, with all
    /// frames heard.
    pub fn take(&mut self, id: u16, bytes: &[u8], fd: bool) -> Result<(u32, u32), Box<Twin>> {
        let wanted = Wanted { id, bytes, fd };
        let mut tries = TRIES;
        let mut found = Vec::new();
        for way in std::iter::once(&self.first).chain(&self.others) {
            way.follow(wanted, &mut tries, &mut found);
        }
        found.sort_by_key(|way: &Way| way.left);
        found.truncate(WAYS);
        let mut found = found.into_iter();
        let Some(first) = found.next() else { return Err(Box::new(self.first.all_heard(wanted))) };
        let tick = tick_of(id, bytes, fd, first.twin.tick());
        let before = self.last.insert(id, tick);
        (self.first, self.others) = (first, found.collect());
        Ok((tick, before.map_or(0, |before| tick.saturating_sub(before + 1))))
    }
}

impl Way {
    /// Adds the ways that lead on from here to the frame.
    fn follow(&self, wanted: Wanted<'_>, tries: &mut usize, found: &mut Vec<Self>) {
        if let Some(way) = self.clone().with_sent(wanted) {
            found.push(way);
            return;
        }
        for heard in (0..=self.waiting.len()).rev() {
            // To leave it waiting would change nothing.
            if self.waiting.get(heard).is_some_and(|entry| !self.twin.listens_to(entry)) {
                continue;
            }
            let mut next = self.clone();
            next.waiting.drain(..heard).for_each(|entry| next.twin.hear(&entry, 0));
            next.left += u32::from(!next.waiting.is_empty());
            let missing = next.clone().missing(wanted);
            // It came so late that it ran several ticks at once, or each of them in its time.
            let least = if missing > MISSING { missing } else { 0 };
            for late in (least..=missing).rev() {
                if *tries == 0 {
                    return;
                }
                *tries -= 1;
                let mut next = next.clone();
                next.twin.step(late);
                match next.clone().with_sent(wanted) {
                    Some(way) => found.push(way),
                    None if late < missing => next.follow(wanted, tries, found),
                    None => {}
                }
            }
        }
    }

    /// Ticks between the next one of the node and that of the frame.
    fn missing(mut self, wanted: Wanted<'_>) -> u32 {
        self.twin.step(0);
        let Wanted { id, bytes, fd } = wanted;
        let newest = self.twin.sent.get(&id).and_then(|sent| sent.back()).map(|sent| sent.tick);
        newest.map_or(0, |newest| tick_of(id, bytes, fd, newest).saturating_sub(newest))
    }

    /// Without the frame, and those before it, where it waits to be found.
    fn with_sent(mut self, wanted: Wanted<'_>) -> Option<Self> {
        let Wanted { id, bytes, fd } = wanted;
        let waiting = self.twin.sent.get_mut(&id)?;
        let at = waiting
            .iter()
            .position(|sent| sent.frame.data() == bytes && sent.tick == tick_of(id, bytes, fd, sent.tick))?;
        waiting.drain(..=at);
        Some(self)
    }

    /// The node when it has heard everything, and has sent the state of that tick.
    fn all_heard(&self, wanted: Wanted<'_>) -> Twin {
        let mut way = self.clone();
        if way.twin.sent.get(&wanted.id).is_some_and(|waiting| !waiting.is_empty()) {
            return way.twin;
        }
        way.waiting.drain(..).for_each(|entry| way.twin.hear(&entry, 0));
        let missing = way.clone().missing(wanted);
        way.twin.step(missing);
        way.twin
    }
}
