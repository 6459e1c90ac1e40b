//! A run on a bench beside the same run in loopback, tick by tick.

use crate::bus::Medium;
use crate::engine::{Engine, NodeEvent};
use crate::extremes::larger;
use crate::presence::Presence;
use funnelnet_node::{Event, Observation};
use funnelnet_protocol::message::FaultCode;

/// How a node's run differs from loopback.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Difference {
    /// First tick at which a bit of tick number, state, diffusive term, funnel or input differs, at which one
    /// has stopped and the other has not, or at which nothing was recorded: a node at rest sends the same
    /// value dead or alive.
    pub first: Option<u64>,
    /// Largest distance of the states where both are known, state units; not a number where one is not.
    pub largest: f64,
    /// Ticks at which nothing was recorded of the bench's node, or not all.
    pub unrecorded: u64,
}

/// Loopback, whatever its bus.
trait Beside {
    fn advance(&mut self);
    fn take_events(&mut self) -> Vec<NodeEvent>;
    fn observations(&self) -> &[Observation<f32>];
    fn presence(&self, k: u64) -> Vec<Presence>;
}

impl<M: Medium> Beside for Engine<M> {
    fn advance(&mut self) {
        // Once all nodes have stopped by themselves, what they saw last stays.
        let _ = Self::advance(self);
    }

    fn take_events(&mut self) -> Vec<NodeEvent> {
        self.take_events()
    }

    fn observations(&self) -> &[Observation<f32>] {
        self.observations()
    }

    fn presence(&self, k: u64) -> Vec<Presence> {
        self.presence(k)
    }
}

/// Runs loopback along, so that nothing has to be kept.
pub struct Comparison {
    engine: Box<dyn Beside>,
    differences: Vec<Difference>,
    /// Of loopback.
    faults: Vec<NodeEvent>,
    /// The last tick that was compared.
    last: u64,
}

impl Comparison {
    /// Beside `engine`, which is not started yet.
    pub fn new<M: Medium + 'static>(mut engine: Engine<M>) -> Self {
        engine.start();
        let differences = vec![Difference::default(); engine.nodes().len()];
        Self { engine: Box::new(engine), differences, faults: Vec::new(), last: 0 }
    }

    /// Takes what the bench's nodes saw at tick `k`, by index and then by component, and what is known of
    /// them, by index.
    pub fn tick(&mut self, k: u64, seen: &[Observation<f32>], presence: &[Presence]) {
        self.engine.advance();
        let faults =
            self.engine.take_events().into_iter().filter(|event| matches!(event.event, Event::Fault(_)));
        self.faults.extend(faults);
        self.last = k;
        let components = seen.len().checked_div(self.differences.len()).unwrap_or(0).max(1);
        let states = seen.chunks(components).zip(self.engine.observations().chunks(components));
        let known = self.engine.presence(k);
        let nodes = self.differences.iter_mut().zip(states).zip(presence.iter().zip(known));
        for ((difference, states), presence) in nodes {
            difference.take(k, states, presence);
        }
    }

    /// Takes what the bench's nodes have said of faults, at the end: one that stopped for another reason than
    /// in loopback, or only there, or only here, differs.
    pub fn faults(&mut self, events: &[NodeEvent]) {
        for (node, difference) in self.differences.iter_mut().enumerate() {
            if !of(node, events).eq(of(node, &self.faults)) {
                difference.first.get_or_insert(self.last);
            }
        }
    }

    /// The run has ended early: nothing is recorded from the next tick on.
    pub fn cut(&mut self) {
        let next = self.last + 1;
        self.differences.iter_mut().for_each(|difference| difference.first = difference.first.or(Some(next)));
    }

    /// By index.
    pub fn differences(&self) -> &[Difference] {
        &self.differences
    }
}

impl Difference {
    fn take(
        &mut self,
        k: u64,
        (bench, loopback): (&[Observation<f32>], &[Observation<f32>]),
        (here, there): (&Presence, Presence),
    ) {
        // What is off has no bits.
        if (*here, there) == (Presence::Off, Presence::Off) {
            return;
        }
        if !here.is_known() && *here != Presence::Off {
            self.unrecorded += 1;
            self.first.get_or_insert(k);
            return;
        }
        if (*here == Presence::Off) != (there == Presence::Off) {
            self.first.get_or_insert(k);
            return;
        }
        for (a, b) in bench.iter().zip(loopback) {
            self.largest = larger(self.largest, (f64::from(a.x) - f64::from(b.x)).abs());
        }
        if *here != there || bench.iter().map(bits).ne(loopback.iter().map(bits)) {
            self.first.get_or_insert(k);
        }
    }
}

