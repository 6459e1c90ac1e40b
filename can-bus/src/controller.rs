//! A CAN controller as its driver sees it: transmit buffers, acceptance filter, receive FIFO, and what it
//! lost.

use crate::filter::Filter;
use crate::frame::Frame;

/// Transmit buffers, as in bxCAN and FDCAN of the STM32.
pub const TRANSMIT_BUFFERS: usize = 3;
/// Frames that the receive FIFO holds, as there.
pub const RECEIVE_FIFO: usize = 3;

/// Which of the frames in its transmit buffers a controller sends first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// The one that wins arbitration; of two with the same identifier, the one that came first.
    #[default]
    Priority,
    /// The one that came first.
    Fifo,
}

/// A frame in a transmit buffer.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pending {
    pub(crate) frame: Frame,
    /// When it came, ns.
    pub(crate) ready: u64,
    /// Its place in the order in which frames came.
    sequence: u64,
    /// Attempts that ended in an error.
    pub(crate) errors: u32,
    /// It is being sent and shall not be tried again.
    pub(crate) cancelled: bool,
}

/// Buffers of a controller.
#[derive(Clone, Debug)]
pub(crate) struct Controller {
    order: Order,
    pub(crate) filter: Filter,
    buffers: [Option<Pending>; TRANSMIT_BUFFERS],
    /// Buffers that hold a frame.
    used: usize,
    sequence: u64,
    fifo: Fifo,
    overflows: u64,
}

/// Received frames, the oldest one first.
#[derive(Clone, Debug)]
struct Fifo {
    frames: [Frame; RECEIVE_FIFO],
    /// Place of the oldest one.
    first: usize,
    count: usize,
}

impl Controller {
    pub(crate) fn new(order: Order, filter: Filter) -> Self {
        let fifo = Fifo { frames: [Frame::EMPTY; RECEIVE_FIFO], first: 0, count: 0 };
        Self { order, filter, buffers: [None; TRANSMIT_BUFFERS], used: 0, sequence: 0, fifo, overflows: 0 }
    }

    /// One with the same filter, that holds nothing.
    pub(crate) fn empty(&self) -> Self {
        Self::new(self.order, self.filter.clone())
    }

    /// Puts a frame into a free buffer; whether there was one.
    pub(crate) fn load(&mut self, frame: &Frame, ready: u64) -> bool {
        let sequence = self.sequence;
        let Some(free) = self.buffers.iter_mut().find(|buffer| buffer.is_none()) else { return false };
        *free = Some(Pending { frame: *frame, ready, sequence, errors: 0, cancelled: false });
        self.sequence += 1;
        self.used += 1;
        true
    }

    pub(crate) fn free_buffers(&self) -> usize {
        TRANSMIT_BUFFERS - self.used
    }

    /// The frame that is sent next is the one with the smallest priority, rather than the oldest.
    pub(crate) fn is_by_priority(&self) -> bool {
        self.order == Order::Priority
    }

    /// Drops what waits; the frame that is being sent is not tried again.
    pub(crate) fn cancel(&mut self, being_sent: Option<usize>) {
        for (at, buffer) in self.buffers.iter_mut().enumerate() {
            match buffer {
                Some(pending) if being_sent == Some(at) => pending.cancelled = true,
                _ => *buffer = None,
            }
        }
        self.used = self.buffers.iter().flatten().count();
    }

    /// The buffer that is sent next, of the frames that came until `by`.
    pub(crate) fn next(&self, by: u64) -> Option<usize> {
        if self.used <= 1 {
            let ready = |buffer: &Option<Pending>| buffer.as_ref().is_some_and(|pending| pending.ready <= by);
            return if self.used == 0 { None } else { self.buffers.iter().position(ready) };
        }
        let ready = |(at, buffer): (usize, &Option<Pending>)| {
            let pending = buffer.as_ref().filter(|pending| pending.ready <= by)?;
            let rank = if self.order == Order::Priority { pending.frame.priority() } else { 0 };
            Some((rank, pending.sequence, at))
        };
        self.buffers.iter().enumerate().filter_map(ready).min().map(|(_, _, at)| at)
    }

    pub(crate) fn pending(&self, at: usize) -> Option<&Pending> {
        self.buffers.get(at)?.as_ref()
    }

    /// Empties a transmit buffer.
    pub(crate) fn remove(&mut self, at: usize) {
        if let Some(buffer) = self.buffers.get_mut(at) {
            self.used -= usize::from(buffer.is_some());
            *buffer = None;
        }
    }

    /// An attempt has not succeeded: it is tried again, unless it was cancelled.
    pub(crate) fn failed(&mut self, at: usize, error: bool) {
        let Some(buffer) = self.buffers.get_mut(at) else { return };
        if let Some(pending) = buffer {
            pending.errors = pending.errors.saturating_add(u32::from(error));
            if pending.cancelled {
                *buffer = None;
                self.used -= 1;
            }
        }
    }

    /// Takes a frame from the bus; whether there was room.
    // Inlined because it is done at each receiver of each frame.
    #[inline]
    pub(crate) fn deliver(&mut self, frame: &Frame) -> bool {
        let Fifo { frames, first, count } = &mut self.fifo;
        if *count == RECEIVE_FIFO {
            self.overflows += 1;
            return false;
        }
        let last = *first + *count;
        frames[if last < RECEIVE_FIFO { last } else { last - RECEIVE_FIFO }] = *frame;
        *count += 1;
        true
    }

    /// The oldest received frame, which goes with that.
    pub(crate) fn receive(&mut self) -> Option<&Frame> {
        let Fifo { frames, first, count } = &mut self.fifo;
        let at = *first;
        *count = count.checked_sub(1)?;
        *first = if at + 1 < RECEIVE_FIFO { at + 1 } else { 0 };
        frames.get(at)
    }

    /// Drops all that it holds.
    pub(crate) fn clear(&mut self) {
        (self.buffers, self.used) = ([None; TRANSMIT_BUFFERS], 0);
        (self.fifo.first, self.fifo.count) = (0, 0);
    }

    pub(crate) fn overflows(&self) -> u64 {
        self.overflows
    }
}
