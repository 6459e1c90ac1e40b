//! The life of a node: it starts, is stopped, and fails.

use super::Node;
use super::clock::Schedule;
use super::step::Step;
use crate::observe::{Event, Phase};
use funnelnet_law::field::VectorField;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::math::Real;
use funnelnet_protocol::message::{Command, FaultCode, Message, Severity, Target, TickStamp};
use funnelnet_protocol::refusal::Refusal;

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    pub(super) fn on_command(
        &mut self,
        command: Command,
        target: Target,
        at_tick: u16,
        now: u64,
    ) -> Result<(), Refusal> {
        match (command, self.phase) {
            (Command::Start, Phase::Ready) => {
                self.phase = Phase::Running;
                // A newcomer says nothing before it knows the tick.
                if !self.joins(at_tick) {
                    self.announce();
                }
                self.clock.start(self.params.tick_source, at_tick, self.params.tick_ns, now);
                self.outbox.report(Event::Started);
                Ok(())
            }
            (Command::Stop, Phase::Ready | Phase::Running) => {
                // Where all stop, nobody needs to know.
                if self.phase == Phase::Running && target != Target::All {
                    self.outbox.fault = Some(self.fault_message(FaultCode::LEAVES, Severity::Stopped, 0));
                }
                self.halt(Phase::Stopped);
                self.outbox.report(Event::Stopped);
                Ok(())
            }
            // A commit needs a storage, and comes by `commit_at` from whoever has one.
            _ => Err(Refusal::Phase),
        }
    }

    /// Starts a node that comes to a network that runs, and whose timer keeps the network's time: `tick` is its
    /// first one, and comes at `at` (ns). One that does not run yet.
    pub fn come(&mut self, tick: u32, at: u64) {
        if self.phase != Phase::Ready {
            return;
        }
        self.phase = Phase::Running;
        (self.clock.tick, self.clock.schedule) = (tick, Schedule::At(at));
        if !self.becomes_newcomer() {
            self.announce();
        }
        self.outbox.report(Event::Started);
    }

    fn halt(&mut self, phase: Phase) {
        self.phase = phase;
        self.clock.halt();
        self.outbox.halt();
        self.step = Step::Stop;
    }

    #[cold]
    pub(super) fn fault(&mut self, code: FaultCode) {
        self.fail(code, u16::from(self.params.id.get()));
    }

    /// Tells the link something that does not stop the node; `arg` is the detail of the FAULT.
    pub fn warn(&mut self, code: FaultCode, arg: u16) {
        self.outbox.fault = Some(self.fault_message(code, Severity::Warning, arg));
    }

    pub(super) fn fault_message(&self, code: FaultCode, severity: Severity, arg: u16) -> Message {
        let tick = TickStamp::full(self.clock.tick);
        Message::Fault { source: self.params.id, code, severity, arg, tick }
    }

    /// Stops, says so once on the link, and stays silent until it is configured anew. `arg` is the detail of
    /// the FAULT.
    pub fn fail(&mut self, code: FaultCode, arg: u16) {
        if matches!(self.phase, Phase::Faulted(_)) {
            return;
        }
        self.halt(Phase::Faulted(code));
        self.outbox.fault = Some(self.fault_message(code, Severity::Stopped, arg));
        self.outbox.report_surely(Event::Fault(code));
    }
}
