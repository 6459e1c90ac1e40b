//! Either format of CAN frames, chosen as the program runs: what is said on a port becomes frames, and frames
//! what is heard.

use funnelnet_link::{Classic, Fd, Format, Frame};
use funnelnet_protocol::can_fd::MAX_DATA;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;

/// A frame to send, in the format of its port.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortFrame {
    id: u16,
    data: heapless::Vec<u8, MAX_DATA>,
}

impl PortFrame {
    fn of(frame: &impl Frame) -> Self {
        // No frame of the plane is longer.
        Self { id: frame.id(), data: heapless::Vec::from_slice(frame.data()).unwrap_or_default() }
    }
}

impl Frame for PortFrame {
    fn id(&self) -> u16 {
        self.id
    }

    fn data(&self) -> &[u8] {
        &self.data
    }
}

/// One of the formats, with what it has collected.
#[derive(Debug)]
pub enum AnyFormat {
    /// One message, one frame of up to 8 bytes.
    Classic(Classic),
    /// CAN FD.
    Fd(Fd),
}

impl AnyFormat {
    /// That of CAN FD, or the classic one.
    pub fn new(fd: bool) -> Self {
        if fd { Self::Fd(Fd::default()) } else { Self::Classic(Classic::default()) }
    }

    /// The frames that are complete with `message`, in order.
    pub fn pack(&mut self, message: &Message) -> Vec<PortFrame> {
        match self {
            Self::Classic(format) => pack(format, message),
            Self::Fd(format) => pack(format, message),
        }
    }

    /// The frame that was collected, when there is nothing more to say.
    pub fn flush(&mut self) -> Option<PortFrame> {
        match self {
            Self::Classic(format) => format.flush().as_ref().map(PortFrame::of),
            Self::Fd(format) => format.flush().as_ref().map(PortFrame::of),
        }
    }

    /// What a frame says, message by message, or the reason for refusing it.
    pub fn unpack(&mut self, id: u16, data: &[u8]) -> Vec<Result<Message, Refusal>> {
        match self {
            Self::Classic(format) => unpack(format, id, data),
            Self::Fd(format) => unpack(format, id, data),
        }
    }
}

fn pack<F: Format>(format: &mut F, message: &Message) -> Vec<PortFrame> {
    format.pack(message).iter().flatten().map(PortFrame::of).collect()
}

fn unpack<F: Format>(format: &mut F, id: u16, data: &[u8]) -> Vec<Result<Message, Refusal>> {
    format.receive(id, data);
    std::iter::from_fn(|| format.unpack()).collect()
}
