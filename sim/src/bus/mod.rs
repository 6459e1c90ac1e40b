//! Bus models: what happens to a frame between its sender and its receivers.

pub mod can;
mod harms;
pub mod ideal;
pub mod links;
pub mod loss;
pub mod table;
pub mod uart;
pub mod watch;

use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use watch::Watch;

/// Name of the interface of a simulated bus in its logs.
pub const SIMULATED: &str = "can0";

/// Frame counts. What is counted at receivers is counted for each of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Frames sent.
    pub sent: u64,
    /// Deliveries that were lost.
    pub lost: u64,
    /// Frames for which a receiver had no room.
    pub no_room: u64,
    /// Frames that never went out: a newer one took their place.
    pub replaced: u64,
    /// Frames that a link has disturbed.
    pub corrupted: u64,
    /// Frames that came twice.
    pub duplicated: u64,
    /// Frames that came after the next one.
    pub reordered: u64,
}

/// The instant at which a SYNC was on the wire, as a controller notes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Index of the node whose controller it is.
    pub node: usize,
    /// Time, ns.
    pub at: u64,
    /// It has sent it.
    pub own: bool,
}

/// Power of a node, which an event has switched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Power {
    /// It comes.
    On,
    /// It goes without a word: what it has not begun to send is lost.
    Off,
    /// It goes once all that it has said is sent.
    OffWhenSent,
}

/// A medium that carries the frames of nodes to their neighbours.
pub trait Medium {
    /// Node `sender` says something at `now` (ns, never going back).
    fn send(&mut self, now: u64, sender: usize, message: &Message);

    /// Node `sender` has nothing more to say at `now` (ns): what was collected for one frame goes.
    fn flush(&mut self, _now: u64, _sender: usize) {}

    /// Node `node` computes until then (ns), and takes no frame from its driver meanwhile. What it hears in
    /// its tick it uses in the next one, so that this matters only where the driver has limited room.
    fn computes(&mut self, _node: usize, _until: u64) {}

    /// When the next thing happens, ns.
    fn next_arrival(&self) -> Option<u64>;

    /// Lets the next thing happen: `receive(receiver, message)` for each node that hears something then, or
    /// the reason for refusing it.
    fn deliver(&mut self, receive: impl FnMut(usize, Result<Message, Refusal>));

    /// Lets the next thing happen that comes before `before` (ns), with its time; none where nothing does.
    /// `receive(time, receiver, message)` is as above. Times at which nobody hears anything may be passed
    /// over.
    fn deliver_before(
        &mut self,
        before: u64,
        mut receive: impl FnMut(u64, usize, Result<Message, Refusal>),
    ) -> Option<u64> {
        let at = self.next_arrival().filter(|&at| at < before)?;
        self.deliver(|receiver, heard| receive(at, receiver, heard));
        Some(at)
    }

    /// Whether there is anything to [take off](Self::take_off).
    fn has_off(&self) -> bool {
        false
    }

    /// Nodes whose controllers have gone off the bus since the last call, and how often so far.
    fn take_off(&mut self) -> Vec<(usize, u16)> {
        Vec::new()
    }

    /// Has the nodes `listeners[i]` accept the frames of node `i` from now on. Events happen on the ideal bus
    /// and on CAN alone: a scenario refuses them on any other.
    fn set_listeners(&mut self, _listeners: Vec<Vec<usize>>) {}

    /// Stamps of SYNC since the last call, in the order in which nodes hear of them; none on a medium without
    /// a shared wire.
    fn take_stamps(&mut self) -> Vec<Stamp> {
        Vec::new()
    }

    /// Node `node` goes at `now` (ns), or comes. On the ideal bus nothing follows: a node is no more than its
    /// frames there.
    fn switch(&mut self, _now: u64, _node: usize, _power: Power) {}

    /// Frame counts so far.
    fn traffic(&self) -> Traffic;

    /// Has a table, and with `log` what a log holds, kept from now on; the scenario's t = 0 comes at
    /// `zero_ns`.
    fn watch(&mut self, _zero_ns: u64, _log: bool) {}

    /// What is kept, if anything is.
    fn watched(&mut self) -> Option<&mut Watch> {
        None
    }

    /// Frames that the queues of drivers had no room for.
    fn queue_overflows(&self) -> u64 {
        0
    }

    /// Time for which it was busy before `now`, ns; 0 without a bit rate.
    fn busy_ns(&self, _now: u64) -> u64 {
        0
    }

    /// Part of the time so far for which it was busy; 0 without a bit rate.
    fn utilisation(&self) -> f64 {
        0.0
    }
}
