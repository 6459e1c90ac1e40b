//! A CAN interface of a run: what is said and heard there, and the log of it.

use super::HubError;
use crate::can::{CanPort, Heard, PortFrame};
use std::io;
use std::sync::Arc;
use std::time::Duration;

/// How long the host waits for room in its transmit queue: some 500 frames at the lowest bit rate.
const ROOM: Duration = Duration::from_secs(1);

/// An interface that is open.
pub struct CanSide {
    interface: String,
    port: Arc<CanPort>,
    fd: bool,
    /// What was heard and not taken yet.
    log: Vec<Heard>,
}

impl CanSide {
    /// The bus on `interface`, open as `port`, for frames of CAN FD if `fd`.
    pub fn new(interface: String, port: CanPort, fd: bool) -> Self {
        Self { interface, port: Arc::new(port), fd, log: Vec::new() }
    }

    /// Its name, and whether its frames are those of CAN FD.
    pub(super) fn interface(&self) -> (String, bool) {
        (self.interface.clone(), self.fd)
    }

    /// The port, for a thread that listens.
    pub(super) fn port(&self) -> Arc<CanPort> {
        Arc::clone(&self.port)
    }

    pub(super) fn say(&self, frames: &[PortFrame]) -> Result<(), HubError> {
        self.port.send_all(frames, ROOM).map_err(|error| self.failed(error))
    }

    /// Waits until something may have come, for so long at most.
    pub(super) fn wait(&self, limit: Duration) {
        if !limit.is_zero() {
            self.port.wait(limit);
        }
    }

    /// What has come, if something has.
    pub(super) fn next_heard(&mut self) -> Option<Result<Heard, HubError>> {
        let heard = self.port.receive().transpose()?;
        Some(self.taken(heard))
    }

    /// What was heard, with a note in the log.
    pub(super) fn taken(&mut self, heard: io::Result<Heard>) -> Result<Heard, HubError> {
        let heard = heard.map_err(|error| self.failed(error))?;
        self.log.push(heard.clone());
        Ok(heard)
    }

    /// What was heard since the last call.
    pub(super) fn take_log(&mut self) -> Vec<Heard> {
        std::mem::take(&mut self.log)
    }

    fn failed(&self, source: io::Error) -> HubError {
        HubError::Can { interface: self.interface.clone(), source }
    }
}
