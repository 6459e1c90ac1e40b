//! The driver of the conductor: does what its tasks ask for, on real lines and by the real clock.

use super::link::Link;
use super::readers::{Place, Readers, Reading, What};
use super::{Attached, CanSide, Device, HubError};
use crate::can::Heard;
use crate::conductor::{Action, Seat, Source, Step, Task};
use std::io::{self, Read};
use std::time::{Duration, Instant, SystemTime};

/// A node's line and device.
struct Outlet {
    link: Link,
    device: Box<dyn Device>,
}

/// All that the conductor reaches nodes by.
pub(super) struct Outlets {
    nodes: Vec<Outlet>,
    buses: Vec<CanSide>,
    /// Where several lines are read at once.
    readers: Option<Readers>,
    /// Time 0 of the conductor.
    origin: Instant,
    /// A moment by this program's clock, and by the one that the kernel stamps frames with.
    moment: (Instant, SystemTime),
}

impl Outlets {
    /// Those of these nodes, and who is to be there.
    pub(super) fn of(attached: Vec<Attached>) -> (Vec<Seat>, Self) {
        let seat = |Attached { link, uid, .. }: &Attached| Seat {
            id: link.id(),
            place: link.place().to_owned(),
            uid: *uid,
        };
        let seats = attached.iter().map(seat).collect();
        let nodes =
            attached.into_iter().map(|Attached { link, device, .. }| Outlet { link, device }).collect();
        let now = Instant::now();
        let (origin, moment) = (now, (now, SystemTime::now()));
        (seats, Self { nodes, buses: Vec::new(), readers: None, origin, moment })
    }

    pub(super) fn set_buses(&mut self, buses: Vec<CanSide>) {
        self.buses = buses;
    }

    /// Compares this program's clock with the kernel's.
    pub(super) fn compare_clocks(&mut self) {
        self.moment = (Instant::now(), SystemTime::now());
    }

    /// A second handle of the line of a node; one that is gone where there is no such node.
    ///
    /// # Errors
    /// The operating system's.
    pub(super) fn reader_of(&self, index: usize) -> Result<Box<dyn Read + Send>, HubError> {
        self.nodes.get(index).map_or_else(|| Ok(Box::new(io::empty()) as _), |node| node.link.reader())
    }

    /// Starts threads that read all lines and buses.
    ///
    /// # Errors
    /// The operating system's.
    pub(super) fn start_readers(&mut self) -> Result<(), HubError> {
        let lines = self.nodes.iter().map(|node| &node.link);
        self.readers = Some(Readers::start(lines, self.buses.iter().map(CanSide::port))?);
        Ok(())
    }

    /// Does what a task asks for, until it is over.
    pub(super) fn run<T>(&mut self, mut task: Task<'_, T>) -> T {
        loop {
            match task.poll(self.since_origin(Instant::now())) {
                Step::Do(action) => {
                    if let Err(error) = self.act(action, &mut task) {
                        task.on_failed(error);
                    }
                }
                Step::Done(outcome) => return outcome,
            }
        }
    }

    fn act<T>(&mut self, action: Action, task: &mut Task<'_, T>) -> Result<(), HubError> {
        match action {
            Action::Write { node, bytes } => {
                self.nodes.get_mut(node).map_or(Ok(()), |node| node.link.write(&bytes))
            }
            Action::Say { bus, frames } => self.buses.get(bus).map_or(Ok(()), |bus| bus.say(&frames)),
            Action::Read { from: Source::Line(node), .. } => self.read_line(node, task),
            Action::Read { from: Source::Bus(bus), until } => self.read_bus(bus, until, task),
            Action::Read { from: Source::All, until } => self.read_any(until, task),
            Action::Wait { until } => {
                std::thread::sleep(self.left(until));
                Ok(())
            }
            Action::Close { node } => {
                if let Some(node) = self.nodes.get_mut(node) {
                    node.link.replace(Box::new(io::empty()));
                }
                Ok(())
            }
            Action::Reopen { node: index } => {
                if let Some(node) = self.nodes.get_mut(index)
                    && let Some(stream) = node.device.reopen()
                {
                    node.link.replace(stream);
                    task.on_reopened(index);
                }
                Ok(())
            }
            Action::Switch { node: index, on } => {
                if let Some(node) = self.nodes.get_mut(index)
                    && let Some(stream) = node.device.switch(on)?
                {
                    node.link.replace(stream);
                    if let Some(readers) = &mut self.readers {
                        readers.replace(index, on.then_some(&node.link))?;
                    }
                    task.on_switched(index);
                }
                Ok(())
            }
        }
    }

    /// Reads a line for a slice of time at most.
    fn read_line<T>(&mut self, index: usize, task: &mut Task<'_, T>) -> Result<(), HubError> {
        if self.end_readers(task) {
            return Ok(());
        }
        let mut bytes = [0; 1024];
        let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
        let length = node.link.read(&mut bytes)?;
        let now = self.since_origin(Instant::now());
        task.on_bytes(index, bytes.get(..length).unwrap_or(&bytes), now);
        Ok(())
    }

