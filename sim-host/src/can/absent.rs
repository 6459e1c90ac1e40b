//! Where there is no SocketCAN.

use super::{CanError, Heard, Own};
use funnelnet_link::Frame;
use std::io;
use std::time::Duration;

/// An interface that cannot be opened.
#[derive(Debug)]
pub enum CanPort {}

impl CanPort {
    /// Fails.
    ///
    /// # Errors
    /// Always.
    pub fn open(interface: &str, _: Own, _: bool) -> Result<Self, CanError> {
        Err(CanError {
            problem: format!("the CAN interface {interface} cannot be opened"),
            advice: "CAN interfaces are used by SocketCAN, which only Linux has",
        })
    }

    /// There is none.
    ///
    /// # Errors
    /// None.
    pub fn receive(&self) -> io::Result<Option<Heard>> {
        match *self {}
    }

    /// There is none.
    pub fn wait(&self, _: Duration) {
        match *self {}
    }

    /// There is none.
    ///
    /// # Errors
    /// None.
    pub fn send(&self, _: &impl Frame) -> io::Result<bool> {
        match *self {}
    }
}
