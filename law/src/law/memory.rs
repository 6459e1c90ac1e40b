//! What a law remembers from tick to tick, and the right side of (**) that is made of it.

use super::constants::Constants;
use crate::math::Real;
use crate::start::{PARTS, Pace};

/// How much of a memory means something.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
enum Depth {
    /// There was no tick yet.
    #[default]
    Nothing,
    /// The last input; the rest was disturbed at this tick.
    Input,
    /// The last input; the rest was disturbed at the tick before.
    Settling,
    /// All of it.
    All,
}

/// Memory of a law between ticks.
///
/// ```
/// use funnelnet_law::law::node_wise::Memory;
/// // An actuator at its limit: the law goes on from what was really done.
/// let mut memory = Memory::default();
/// memory.feed_back(2.0);
/// assert_eq!(memory.last_input(), Some(2.0));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Memory<F> {
    /// `u[k-1]`, state units / s.
    last: F,
    /// `u[k-2]`, state units / s.
    before: F,
    /// `dnu[k-1]`, state units.
    dnu: F,
    depth: Depth,
}

impl<F: Real> Memory<F> {
    /// The memory after undisturbed ticks: the last input and the one before it (state units / s), and the
    /// last change of the diffusive term (state units).
    #[must_use]
    pub fn settled(last: F, before: F, dnu: F) -> Self {
        Self { last, before, dnu, depth: Depth::All }
    }

    /// What [`Self::settled`] takes, where all of the memory means something.
    #[inline]
    #[must_use]
    pub fn as_settled(&self) -> Option<[F; 3]> {
        (self.depth == Depth::All).then_some([self.last, self.before, self.dnu])
    }

    /// Replaces the last input by what an actuator really did (law.md 6).
    pub fn feed_back(&mut self, u: F) {
        (self.last, self.depth) = (u, Depth::Input);
    }

    /// The last input, state units / s, once there is one.
    #[inline]
    #[must_use]
    pub fn last_input(&self) -> Option<F> {
        if self.depth == Depth::Nothing { None } else { Some(self.last) }
    }

    /// Takes note that the diffusive term of this tick does not follow from those before it: an edge was
    /// extrapolated, came or went, the node was configured anew. Then `g` is 0 at this tick and at the next
    /// one (law.md 3).
    #[inline]
    pub fn disturb(&mut self) {
        self.depth = self.depth.min(Depth::Input);
    }

    /// Takes note of a tick: the last input before it, its own one, and the change of the diffusive term that
    /// led to it.
    #[inline]
    pub(super) fn note(&mut self, last: F, u: F, dnu: F) {
        (self.before, self.last, self.dnu) = (last, u, dnu);
        self.depth = match self.depth {
            // The first tick has no change of the diffusive term to look back on.
            Depth::Nothing | Depth::Input => Depth::Settling,
            Depth::Settling | Depth::All => Depth::All,
        };
    }
}

/// `b` of a pace over the usual one: `theta` is 1 and not 1/2, the damping three quarters, the tick perhaps
/// an eighth.
pub(super) fn share_of_b<F: Real>(pace: Pace) -> F {
    F::from_f32(match pace {
        Pace::Usual => 1.0,
        Pace::Damped => 1.5,
        Pace::Slow => 1.5 / PARTS as f32,
    })
}

/// `theta` and `g`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LookBack<F> {
    pub theta: F,
    g: F,
}

impl<F: Real> LookBack<F> {
    pub fn new(constants: Constants) -> Self {
        Self { theta: F::from_f64(constants.theta), g: F::from_f64(constants.g) }
    }

    pub fn off(self) -> Self {
        Self { g: F::ZERO, ..self }
    }

    /// Constants of a pace.
    pub fn at(self, pace: Pace) -> Self {
        match pace {
            Pace::Usual => self,
            Pace::Slow | Pace::Damped => Self { theta: F::ONE, g: F::ZERO },
        }
    }

    /// `r` of (**), state units, for `b` (s), the diffusive term and its change (state units), and the last
    /// input (state units / s).
    #[inline]
    pub fn right_side(&self, memory: &Memory<F>, b: F, (nu, dnu): (F, F), last: F) -> F {
        let r = nu + self.theta * dnu + b * last;
        if memory.depth != Depth::All {
            return r;
        }
        r + self.g * ((dnu - memory.dnu) + (b + b) * (last - memory.before))
    }
}
