//! SocketCAN (Linux).

use super::{CanError, Heard, Own, Traffic};
use funnelnet_can_bus::Record;
use funnelnet_link::Frame;
use socketcan::id::FdFlags;
use socketcan::{
    CanAnyFrame, CanDataFrame, CanErrorFrame, CanFdFrame, CanFdSocket, CanSocket, EmbeddedFrame, Id,
    ShouldRetry, Socket, SocketOptions, StandardId,
};
use std::io::{self, ErrorKind};
use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

/// Linux has no room left in an interface's transmit queue.
const NO_ROOM: i32 = 105; // ENOBUFS
/// MTU of an interface that carries frames of CAN FD.
const FD_MTU: u32 = 72;

/// An open interface, in one of the formats.
#[derive(Debug)]
pub enum CanPort {
    /// Frames of up to 8 bytes.
    Classic(CanSocket),
    /// CAN FD, with bit rate switch.
    Fd(CanFdSocket),
}

impl CanPort {
    /// Opens an interface, such as `can0`; for frames of CAN FD if `fd`.
    ///
    /// # Errors
    /// There is none, or it may not be used, or it cannot do CAN FD.
    pub fn open(interface: &str, own: Own, fd: bool) -> Result<Self, CanError> {
        if let Some(mtu) = mtu(interface).filter(|&mtu| fd && mtu < FD_MTU) {
            return Err(CanError {
                problem: format!(
                    "the CAN interface {interface} is not set up for CAN FD: its MTU is {mtu}, not {FD_MTU}"
                ),
                advice: "sudo ip link set can0 down, then sudo ip link set can0 up type can bitrate 1000000 dbitrate 2000000 fd on; \
                         a virtual one: sudo ip link set vcan0 mtu 72",
            });
        }
        let opened = if fd { Self::open_fd(interface, own) } else { Self::open_classic(interface, own) };
        opened.map_err(|error| CanError {
            problem: format!("the CAN interface {interface} cannot be opened: {error}"),
            advice: "Is its adapter plugged in, and is it up? sudo ip link set can0 up type can bitrate 1000000; \
                     `ip -brief link` shows the interfaces that there are",
        })
    }

    fn open_classic(interface: &str, own: Own) -> io::Result<Self> {
        let socket = CanSocket::open(interface)?;
        set_up(&socket, own)?;
        Ok(Self::Classic(socket))
    }

    fn open_fd(interface: &str, own: Own) -> io::Result<Self> {
        let socket = CanFdSocket::open(interface)?;
        set_up(&socket, own)?;
        Ok(Self::Fd(socket))
    }

    /// What was heard next, if there is something.
    ///
    /// # Errors
    /// The operating system's: the interface is down or gone.
    pub fn receive(&self) -> io::Result<Option<Heard>> {
        let read = match self {
            Self::Classic(socket) => {
                socket.read_frame_with_timestamp().map(|(frame, at)| (classic_traffic(&frame), at))
            }
            Self::Fd(socket) => {
                socket.read_frame_with_timestamp().map(|(frame, at)| (any_traffic(&frame), at))
            }
        };
        match read {
            Ok((what, at)) => Ok(Some(Heard { at, what })),
            Err(error) if error.kind() == ErrorKind::WouldBlock || error.should_retry() => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Waits until there may be something to [receive](Self::receive), for `limit` at most.
    pub fn wait(&self, limit: Duration) {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let limit = Timespec::try_from(limit).ok();
        // An interrupted wait is a short one.
        let _ = poll(&mut [PollFd::new(self, PollFlags::IN)], limit.as_ref());
    }

    /// Sends a frame; `false` where there is no room for it now.
    ///
    /// # Errors
    /// The operating system's: the interface is down or gone.
    pub fn send(&self, frame: &impl Frame) -> io::Result<bool> {
        let id = StandardId::new(frame.id()).ok_or(ErrorKind::InvalidInput)?;
        let written = match self {
            Self::Classic(socket) => {
                socket.write_frame(&CanDataFrame::new(id, frame.data()).ok_or(ErrorKind::InvalidInput)?)
            }
            Self::Fd(socket) => {
                let frame = CanFdFrame::with_flags(id, frame.data(), FdFlags::BRS);
                socket.write_frame(&frame.ok_or(ErrorKind::InvalidInput)?)
            }
        };
        match written {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::WouldBlock || error.raw_os_error() == Some(NO_ROOM) => {
                Ok(false)
            }
            Err(error) if error.should_retry() => Ok(false),
            Err(error) => Err(error),
        }
    }
}

fn set_up(socket: &(impl Socket + SocketOptions), own: Own) -> io::Result<()> {
    socket.set_nonblocking(true)?;
    socket.set_recv_own_msgs(own == Own::Heard)?;
    socket.set_error_filter_accept_all()?;
    socket.set_recv_timestamp(true)
}

/// Longest frame of an interface, bytes, where the system tells.
fn mtu(interface: &str) -> Option<u32> {
    std::fs::read_to_string(format!("/sys/class/net/{interface}/mtu")).ok()?.trim().parse().ok()
}

impl AsFd for CanPort {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match self {
            Self::Classic(socket) => socket.as_fd(),
            Self::Fd(socket) => socket.as_fd(),
        }
    }
}

fn classic_traffic(frame: &socketcan::CanFrame) -> Traffic {
    match frame {
        socketcan::CanFrame::Data(frame) => data_traffic(frame),
        socketcan::CanFrame::Error(error) => error_traffic(*error),
        socketcan::CanFrame::Remote(frame) => Traffic::Other(record(frame, None)),
    }
}

fn any_traffic(frame: &CanAnyFrame) -> Traffic {
    match frame {
        CanAnyFrame::Fd(frame) => match frame.id() {
            Id::Standard(id) => Traffic::Frame {
                id: id.as_raw(),
                data: frame.data().to_vec(),
                fd: Some(frame.flags().bits()),
            },
            Id::Extended(_) => Traffic::Other(record(frame, Some(frame.flags().bits()))),
        },
        CanAnyFrame::Normal(frame) => data_traffic(frame),
        CanAnyFrame::Error(error) => error_traffic(*error),
        CanAnyFrame::Remote(frame) => Traffic::Other(record(frame, None)),
    }
}

fn data_traffic(frame: &CanDataFrame) -> Traffic {
    match frame.id() {
        Id::Standard(id) => Traffic::Frame { id: id.as_raw(), data: frame.data().to_vec(), fd: None },
        Id::Extended(_) => Traffic::Other(record(frame, None)),
    }
}

fn error_traffic(error: CanErrorFrame) -> Traffic {
    let record = record(&error, None);
    let error = error.into_error();
    Traffic::Error { off: error.is_bus_off(), text: error.to_string(), record }
}

/// A frame as a log has it, but for its time.
pub(crate) fn record(frame: &impl socketcan::Frame, fd: Option<u8>) -> Record {
    // A remote frame has a length and no data.
    let length = if frame.is_remote_frame() { frame.dlc() } else { frame.data().len() };
    Record::new(0, frame.id_word(), fd, length as u8, frame.data())
}
