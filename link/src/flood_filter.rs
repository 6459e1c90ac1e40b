//! What goes to all nodes of a network by the lines between them: commands, and faults.

use crate::sync_filter::FORGET_MS;
use funnelnet_protocol::message::Message;
use heapless::Vec;

/// A bit for each line.
pub type Lines = u8;

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Put {
    /// It is new, and waits for its lines.
    New,
    /// The same has come within [`FORGET_MS`].
    Copy,
    /// It is new, and there is no room to remember it: it waits for no line.
    NoRoom,
}

/// Frames that are remembered for [`FORGET_MS`], oldest first: a copy that has gone round a ring is known. No
/// one replaces another.
#[derive(Debug)]
pub struct FloodFilter<const ROOM: usize> {
    frames: Vec<Remembered, ROOM>,
    /// Lines that some frame waits for.
    waiting: Lines,
}

#[derive(Debug)]
struct Remembered {
    frame: Message,
    /// When it came, ms.
    at: u64,
    /// Lines that it waits for.
    lines: Lines,
}

impl<const ROOM: usize> FloodFilter<ROOM> {
    /// Nothing is remembered.
    pub const fn new() -> Self {
        Self { frames: Vec::new(), waiting: 0 }
    }

    /// Takes a frame that came at `now` (ms) and goes on to `lines`.
    pub fn put(&mut self, frame: Message, lines: Lines, now: u64) -> Put {
        self.forget(now);
        if let Some(older) = self.frames.iter_mut().find(|each| each.frame == frame) {
            if older.is_young(now) {
                return Put::Copy;
            }
            // It still waits for a line.
            (older.at, older.lines) = (now, older.lines | lines);
        } else if self.frames.push(Remembered { frame, at: now, lines }).is_err() {
            return Put::NoRoom;
        }
        self.waiting |= lines;
        Put::New
    }

    /// The same for a frame of the node itself, which takes the place of the oldest one where there is no
    /// room.
    pub fn put_own(&mut self, frame: Message, lines: Lines, now: u64) -> Put {
        self.forget(now);
        if self.frames.is_full() {
            self.drop_first(|_| true);
        }
        self.put(frame, lines, now)
    }

    /// The frame that a line gets next.
    pub fn take(&mut self, line: Lines) -> Option<Message> {
        if self.waiting & line == 0 {
            return None;
        }
        let next = self.frames.iter_mut().find(|each| each.lines & line != 0);
        if next.is_none() {
            self.waiting &= !line;
        }
        let next = next?;
        next.lines &= !line;
        Some(next.frame)
    }

    /// Forgets what is old and waits for no line; where that makes no room, the oldest that waits for a line
    /// which does not take it.
    fn forget(&mut self, now: u64) {
        self.frames.retain(|each| each.lines != 0 || each.is_young(now));
        if self.frames.is_full() {
            self.drop_first(|each| !each.is_young(now));
        }
    }

    /// Drops the oldest frame of this kind, if there is one.
    fn drop_first(&mut self, is_one: impl Fn(&Remembered) -> bool) {
        let mut dropped = false;
        // Not `remove`, which can panic.
        self.frames.retain(|each| {
            let stays = dropped || !is_one(each);
            dropped |= !stays;
            stays
        });
    }
}

impl Remembered {
    fn is_young(&self, now: u64) -> bool {
        now.saturating_sub(self.at) < FORGET_MS
    }
}
