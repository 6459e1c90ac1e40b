//! The step of a node: what the app has to do for it before its next tick.

use super::{Action, Node};
use funnelnet_law::field::VectorField;
use funnelnet_law::gain::GainFunction;
use funnelnet_law::math::Real;

/// Use of a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Purpose {
    /// The announcement of the initial state.
    Announce,
    /// A tick, which waits for it.
    Tick,
}

/// Thing that the app has to do for the node before the next tick.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    /// Nothing.
    Idle,
    /// It is to be asked for a sample.
    Ask(Purpose),
    /// It has been asked for one.
    Await(Purpose),
    /// It is to be told that there are inputs.
    Tell,
    /// It is to be told that the node has stopped.
    Stop,
    /// It has been asked for another configuration.
    Commit,
}

impl<F: Real, V: VectorField<F>, G: GainFunction<F>> Node<F, V, G> {
    /// Asks or tells the app what is due now, each once.
    pub(super) fn demand(&mut self) -> Option<Action> {
        let (action, next) = match self.step {
            Step::Idle | Step::Await(_) | Step::Commit => return None,
            Step::Ask(purpose) => (Action::Sample, Step::Await(purpose)),
            Step::Tell => (Action::Actuate, Step::Idle),
            Step::Stop => (Action::Safe, Step::Idle),
        };
        self.step = next;
        Some(action)
    }

    /// Whether the app is to be told that the node has stopped; told once.
    pub(crate) fn take_stop(&mut self) -> bool {
        let stopped = self.step == Step::Stop;
        if stopped {
            self.step = Step::Idle;
        }
        stopped
    }

    pub(super) fn tick_waits_for_sample(&self) -> bool {
        matches!(self.step, Step::Ask(Purpose::Tick) | Step::Await(Purpose::Tick))
    }
}