/// The faults that stopped a node, in order.
fn of(node: usize, events: &[NodeEvent]) -> impl Iterator<Item = FaultCode> {
    events.iter().filter(move |event| event.node == node).filter_map(|event| match event.event {
        Event::Fault(code) => Some(code),
        _ => None,
    })
}

fn bits(seen: &Observation<f32>) -> [u32; 5] {
    let [x, nu, psi, u] = [seen.x, seen.nu, seen.psi, seen.u].map(f32::to_bits);
    [seen.tick, x, nu, psi, u]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::NOTHING;
    use crate::loopback::engine as engine_of;
    use crate::scenario::Scenario;
    use std::path::Path;

    /// Two nodes at rest: the value that they send says nothing about whether they live.
    const REST: &str = r#"
version = 1
time = { tick = "1ms", duration = "10ms" }
graph = { kind = "path", nodes = 2 }
coupling = { kind = "node-wise", gain = { kind = "reciprocal", scale = 1.0 }, funnel = { kind = "constant", width = 2.0 } }
agent = { dynamics = { kind = "affine", slope = -1.0 } }
"#;

    /// What the second of two nodes came to, where `change` says what the bench says of it at each of three
    /// ticks.
    fn second(change: impl Fn(u64, &mut Observation<f32>) -> Presence, events: &[NodeEvent]) -> Difference {
        let scenario = Scenario::parse(REST, Path::new("rest.toml"), &[]).unwrap();
        let mut twin = engine_of(&scenario).unwrap();
        twin.start();
        let mut comparison = Comparison::new(engine_of(&scenario).unwrap());
        for k in 0..3 {
            let _ = twin.advance();
            let mut seen = twin.observations().to_vec();
            let presence = change(k, &mut seen[1]);
            comparison.tick(k, &seen, &[Presence::Ran, presence]);
        }
        comparison.faults(events);
        assert_eq!(comparison.differences()[0], Difference::default());
        comparison.differences()[1]
    }

    #[test]
    fn a_node_at_rest_that_is_gone_has_stopped_or_runs_another_tick_differs() {
        assert_eq!(second(|_, _| Presence::Ran, &[]), Difference::default());
        for (unknown, unrecorded) in
            [(Presence::Absent, 1), (Presence::Unrecorded, 1), (Presence::Stopped, 0)]
        {
            let found = second(|k, _| if k == 1 { unknown } else { Presence::Ran }, &[]);
            assert_eq!(found, Difference { first: Some(1), largest: 0.0, unrecorded }, "{unknown:?}");
        }
        let another = |k, seen: &mut Observation<f32>| {
            seen.tick += u32::from(k == 2);
            Presence::Ran
        };
        assert_eq!(second(another, &[]).first, Some(2));
    }

    /// A bench takes a node off by its own clock, a tick earlier or later than loopback.
    #[test]
    fn a_node_that_is_off_in_one_of_the_two_differs_and_has_no_distance() {
        let mut difference = Difference::default();
        let known = Observation { x: 3.0, ..Observation::default() };
        difference.take(4, (&[NOTHING], &[known]), (&Presence::Off, Presence::Ran));
        assert_eq!(difference, Difference { first: Some(4), largest: 0.0, unrecorded: 0 });
        difference.take(5, (&[known], &[NOTHING]), (&Presence::Ran, Presence::Off));
        assert_eq!(difference, Difference { first: Some(4), largest: 0.0, unrecorded: 0 });
    }

    #[test]
    fn a_fault_that_loopback_does_not_have_differs() {
        let event = |event| [NodeEvent { at: 3_000_000, node: 1, event }];
        assert_eq!(second(|_, _| Presence::Ran, &event(Event::Fault(FaultCode::PLANT))).first, Some(2));
        assert_eq!(second(|_, _| Presence::Ran, &event(Event::Warned(FaultCode::PANIC))).first, None);
    }

    #[test]
    fn a_state_that_is_not_a_number_is_the_farthest_of_all() {
        let spoil = |k, seen: &mut Observation<f32>| {
            seen.x = if k == 1 { f32::NAN } else { 3.0 };
            Presence::Ran
        };
        assert!(second(spoil, &[]).largest.is_nan());
    }
}
