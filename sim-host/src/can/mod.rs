//! A CAN interface of this machine, by SocketCAN: the real-time plane as a node or the host sees it.

#[cfg_attr(not(target_os = "linux"), path = "absent.rs")]
mod socket;

pub use socket::CanPort;

use funnel_protocol::can::{self, CanFrame};
use funnel_protocol::message::Message;
use funnel_protocol::refusal::Refusal;
use std::fmt;
use std::time::{Duration, SystemTime};

/// Whether a port hears what it sends itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Own {
    /// As everybody else hears it, with its bus time.
    Heard,
    /// As a node: its own id is that of a twin.
    Ignored,
}

/// Something that was heard on the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Heard {
    /// When, by the kernel's clock: the bus time.
    pub at: SystemTime,
    /// What.
    pub what: Traffic,
}

/// What travels on a bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Traffic {
    /// A data frame with an 11-bit identifier.
    Frame {
        /// Identifier.
        id: u16,
        /// Its 0 to 8 bytes.
        data: Vec<u8>,
    },
    /// A frame that is not of the real-time plane: 29-bit identifier, or a remote frame. As the kernel names it.
    Other(String),
    /// The controller reports an error.
    Error {
        /// It went off the bus.
        off: bool,
        /// In words.
        text: String,
    },
}

impl Heard {
    /// The frame of the real-time plane that it is.
    ///
    /// # Errors
    /// Why it is none; `None` where it is no frame at all.
    pub fn message(&self) -> Result<Message, Option<Refusal>> {
        match &self.what {
            Traffic::Frame { id, data } => can::decode(*id, data).map_err(Some),
            Traffic::Other(_) => Err(Some(Refusal::Kind)),
            Traffic::Error { .. } => Err(None),
        }
    }

    /// Its line in a log that `candump -L` could have written; `None` for what such a log does not hold.
    pub fn log_line(&self, interface: &str) -> Option<String> {
        let Traffic::Frame { id, data } = &self.what else { return None };
        let since = self.at.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let bytes: String = data.iter().map(|byte| format!("{byte:02X}")).collect();
        Some(format!("({}.{:06}) {interface} {id:03X}#{bytes}", since.as_secs(), since.subsec_micros()))
    }
}

/// Why an interface cannot be used, and what to try.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CanError {
    /// The interface, and what is wrong with it.
    pub problem: String,
    /// What to try.
    pub advice: &'static str,
}

impl fmt::Display for CanError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}. {}", self.problem, self.advice)
    }
}

impl CanPort {
    /// Puts a message on the bus; waits for room up to `limit`.
    ///
    /// # Errors
    /// The operating system's.
    pub fn say(&self, message: &Message, limit: Duration) -> std::io::Result<()> {
        self.send_within(&can::encode(message), limit)
    }

    fn send_within(&self, frame: &CanFrame, limit: Duration) -> std::io::Result<()> {
        let begin = std::time::Instant::now();
        while !self.send(frame)? {
            if begin.elapsed() > limit {
                return Err(std::io::ErrorKind::TimedOut.into());
            }
            std::thread::sleep(Duration::from_micros(200));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_that_of_candump() {
        let at = SystemTime::UNIX_EPOCH + Duration::from_micros(1_700_000_000_000_123);
        let what = Traffic::Frame { id: 0x185, data: vec![0, 0, 0xC0, 0x3F, 0xE8] };
        let line = Heard { at, what }.log_line("vcan0").unwrap();
        assert_eq!(line, "(1700000000.000123) vcan0 185#0000C03FE8");
    }
}
