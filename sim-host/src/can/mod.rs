//! A CAN interface of this machine, by SocketCAN: the real-time plane as a node or the host sees it, in either format.

mod format;

#[cfg_attr(not(target_os = "linux"), path = "absent.rs")]
mod socket;

pub use format::{AnyFormat, PortFrame};
pub use socket::CanPort;

use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
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
        /// Its 0 to 8 bytes, or up to 64 in CAN FD.
        data: Vec<u8>,
        /// Flags of a frame of CAN FD, as the kernel has them: 1 bit rate switch, 2 error state indicator, 4 CAN FD.
        fd: Option<u8>,
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
    /// What it says in the real-time plane of a bus in this format, message by message, or the reason for refusing it; nothing where it is no frame.
    /// As in the firmware, its identifier and bytes alone say what it is: that a frame is one of CAN FD is for the log only.
    pub fn messages(&self, format: &mut AnyFormat) -> Vec<Result<Message, Refusal>> {
        match &self.what {
            Traffic::Frame { id, data, .. } => format.unpack(*id, data),
            Traffic::Other(_) => vec![Err(Refusal::Kind)],
            Traffic::Error { .. } => Vec::new(),
        }
    }

    /// Its line in a log that `candump -L` could have written; `None` for what such a log does not hold.
    pub fn log_line(&self, interface: &str) -> Option<String> {
        let Traffic::Frame { id, data, fd } = &self.what else { return None };
        let since = self.at.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let bytes: String = data.iter().map(|byte| format!("{byte:02X}")).collect();
        let separator = fd.map_or_else(|| "#".to_owned(), |flags| format!("##{:X}", flags & 0xF));
        let time = format!("({}.{:06})", since.as_secs(), since.subsec_micros());
        Some(format!("{time} {interface} {id:03X}{separator}{bytes}"))
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
    /// Puts frames on the bus, in order; waits for room up to `limit` for each.
    ///
    /// # Errors
    /// The operating system's.
    pub fn send_all(&self, frames: &[PortFrame], limit: Duration) -> std::io::Result<()> {
        frames.iter().try_for_each(|frame| self.send_within(frame, limit))
    }

    fn send_within(&self, frame: &PortFrame, limit: Duration) -> std::io::Result<()> {
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
        let line =
            |id, data, fd| Heard { at, what: Traffic::Frame { id, data, fd } }.log_line("vcan0").unwrap();
        let classic = line(0x185, vec![0, 0, 0xC0, 0x3F, 0xE8], None);
        assert_eq!(classic, "(1700000000.000123) vcan0 185#0000C03FE8");
        let fd = line(0x585, vec![0, 0, 0xE8, 3, 0, 0, 0xC0, 0x3F], Some(5));
        assert_eq!(fd, "(1700000000.000123) vcan0 585##50000E8030000C03F");
    }
}
