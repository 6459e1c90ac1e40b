//! The border of the conductor: what it asks of the outside, and what it is told.
//!
//! Its logic is written as asynchronous functions, which read in the order in which they run. The compiler
//! makes state machines of them: each `await` is a state. No executor and no waker drives them, but whoever
//! has the lines and the clock: it polls with the time, does what is asked, tells what came of it, and polls
//! again.

use super::HubError;
use crate::can::{Heard, PortFrame};
use std::cell::{RefCell, RefMut};
use std::collections::VecDeque;
use std::future::poll_fn;
use std::pin::Pin;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

/// What is to be done before the next poll. Nodes and buses are given by index, times in nanoseconds on the
/// clock of who polls.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// To write whole frames to a node.
    Write {
        /// The node.
        node: usize,
        /// The frames.
        bytes: Vec<u8>,
    },
    /// To put frames on a bus, in order.
    Say {
        /// The bus.
        bus: usize,
        /// The frames.
        frames: Vec<PortFrame>,
    },
    /// To read until something has come, or until the time. A poll that comes earlier does no harm.
    Read {
        /// From where.
        from: Source,
        /// First moment at which it is too late.
        until: u64,
    },
    /// To let time pass.
    Wait {
        /// Its end.
        until: u64,
    },
    /// To close the line of a node that is gone.
    Close {
        /// The node.
        node: usize,
    },
    /// To open that line anew if the device is back, and to tell so by [`Task::on_reopened`].
    Reopen {
        /// The node.
        node: usize,
    },
    /// To switch what the node runs on, where that can be done from here, and to tell so by
    /// [`Task::on_switched`].
    Switch {
        /// The node.
        node: usize,
        /// On, or off.
        on: bool,
    },
}

/// What is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// The line of one node.
    Line(usize),
    /// One bus.
    Bus(usize),
    /// All lines and buses, of which the first to have something is read.
    All,
}

/// How far a task is.
#[derive(Debug, PartialEq, Eq)]
pub enum Step<T> {
    /// This is to be done now.
    Do(Action),
    /// It is over.
    Done(T),
}

/// A task of the conductor under way.
#[must_use = "a task does nothing unless it is polled"]
pub struct Task<'a, T> {
    outside: Outside,
    logic: Pin<Box<dyn Future<Output = T> + 'a>>,
}

impl<'a, T> Task<'a, T> {
    pub(crate) fn new(outside: &Outside, logic: impl Future<Output = T> + 'a) -> Self {
        outside.begin();
        Self { outside: outside.clone(), logic: Box::pin(logic) }
    }

    /// Goes on at `now`, ns, until something is to be done.
    pub fn poll(&mut self, now: u64) -> Step<T> {
        self.outside.desk().now = now;
        match self.logic.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            Poll::Ready(outcome) => Step::Done(outcome),
            // It waits for nothing but its actions.
            Poll::Pending => {
                Step::Do(self.outside.desk().asked.take().unwrap_or(Action::Wait { until: now }))
            }
        }
    }

    /// Takes what was read at `at`, ns, from the line of a node.
    pub fn on_bytes(&mut self, node: usize, bytes: &[u8], at: u64) {
        let mut desk = self.outside.desk();
        slot(&mut desk.bytes, node).extend_from_slice(bytes);
        desk.last = Some(Reading { from: Source::Line(node), at });
    }

    /// Takes what was read at `at`, ns, from a bus, where it was at `bus_ns` of the same time.
    pub fn on_heard(&mut self, bus: usize, heard: Heard, bus_ns: u64, at: u64) {
        let mut desk = self.outside.desk();
        slot(&mut desk.heard, bus).push_back((heard, bus_ns));
        desk.last = Some(Reading { from: Source::Bus(bus), at });
    }

    /// Takes note that what was to be done has failed.
    pub fn on_failed(&mut self, error: HubError) {
        self.outside.desk().failed = Some(error);
    }

    /// Takes note that a node has another line now.
    pub fn on_reopened(&mut self, node: usize) {
        let mut desk = self.outside.desk();
        slot(&mut desk.bytes, node).clear();
        desk.reopened = true;
    }

    /// Takes note that what a node runs on was switched, and that it has another line now.
    pub fn on_switched(&mut self, node: usize) {
        let mut desk = self.outside.desk();
        slot(&mut desk.bytes, node).clear();
        desk.switched = true;
    }
}

/// That something was read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Reading {
    pub(super) from: Source,
    pub(super) at: u64,
}

/// What lies between the logic and the outside.
#[derive(Default)]
struct Desk {
    now: u64,
    asked: Option<Action>,
    failed: Option<HubError>,
    reopened: bool,
    switched: bool,
    /// Read and not taken, by node.
    bytes: Vec<Vec<u8>>,
    /// The same by bus, each with its bus time.
    heard: Vec<VecDeque<(Heard, u64)>>,
    last: Option<Reading>,
}

/// The logic's side of the border.
#[derive(Clone, Default)]
pub(crate) struct Outside(Rc<RefCell<Desk>>);

impl Outside {
    fn desk(&self) -> RefMut<'_, Desk> {
        self.0.borrow_mut()
    }

    /// Forgets what a task has left that was not polled to its end.
    fn begin(&self) {
        let mut desk = self.desk();
        (desk.asked, desk.failed, desk.last) = (None, None, None);
        (desk.reopened, desk.switched) = (false, false);
    }

    /// Time of the last poll, ns.
    pub(super) fn now(&self) -> u64 {
        self.desk().now
    }

    /// Asks for an action, and waits until it is done.
    ///
    /// # Errors
    /// It has failed.
    pub(super) async fn act(&self, action: Action) -> Result<(), HubError> {
        let mut asked = Some(action);
        poll_fn(|_| match asked.take() {
            Some(action) => {
                self.desk().asked = Some(action);
                Poll::Pending
            }
            None => Poll::Ready(()),
        })
        .await;
        self.desk().failed.take().map_or(Ok(()), Err)
    }

    /// Reads all lines and buses until something has come, and says what; nothing after `until`.
    ///
    /// # Errors
    /// One of them has failed, or the user wants to stop.
    pub(super) async fn read_any(&self, until: u64) -> Result<Option<Reading>, HubError> {
        self.desk().last = None;
        self.act(Action::Read { from: Source::All, until }).await?;
        Ok(self.desk().last.take())
    }

    /// Opens the line of a node anew, if its device is back; whether it is.
    ///
    /// # Errors
    /// The user wants to stop.
    pub(super) async fn reopen(&self, node: usize) -> Result<bool, HubError> {
        self.act(Action::Reopen { node }).await?;
        Ok(std::mem::take(&mut self.desk().reopened))
    }

    /// Switches what a node runs on; whether that can be done from here.
    ///
    /// # Errors
    /// It does not start, or the user wants to stop.
    pub(super) async fn switch(&self, node: usize, on: bool) -> Result<bool, HubError> {
        self.act(Action::Switch { node, on }).await?;
        Ok(std::mem::take(&mut self.desk().switched))
    }

    /// What has come from the line of a node.
    pub(super) fn take_bytes(&self, node: usize) -> Vec<u8> {
        std::mem::take(slot(&mut self.desk().bytes, node))
    }

    /// The oldest thing that has come from a bus, with its bus time.
    pub(super) fn take_heard(&self, bus: usize) -> Option<(Heard, u64)> {
        slot(&mut self.desk().heard, bus).pop_front()
    }
}

fn slot<T: Default>(list: &mut Vec<T>, index: usize) -> &mut T {
    if list.len() <= index {
        list.resize_with(index + 1, T::default);
    }
    &mut list[index]
}
