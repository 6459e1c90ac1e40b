//! What carries frames between a session and the world: a serial line ([`serial`]), one and others to
//! neighbours ([`peers`]), or CAN with a serial line for the service plane ([`can`]).

pub mod can;
mod outgoing;
pub mod peers;
mod receiving;
pub mod serial;

use funnelnet_link::{BusState, Change, Filters};
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::Losses;
use funnelnet_protocol::serial::Frame;
use funnelnet_protocol::service::Reply;

use crate::clock::Clock;

/// Something that came from a link.
pub enum Input<'a> {
    /// A frame, or the reason for refusing one.
    Frame(Result<Frame<'a>, Refusal>),
    /// A SYNC, and when it was on the wire, by the app's clock, ns. A link that does not know that hands it over
    /// as a frame.
    Sync(Message, u64),
    /// The link's own state has changed.
    Change(Change),
}

/// How a link is doing. All counters saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Health {
    /// Error state; a serial line is always active.
    pub state: BusState,
    /// CAN: the controller's transmit and receive error counters.
    pub counters: (u8, u8),
    /// What was lost since the start.
    pub losses: Losses,
}

/// A link of the node. The app waits, takes what has come until there is nothing more, and sends.
#[allow(async_fn_in_trait)] // One executor, one task: nobody needs the futures to be `Send`.
pub trait Link {
    /// Waits until there may be an [input](Self::next). Dropping the future loses nothing.
    async fn wait(&mut self, clock: impl Clock);

    /// The next input at `now` (ns), without waiting.
    fn next(&mut self, now: u64) -> Option<Input<'_>>;

    /// Takes a frame of the real-time plane to send, at `now` (ns). Frames are not queued: of two with the
    /// same identifier that wait, the latest wins.
    async fn send(&mut self, message: &Message, now: u64);

    /// When the last SYNC that was [sent](Self::send) was on the wire, by the app's clock, ns, where the link knows
    /// that better than whoever has just sent it.
    fn sent_at(&self) -> Option<u64> {
        None
    }

    /// Sends a frame of the service plane, which comes from the node `source`, 0 while blank.
    async fn reply(&mut self, reply: &Reply, source: u8);

    /// How the link is doing.
    fn health(&self) -> Health;

    /// Has a controller let in what these filters pass, and more only where it has no room for them. Most
    /// links bring nothing else anyway.
    fn listen(&mut self, _filters: Filters<'_>) {}
}
