//! The plant of a node that has none of its own: its field, driven by what its actuator does. What the node's model predicts is what happens, as
//! long as nothing fails.

use funnelnet_law::field::{State, VectorField};
use funnelnet_node::plant::{InputRange, PlantSetup};

/// Samples in a row that may fail before the node stops.
pub const COAST_TICKS: u32 = 10;

/// What the node has to know of it: its actuator has no limits but those of the node.
#[must_use]
pub fn setup(components: usize) -> PlantSetup {
    let widest = InputRange::new(-f32::MAX, f32::MAX).ok();
    PlantSetup::new(widest.into_iter().cycle().take(components), COAST_TICKS)
}

/// A field that is driven.
pub(super) struct OwnField<V> {
    field: V,
    /// Of a tick, s.
    tick_s: f64,
    /// Tick that its state is of.
    tick: u64,
    /// State units, component by component.
    x: Vec<f64>,
    /// What its actuator does, state units / s.
    u: Vec<f64>,
}

impl<V: VectorField<f32>> OwnField<V> {
    /// At rest in `x` (state units) at tick 0, without an input; ticks of `tick_s` seconds.
    pub(super) fn new(field: V, tick_s: f64, x: impl Iterator<Item = f32>) -> Self {
        let x: Vec<f64> = x.map(f64::from).collect();
        Self { field, tick_s, tick: 0, u: vec![0.0; x.len()], x }
    }

    /// Lets it go on to tick `k` with the inputs that it has, by the midpoint step of a node.
    pub(super) fn go_on_to(&mut self, k: u64) {
        while self.tick < k {
            let half_ticks = 2 * self.tick;
            let middle = self.stepped(half_ticks, &self.x, 0.5 * self.tick_s);
            self.x = self.stepped(half_ticks + 1, &middle, self.tick_s);
            self.tick += 1;
        }
    }

    /// Where it is `time` (s) after its tick if it moves as it does in `from` (state units).
    fn stepped(&self, half_ticks: u64, from: &[f64], time: f64) -> Vec<f64> {
        let seen: State<f32> = from.iter().map(|&x| x as f32).collect();
        let rate = |index: usize| f64::from(self.field.component(half_ticks, &seen, index));
        let states = self.x.iter().zip(&self.u).enumerate();
        states.map(|(index, (x, u))| x + time * (rate(index) + u)).collect()
    }

    /// Its state, state units.
    pub(super) fn state(&self) -> State<f32> {
        self.x.iter().map(|&x| x as f32).collect()
    }

    /// Has its actuator do `u` (state units / s).
    pub(super) fn drive(&mut self, u: &[f32]) {
        self.u.iter_mut().zip(u).for_each(|(slot, &u)| *slot = u.into());
    }
}
