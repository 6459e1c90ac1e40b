//! A CAN controller as its driver sees it: transmit buffers, acceptance filter, receive FIFO, and what it lost.

use crate::filter::Filter;
use crate::frame::Frame;
use std::collections::VecDeque;

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
    sequence: u64,
    received: VecDeque<Frame>,
    overflows: u64,
}

impl Controller {
    pub(crate) fn new(order: Order, filter: Filter) -> Self {
        let received = VecDeque::with_capacity(RECEIVE_FIFO);
        Self { order, filter, buffers: [None; TRANSMIT_BUFFERS], sequence: 0, received, overflows: 0 }
    }

    /// Puts a frame into a free buffer; whether there was one.
    pub(crate) fn load(&mut self, frame: Frame, ready: u64) -> bool {
        let sequence = self.sequence;
        let Some(free) = self.buffers.iter_mut().find(|buffer| buffer.is_none()) else { return false };
        *free = Some(Pending { frame, ready, sequence, errors: 0, cancelled: false });
        self.sequence += 1;
        true
    }

    pub(crate) fn free_buffers(&self) -> usize {
        self.buffers.iter().filter(|buffer| buffer.is_none()).count()
    }

    /// Drops what waits; the frame that is being sent is not tried again.
    pub(crate) fn cancel(&mut self, being_sent: Option<usize>) {
        for (at, buffer) in self.buffers.iter_mut().enumerate() {
            match buffer {
                Some(pending) if being_sent == Some(at) => pending.cancelled = true,
                _ => *buffer = None,
            }
        }
    }

    /// The buffer that is sent next, of the frames that came until `by`.
    pub(crate) fn next(&self, by: u64) -> Option<usize> {
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

    pub(crate) fn remove(&mut self, at: usize) -> Option<Pending> {
        self.buffers.get_mut(at)?.take()
    }

    /// An attempt has not succeeded: it is tried again, unless it was cancelled.
    pub(crate) fn failed(&mut self, at: usize, error: bool) {
        let Some(buffer) = self.buffers.get_mut(at) else { return };
        if let Some(pending) = buffer {
            pending.errors = pending.errors.saturating_add(u32::from(error));
            if pending.cancelled {
                *buffer = None;
            }
        }
    }

    /// Takes a frame from the bus; whether there was room.
    pub(crate) fn deliver(&mut self, frame: Frame) -> bool {
        if self.received.len() == RECEIVE_FIFO {
            self.overflows += 1;
            return false;
        }
        self.received.push_back(frame);
        true
    }

    pub(crate) fn receive(&mut self) -> Option<Frame> {
        self.received.pop_front()
    }

    pub(crate) fn overflows(&self) -> u64 {
        self.overflows
    }
}
