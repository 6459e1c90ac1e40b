//! The time that a node keeps with others: a [`Keeper`] between the clock of its platform and the node.
//!
//! A session whose configuration has rules of time hands its node the time of the network in place of its own. All
//! that is done here is for such a session; any other one goes past it.

use super::{Output, Session};
use crate::model::Model;
use crate::node::Node;
use crate::observe::Phase;
use crate::time::{self, Keeper, Rules};
use funnelnet_law::field::VectorField;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::message::{Command, FaultCode, JOIN, Message};
use funnelnet_protocol::refusal::Refusal;

/// Time of a node that keeps it with others.
#[derive(Debug)]
pub(super) struct Timing {
    keeper: Keeper,
    /// The node has been told to join, and does not know the tick yet.
    waits: bool,
}

impl Timing {
    /// Of a node with this configuration, which does not run yet; none where that has no rules of time.
    pub(super) fn of(config: &NodeConfig) -> Option<Self> {
        Rules::of(config).map(|rules| Self { keeper: Keeper::new(rules), waits: false })
    }

    /// Time of the network when the own clock shows `own`, ns.
    pub(super) fn network(&self, own: u64) -> u64 {
        self.keeper.network(own)
    }

    /// Time of the own clock at which it is `network` on that of the network, ns. What is due at once stays so.
    pub(super) fn own(&self, network: u64) -> u64 {
        if network == 0 { 0 } else { self.keeper.own(network) }
    }

    /// When there is something to do by itself, ns on the own clock.
    fn poll_at(&self) -> Option<u64> {
        self.keeper.poll_at()
    }

    /// Takes a message in place of the node, or gives the time at which the node is to take it, ns. `stamp` is when a
    /// SYNC was on the wire, as far as its link knows, by the own clock as `now` is (ns).
    fn take<V: VectorField<f32>>(
        &mut self,
        node: &mut Node<f32, V>,
        message: &Message,
        (stamp, now): (u64, u64),
    ) -> Option<u64> {
        match *message {
            Message::Sync { source: Some(source), previous_tick, phase_us } => {
                match self.keeper.on_sync(source, (previous_tick, phase_us), stamp, now) {
                    Ok(()) => node.accept(),
                    Err(reason) => node.refuse(reason),
                }
                None
            }
            Message::Ctrl { command: Command::Start, target, at_tick, .. } if target.includes(node.id()) => {
                self.start(node, at_tick, now).then_some(now)
            }
            _ => Some(self.network(now)),
        }
    }

    /// Starts the keeper; whether the node is to start, too. One that joins starts once it knows the tick: a node that
    /// ticks by its timer would take that start for a long wait.
    fn start<V: VectorField<f32>>(&mut self, node: &mut Node<f32, V>, at_tick: u16, now: u64) -> bool {
        if node.phase() != Phase::Ready || self.waits {
            node.refuse(Refusal::Phase);
            return false;
        }
        self.waits = at_tick == JOIN;
        // Of a newcomer nobody knows yet when tick 0 was.
        let ticks = if self.waits { 1 } else { u64::from(at_tick) + 1 };
        self.keeper.start(now, now, now.saturating_add(ticks.saturating_mul(node.tick_ns())), self.waits);
        if self.waits {
            node.accept();
        }
        !self.waits
    }

    /// Goes on by the holdover of another configuration, whose rules are the same.
    pub(super) fn hold_over(&mut self, config: &NodeConfig) {
        self.keeper.hold_over(time::holdover(config));
    }

    /// Takes note of when a SYNC of this node was on the wire, by the own clock, ns.
    pub(super) fn on_sent(&mut self, stamp: u64) {
        self.keeper.on_sent(stamp);
    }

    /// Does what is due, and gives the next output about it.
    fn poll<V: VectorField<f32>>(&mut self, node: &mut Node<f32, V>, now: u64) -> Option<Output> {
        if !matches!(node.phase(), Phase::Ready | Phase::Running) {
            self.keeper.stop();
            self.waits = false;
            return None;
        }
        while let Some(output) = self.keeper.poll(now) {
            match output {
                time::Output::Send(sync) => return Some(Output::Sync(sync)),
                time::Output::Report(change) => return Some(Output::Report(change.into())),
                time::Output::Lost { silent_ms } => node.fail(FaultCode::HOLDOVER, silent_ms),
            }
        }
        if self.waits && self.keeper.is_in_time() {
            self.waits = false;
            let (tick, at) = self.keeper.next_tick(now);
            node.come(tick, at);
        }
        None
    }
}

impl<M: Model> Session<M> {
    /// The keeper of its time, where the configuration has rules for one.
    pub fn keeper(&self) -> Option<&Keeper> {
        self.timing.as_ref().map(|timing| &timing.keeper)
    }

    /// Takes a SYNC that was on the wire when the clock showed `stamp`, and is known now, when it shows `now` (ns).
    /// A link that knows no stamp hands it over as any other frame: then it counts as of `now`.
    pub fn on_sync(&mut self, sync: &Message, stamp: u64, now: u64) {
        self.on_stamped(sync, (stamp, now));
    }

    /// Answers [`Output::Sync`]: the SYNC was on the wire when the clock showed `stamp` (ns).
    pub fn sync_sent(&mut self, stamp: u64) {
        if let Some(timing) = &mut self.timing {
            timing.on_sent(stamp);
        }
    }

    /// Whether it has been told to join, and does not know the tick yet.
    pub(super) fn waits_for_tick(&self) -> bool {
        self.timing.as_ref().is_some_and(|timing| timing.waits)
    }

    /// Has time kept as the configuration of the node says, which is new.
    // Not inlined because making the node would need stack for this, too.
    #[inline(never)]
    pub(super) fn set_timing(&mut self) {
        self.timing = self.config.as_ref().and_then(Timing::of);
    }

    #[cold]
    #[inline(never)]
    pub(super) fn keep_time(&mut self, now: u64) -> Option<Output> {
        let (timing, node) = (self.timing.as_mut()?, self.node.as_mut()?);
        timing.poll(node, now)
    }

    /// Time of the network at `now`, ns.
    #[cold]
    #[inline(never)]
    pub(super) fn network_time(&self, now: u64) -> u64 {
        self.timing.as_ref().map_or(now, |timing| timing.network(now))
    }

    /// When node or keeper have something to do; `node` is that by the time of the network.
    #[cold]
    #[inline(never)]
    pub(super) fn own_time(&self, node: Option<u64>) -> Option<u64> {
        let Some(timing) = &self.timing else { return node };
        let node = node.map(|at| timing.own(at));
        let keeper = timing.poll_at();
        node.into_iter().chain(keeper).min()
    }

    /// As [`Timing::take`].
    #[cold]
    #[inline(never)]
    pub(super) fn take_timed(&mut self, message: &Message, times: (u64, u64)) -> Option<u64> {
        let (Some(timing), Some(node)) = (&mut self.timing, &mut self.node) else { return Some(times.1) };
        timing.take(node, message, times)
    }
}
