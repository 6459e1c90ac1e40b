//! What events do to who is on the wire of a CAN bus, in the order of time.

use crate::scenario::Harm;
use funnelnet_can_bus::{Frame, Id};

/// What happens to a node.
#[derive(Clone, Copy, Debug)]
pub(super) enum Step {
    /// Its connector comes off.
    Unplug,
    /// It is put back.
    Plug,
    /// It begins to send this frame without end, by the event of this number.
    Babble(usize, Frame),
    /// It ends that.
    Quiet(usize),
}

/// All that happens, and what comes next of it.
#[derive(Clone, Debug, Default)]
pub(super) struct Harms {
    /// Engine time (ns), node, step.
    steps: Vec<(u64, usize, Step)>,
    next: usize,
}

impl Harms {
    /// Of `harms` all but short circuits, which happen to nobody in particular.
    pub(super) fn of(harms: &[Harm]) -> Self {
        let of = |(event, harm): (usize, &Harm)| match *harm {
            Harm::Short(_) => None,
            Harm::Cut { node, ref during } => {
                Some([(during.start, node, Step::Unplug), (during.end, node, Step::Plug)])
            }
            Harm::Babble { node, id, ref during } => {
                let frame = Frame::data(Id::Base(id), &[]).ok()?;
                Some([
                    (during.start, node, Step::Babble(event, frame)),
                    (during.end, node, Step::Quiet(event)),
                ])
            }
        };
        let mut steps: Vec<_> = harms.iter().enumerate().filter_map(of).flatten().collect();
        steps.sort_by_key(|&(at, ..)| at);
        Self { steps, next: 0 }
    }

    /// When something happens next, ns; `u64::MAX`, if nothing does.
    pub(super) fn next_at(&self) -> u64 {
        self.steps.get(self.next).map_or(u64::MAX, |&(at, ..)| at)
    }

    /// The next thing that has happened by `now` (ns), with the node.
    pub(super) fn take(&mut self, now: u64) -> Option<(usize, Step)> {
        let &(_, node, step) = self.steps.get(self.next).filter(|&&(at, ..)| at <= now)?;
        self.next += 1;
        Some((node, step))
    }
}

/// What a node sends without end, where it does: the latest of several.
#[derive(Clone, Debug, Default)]
pub(super) struct Babble {
    frames: Vec<(usize, Frame)>,
    /// What of it waits in the controller, perhaps of an event that is over.
    waits: Option<Id>,
}

impl Babble {
    pub(super) fn begin(&mut self, event: usize, frame: Frame) {
        self.frames.push((event, frame));
    }

    pub(super) fn end(&mut self, event: usize) {
        self.frames.retain(|&(other, _)| other != event);
    }

    /// What is to be given to the controller; it has it, once `waits` is noted.
    pub(super) fn due(&self) -> Option<Frame> {
        self.frames.last().filter(|_| self.waits.is_none()).map(|&(_, frame)| frame)
    }

    /// The controller has taken a frame of this identifier, or has none any more.
    pub(super) fn waits(&mut self, id: Option<Id>) {
        self.waits = id;
    }

    /// The controller has sent a frame.
    pub(super) fn sent(&mut self, id: Id) {
        if self.waits == Some(id) {
            self.waits = None;
        }
    }
}
