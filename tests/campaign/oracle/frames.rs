//! Frames that are in no counter.

use super::Broken;
use funnelnet_protocol::message::Message;
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::Report;
use sim_host::bus::{Medium, Power, Stamp, Traffic};
use sim_host::configure::listeners;
use sim_host::engine::Engine;
use sim_host::scenario::{BusModel, EventKind, Scenario};

/// On the ideal bus without a node that goes, each frame is heard, refused, lost, or still under way; on others each that came is heard or refused.
/// Gives whether they could be counted.
pub(super) fn counted<M: Medium>(
    scenario: &Scenario,
    engine: &mut Engine<Counting<M>>,
    has_ended_early: bool,
) -> Result<bool, Broken> {
    // SYNC of nodes with clocks are for their clocks, and in no counter. A commit comes by no frame.
    if !scenario.stays_whole() || !scenario.clocks.is_empty() || !scenario.staged.is_empty() {
        return Ok(false);
    }
    let counted = |report: &Option<_>| report.as_ref().map_or(0, told);
    let heard: u64 = engine.reports().iter().map(counted).sum();
    let &Counting { due, came, .. } = engine.bus();
    // Each is told to start.
    let heard = heard.saturating_sub(scenario.nodes.len() as u64);
    if heard != came {
        return Err(Broken::Frames(came, heard));
    }
    if scenario.bus.model == BusModel::Ideal {
        let traffic = engine.traffic();
        let accounted = came + traffic.lost;
        let wanted = due + traffic.duplicated;
        // What is under way, or waits to be overtaken.
        let late = wanted.saturating_sub(accounted);
        // Where all have stopped, what an event holds is held for ever.
        let may_hold = has_ended_early && scenario.events.iter().any(|event| event.kind == EventKind::Hold);
        if accounted > wanted || late > under_way(scenario) && !may_hold {
            return Err(Broken::Frames(wanted, accounted));
        }
    }
    Ok(true)
}

/// Frames that may be under way at the same time: two ticks of them, and those of the longest delay.
fn under_way(scenario: &Scenario) -> u64 {
    let of_a_tick = 2 * scenario.graph.edges.len() as u64 * scenario.components() as u64;
    let of_links = scenario.links.iter().map(|link| link.settings.latency_ns + link.settings.jitter_ns).max();
    let longest = scenario.bus.latency_ns + scenario.bus.jitter_ns + of_links.unwrap_or(0);
    of_a_tick * (2 + longest.div_ceil(scenario.time.tick_ns))
}

/// Messages that a node has counted, taken or refused.
fn told(report: &Report) -> u64 {
    let counters = &report.counters;
    u64::from(counters.accepted) + counters.all_refused()
}

/// A medium that counts what is to arrive, and what does.
pub(super) struct Counting<M> {
    medium: M,
    listeners: Vec<Vec<usize>>,
    due: u64,
    came: u64,
}

impl<M> Counting<M> {
    pub(super) fn new(scenario: &Scenario, medium: M) -> Self {
        Self { medium, listeners: listeners(scenario), due: 0, came: 0 }
    }
}

impl<M: Medium> Medium for Counting<M> {
    fn send(&mut self, now: u64, sender: usize, message: &Message) {
        self.due += self.listeners.get(sender).map_or(0, |list| list.len() as u64);
        self.medium.send(now, sender, message);
    }

    fn flush(&mut self, now: u64, sender: usize) {
        self.medium.flush(now, sender);
    }

    fn computes(&mut self, node: usize, until: u64) {
        self.medium.computes(node, until);
    }

    fn next_arrival(&self) -> Option<u64> {
        self.medium.next_arrival()
    }

    fn deliver(&mut self, mut receive: impl FnMut(usize, Result<Message, Refusal>)) {
        let came = &mut self.came;
        self.medium.deliver(|receiver, heard| {
            *came += 1;
            receive(receiver, heard);
        });
    }

    fn deliver_before(
        &mut self,
        before: u64,
        mut receive: impl FnMut(u64, usize, Result<Message, Refusal>),
    ) -> Option<u64> {
        let came = &mut self.came;
        self.medium.deliver_before(before, |at, receiver, heard| {
            *came += 1;
            receive(at, receiver, heard);
        })
    }

    fn has_off(&self) -> bool {
        self.medium.has_off()
    }

    fn take_off(&mut self) -> Vec<(usize, u16)> {
        self.medium.take_off()
    }

    fn set_listeners(&mut self, listeners: Vec<Vec<usize>>) {
        self.medium.set_listeners(listeners);
    }

    fn take_stamps(&mut self) -> Vec<Stamp> {
        self.medium.take_stamps()
    }

    fn switch(&mut self, now: u64, node: usize, power: Power) {
        self.medium.switch(now, node, power);
    }

    fn traffic(&self) -> Traffic {
        self.medium.traffic()
    }
}
