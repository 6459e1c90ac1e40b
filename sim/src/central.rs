//! Weakly-centralised coupling: `u_i = G nu_i / psi_i` with `G = max_j gamma_j(|nu_j| / psi_j)`, the same for
//! all nodes.
//!
//! Every node would have to know the gains of all others within the same tick, which no bus carries. So this
//! is a simulation and nothing more: one loop over all nodes in f32, with the field, the funnel, its floor
//! and the step of the node. In sampled form each node solves its own (*) (law.md 3) for a gain
//! `gamma_j = |u_j| / |s_j|`, and with the largest of them
//!
//! ```text
//! psi_i u_i / G + b_i u_i = r_i
//! ```
//!
//! `r` is that of law (*), without a look back: that (**) is stable with a gain that is common to all has not
//! been shown.

use crate::engine::{NodeEvent, SimField};
use crate::noise::Noise;
use crate::presence::Presence;
use crate::scenario::Graph;
use funnelnet_law::GainFunction;
use funnelnet_law::field::{State, VectorField, compensated_add};
use funnelnet_law::funnel::Widths;
use funnelnet_law::law::node_wise::THETA;
use funnelnet_law::math::larger;
use funnelnet_node::{Event, Observation, Params};
use funnelnet_protocol::message::FaultCode;
use funnelnet_protocol::report::{Counters, Report, count};

/// All nodes, and the largest gain among them.
pub struct Central {
    members: Vec<Member>,
    noise: Noise,
    tick: u32,
    /// A state went beyond its limit, or an input was not a finite number.
    stopped: bool,
    /// It had done so before the last tick.
    stood_still: bool,
    observations: Vec<Observation<f32>>,
    events: Vec<NodeEvent>,
}

/// One node.
struct Member {
    params: Params<f32, SimField>,
    /// Index and weight of its neighbours.
    neighbours: Vec<(usize, f32)>,
    /// `theta c T d`, s.
    b: f32,
    parts: Vec<Part>,
    psi: Widths<f32>,
    counters: Counters,
    max_ratio: f32,
    in_breach: bool,
}

/// One component of a state.
#[derive(Clone, Copy, Default)]
struct Part {
    x: f32,
    carry: f32,
    dx: f32,
    /// State as neighbours see it, and how much that changed over the last tick.
    seen: f32,
    increment: f32,
    nu: f32,
    dnu: f32,
    r: f32,
    u: f32,
}

impl Central {
    /// Nodes that are ready to start, by index.
    pub fn new(params: Vec<Params<f32, SimField>>, graph: &Graph, mut noise: Noise) -> Self {
        let member = |(index, params): (usize, Params<f32, SimField>)| {
            let neighbours: Vec<_> =
                graph.neighbours(index).into_iter().map(|(other, weight)| (other, weight as f32)).collect();
            let b = params.law.b();
            let parts = params.initial_state.iter().map(|&x| Part {
                x,
                seen: noise.measure(index, x),
                ..Part::default()
            });
            let parts = parts.collect();
            let psi = params.funnel.widths(0);
            Member {
                params,
                neighbours,
                b,
                parts,
                psi,
                counters: Counters::default(),
                max_ratio: 0.0,
                in_breach: false,
            }
        };
        let members: Vec<_> = params.into_iter().enumerate().map(member).collect();
        Self {
            members,
            noise,
            tick: 0,
            stopped: false,
            stood_still: false,
            observations: Vec::new(),
            events: Vec::new(),
        }
    }

    /// Runs one tick and gives what the nodes saw, by index and then by component. Once a state is beyond its
    /// limit, everything stays as it was seen last.
    pub fn advance(&mut self) -> &[Observation<f32>] {
        self.stood_still = self.stopped;
        if !self.stopped {
            self.listen();
            let first = self.tick == 0;
            for member in &mut self.members {
                member.right_sides(first);
            }
            let largest = self.members.iter().map(Member::gain).fold(0.0, larger);
            for member in &mut self.members {
                member.inputs(largest);
            }
            self.refuse_inputs();
            self.observe();
            if !self.stopped {
                self.step();
            }
        }
        &self.observations
    }

    /// Observations of the nodes at the last tick, by index and then by component.
    pub fn observations(&self) -> &[Observation<f32>] {
        &self.observations
    }

