//! The real-time plane on CAN, and the service plane on a serial line beside it.

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};
use funnel_link::{Bus, BusState, Change, Mailbox, Put, Step};
use funnel_protocol::can::{self, CanFrame};
use funnel_protocol::message::Message;
use funnel_protocol::refusal::Refusal;
use funnel_protocol::serial::Frame;
use funnel_protocol::service::Reply;

use super::serial::Serial;
use super::{Health, Input, Link};

/// How often the controller's error state is looked at: drivers wake nobody when it changes.
const LOOK_EVERY: Duration = Duration::from_millis(10);

/// A received data frame with an 11-bit identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// Identifier.
    pub id: u16,
    /// Number of data bytes, up to 64 in CAN FD.
    pub length: u8,
    /// The first eight of them; no frame of the real-time plane has more.
    pub data: [u8; 8],
}

impl Received {
    fn message(&self) -> Result<Message, Refusal> {
        let data = self.data.get(..self.length.into()).ok_or(Refusal::Length)?;
        can::decode(self.id, data)
    }
}

/// What a controller has done.
pub enum Exchange {
    /// It has received a frame; `None` for one that is not of this plane (29-bit identifier, remote frame).
    Received(Option<Received>),
    /// It has taken the frame that it was given.
    Taken,
    /// It reports an error on the bus. Its error counters decide what follows.
    Error,
}

/// A CAN controller. It may hold a few frames that it has taken and not sent yet.
#[allow(async_fn_in_trait)] // as for Link
pub trait Controller {
    /// Waits for a frame and, where there is one, for room for `next`. Dropping the future loses nothing.
    async fn exchange(&mut self, next: Option<&CanFrame>) -> Exchange;

    /// Drops the frames that were taken and not sent, but one that is being sent.
    fn cancel(&mut self);

    /// Error state.
    fn state(&self) -> BusState;

    /// Transmit and receive error counters.
    fn counters(&self) -> (u8, u8);

    /// Begins the recovery from bus-off; it must never happen by itself.
    fn restart(&mut self);
}

/// A node with its real-time plane on CAN. CTRL and SYNC may also come on the serial line; a FAULT goes out on both.
pub struct CanNode<C, U> {
    controller: C,
    service: Serial<U>,
    mailbox: Mailbox,
    bus: Bus,
    next_look: Instant,
    received: Option<Received>,
    change: Option<Change>,
    failures: u32,
}

impl<C: Controller, U: Read + Write> CanNode<C, U> {
    /// A node on this controller, with its service plane on this line.
    pub fn new(controller: C, service: Serial<U>) -> Self {
        Self {
            controller,
            service,
            mailbox: Mailbox::new(),
            bus: Bus::new(),
            next_look: Instant::now(),
            received: None,
            change: None,
            failures: 0,
        }
    }

    fn note(&mut self, exchange: Exchange) {
        match exchange {
            Exchange::Received(frame) => self.received = frame,
            Exchange::Taken => self.mailbox.taken(),
            Exchange::Error => self.failures = self.failures.saturating_add(1),
        }
    }

    /// Looks at the error state where that is due.
    fn look(&mut self) {
        let now = Instant::now();
        if now < self.next_look {
            return;
        }
        self.next_look = now + LOOK_EVERY;
        match self.bus.observe(self.controller.state(), now.as_millis()) {
            Step::Report(change) => self.change = change.or(self.change),
            Step::Silence(change) => {
                self.mailbox.clear();
                // States of before the recovery are old: ticks on CAN have eight bits, so one might pass for a new one.
                self.controller.cancel();
                self.change = Some(change);
            }
            Step::Restart => self.controller.restart(),
        }
    }
}

impl<C: Controller, U: Read + Write> Link for CanNode<C, U> {
    async fn wait(&mut self) {
        let next = self.mailbox.next().filter(|_| self.bus.is_on());
        let can = select(self.controller.exchange(next), Timer::at(self.next_look));
        match select(can, self.service.wait()).await {
            Either::First(Either::First(exchange)) => self.note(exchange),
            Either::First(Either::Second(())) | Either::Second(()) => {}
        }
        self.look();
    }

    fn next(&mut self) -> Option<Input<'_>> {
        if let Some(change) = self.change.take() {
            return Some(Input::Change(change));
        }
        if let Some(frame) = self.received.take() {
            return Some(Input::Frame(frame.message().map(Frame::RealTime)));
        }
        self.service.next().map(for_the_service_line)
    }

    async fn send(&mut self, message: &Message) {
        // A frame that has waited for so long that its successor is here: those that the controller holds are older still.
        if self.mailbox.put(can::encode(message)) == Put::Replaced {
            self.controller.cancel();
        }
        if matches!(message, Message::Fault { .. }) {
            self.service.send(message).await;
        }
    }

    async fn reply(&mut self, reply: &Reply, source: u8) {
        self.service.reply(reply, source).await;
    }

    fn health(&self) -> Health {
        Health {
            state: self.bus.state(),
            bus_offs: self.bus.offs(),
            counters: self.controller.counters(),
            failures: self.failures.saturating_add(self.service.health().failures),
        }
    }
}

/// Of the real-time plane, only what a host sends: a node's states come on CAN.
fn for_the_service_line(input: Input<'_>) -> Input<'_> {
    match input {
        Input::Frame(Ok(Frame::RealTime(
            Message::State { .. } | Message::Edge { .. } | Message::Fault { .. },
        ))) => Input::Frame(Err(Refusal::Kind)),
        input => input,
    }
}
