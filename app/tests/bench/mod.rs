//! Nodes in one thread, by a clock that leaps from alarm to alarm: their lines, a CAN bus, and what may go
//! wrong with them.
#![allow(dead_code, reason = "each test uses a part")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use embedded_io_async::{ErrorType, Read, Write};
use funnelnet_app::Clock;
use funnelnet_app::link::can::{Controller, Exchange, Received};
use funnelnet_link::{BusState, Format, Frame};
use funnelnet_protocol::config::{EdgeConfig, Field, NodeConfig, Shape};
use funnelnet_protocol::message::{Command, Message, Target};
use funnelnet_protocol::report::Report;
use funnelnet_protocol::serial::{self, Deframer, HOST, MAX_FRAME, MAX_RAW};
use funnelnet_protocol::service::{Body, Reply, Request};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::future::poll_fn;
use std::marker::PhantomData;
use std::pin::Pin;
use std::task::{Context, Poll, Waker};

pub const MS: u64 = 1_000_000;

/// A clock that stands still while somebody does something.
#[derive(Default)]
pub struct Time {
    now: Cell<u64>,
    alarm: Cell<u64>,
}

impl Time {
    /// Polls a future until `to` (ns).
    pub fn run(&self, mut future: Pin<&mut impl Future>, to: u64) {
        loop {
            self.alarm.set(to);
            let mut context = Context::from_waker(Waker::noop());
            assert!(future.as_mut().poll(&mut context).is_pending(), "nodes run for ever");
            if self.now.get() == to && self.alarm.get() == to {
                return;
            }
            self.now.set(self.alarm.get().max(self.now.get()));
        }
    }

    /// Somebody has something to do now.
    fn stir(&self) {
        self.wake_at(self.now.get());
    }

    fn wake_at(&self, at: u64) {
        self.alarm.set(self.alarm.get().min(at));
    }
}

impl Clock for &Time {
    fn now(self) -> u64 {
        self.now.get()
    }

    fn wait_until(self, at: u64) -> impl Future<Output = ()> {
        poll_fn(move |_| {
            if self.now.get() >= at {
                return Poll::Ready(());
            }
            self.wake_at(at);
            Poll::Pending
        })
    }
}

/// Something that a node has said on its line.
#[derive(Clone, Debug, PartialEq)]
pub enum Said {
    Message(Message),
    Reply(Reply),
}

/// Both directions of a node's line.
pub struct Line<'a> {
    time: &'a Time,
    to_node: RefCell<VecDeque<u8>>,
    from_node: RefCell<Vec<u8>>,
    /// Bytes that it takes before it is full; nobody empties it.
    room: Cell<usize>,
}

impl<'a> Line<'a> {
    pub fn new(time: &'a Time) -> Self {
        let (to_node, from_node) = Default::default();
        Self { time, to_node, from_node, room: Cell::new(usize::MAX) }
    }

    /// From now on it takes so many bytes more.
    pub fn has_room_for(&self, bytes: usize) {
        self.room.set(bytes);
        self.time.stir();
    }

    /// Puts a request on the line.
    pub fn ask(&self, request: &Request) {
        self.request(request);
    }

    /// Puts a request of any kind on the line.
    pub fn request(&self, request: &impl Body) {
        let (mut scratch, mut frame) = ([0; MAX_RAW], [0; MAX_FRAME]);
        let length = serial::encode_service(request, HOST, &mut scratch, &mut frame).unwrap();
        self.to_node.borrow_mut().extend(&frame[..length]);
    }

    /// Puts a message on the line.
    pub fn tell(&self, message: &Message) {
        self.to_node.borrow_mut().extend(&serial::encode(message));
    }

    /// What the node has said since the last call.
    pub fn heard(&self) -> Vec<Said> {
        let (mut deframer, mut heard) = (Deframer::<MAX_FRAME>::new(), Vec::new());
        for byte in self.from_node.take() {
            match deframer.push(byte).map(Result::unwrap) {
                Some(serial::Frame::RealTime(message)) => heard.push(Said::Message(message)),
                Some(serial::Frame::Service { kind, body, .. }) => {
                    heard.push(Said::Reply(Reply::decode(kind, body).unwrap()))
                }
                None => {}
            }
        }
        heard
    }

    /// Asks `node` for its report.
    pub fn report(&self, node: Pin<&mut impl Future>) -> Report {
        self.ask(&Request::Report);
        self.time.run(node, self.time.now.get());
        let report = |said| if let Said::Reply(Reply::Report(report)) = said { Some(report) } else { None };
        self.heard().into_iter().find_map(report).unwrap()
    }
}

