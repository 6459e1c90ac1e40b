//! SocketCAN (Linux).

use super::{CanError, Heard, Own, Traffic};
use funnel_protocol::can::CanFrame;
use socketcan::{CanDataFrame, CanSocket, EmbeddedFrame, Id, ShouldRetry, Socket, SocketOptions, StandardId};
use std::io::{self, ErrorKind};
use std::os::fd::{AsFd, BorrowedFd};
use std::time::Duration;

/// Linux has no room left in an interface's transmit queue.
const NO_ROOM: i32 = 105; // ENOBUFS

/// An open interface.
#[derive(Debug)]
pub struct CanPort(CanSocket);

impl CanPort {
    /// Opens an interface, such as `can0`.
    ///
    /// # Errors
    /// There is none, or it may not be used.
    pub fn open(interface: &str, own: Own) -> Result<Self, CanError> {
        Self::try_open(interface, own).map_err(|error| CanError {
            problem: format!("the CAN interface {interface} cannot be opened: {error}"),
            advice: "Is its adapter plugged in, and is it up? sudo ip link set can0 up type can bitrate 1000000; \
                     `ip -brief link` shows the interfaces that there are",
        })
    }

    fn try_open(interface: &str, own: Own) -> io::Result<Self> {
        let socket = CanSocket::open(interface)?;
        socket.set_nonblocking(true)?;
        socket.set_recv_own_msgs(own == Own::Heard)?;
        socket.set_error_filter_accept_all()?;
        socket.set_recv_timestamp(true)?;
        Ok(Self(socket))
    }

    /// What was heard next, if there is something.
    ///
    /// # Errors
    /// The operating system's: the interface is down or gone.
    pub fn receive(&self) -> io::Result<Option<Heard>> {
        match self.0.read_frame_with_timestamp() {
            Ok((frame, at)) => Ok(Some(Heard { at, what: traffic(&frame) })),
            Err(error) if error.kind() == ErrorKind::WouldBlock || error.should_retry() => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Waits until there may be something to [receive](Self::receive), for `limit` at most.
    pub fn wait(&self, limit: Duration) {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        let limit = Timespec::try_from(limit).ok();
        // An interrupted wait is a short one.
        let _ = poll(&mut [PollFd::new(&self.0, PollFlags::IN)], limit.as_ref());
    }

    /// Sends a frame; `false` where there is no room for it now.
    ///
    /// # Errors
    /// The operating system's: the interface is down or gone.
    pub fn send(&self, frame: &CanFrame) -> io::Result<bool> {
        let id = StandardId::new(frame.id()).ok_or(ErrorKind::InvalidInput)?;
        let frame = CanDataFrame::new(id, frame.data()).ok_or(ErrorKind::InvalidInput)?;
        match self.0.write_frame(&frame) {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == ErrorKind::WouldBlock || error.raw_os_error() == Some(NO_ROOM) => {
                Ok(false)
            }
            Err(error) if error.should_retry() => Ok(false),
            Err(error) => Err(error),
        }
    }
}

impl AsFd for CanPort {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

fn traffic(frame: &socketcan::CanFrame) -> Traffic {
    match (frame, frame.id()) {
        (socketcan::CanFrame::Data(frame), Id::Standard(id)) => {
            Traffic::Frame { id: id.as_raw(), data: frame.data().to_vec() }
        }
        (&socketcan::CanFrame::Error(error), _) => {
            let error = error.into_error();
            Traffic::Error { off: error.is_bus_off(), text: error.to_string() }
        }
        (other, _) => Traffic::Other(format!("{other:?}")),
    }
}
