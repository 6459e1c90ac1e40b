//! The funnel that a node sees is that of its configuration, or what rounding leaves of it.

use super::Broken;
use super::commits::Adoptions;
use funnelnet_law::floor::Floor;
use funnelnet_node::{Event, Observation};
use sim_host::engine::NodeEvent;
use sim_host::judge::Moment;
use sim_host::presence::Presence;
use sim_host::scenario::{Breach, EventKind, Scenario};

/// What f32 may round away of a width.
const ROOM: f64 = 1e-4;
/// And where one comes near to zero, state units.
const RESOLUTION: f64 = 1e-5;
/// The largest that a lie may say, state units, and how much farther than states what is extrapolated may be. A network that runs away farther
/// than that is not looked at any more.
const SAID: f64 = 50.0;
const EXTRAPOLATED: f64 = 2.0;

/// What is watched of a run.
pub(super) struct Widths<'a> {
    scenario: &'a Scenario,
    /// Nodes see the funnels of the network's ticks, and do not widen them but by what they hear.
    is_known: bool,
    /// The largest state and input so far: what a node hears and what it had as an input are of before.
    far: f64,
    input: f64,
    /// It was off, and has not spoken since: until then it may have a wider one of its own.
    comes: Vec<bool>,
}

impl<'a> Widths<'a> {
    pub(super) fn of(scenario: &'a Scenario) -> Self {
        // A bit that is read wrong makes a state of any size, which rounding goes by.
        let bits_flip = scenario.events.iter().any(|event| event.kind == EventKind::Corrupt)
            || scenario.links.iter().any(|link| link.settings.corrupt > 0.0);
        let reopens = matches!(scenario.on_breach, Breach::Reopen { .. });
        let is_known = scenario.clocks.is_empty() && !reopens && !bits_flip;
        Self { scenario, is_known, far: 0.0, input: 0.0, comes: vec![false; scenario.nodes.len()] }
    }

    /// Whether all have the funnels that they should.
    pub(super) fn tick(
        &mut self,
        moment: &Moment<'_>,
        (seen, told): (&[Observation<f32>], &[NodeEvent]),
        adoptions: &Adoptions<'_>,
    ) -> Result<(), Broken> {
        let scenario = self.scenario;
        let size = |values: &[f64]| values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        (self.far, self.input) = (self.far.max(size(moment.x)), self.input.max(size(moment.u)));
        if !self.is_known || self.far > SAID {
            return Ok(());
        }
        let (far, input) = (SAID + EXTRAPOLATED * self.far, self.input);
        for (index, of_node) in seen.chunks(scenario.components()).enumerate() {
            let presence = moment.presence.get(index);
            let spoke =
                told.iter().any(|told| told.node == index && matches!(told.event, Event::Joins { .. }));
            let is_asked = presence == Some(&Presence::Ran) && !self.comes[index] && !spoke;
            if let Some(node) = adoptions.node_at(index, moment.k).filter(|_| is_asked) {
                let width = node.funnel.width(scenario.time.at_s(moment.k));
                let degree = scenario.graph.neighbours(index).iter().map(|(_, weight)| weight).sum();
                let widest =
                    width.max(Floor::<f64>::of_f32(degree, scenario.time.tick_s()).width(far, input));
                let fits = |seen: &Observation<f32>| {
                    (width * (1.0 - ROOM) - RESOLUTION..=widest * (1.0 + ROOM)).contains(&seen.psi.into())
                };
                // Where it is infinite a node has a large number.
                if width.is_finite() && !of_node.iter().all(fits) {
                    return Err(Broken::Width(moment.k, index));
                }
            }
            self.comes[index] = !spoke && (self.comes[index] || presence == Some(&Presence::Off));
        }
        Ok(())
    }
}
