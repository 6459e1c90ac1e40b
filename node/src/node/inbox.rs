//! The inbox of a node: messages in, and why some are refused.

use super::Node;
use crate::neighbour::Heard;
use crate::observe::{Event, Phase};
use funnelnet_law::field::VectorField;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::math::Real;
use funnelnet_protocol::message::{Component, FaultCode, Message, NodeId, Severity, TickStamp};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::count;

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    /// Takes a message that arrived at `now` (ns).
    ///
    /// # Errors
    /// The reason for refusing it, counted; a refused message changes nothing else. A state that carries the
    /// node's own id is refused and stops the node: two nodes with one id would each falsify the other's
    /// edges.
    // Inlined because a decoded message never goes through memory then: 136 of 1,508 instructions per
    // node-tick (`./ci.sh cost`).
    #[inline(always)]
    pub fn on_message(&mut self, message: &Message, now: u64) -> Result<(), Refusal> {
        let outcome = match *message {
            Message::State { source, component, tick, x } => {
                self.on_state(source, component, tick, F::from_f32(x))
            }
            Message::Sync { previous_tick, .. } => self.on_sync(previous_tick, now),
            Message::Ctrl { target, command, at_tick, .. } if target.includes(self.params.id) => {
                self.on_command(command, target, at_tick, now)
            }
            Message::Ctrl { .. } => Ok(()),
            Message::Fault { source, code, severity, tick, .. } => {
                self.on_fault(source, code, severity, tick)
            }
            Message::Edge { source, neighbour, weight } => self.on_edge(source, neighbour, weight),
        };
        match outcome {
            Ok(()) => count(&mut self.counters.accepted),
            Err(reason) => self.counters.refuse(reason),
        }
        outcome
    }

    /// Counts a frame that somebody else has taken for the node.
    pub fn accept(&mut self) {
        count(&mut self.counters.accepted);
    }

    /// Counts a frame that the link could not decode.
    pub fn refuse(&mut self, reason: Refusal) {
        self.counters.refuse(reason);
    }

    fn on_state(
        &mut self,
        source: NodeId,
        component: Component,
        tick: TickStamp,
        x: F,
    ) -> Result<(), Refusal> {
        if source == self.params.id {
            self.fault(FaultCode::DUPLICATE_ID);
            return Err(Refusal::OwnId);
        }
        // Written so that NaN is outside.
        let is_within = x.abs() <= self.params.heard.limit;
        if !is_within {
            let reason = if x.is_finite() { Refusal::OutOfRange } else { Refusal::NotFinite };
            return Err(self.not_taken(reason, source, (component, tick), x));
        }
        let (heard, late) = match self.neighbours.hear(source, component, tick, self.clock.tick, x) {
            Ok(heard) => heard,
            Err(reason) => return Err(self.not_taken(reason, source, (component, tick), x)),
        };
        if heard != Heard::Newer {
            self.disturb();
            // Once per neighbour, whatever its number of components.
            if component == Component::FIRST && heard == Heard::First {
                self.outbox.report(Event::NeighbourFound(source));
            }
        }
        if late > 0 {
            count(&mut self.counters.late);
        }
        Ok(())
    }

    /// Takes note of a state that is refused for this reason, which it gives back. Who says too much is
    /// extrapolated, as one that is silent, and after many in a row its edge is barred.
    #[cold]
    #[inline(never)]
    fn not_taken(
        &mut self,
        reason: Refusal,
        source: NodeId,
        (component, tick): (Component, TickStamp),
        x: F,
    ) -> Refusal {
        if !matches!(reason, Refusal::OutOfRange | Refusal::TooFast) {
            return reason;
        }
        // Ticks of who has stopped, or is not told the tick yet, stand still: by a stamp of eight bits it would take
        // new states for old ones, and judge by that.
        if self.counters.ticks == 0 || matches!(self.phase, Phase::Stopped | Phase::Faulted(_)) {
            return reason;
        }
        let own = self.clock.tick;
        let Some(doubt) = self.neighbours.doubt(source, component, tick, own, x) else { return reason };
        // A row of them is told once.
        if doubt.is_first {
            self.outbox.report(match reason {
                Refusal::TooFast => Event::TooFast { node: source, change: doubt.change.to_f32() },
                _ => Event::TooFar { node: source, x: x.to_f32() },
            });
        }
        if doubt.bars {
            self.disturb();
            count(&mut self.counters.kept.edges);
            self.outbox.report(Event::Barred(source));
        }
        reason
    }

    /// Takes a FAULT. It goes from line to line, so one with the node's own id may be its own, come back: no
    /// sign of a twin, which sends states, too.
    fn on_fault(
        &mut self,
        source: NodeId,
        code: FaultCode,
        severity: Severity,
        tick: TickStamp,
    ) -> Result<(), Refusal> {
        if source == self.params.id {
            return Err(Refusal::OwnId);
        }
        match (severity, code) {
            _ if self.phase != Phase::Running => {}
            (Severity::Stopped, _) => self.dismiss(source, tick),
            (_, FaultCode::STARTS_ANEW) => self.neighbours.starts_anew(source, tick, self.clock.tick),
            _ => {}
        }
        Ok(())
    }

    /// Drops the edge to a neighbour that says that it has stopped. To extrapolate it, as one that is silent,
    /// would be to follow one that is known to be gone (law.md 9).
    #[cold]
    #[inline(never)]
    fn dismiss(&mut self, source: NodeId, tick: TickStamp) {
        if self.neighbours.leaves(source, tick, self.clock.tick) {
            self.disturb();
            count(&mut self.counters.neighbours_lost);
            self.outbox.report(Event::NeighbourLost(source));
        }
    }

    /// Compares an announced weight with the node's own (paper, Assumption 1). The law goes on; people must
    /// act.
    fn on_edge(&mut self, source: NodeId, neighbour: NodeId, weight: f32) -> Result<(), Refusal> {
        // As for a FAULT: a host that hands it on to everybody hands it back.
        if source == self.params.id {
            return Err(Refusal::OwnId);
        }
        if neighbour != self.params.id {
            return Ok(());
        }
        let own = self.neighbours.weight(source).map_or(0.0, F::to_f32);
        if own != weight {
            count(&mut self.counters.weights_differ);
            self.outbox.report(Event::WeightsDiffer { node: source, own, theirs: weight });
        }
        Ok(())
    }
}
