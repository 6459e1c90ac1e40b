//! What happens to the wire and to who is on it: a short circuit, a connector that comes off, a controller that goes in the middle of a frame.

use super::{Attempt, Bus, Clean, Node, Phase, Power, Stage};
use crate::controller::Controller;
use crate::counters::Mode;
use crate::event::Event;
use crate::length::Length;
use crate::noise::{Noise, Quiet};
use crate::participant::Participant;
use crate::wire::Pace;
use std::ops::Range;

impl<N: Noise> Bus<N> {
    /// Holds the wire dominant for a time (ns, which has not begun; nothing happens if it is empty). Times may touch or overlap. A bit is dominant where the
    /// wire is so at its sample point.
    ///
    /// One that is told in the last four bits of a frame that goes as a whole, and begins there, begins with the bus idle.
    ///
    /// All who are not sending when it begins take it for a start of frame. Their receive error counters run up, and they are error-passive after
    /// some 130 bits. The transmit error counter of one that is sending runs up, and takes it off the bus after some 250.
    pub fn short(&mut self, during: Range<u64>) {
        if during.is_empty() {
            return;
        }
        self.settle_idle();
        if matches!(self.phase, Phase::Clean(Clean { free, .. }) if during.start < free) {
            self.unfold();
        }
        let at = self.shorts.partition_point(|short| short.start <= during.start);
        self.shorts.insert(at, during);
        self.go(self.phase);
    }

    /// Takes the connector of a controller off. A frame that is on the way breaks off for it. Alone on its wire, it is not acknowledged: it sends
    /// its frames again and again, is error-passive after 16 attempts, and never goes off the bus.
    pub fn unplug(&mut self, node: usize) {
        if self.lone.contains_key(&node) {
            return;
        }
        self.before_one_goes();
        self.set_waiting(node, None);
        let nobody = Node::nobody(self.nodes[node].controller.empty());
        let mut own = std::mem::replace(&mut self.nodes[node], nobody);
        own.failed(false);
        own.participant.unplug();
        let mut lone = Bus::new(self.timing, Quiet);
        (lone.now, lone.nodes) = (self.now, vec![own]);
        lone.note_all();
        lone.begin_or_idle(self.now);
        self.lone.insert(node, Box::new(lone));
    }

    /// Puts the connector of a controller back: it takes part after eleven recessive bits, with the error counters that it has, and sends what
    /// waits in it.
    pub fn plug(&mut self, node: usize) {
        self.settle_idle();
        let Some(mut own) = self.lone.remove(&node).and_then(|mut lone| lone.nodes.pop()) else { return };
        own.failed(false);
        own.waits = None;
        if own.power != Power::Off {
            own.participant.plug();
            (own.mode, own.restarted) = (Mode::Off, self.now);
            if own.participant.is_recovering() {
                own.power = Power::Starting;
                self.recovering = true;
            }
        }
        self.nodes[node] = own;
    }

    /// Time passes for those whose connector is off.
    #[cold]
    pub(super) fn advance_lone(&mut self) {
        let now = self.now;
        self.lone.values_mut().for_each(|lone| lone.advance(now, &mut |_| ()));
    }

    /// What has to be so before a controller is taken off the wire.
    pub(super) fn before_one_goes(&mut self) {
        self.settle_idle();
        self.unfold();
        // What waits at a start of frame is not what takes part in it.
        self.late |= matches!(self.phase, Phase::Start { at } if at <= self.now);
    }

    /// Lets the frame that is on the way as a whole go bit by bit from now on, as if it had done so from its start.
    fn unfold(&mut self) {
        let Phase::Clean(Clean { node, free, stage: Stage::Receive }) = self.phase else { return };
        let Some(Attempt { buffer, started, .. }) = self.nodes[node].attempt.take() else { return };
        let bits =
            self.nodes[node].controller.pending(buffer).map(|sent| Length::of(&sent.frame, false).bits());
        if let Some((hit, bits)) = self.hit.as_mut().zip(bits) {
            hit.after += u64::from(bits);
        }
        self.busy_ns -= free - started;
        let now = self.now;
        self.go(Phase::Bits { at: started, pace: Pace::Nominal });
        while let Phase::Bits { at, pace } = self.phase
            && self.next <= now
        {
            self.now = self.next;
            self.bit(at, pace, &mut |_| ());
        }
        self.now = now;
    }

    /// A short circuit begins on an idle bus.
    pub(super) fn be_shorted(&mut self, since: u64, sink: &mut impl FnMut(Event)) {
        let (at, now) = (self.shorts.front().map_or(since, |short| short.start.max(since)), self.now);
        // Recessive bits have ended before.
        self.now = at;
        self.settle_idle();
        self.now = now;
        self.bit(at, Pace::Nominal, sink);
    }

    /// Whether the wire is held dominant at the sample point `at` (ns), after which earlier ones are forgotten.
    pub(super) fn is_shorted(&mut self, at: u64) -> bool {
        while self.shorts.front().is_some_and(|short| short.end <= at) {
            self.shorts.pop_front();
        }
        self.shorts.front().is_some_and(|short| short.start <= at)
    }
}

impl Node {
    /// In the place of one whose connector is off.
    fn nobody(controller: Controller) -> Self {
        let mut participant = Participant::new();
        participant.switch_off();
        Self {
            controller,
            participant,
            attempt: None,
            waits: None,
            mode: Mode::Off,
            restarted: 0,
            power: Power::Off,
        }
    }
}
