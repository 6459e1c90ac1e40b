//! Telemetry of a session: which ticks are told, and how far that has come.

use crate::node::Node;
use funnelnet_law::field::VectorField;
use funnelnet_protocol::report::Telemetry;

/// Teller of a node's ticks, once per tick and component.
#[derive(Debug, Default)]
pub(super) struct Teller {
    /// Every so many ticks; 0 is never.
    every: u32,
    /// Tick after the last one that telemetry was considered for, and how many components of it have been
    /// told.
    told: (u32, u8),
}

impl Teller {
    /// Tells every so many ticks from now on, where the configuration asks for it.
    pub fn tell_every(&mut self, ticks: u32) {
        self.every = ticks;
    }

    /// Begins anew, with a node that has not ticked yet.
    pub fn restart(&mut self) {
        self.told = (0, 0);
    }

    /// Tells nothing more of the tick before `tick`.
    pub fn pass_over(&mut self, tick: u32) {
        self.told = (tick, u8::MAX);
    }

    /// Next telemetry of the last tick of `node`.
    pub fn next<V: VectorField<f32>>(&mut self, node: &Node<f32, V>) -> Option<Telemetry> {
        let (tick, told) = self.told;
        let component = if tick == node.tick() { told } else { 0 };
        let seen = node.observations().get(usize::from(component))?;
        // Nothing has been seen before the first tick, nor where SYNC has moved the node on and its next tick
        // waits.
        let ran = node.tick() != 0 && seen.tick.wrapping_add(1) == node.tick();
        let wanted = self.every != 0 && ran;
        if !wanted || !seen.tick.is_multiple_of(self.every) {
            return None;
        }
        self.told = (node.tick(), component + 1);
        Some(Telemetry { tick: seen.tick, component, nu: seen.nu, psi: seen.psi, u: seen.u })
    }
}
