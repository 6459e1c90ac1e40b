//! What a node reports about itself: counters, telemetry, and the closing report.

use crate::Refusal;
use serde::{Deserialize, Serialize};

/// Reasons that every report has; of those that came later each travels at its end.
const REASONS: usize = Refusal::Phase as usize + 1;

/// Event counters of a node since its configuration. All saturate.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Completed ticks.
    pub ticks: u32,
    /// Frames handed to the link.
    pub sent: u32,
    /// Frames accepted.
    pub accepted: u32,
    /// Ticks with `|nu| >= psi`: the guarantee did not hold.
    pub breaches: u32,
    /// Ticks at which the funnel was floored at the resolution of `nu` (law.md 4).
    pub floored: u32,
    /// Neighbour values that were extrapolated because no fresh one had come.
    pub extrapolated: u32,
    /// Edges dropped because a neighbour stayed silent too long.
    pub neighbours_lost: u32,
    /// SYNC frames that skipped at least one tick.
    pub sync_gaps: u32,
    /// Timer ticks that came a whole period late or more.
    pub overruns: u32,
    /// Times that the node widened its own funnel after a breach.
    pub reopened: u32,
    /// Announced weights of an edge that are not the node's own: Assumption 1 does not hold.
    pub weights_differ: u32,
    /// Refused frames, by [`Refusal`] up to `Phase`; [`Counters::refused`] has all of them.
    pub refused: [u32; REASONS],
    /// Samples of the plant that failed: the node went on with its prediction, or stopped.
    pub coasted: u32,
    /// Ticks at which the actuator could not do what the law asked for.
    pub saturated: u32,
    /// States that were accepted after the tick that they are for had run.
    pub late: u32,
    /// Ticks that the node was moved on over without running them: SYNC skipped them, or they came too late
    /// to be made up for.
    pub skipped: u32,
    /// Ticks at which the law asked for more than the largest input that it may.
    pub limited: u32,
    /// Ticks after which the node's own field was not a finite number: it stopped (fault code 11).
    pub field_not_finite: u32,
    /// Losses of the node's link.
    pub link: Losses,
    /// What the limits of what is heard have kept away. Not written where that is nothing, so that a report
    /// has the bytes that it had before there were any.
    #[serde(skip_serializing_if = "Kept::is_nothing")]
    pub kept: Kept,
}

/// What limits of what is heard have kept away. All saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Kept {
    /// Refused frames: [`Refusal::TooFast`].
    pub too_fast: u32,
    /// Refused frames: [`Refusal::Barred`].
    pub barred: u32,
    /// Edges that were barred, each time.
    pub edges: u32,
}

impl Kept {
    /// Bytes of it where it travels and is nothing.
    pub(crate) const ZEROS: usize = 3;

    /// Whether nothing was kept away.
    #[must_use]
    pub fn is_nothing(&self) -> bool {
        *self == Self::default()
    }
}

/// Losses and errors of a node's link since the node's configuration. A link that has no such thing says 0.
/// All saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Losses {
    /// Received CAN frames for which the node's queue had no room, and times that the controller's own places
    /// had none: then one frame was lost, or more.
    pub frames: u32,
    /// Errors that the CAN controller has found on the bus.
    pub bus_errors: u32,
    /// Times that the CAN controller went off the bus.
    pub bus_offs: u32,
    /// Serial lines: overruns, noise, wrong stop bits, and reads and writes that failed.
    pub line_errors: u32,
    /// Replies and telemetry that a service line had no time for: they were not said, so that no tick had to
    /// wait for it.
    pub unsaid: u32,
}

impl Losses {
    /// Losses since `before`.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        let Self { frames, bus_errors, bus_offs, line_errors, unsaid } = self;
        Self {
            frames: frames.saturating_sub(before.frames),
            bus_errors: bus_errors.saturating_sub(before.bus_errors),
            bus_offs: bus_offs.saturating_sub(before.bus_offs),
            line_errors: line_errors.saturating_sub(before.line_errors),
            unsaid: unsaid.saturating_sub(before.unsaid),
        }
    }
}

impl Counters {
    /// Counts one refusal.
    pub fn refuse(&mut self, reason: Refusal) {
        let counter = match reason {
            Refusal::TooFast => Some(&mut self.kept.too_fast),
            Refusal::Barred => Some(&mut self.kept.barred),
            _ => self.refused.get_mut(reason as usize),
        };
        if let Some(counter) = counter {
            count(counter);
        }
    }

    /// Number of times that `reason` was given.
    pub fn refused(&self, reason: Refusal) -> u32 {
        match reason {
            Refusal::TooFast => self.kept.too_fast,
            Refusal::Barred => self.kept.barred,
            _ => self.refused.get(reason as usize).copied().unwrap_or(0),
        }
    }

    /// Number of refused frames, for whatever reason.
    pub fn all_refused(&self) -> u64 {
        Refusal::ALL.iter().map(|&reason| u64::from(self.refused(reason))).sum()
    }
}

/// Adds one without wrapping.
pub fn count(counter: &mut u32) {
    *counter = counter.saturating_add(1);
}

/// Values of the law at one tick in one component, sent when the configuration asks for it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Telemetry {
    /// Tick number `k`.
    pub tick: u32,
    /// Component of the state, from 0.
    pub component: u8,
    /// Diffusive term `nu` at `k`, state units; with edge-wise coupling the largest term of an edge.
    pub nu: f32,
    /// Funnel `psi(k T)`, state units.
    pub psi: f32,
    /// Input `u` held over the tick that begins at `k`, state units / s.
    pub u: f32,
}

/// Closing report of a node.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Largest `|nu| / psi` at any tick.
    pub max_ratio: f32,
    /// All counters.
    pub counters: Counters,
}