    /// Presence of each node at the last tick, by index.
    pub fn presence(&self) -> Vec<Presence> {
        let presence = if self.stood_still { Presence::Stopped } else { Presence::Ran };
        vec![presence; self.members.len()]
    }

    /// Events that the nodes reported so far.
    pub fn take_events(&mut self) -> Vec<NodeEvent> {
        std::mem::take(&mut self.events)
    }

    /// Reports that the nodes would give now, by index.
    pub fn reports(&self) -> Vec<Report> {
        let report =
            |member: &Member| Report { max_ratio: member.max_ratio, counters: member.counters.clone() };
        self.members.iter().map(report).collect()
    }

    /// Diffusive terms and funnels.
    fn listen(&mut self) {
        let parts: Vec<Vec<Part>> = self.members.iter().map(|member| member.parts.clone()).collect();
        for member in &mut self.members {
            let mut most = 0.0f32;
            for (component, own) in member.parts.iter_mut().enumerate() {
                (own.nu, own.dnu) = (0.0, 0.0);
                most = larger(most, own.x.abs());
                for &(other, weight) in &member.neighbours {
                    let Some(other) = parts.get(other).and_then(|parts| parts.get(component)) else {
                        continue;
                    };
                    own.nu += weight * (other.seen - own.x);
                    own.dnu += weight * (other.increment - own.dx);
                    most = larger(most, other.seen.abs());
                }
            }
            member.widths(self.tick, most);
        }
    }

    /// As a node does: an input that is not a finite number stops it, and here all, with none at all.
    fn refuse_inputs(&mut self) {
        let at = self.now();
        for (node, member) in self.members.iter().enumerate() {
            if member.parts.iter().any(|part| !part.u.is_finite()) {
                self.stopped = true;
                self.events.push(NodeEvent { at, node, event: Event::Fault(FaultCode::INPUT) });
            }
        }
        if self.stopped {
            self.members.iter_mut().flat_map(|member| &mut member.parts).for_each(|part| part.u = 0.0);
        }
    }

    /// Time at which the next tick is over, ns.
    fn now(&self) -> u64 {
        (u64::from(self.tick) + 1) * self.members.first().map_or(0, |member| member.params.tick_ns)
    }

    fn observe(&mut self) {
        let (tick, at) = (self.tick, self.now());
        self.observations.clear();
        for (node, member) in self.members.iter_mut().enumerate() {
            let psi = member.psi.now;
            let seen = |part: &Part| Observation {
                tick,
                x: part.x,
                nu: part.nu,
                psi,
                ratio: part.nu.abs() / psi,
                u: part.u,
            };
            self.observations.extend(member.parts.iter().map(seen));
            let ratio = member.parts.iter().map(|part| part.nu.abs() / psi).fold(0.0, larger);
            if let Some(event) = member.judge(tick, ratio) {
                self.events.push(NodeEvent { at, node, event });
            }
        }
    }

    /// Advances all states by a tick.
    fn step(&mut self) {
        let at = self.now();
        for (node, member) in self.members.iter_mut().enumerate() {
            let before: Vec<f32> = member.parts.iter().map(|part| part.x).collect();
            midpoint(&member.params, self.tick, &mut member.parts);
            count(&mut member.counters.ticks);
            for (part, before) in member.parts.iter_mut().zip(before) {
                part.dx = part.x - before;
                let seen = self.noise.measure(node, part.x);
                part.increment = seen - part.seen;
                part.seen = seen;
            }
            let limit = member.params.state_limit;
            // Written so that NaN is beyond.
            if !member.parts.iter().all(|part| part.x.abs() <= limit) {
                self.stopped = true;
                self.events.push(NodeEvent { at, node, event: Event::Fault(FaultCode::STATE_LIMIT) });
            }
        }
        self.tick += 1;
    }
}

impl Member {
    /// The funnel, floored as a node floors it.
    fn widths(&mut self, tick: u32, largest: f32) {
        self.psi = self.params.funnel.widths(tick);
        let input = self.parts.iter().map(|part| part.u.abs()).fold(0.0, larger);
        let floor = self.params.floor.width(largest, input);
        if !self.psi.clears(floor) {
            count(&mut self.counters.floored);
            self.psi = self.psi.floored(floor);
        }
        self.psi = self.params.guard.of(tick, self.psi);
    }

