//! The real-time plane on CAN, and the service plane on a serial line beside it.

use embassy_futures::select::{Either, select};
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};
use funnelnet_link::{Bus, BusState, Change, Format, Mailbox, Put, Step};
use funnelnet_protocol::can_fd::MAX_DATA;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::serial::Frame;
use funnelnet_protocol::service::Reply;

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
    /// The first of them; no frame of the real-time plane has more.
    pub data: [u8; MAX_DATA],
}

impl Received {
    /// A frame with this identifier that holds `length` bytes, of which these are the first.
    pub fn new(id: u16, length: u8, bytes: &[u8]) -> Self {
        let mut data = [0; MAX_DATA];
        data.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
        Self { id, length, data }
    }

    /// Its data; nothing of one that is longer than any of the plane, which is no length of the plane either.
    fn data(&self) -> &[u8] {
        self.data.get(..self.length.into()).unwrap_or(&[])
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
    /// The format of its frames.
    type Format: Format;

    /// Waits for a frame and, where there is one, for room for `next`. Dropping the future loses nothing.
    async fn exchange(&mut self, next: Option<&FrameOf<Self>>) -> Exchange;

    /// Drops the frames that were taken and not sent, but one that is being sent.
    fn cancel(&mut self);

    /// Error state.
    fn state(&self) -> BusState;

    /// Transmit and receive error counters.
    fn counters(&self) -> (u8, u8);

    /// Begins the recovery from bus-off; it must never happen by itself.
    fn restart(&mut self);
}

/// The frames that a controller sends.
pub type FrameOf<C> = <<C as Controller>::Format as Format>::Frame;

/// A node with its real-time plane on CAN. CTRL and SYNC may also come on the serial line; a FAULT goes out on both.
pub struct CanNode<C: Controller, U> {
    controller: C,
    service: Serial<U>,
    format: C::Format,
    mailbox: Mailbox<FrameOf<C>>,
    bus: Bus,
    next_look: Instant,
    change: Option<Change>,
    failures: u32,
}

impl<C: Controller, U: Read + Write> CanNode<C, U> {
    /// A node on this controller, with its service plane on this line.
    pub fn new(controller: C, service: Serial<U>) -> Self {
        Self {
            controller,
            service,
            format: C::Format::default(),
            mailbox: Mailbox::new(),
            bus: Bus::new(),
            next_look: Instant::now(),
            change: None,
            failures: 0,
        }
    }

    fn note(&mut self, exchange: Exchange) {
        match exchange {
            Exchange::Received(Some(frame)) => self.format.receive(frame.id, frame.data()),
            Exchange::Received(None) => {}
            Exchange::Taken => self.mailbox.taken(),
            Exchange::Error => self.failures = self.failures.saturating_add(1),
        }
    }

    /// Lets a frame wait for the controller.
    fn put(&mut self, frame: FrameOf<C>) {
        // A frame that has waited for so long that its successor is here: those that the controller holds are older still.
        if self.mailbox.put(frame) == Put::Replaced {
            self.controller.cancel();
        }
    }

    /// The session has nothing more to say for now.
    fn flush(&mut self) {
        if let Some(frame) = self.format.flush() {
            self.put(frame);
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
                drop(self.format.flush());
                // States of before the recovery are old: ticks on CAN have eight bits, or sixteen, so one might pass for a new one.
                self.controller.cancel();
                self.change = Some(change);
            }
            Step::Restart => self.controller.restart(),
        }
    }
}

impl<C: Controller, U: Read + Write> Link for CanNode<C, U> {
    async fn wait(&mut self) {
        self.flush();
        let next = self.mailbox.next().filter(|_| self.bus.is_on());
        let can = select(self.controller.exchange(next), Timer::at(self.next_look));
        match select(can, self.service.wait()).await {
            Either::First(Either::First(exchange)) => self.note(exchange),
            Either::First(Either::Second(())) | Either::Second(()) => {}
        }
        self.look();
    }

    fn next(&mut self) -> Option<Input<'_>> {
        self.flush();
        if let Some(change) = self.change.take() {
            return Some(Input::Change(change));
        }
        if let Some(heard) = self.format.unpack() {
            return Some(Input::Frame(heard.map(Frame::RealTime)));
        }
        self.service.next().map(for_the_service_line)
    }

    async fn send(&mut self, message: &Message) {
        for frame in self.format.pack(message).into_iter().flatten() {
            self.put(frame);
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
