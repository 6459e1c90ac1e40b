//! The queue between a controller's receive FIFO and a node, which the driver's interrupt fills.

use crate::frame::Frame;
use std::collections::VecDeque;

/// Frames that the queue of a driver holds.
pub const DRIVER_QUEUE: usize = 16;

/// The queue of a driver, with what it lost.
#[derive(Clone, Debug)]
pub struct Queue {
    frames: VecDeque<Frame>,
    lost: u64,
}

impl Default for Queue {
    fn default() -> Self {
        Self { frames: VecDeque::with_capacity(DRIVER_QUEUE), lost: 0 }
    }
}

impl Queue {
    /// Takes a frame; the newest is lost where there is no room.
    pub fn put(&mut self, frame: Frame) {
        if self.frames.len() == DRIVER_QUEUE {
            self.lost += 1;
        } else {
            self.frames.push_back(frame);
        }
    }

    /// The oldest frame.
    pub fn take(&mut self) -> Option<Frame> {
        self.frames.pop_front()
    }

    /// Drops what it holds.
    pub fn clear(&mut self) {
        self.frames.clear();
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Frames that had no room.
    pub fn lost(&self) -> u64 {
        self.lost
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Id;

    #[test]
    fn the_seventeenth_frame_is_lost_and_counted() {
        let mut queue = Queue::default();
        for id in 0..=DRIVER_QUEUE as u16 {
            queue.put(Frame::data(Id::Base(id), &[]).unwrap());
        }
        assert_eq!(queue.lost(), 1);
        let ids: Vec<Id> = std::iter::from_fn(|| queue.take()).map(|frame| frame.id()).collect();
        assert_eq!(ids, (0..DRIVER_QUEUE as u16).map(Id::Base).collect::<Vec<_>>());
    }
}