    fn read_bus<T>(&mut self, index: usize, until: u64, task: &mut Task<'_, T>) -> Result<(), HubError> {
        let left = if self.end_readers(task) { Duration::ZERO } else { self.left(until) };
        if let Some(bus) = self.buses.get(index) {
            bus.wait(left);
        }
        while let Some(heard) = self.buses.get_mut(index).and_then(CanSide::next_heard) {
            let (heard, now) = (heard?, self.since_origin(Instant::now()));
            let at = self.bus_ns(&heard);
            task.on_heard(index, heard, at, now);
        }
        Ok(())
    }

    /// Waits until a thread has read something.
    fn read_any<T>(&mut self, until: u64, task: &mut Task<'_, T>) -> Result<(), HubError> {
        self.check_interrupt()?;
        let left = self.left(until);
        let reading = self.readers.as_ref().and_then(|readers| readers.wait(left));
        reading.map_or(Ok(()), |reading| self.hand_over(reading, task))
    }

    /// Ends the threads that read, and hands over what they have left; whether there were some. From here on
    /// lines are read as they are asked.
    fn end_readers<T>(&mut self, task: &mut Task<'_, T>) -> bool {
        let were_some = self.readers.is_some();
        for reading in self.readers.take().map_or_else(Vec::new, Readers::end) {
            // A line or a bus that is gone says so again to whoever asks it.
            let _ = self.hand_over(reading, task);
        }
        were_some
    }

    fn hand_over<T>(
        &mut self,
        Reading { at, what }: Reading,
        task: &mut Task<'_, T>,
    ) -> Result<(), HubError> {
        let at = self.since_origin(at);
        match what {
            What::Bytes(Place { node: index, .. }, read) => {
                let Some(node) = self.nodes.get(index) else { return Ok(()) };
                match read {
                    Ok(bytes) if bytes.is_empty() => return Err(node.link.closed()),
                    Ok(bytes) => task.on_bytes(index, &bytes, at),
                    Err(error) => return Err(node.link.died(&error.kind().to_string())),
                }
            }
            What::Heard(index, heard) => {
                let Some(bus) = self.buses.get_mut(index) else { return Ok(()) };
                let heard = bus.taken(heard)?;
                let bus_ns = self.bus_ns(&heard);
                task.on_heard(index, heard, bus_ns, at);
            }
        }
        Ok(())
    }

    fn since_origin(&self, at: Instant) -> u64 {
        u64::try_from(at.saturating_duration_since(self.origin).as_nanos()).unwrap_or(u64::MAX)
    }

    fn left(&self, until: u64) -> Duration {
        Duration::from_nanos(until.saturating_sub(self.since_origin(Instant::now())))
    }

    /// When a frame was on its bus, on the conductor's clock.
    fn bus_ns(&self, heard: &Heard) -> u64 {
        let (here, kernel) = self.moment;
        let at = match heard.at.duration_since(kernel) {
            Ok(later) => here.checked_add(later),
            Err(error) => here.checked_sub(error.duration()),
        };
        self.since_origin(at.unwrap_or(here))
    }

    /// From now on a write takes no longer than `limit`, and the user's wish to stop, which has been heard,
    /// ends nothing.
    pub(super) fn hurry(&mut self, limit: Duration) {
        self.nodes.iter_mut().for_each(|node| node.link.hurry(limit));
    }

    /// Fails once the user wants to stop.
    ///
    /// # Errors
    /// An interrupt.
    pub(super) fn check_interrupt(&self) -> Result<(), HubError> {
        self.nodes.iter().try_for_each(|node| node.link.check_interrupt())
    }

    /// What was heard since the last call, with the index of the bus; in order of bus time.
    pub(super) fn take_heard(&mut self) -> Vec<(usize, Heard)> {
        let logs = self.buses.iter_mut().map(CanSide::take_log);
        let mut heard: Vec<_> =
            logs.enumerate().flat_map(|(bus, log)| log.into_iter().map(move |heard| (bus, heard))).collect();
        if self.buses.len() > 1 {
            heard.sort_by_key(|(_, heard)| heard.at);
        }
        heard
    }

    /// What the device of a node has to say about an error.
    pub(super) fn last_words(&mut self, id: u8, error: &HubError) -> Option<Vec<String>> {
        let index = self.nodes.iter().position(|node| node.link.id() == id)?;
        self.last_words_of(index, error)
    }

    /// The same by index.
    pub(super) fn last_words_of(&mut self, index: usize, error: &HubError) -> Option<Vec<String>> {
        let ended = matches!(error, HubError::Died { .. });
        self.nodes.get_mut(index).map(|node| node.device.last_words(ended))
    }

    /// Ends all devices and gives the logs that this program has: id and text.
    pub(super) fn into_logs(self) -> Vec<(u8, String)> {
        let log = |node: Outlet| Some((node.link.id(), node.device.into_log()?));
        self.nodes.into_iter().filter_map(log).collect()
    }
}
