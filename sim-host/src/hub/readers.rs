//! A thread per line and per bus that reads, so that none waits for another one.

use super::link::is_pause;
use super::{HubError, Link, SLICE};
use crate::can::{CanPort, Heard};
use std::io::{self, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What was read.
pub(super) struct Reading {
    /// When.
    pub(super) at: Instant,
    /// What.
    pub(super) what: What,
}

/// Of a line or of a bus, by index.
pub(super) enum What {
    /// From a node's line; no bytes are its end.
    Bytes(Place, io::Result<Vec<u8>>),
    /// On a bus.
    Heard(usize, io::Result<Heard>),
}

/// A line of a node, by index, and which one of those that it has had.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) node: usize,
    nth: u32,
}

/// The threads; dropping them ends them, within [`SLICE`].
pub(super) struct Readers {
    readings: Receiver<Reading>,
    sender: Sender<Reading>,
    /// By node.
    lines: Vec<Place>,
    quit: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Readers {
    /// A thread for each of these lines and buses, by index.
    ///
    /// # Errors
    /// The operating system's.
    pub(super) fn start<'a>(
        lines: impl IntoIterator<Item = &'a Link>,
        buses: impl IntoIterator<Item = Arc<CanPort>>,
    ) -> Result<Self, HubError> {
        let (sender, readings) = mpsc::channel();
        let mut readers =
            Self { readings, sender, lines: Vec::new(), quit: Arc::default(), threads: Vec::new() };
        for (node, link) in lines.into_iter().enumerate() {
            let place = Place { node, nth: 0 };
            readers.lines.push(place);
            readers.read(place, link)?;
        }
        for (bus, port) in buses.into_iter().enumerate() {
            let sender = readers.sender.clone();
            readers.spawn("start a thread for a CAN bus", move |quit| listen(bus, &port, &sender, quit))?;
        }
        Ok(readers)
    }

    /// Goes on with another line of a node, or with none. What its old one still says comes from nobody.
    ///
    /// # Errors
    /// The operating system's.
    pub(super) fn replace(&mut self, node: usize, link: Option<&Link>) -> Result<(), HubError> {
        let Some(place) = self.lines.get_mut(node) else { return Ok(()) };
        place.nth += 1;
        let place = *place;
        link.map_or(Ok(()), |link| self.read(place, link))
    }

    fn read(&mut self, place: Place, link: &Link) -> Result<(), HubError> {
        let (line, sender) = (link.reader()?, self.sender.clone());
        self.spawn("start a thread for a line", move |quit| read(place, line, &sender, quit))
    }

    /// Whether that was read from the line that its node has now.
    fn is_of_now(&self, reading: &Reading) -> bool {
        match &reading.what {
            What::Bytes(place, _) => self.lines.get(place.node) == Some(place),
            What::Heard(..) => true,
        }
    }

    fn spawn(
        &mut self,
        task: &'static str,
        work: impl FnOnce(&AtomicBool) + Send + 'static,
    ) -> Result<(), HubError> {
        let quit = Arc::clone(&self.quit);
        let thread = std::thread::Builder::new().spawn(move || work(&quit));
        self.threads.push(thread.map_err(HubError::io(task))?);
        Ok(())
    }

    /// The next thing that was read, if one comes within `limit`.
    pub(super) fn wait(&self, limit: Duration) -> Option<Reading> {
        self.readings.recv_timeout(limit).ok().filter(|reading| self.is_of_now(reading))
    }

    /// Ends the threads, and gives what nobody has taken.
    pub(super) fn end(mut self) -> Vec<Reading> {
        self.join();
        self.readings.try_iter().filter(|reading| self.is_of_now(reading)).collect()
    }

    fn join(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // It has nothing that could panic.
            let _ = thread.join();
        }
    }
}

impl Drop for Readers {
    fn drop(&mut self) {
        self.join();
    }
}

/// Reads until it shall quit, or the line ends.
fn read(place: Place, mut line: Box<dyn Read + Send>, to: &Sender<Reading>, quit: &AtomicBool) {
    let mut bytes = [0; 1024];
    while !quit.load(Ordering::Relaxed) {
        let read = match line.read(&mut bytes) {
            Err(error) if is_pause(error.kind()) => continue,
            read => read.map(|length| bytes.get(..length).unwrap_or(&bytes).to_vec()),
        };
        let last = !matches!(&read, Ok(bytes) if !bytes.is_empty());
        if !send(to, What::Bytes(place, read)) || last {
            return;
        }
    }
}

/// The same for a bus.
fn listen(bus: usize, port: &CanPort, to: &Sender<Reading>, quit: &AtomicBool) {
    while !quit.load(Ordering::Relaxed) {
        let Some(heard) = port.receive().transpose() else {
            port.wait(SLICE);
            continue;
        };
        let last = heard.is_err();
        if !send(to, What::Heard(bus, heard)) || last {
            return;
        }
    }
}

/// `false` once nobody takes it any more.
fn send(to: &Sender<Reading>, what: What) -> bool {
    to.send(Reading { at: Instant::now(), what }).is_ok()
}
