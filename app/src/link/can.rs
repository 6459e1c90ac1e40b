//! The real-time plane on CAN, and the service plane on a serial line beside it.

use embassy_futures::select::{Either, select};
use embedded_io_async::{Read, Write};
use funnelnet_link::{BusState, CanPort, Filters, Format, Heard, Request};
use funnelnet_protocol::can_fd::MAX_DATA;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::Losses;
use funnelnet_protocol::serial::{self, Frame};
use funnelnet_protocol::service::Reply;

use super::outgoing::Outgoing;
use super::serial::Serial;
use super::{Health, Input, Link};
use crate::clock::Clock;

/// Received frames that are taken one after the other before anything else has its turn: the line, frames to
/// send.
const IN_A_ROW: u8 = 16;

/// A received data frame with an 11-bit identifier.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// Identifier.
    pub id: u16,
    /// Number of data bytes, up to 64 in CAN FD.
    pub length: u8,
    /// The first of them; no frame of the real-time plane has more.
    pub data: [u8; MAX_DATA],
    /// When it began on the bus, by the app's clock (ns), where the controller knows that: it may have waited since.
    pub began: Option<u64>,
}

impl Received {
    /// A frame with this identifier that holds `length` bytes, of which these are the first.
    pub fn new(id: u16, length: u8, bytes: &[u8]) -> Self {
        let mut data = [0; MAX_DATA];
        data.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
        Self { id, length, data, began: None }
    }

    /// The same, which began on the bus then (ns).
    #[must_use]
    pub fn that_began(self, began: Option<u64>) -> Self {
        Self { began, ..self }
    }

    /// Its data; nothing of one that is longer than any of the plane, which is no length of the plane either.
    fn data(&self) -> &[u8] {
        self.data.get(..self.length.into()).unwrap_or(&[])
    }
}

/// What a controller has done.
pub enum Exchange {
    /// It has received a frame; `None` for one that is not of this plane (29-bit identifier, remote frame)
    /// and of which nobody keeps count.
    Received(Option<Received>),
    /// It has received a frame that the node refuses, and counts, for this reason.
    Refused(Refusal),
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

    /// Gives it a frame now; whether it has taken it. Without this, each frame waits for an [exchange](Self::exchange), behind what is received.
    fn offer(&mut self, _frame: &FrameOf<Self>) -> bool {
        false
    }

    /// A frame that has been received already, and waits: without this, each has a wait of its own.
    fn received(&mut self) -> Option<Exchange> {
        None
    }

    /// Drops the frames that were taken and not sent, but one that is being sent.
    fn cancel(&mut self);

    /// Error state.
    fn state(&self) -> BusState;

    /// Transmit and receive error counters.
    fn counters(&self) -> (u8, u8);

    /// Begins the recovery from bus-off; it must never happen by itself.
    fn restart(&mut self);

    /// Frames that were received and lost, and errors on the bus of which no [exchange](Self::exchange)
    /// tells, both since the start.
    fn losses(&self) -> Losses {
        Losses::default()
    }

    /// Lets in what these filters pass, from now on; what passes both the old ones and these is never missed.
    /// More than that only where there is no room for them. Without this, it lets in everything.
    fn listen(&mut self, _filters: Filters<'_>) {}
}

/// The frames that a controller sends.
pub type FrameOf<C> = <<C as Controller>::Format as Format>::Frame;

/// A node with its real-time plane on CAN. CTRL and SYNC may also come on the serial line; a FAULT goes out
/// on both.
pub struct CanNode<C: Controller, U> {
    controller: C,
    service: Serial<U>,
    outgoing: Outgoing,
    port: CanPort<C::Format>,
    /// When the frame that the port was given last began on the bus. What the port says then is of that frame.
    began: Option<u64>,
    /// Frames that may be taken before the next wait.
    in_a_row: u8,
}

impl<C: Controller, U: Read + Write> CanNode<C, U> {
    /// A node on this controller, with its service plane on this line.
    pub fn new(controller: C, service: Serial<U>) -> Self {
        Self {
            controller,
            service,
            outgoing: Outgoing::new(),
            port: CanPort::new(),
            began: None,
            in_a_row: 0,
        }
    }

