//! What a node in a process has received, in the order in which it came: bytes of its line, frames of its
//! bus, and the end of either.

use super::End;
use crate::can::{CanPort, Heard};
use std::cell::{RefCell, RefMut};
use std::io::{ErrorKind, Read};
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, Sender, TryRecvError};
use std::thread::{self, Thread};
use std::time::Duration;

/// How long a thread that listens to a bus waits at a time.
const REST: Duration = Duration::from_millis(100);

enum Input {
    Bytes(Vec<u8>),
    Heard(Heard),
    Ended(End),
}

/// What was received and not taken yet. Who wants a frame does not get it before the bytes that came before
/// it were taken.
pub struct Inbox {
    receiver: Receiver<Input>,
    first: RefCell<Option<Input>>,
}

impl Inbox {
    /// An inbox of this thread, which is unparked whenever something comes from the line or, if there is one,
    /// from the bus.
    pub fn open(line: Box<dyn Read + Send>, bus: Option<Arc<CanPort>>) -> Self {
        let (sender, receiver) = mpsc::channel();
        let to = Mail { sender, node: thread::current() };
        if let Some(port) = bus {
            let to = to.clone();
            thread::spawn(move || listen(&port, &to));
        }
        thread::spawn(move || read(line, &to));
        Self { receiver, first: RefCell::new(None) }
    }

    /// Takes bytes of the line, as many as `into` has room for; how many, `None` where none are next.
    pub fn take_bytes(&self, into: &mut [u8]) -> Option<usize> {
        let mut first = self.first();
        let Some(Input::Bytes(bytes)) = &mut *first else { return None };
        let length = bytes.len().min(into.len());
        into.iter_mut().zip(bytes.drain(..length)).for_each(|(to, from)| *to = from);
        if bytes.is_empty() {
            *first = None;
        }
        Some(length)
    }

    /// Takes what was heard on the bus, where that is next.
    pub fn take_heard(&self) -> Option<Heard> {
        self.first().take_if(|first| matches!(first, Input::Heard(_))).and_then(|first| match first {
            Input::Heard(heard) => Some(heard),
            _ => None,
        })
    }

    /// The end, once everything before it was taken.
    pub fn end(&self) -> Option<End> {
        match &*self.first() {
            Some(Input::Ended(end)) => Some(end.clone()),
            _ => None,
        }
    }

    /// Ends the node, whatever else may have come.
    pub fn finish(&self, end: End) {
        *self.first.borrow_mut() = Some(Input::Ended(end));
    }

    fn first(&self) -> RefMut<'_, Option<Input>> {
        let mut first = self.first.borrow_mut();
        if first.is_none() {
            *first = match self.receiver.try_recv() {
                Ok(input) => Some(input),
                Err(TryRecvError::Empty) => None,
                Err(TryRecvError::Disconnected) => Some(Input::Ended(End::Closed)),
            };
        }
        first
    }
}

/// The way to an inbox.
#[derive(Clone)]
struct Mail {
    sender: Sender<Input>,
    node: Thread,
}

impl Mail {
    /// Puts something into the inbox; whether something more may follow.
    fn put(&self, input: Input) -> bool {
        let is_last = matches!(input, Input::Ended(_));
        let is_open = self.sender.send(input).is_ok();
        self.node.unpark();
        is_open && !is_last
    }
}

/// Reads a line until nobody listens any more.
fn read(mut from: Box<dyn Read + Send>, to: &Mail) {
    let mut bytes = [0; 1024];
    loop {
        let input = match from.read(&mut bytes) {
            Ok(0) => Input::Ended(End::Closed),
            Ok(length) => Input::Bytes(bytes.get(..length).unwrap_or(&[]).to_vec()),
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
                ) =>
            {
                continue;
            }
            Err(_) => Input::Ended(End::Closed),
        };
        if !to.put(input) {
            return;
        }
    }
}

/// The same for a bus.
fn listen(port: &CanPort, to: &Mail) {
    loop {
        let input = match port.receive() {
            Ok(None) => {
                port.wait(REST);
                continue;
            }
            Ok(Some(heard)) => Input::Heard(heard),
            Err(error) => Input::Ended(End::CanGone(error.to_string())),
        };
        if !to.put(input) {
            return;
        }
    }
}
