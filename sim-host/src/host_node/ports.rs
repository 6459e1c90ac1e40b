//! The line and the CAN controller of a node in a process, as its app sees them.

use super::End;
use super::clock::SystemClock;
use super::inbox::Inbox;
use crate::can::{CanPort, Traffic};
use embedded_io_async::{ErrorType, Read, Write};
use funnelnet_app::Clock;
use funnelnet_app::link::can::{Controller, Exchange, Received};
use funnelnet_link::{BusState, Format};
use funnelnet_protocol::Refusal;
use std::convert::Infallible;
use std::future::{pending, poll_fn};
use std::io;
use std::marker::PhantomData;
use std::sync::Arc;
use std::task::Poll;

/// How soon a frame for which there was no room is sent again, ns.
const AGAIN: u64 = 200_000;

/// A line. Where it does not take what is said any more, the node ends.
pub struct HostLine<'a> {
    inbox: &'a Inbox,
    to_host: Box<dyn io::Write>,
}

impl<'a> HostLine<'a> {
    /// A line that this inbox receives from.
    pub fn new(inbox: &'a Inbox, to_host: Box<dyn io::Write>) -> Self {
        Self { inbox, to_host }
    }
}

impl ErrorType for HostLine<'_> {
    type Error = Infallible;
}

impl Read for HostLine<'_> {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Infallible> {
        Ok(poll_fn(|_| self.inbox.take_bytes(bytes).map_or(Poll::Pending, Poll::Ready)).await)
    }
}

impl Write for HostLine<'_> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        if self.to_host.write_all(bytes).and_then(|()| self.to_host.flush()).is_ok() {
            return Ok(bytes.len());
        }
        self.inbox.finish(End::Closed);
        pending().await
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// A CAN interface of the system. It recovers from bus-off by itself, or when somebody sees to it.
pub struct SocketController<'a, F> {
    port: Arc<CanPort>,
    inbox: &'a Inbox,
    clock: &'a SystemClock,
    is_off: bool,
    format: PhantomData<F>,
}

impl<'a, F: Format> SocketController<'a, F> {
    /// The interface behind this port, which the inbox receives from.
    pub fn new(port: Arc<CanPort>, inbox: &'a Inbox, clock: &'a SystemClock) -> Self {
        Self { port, inbox, clock, is_off: false, format: PhantomData }
    }

    /// Whether the interface has taken a frame. Where there is no room for it, the rest is a short one; where
    /// the interface is gone, the node ends.
    fn send(&self, frame: &F::Frame) -> bool {
        match self.port.send(frame) {
            Ok(true) => return true,
            Ok(false) => self.clock.wake_at(self.clock.now() + AGAIN),
            Err(error) => self.inbox.finish(End::CanGone(error.to_string())),
        }
        false
    }

    fn hear(&mut self, what: Traffic) -> Exchange {
        match what {
            Traffic::Frame { id, data, .. } => {
                // No frame has more than 64 bytes.
                Exchange::Received(Some(Received::new(id, data.len() as u8, &data)))
            }
            Traffic::Other(_) => Exchange::Refused(Refusal::Kind),
            Traffic::Error { off, .. } => {
                self.is_off |= off;
                Exchange::Error
            }
        }
    }
}

impl<F: Format> Controller for SocketController<'_, F> {
    type Format = F;

    async fn exchange(&mut self, next: Option<&F::Frame>) -> Exchange {
        let exchange = poll_fn(|_| {
            if next.is_some_and(|frame| self.send(frame)) {
                return Poll::Ready(None);
            }
            self.inbox.take_heard().map_or(Poll::Pending, |heard| Poll::Ready(Some(heard.what)))
        });
        match exchange.await {
            Some(what) => self.hear(what),
            None => Exchange::Taken,
        }
    }

    /// The system sends what it has taken.
    fn cancel(&mut self) {}

    fn state(&self) -> BusState {
        if self.is_off { BusState::Off } else { BusState::Active }
    }

    /// Nobody tells.
    fn counters(&self) -> (u8, u8) {
        (0, 0)
    }

    /// The interface is taken to be back; while it is not, it takes no frames.
    fn restart(&mut self) {
        self.is_off = false;
    }
}
