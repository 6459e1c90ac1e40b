//! A newcomer: a node that is told at its start that it joins a network that runs. It hears everybody and
//! sends no states until it is where its neighbours are (law.md 9): nothing that it was before throws them
//! out.

use super::Node;
use super::part::Part;
use crate::observe::Event;
use funnelnet_law::field::VectorField;
use funnelnet_law::funnel::Widths;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::law::Law;
use funnelnet_law::math::{Real, larger};
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::message::{FaultCode, JOIN, Severity};

/// Ticks in a row that a node with a plant is inside its own funnel before it speaks.
const SETTLED: u8 = 10;
/// What counts as inside meanwhile: nobody answers its pull, so that it comes near from one side.
const INSIDE: f32 = 1.05;
/// The private funnel at its beginning, over the diffusive term that it finds.
const ROOM: f32 = 1.25;
/// Shortest time constant of the private funnel, s.
const SHORTEST: f64 = 0.1;
/// What its coming may move the term of a neighbour by, over its own funnel: a node at the mean of neighbours
/// that are apart pulls them together.
const GENTLE: f32 = 0.5;
/// The same where waiting no longer helps: neighbours that others hold together are not as far apart.
const APART: f32 = 2.0;
/// Times as long as a silent neighbour is extrapolated, after which a node that hears nobody speaks.
const NOBODY: u32 = 3;

/// State of a newcomer.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Newcomer<F> {
    /// Ticks for which it has listened.
    ticks: u32,
    /// The funnel that nobody else knows of, once there is one.
    private: Option<Private<F>>,
    /// Ticks in a row inside its own funnel.
    inside: u8,
    /// Ticks for which it could have spoken.
    ready: u16,
}

/// Funnel of a node with a plant that has to move first.
#[derive(Clone, Copy, Debug)]
struct Private<F> {
    /// At the tick that comes next, state units.
    width: F,
    /// `exp(-T / tau)`.
    decay: F,
}

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    /// Whether a node that is started with this `at_tick` is a newcomer. It is one from then on.
    #[cold]
    pub(super) fn joins(&mut self, at_tick: u16) -> bool {
        // To a timer it is a time.
        let told = at_tick == JOIN && self.params.tick_source == TickSource::Sync;
        told && self.becomes_newcomer()
    }

    /// Makes it one, unless it has nobody to join.
    #[cold]
    pub(super) fn becomes_newcomer(&mut self) -> bool {
        let joins = self.params.coupling != Law::None && self.neighbours.count() != 0;
        if joins {
            self.newcomer = Some(Newcomer::default());
        }
        joins
    }

    /// Whether a newcomer at tick `k`, whose largest diffusive term is `nu` (state units), has no input yet.
    /// A virtual node takes the mean of its neighbours.
    #[cold]
    pub(super) fn waits(&mut self, k: u32, nu: &mut F) -> bool {
        let Some(mut newcomer) = self.newcomer else { return false };
        if newcomer.ticks == 0 {
            self.outbox.report(Event::Listens { tick: k });
        }
        newcomer.ticks = newcomer.ticks.saturating_add(1);
        self.newcomer = Some(newcomer);
        if newcomer.private.is_some() {
            return false;
        }
        let (known, unheard) = self.neighbours.known_and_unheard();
        if known == 0 && newcomer.ticks > NOBODY.saturating_mul(self.params.extrapolate_ticks) {
            self.speak(k);
            return false;
        }
        if known == 0 || unheard != 0 {
            return true;
        }
        if self.plant.is_none() {
            self.adopt_mean();
            *nu = F::ZERO;
            // From now on it is where it should be.
            newcomer.inside = SETTLED;
        }
        newcomer.private = Some(self.private_funnel(*nu));
        self.newcomer = Some(newcomer);
        false
    }

    /// The funnel of a newcomer at a tick: its private one, while that is wider. `nu` is its largest
    /// diffusive term, state units.
    #[cold]
    pub(super) fn private(&mut self, k: u32, nu: F, psi: Widths<F>) -> Widths<F> {
        let Some(Newcomer { private: Some(private), inside, ready, .. }) = &mut self.newcomer else {
            return psi;
        };
        let width = private.width;
        private.width = width * private.decay;
        *inside = if nu < F::from_f32(INSIDE) * psi.now { inside.saturating_add(1) } else { 0 };
        if *inside >= SETTLED {
            *ready = ready.saturating_add(1);
            // One with a plant has taken its time.
            let waits_no_longer = self.plant.is_some() || *ready > self.params.newcomer_patience;
            if waits_no_longer || self.it_is_time(k, psi.now) {
                self.speak(k);
            }
        }
        Widths { now: larger(psi.now, width), ahead: larger(psi.ahead, width) }
    }

    /// Whether its edges would move the term of no neighbour by much of a funnel of `psi` (state units), or
    /// of one by so much that nothing but the newcomer holds it: neighbours on a path that it closes run
    /// apart for as long as it waits.
    #[cold]
    fn it_is_time(&mut self, k: u32, psi: F) -> bool {
        let edge =
            |(component, part): (usize, &Part<F>)| self.neighbours.largest_term(k, component as u8, part.x);
        let term = self.parts.iter().enumerate().map(edge).fold(F::ZERO, larger);
        term < F::from_f32(GENTLE) * psi || term > F::from_f32(APART) * psi
    }

    fn speak(&mut self, k: u32) {
        self.newcomer = None;
        self.outbox.report(Event::Joins { tick: k });
        // Neighbours that have not missed it would hold its state against what it said before, and bar it.
        if self.params.heard.remembers() {
            let anew = FaultCode::STARTS_ANEW;
            self.outbox.fault = Some(self.fault_message(anew, Severity::Notice, 0));
        }
    }

    /// Puts every component where `nu` is zero.
    fn adopt_mean(&mut self) {
        for component in 0..self.parts.len() {
            let degree = self.neighbours.known_degree(component as u8);
            let Some(part) = self.parts.get_mut(component).filter(|_| degree > F::ZERO) else { continue };
            let (x, dx) = (part.x + part.nu / degree, part.dx + part.dnu / degree);
            *part = Part { x, dx, carry: F::ZERO, nu: F::ZERO, dnu: F::ZERO, ..*part };
        }
    }

    /// `max(psi, 1.25 |nu0| exp(-t / tau))`, `tau = max(0.1 s, 2 |nu0| / (d U))`: no faster than the actuator
    /// can.
    fn private_funnel(&self, nu: F) -> Private<F> {
        let actuator = self.plant.as_ref().map_or(F::WIDEST, crate::plant::Plant::largest_input);
        let input = self.params.input_limit.min(actuator);
        let speed = self.neighbours.known_degree(0) * input;
        let needed = (nu + nu) / speed;
        let tau = larger(F::from_f64(SHORTEST), needed);
        let period = F::from_f64(self.params.tick_ns as f64 * 1e-9);
        Private { width: F::from_f32(ROOM) * nu, decay: (-(period / tau)).exp() }
    }
}
