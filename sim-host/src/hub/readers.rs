//! A thread per line that reads, so that no line waits for another one.

use super::link::is_pause;
use super::{HubError, Link};
use std::io::{self, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// What was read from a line.
pub(super) struct Reading {
    /// Whose line, by index.
    pub(super) node: usize,
    /// When.
    pub(super) at: Instant,
    /// No bytes are its end.
    pub(super) bytes: io::Result<Vec<u8>>,
}

/// The threads; dropping them ends them, within [`SLICE`](super::SLICE).
pub(super) struct Readers {
    readings: Receiver<Reading>,
    quit: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Readers {
    /// A thread for each of these lines, by index.
    ///
    /// # Errors
    /// The operating system's.
    pub(super) fn start<'a>(lines: impl IntoIterator<Item = &'a Link>) -> Result<Self, HubError> {
        let (sender, readings) = mpsc::channel();
        let mut readers = Self { readings, quit: Arc::default(), threads: Vec::new() };
        for (node, link) in lines.into_iter().enumerate() {
            let (line, sender, quit) = (link.reader()?, sender.clone(), Arc::clone(&readers.quit));
            let thread = std::thread::Builder::new().spawn(move || read(node, line, &sender, &quit));
            readers.threads.push(thread.map_err(HubError::io("start a thread for a line"))?);
        }
        Ok(readers)
    }

    /// The next thing that was read, if one comes within `limit`.
    pub(super) fn wait(&self, limit: Duration) -> Option<Reading> {
        self.readings.recv_timeout(limit).ok()
    }

    /// Ends the threads, and gives what nobody has taken.
    pub(super) fn end(mut self) -> Vec<Reading> {
        self.join();
        self.readings.try_iter().collect()
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
fn read(node: usize, mut line: Box<dyn Read + Send>, to: &Sender<Reading>, quit: &AtomicBool) {
    let mut bytes = [0; 1024];
    while !quit.load(Ordering::Relaxed) {
        let read = match line.read(&mut bytes) {
            Err(error) if is_pause(error.kind()) => continue,
            read => read.map(|length| bytes.get(..length).unwrap_or(&bytes).to_vec()),
        };
        let last = !matches!(&read, Ok(bytes) if !bytes.is_empty());
        if to.send(Reading { node, at: Instant::now(), bytes: read }).is_err() || last {
            return;
        }
    }
}