impl ErrorType for &Line<'_> {
    type Error = Infallible;
}

impl Read for &Line<'_> {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Infallible> {
        let line = *self;
        let take = |bytes: &mut [u8]| std::io::Read::read(&mut *line.to_node.borrow_mut(), bytes).unwrap();
        Ok(poll_fn(|_| match take(bytes) {
            0 => Poll::Pending,
            length => Poll::Ready(length),
        })
        .await)
    }
}

impl Write for &Line<'_> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let line = *self;
        let taken = poll_fn(|_| match bytes.len().min(line.room.get()) {
            0 => Poll::Pending,
            count => Poll::Ready(count),
        });
        let count = taken.await;
        self.room.set(self.room.get() - count);
        self.from_node.borrow_mut().extend(&bytes[..count]);
        Ok(count)
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

/// A bus that carries a frame as soon as it is there, to all but its sender.
pub struct Bus<'a, const N: usize> {
    time: &'a Time,
    heard: [RefCell<VecDeque<Received>>; N],
    /// Whose controller is off the bus.
    pub off: [Cell<bool>; N],
    /// Identifiers of what was sent.
    pub sent: RefCell<Vec<u16>>,
    /// When frames begin, as controllers stamp them; those after the last of these have no stamp.
    pub begins: RefCell<VecDeque<u64>>,
}

impl<'a, const N: usize> Bus<'a, N> {
    pub fn new(time: &'a Time) -> Self {
        let heard = std::array::from_fn(|_| RefCell::default());
        Self {
            time,
            heard,
            off: std::array::from_fn(|_| Cell::default()),
            sent: RefCell::default(),
            begins: RefCell::default(),
        }
    }

    /// The controller of a node.
    pub fn tap<F: Format>(&self, index: usize) -> Tap<'_, N, F> {
        Tap { bus: self, index, format: PhantomData }
    }

    fn carry(&self, sender: usize, frame: &impl Frame) {
        let (id, data) = (frame.id(), frame.data());
        self.sent.borrow_mut().push(id);
        let began = self.begins.borrow_mut().pop_front();
        for (_, queue) in self.heard.iter().enumerate().filter(|&(index, _)| index != sender) {
            queue.borrow_mut().push_back(Received::new(id, data.len() as u8, data).that_began(began));
        }
        self.time.stir();
    }
}

pub struct Tap<'b, const N: usize, F> {
    bus: &'b Bus<'b, N>,
    index: usize,
    format: PhantomData<F>,
}

impl<const N: usize, F: Format> Controller for Tap<'_, N, F> {
    type Format = F;

    async fn exchange(&mut self, next: Option<&F::Frame>) -> Exchange {
        poll_fn(|_| {
            if let Some(frame) = self.bus.heard[self.index].borrow_mut().pop_front() {
                return Poll::Ready(Exchange::Received(Some(frame)));
            }
            match next.is_some_and(|frame| self.offer(frame)) {
                true => Poll::Ready(Exchange::Taken),
                false => Poll::Pending,
            }
        })
        .await
    }

    fn offer(&mut self, frame: &F::Frame) -> bool {
        let is_on = !self.bus.off[self.index].get();
        if is_on {
            self.bus.carry(self.index, frame);
        }
        is_on
    }

    fn cancel(&mut self) {}

    fn state(&self) -> BusState {
        if self.bus.off[self.index].get() { BusState::Off } else { BusState::Active }
    }

    fn counters(&self) -> (u8, u8) {
        (0, 0)
    }

    fn restart(&mut self) {
        self.bus.off[self.index].set(false);
    }
}

/// Node `id` of two, by its own timer of 1 ms.
pub fn config(id: u8) -> NodeConfig {
    NodeConfig::builder(id, MS as u32)
        .state([f32::from(id)])
        .state_limit(1e6)
        .field(Field {
            slope: [-0.7].into_iter().collect(),
            offset: [f32::from(id)].into_iter().collect(),
            sines: [].into_iter().collect(),
        })
        .funnel(Shape::Constant { width: 10.0 })
        .edges([EdgeConfig { id: 3 - id, weight: 1.0, edges: 1 }])
        .extrapolate_ticks(3)
        .build()
        .unwrap()
}

pub fn start() -> Message {
    Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 }
}