    fn losses(&self) -> Losses {
        let of_controller = self.controller.losses();
        Losses {
            bus_errors: of_controller.bus_errors.saturating_add(self.port.errors()),
            bus_offs: self.port.offs().into(),
            line_errors: self.service.errors(),
            unsaid: self.outgoing.unsaid(),
            ..of_controller
        }
    }

    fn note(&mut self, exchange: Exchange) {
        match exchange {
            Exchange::Received(Some(frame)) => {
                self.began = frame.began;
                self.port.on_frame(frame.id, frame.data());
            }
            Exchange::Received(None) => {}
            Exchange::Refused(reason) => self.port.on_refused(reason),
            Exchange::Taken => self.port.on_taken(),
            Exchange::Error => self.port.on_error(),
        }
    }

    /// Does what the port asks of the controller.
    fn obey(&mut self, request: Option<Request>) {
        match request {
            Some(Request::Cancel) => self.controller.cancel(),
            Some(Request::Restart) => self.controller.restart(),
            None => {}
        }
    }

    /// The session has nothing more to say for now. The controller gets what it has room for before anything else has its turn: received frames
    /// and telemetry would make states uneven, by 23 us on an STM32G474.
    fn flush(&mut self) {
        let request = self.port.flush();
        self.obey(request);
        while let Some(frame) = self.port.next_frame() {
            if !self.controller.offer(frame) {
                return;
            }
            self.port.on_taken();
        }
    }

    /// The next thing on CAN for the node.
    fn hear(&mut self) -> Option<Heard> {
        loop {
            self.flush();
            if let Some(heard) = self.port.hear() {
                return Some(heard);
            }
            self.in_a_row = self.in_a_row.checked_sub(1)?;
            let exchange = self.controller.received()?;
            self.note(exchange);
        }
    }

    /// Looks at the error state where that is due.
    fn look(&mut self, now: u64) {
        if now >= self.port.look_at() {
            let request = self.port.on_state(self.controller.state(), now);
            self.obey(request);
        }
    }
}

impl<C: Controller, U: Read + Write> Link for CanNode<C, U> {
    async fn wait(&mut self, clock: impl Clock) {
        self.flush();
        self.outgoing.write(&mut self.service);
        let can =
            select(self.controller.exchange(self.port.next_frame()), clock.wait_until(self.port.look_at()));
        match select(can, self.service.wait(clock)).await {
            Either::First(Either::First(exchange)) => self.note(exchange),
            Either::First(Either::Second(())) | Either::Second(()) => {}
        }
        self.in_a_row = IN_A_ROW;
        self.look(clock.now());
    }

    fn next(&mut self, now: u64) -> Option<Input<'_>> {
        match self.hear() {
            Some(Heard::Change(change)) => Some(Input::Change(change)),
            Some(Heard::Message(Ok(sync @ Message::Sync { source: Some(_), .. }))) => {
                Some(self.began.map_or(Input::Frame(Ok(Frame::RealTime(sync))), |at| Input::Sync(sync, at)))
            }
            Some(Heard::Message(message)) => Some(Input::Frame(message.map(Frame::RealTime))),
            None => self.service.next(now).map(for_the_service_line),
        }
    }

    async fn send(&mut self, message: &Message, _: u64) {
        let request = self.port.send(message);
        self.obey(request);
        if matches!(message, Message::Sync { .. }) {
            // It is stamped when the controller has it.
            self.flush();
        }
        if matches!(message, Message::Fault { .. }) {
            self.outgoing.say(&serial::encode(message), &mut self.service);
        }
    }

    /// Without waiting for the line: it is slower than the bus, and frames and ticks would wait, too.
    async fn reply(&mut self, reply: &Reply, source: u8) {
        self.flush();
        self.outgoing.reply(reply, source, &mut self.service);
    }

    fn health(&self) -> Health {
        Health { state: self.port.state(), counters: self.controller.counters(), losses: self.losses() }
    }

    fn listen(&mut self, filters: Filters<'_>) {
        self.controller.listen(filters);
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
