//! A CAN interface of this machine, by SocketCAN: the real-time plane as a node or the host sees it, in
//! either format.

mod format;

#[cfg_attr(not(target_os = "linux"), path = "absent.rs")]
mod socket;

pub use format::{AnyFormat, PortFrame};
pub use socket::CanPort;
#[cfg(target_os = "linux")]
pub(crate) use socket::record;

use funnelnet_can_bus::Record;
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
        /// Flags of a frame of CAN FD, as the kernel has them: 1 bit rate switch, 2 error state indicator, 4
        /// CAN FD.
        fd: Option<u8>,
    },
    /// A frame that is not of the real-time plane, as a log has it, but for its time: 29-bit identifier, or a
    /// remote frame.
    Other(Record),
    /// The controller reports an error.
    Error {
        /// It went off the bus.
        off: bool,
        /// In words.
        text: String,
        /// As a log has it, but for its time.
        record: Record,
    },
}

impl Heard {
    /// What it says in the real-time plane of a bus in this format, message by message, or the reason for
    /// refusing it; nothing where it is no frame. As in the firmware, its identifier and bytes alone say what
    /// it is: that a frame is one of CAN FD is for the log only.
    pub fn messages(&self, format: &mut AnyFormat) -> Vec<Result<Message, Refusal>> {
        match &self.what {
            Traffic::Frame { id, data, .. } => format.unpack(*id, data),
            Traffic::Other(_) => vec![Err(Refusal::Kind)],
            Traffic::Error { .. } => Vec::new(),
        }
    }

    /// As a log has it: with the time since 1970, ns.
    pub fn record(&self) -> Record {
        let since = self.at.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let at = u64::try_from(since.as_nanos()).unwrap_or(u64::MAX);
        match &self.what {
            Traffic::Frame { id, data, fd } => {
                Record::new(at, u32::from(*id), fd.map(|flags| flags & 0xF), data.len() as u8, data)
            }
            Traffic::Other(record) | Traffic::Error { record, .. } => record.at(at),
        }
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
    fn a_line_is_that_of_candump_for_all_that_is_on_a_bus() {
        let at = SystemTime::UNIX_EPOCH + Duration::from_micros(1_700_000_000_000_123);
        let line = |what| {
            let record = Heard { at, what }.record();
            funnelnet_can_bus::Line { interface: "vcan0", record: &record }.to_string()
        };
        let frame = |id, data, fd| line(Traffic::Frame { id, data, fd });
        let classic = frame(0x185, vec![0, 0, 0xC0, 0x3F, 0xE8], None);
        assert_eq!(classic, "(1700000000.000123) vcan0 185#0000C03FE8");
        let fd = frame(0x585, vec![0, 0, 0xE8, 3, 0, 0, 0xC0, 0x3F], Some(5));
        assert_eq!(fd, "(1700000000.000123) vcan0 585##50000E8030000C03F");
        let other = line(Traffic::Other(Record::new(0, 0x8000_1234, None, 1, &[7])));
        assert_eq!(other, "(1700000000.000123) vcan0 00001234#07");
        let record = Record::new(0, 0x2000_0040, None, 8, &[0; 8]);
        let off = line(Traffic::Error { off: true, text: "bus-off".to_owned(), record });
        assert_eq!(off, "(1700000000.000123) vcan0 20000040#0000000000000000");
    }
}
