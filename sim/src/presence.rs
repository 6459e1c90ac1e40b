//! What is known of a node at a tick. A last value that stands in for a measurement must not be judged as
//! one.

/// Presence of a node at a tick, as far as it is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Presence {
    /// It has run the tick, and its state there is known.
    #[default]
    Ran,
    /// It stopped before this tick; its state is what it stopped with.
    Stopped,
    /// It runs, but its state at this tick has not been recorded.
    Unrecorded,
    /// It is lost, and nothing is known of it.
    Absent,
    /// An event keeps it off: it has no state and no edge.
    Off,
}

impl Presence {
    /// Whether the state that stands in the record is the node's state at this tick.
    #[must_use]
    pub fn is_known(self) -> bool {
        matches!(self, Self::Ran | Self::Stopped)
    }
}