    /// `r` of (*) for every component.
    fn right_sides(&mut self, first: bool) {
        for part in &mut self.parts {
            if first {
                part.u = self.params.law.gain.solve(self.psi.ahead, self.b, part.nu).u;
            }
            part.r = part.nu + THETA as f32 * part.dnu + self.b * part.u;
        }
    }

    /// The gain `|u| / |s|` that the node would use by itself, 1/s times state units; at rest the slope of
    /// `mu` at zero.
    fn gain(&self) -> f32 {
        let law = &self.params.law.gain;
        let gamma = |part: &Part| {
            let solution = law.solve(self.psi.ahead, self.b, part.r);
            if solution.s == 0.0 { 1.0 / law.inverse_slope(0.0) } else { (solution.u / solution.s).abs() }
        };
        self.parts.iter().map(gamma).fold(0.0, larger)
    }

    /// Inputs with the gain of all.
    fn inputs(&mut self, gain: f32) {
        for part in &mut self.parts {
            let asked = part.r / (self.psi.ahead / gain + self.b);
            part.u = match self.params.limits {
                // What is not finite is refused below.
                Some(range) if asked.is_finite() => range.clamp(asked),
                _ => asked,
            };
        }
    }

    fn judge(&mut self, tick: u32, ratio: f32) -> Option<Event> {
        // What is not a number is not inside, and stays the largest.
        let inside = ratio < 1.0;
        let breach = !inside;
        self.max_ratio = larger(self.max_ratio, ratio);
        self.counters.breaches += u32::from(breach);
        let changed = std::mem::replace(&mut self.in_breach, breach) != breach;
        changed.then_some(match breach {
            true => Event::BreachBegan { tick, ratio },
            false => Event::BreachEnded { tick },
        })
    }
}

/// The node's midpoint steps of a tick, for all components at once.
fn midpoint(params: &Params<f32, SimField>, k: u32, parts: &mut [Part]) {
    let first = u64::from(k) * u64::from(params.round);
    for step in first..first + u64::from(params.round) {
        midpoint_step(params, step << 1, parts);
    }
}

fn midpoint_step(params: &Params<f32, SimField>, half_ticks: u64, parts: &mut [Part]) {
    let (field, tick) = (&params.field, params.tick);
    let now: State<f32> = parts.iter().map(|part| part.x).collect();
    let to_middle = |(index, part): (usize, &Part)| {
        part.x + tick * 0.5 * (field.component(half_ticks, &now, index) + part.u)
    };
    let middle: State<f32> = parts.iter().enumerate().map(to_middle).collect();
    for (index, part) in parts.iter_mut().enumerate() {
        let rate = field.component(half_ticks | 1, &middle, index) + part.u;
        compensated_add(&mut part.x, &mut part.carry, tick * rate);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::configure::{Drive, central_configs};
    use crate::scenario::Scenario;
    use funnelnet_protocol::config::TickSource;

    #[test]
    fn an_input_that_is_not_finite_stops_all_with_their_states() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenarios/side-by-side-weakly-centralised.toml");
        let scenario = Scenario::load(path.as_ref(), &[]).unwrap();
        let drive = Drive { tick_source: TickSource::Timer, telemetry_every: 0, is_simulated: true };
        let configs = central_configs(&scenario, drive).unwrap();
        let params = configs.iter().zip(&scenario.nodes);
        let params = params.map(|(config, spec)| crate::engine::params(config, spec).unwrap()).collect();
        let mut central = Central::new(params, &scenario.graph, Noise::of(&scenario));
        let before: Vec<_> = central.advance().iter().map(|seen| seen.x).collect();
        assert!(central.take_events().is_empty());
        if let Some(member) = central.members.get_mut(1) {
            member.b = f32::NAN;
        }
        let after = central.advance().to_vec();
        let faults = central.take_events();
        assert!(faults.iter().any(|event| event.event == Event::Fault(FaultCode::INPUT)));
        assert!(after.iter().all(|seen| seen.u == 0.0 && seen.x.is_finite()), "{after:?}");
        assert_eq!(central.advance(), &after[..], "everything stays");
        assert_eq!(before.len(), after.len());
    }
}
