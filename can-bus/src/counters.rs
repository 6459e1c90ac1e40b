//! The error counters of ISO 11898-1.

/// Counter above which a controller is error-passive.
const PASSIVE_ABOVE: u16 = 127;
/// Transmit error counter above which it is off the bus.
const OFF_ABOVE: u16 = 255;
/// The standard allows 119 to 127: what the receive error counter becomes when a passive receiver hears a
/// frame.
const RECEIVE_AFTER_PASSIVE: u16 = 119;
/// Where a receive error counter stops, as one of eight bits does.
const LARGEST_RECEIVE: u16 = 255;

/// How a controller takes part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Mode {
    /// Error-active: it marks errors with dominant bits.
    #[default]
    Active,
    /// Error-passive: it marks errors with recessive bits.
    Passive,
    /// Bus-off: it takes no part.
    Off,
}

/// Error counters of a controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Transmit error counter (TEC).
    pub transmit: u16,
    /// Receive error counter (REC); stays at 255.
    pub receive: u16,
}

impl Counters {
    /// What they make of a controller.
    pub fn mode(self) -> Mode {
        if self.transmit > OFF_ABOVE {
            Mode::Off
        } else if self.transmit > PASSIVE_ABOVE || self.receive > PASSIVE_ABOVE {
            Mode::Passive
        } else {
            Mode::Active
        }
    }

    /// An error of a sender, or of a receiver that counts that much.
    pub(crate) fn failed(&mut self, sender: bool, by: u16) {
        if sender {
            self.transmit += by;
        } else {
            self.receive = (self.receive + by).min(LARGEST_RECEIVE);
        }
    }

    pub(crate) fn sent(&mut self) {
        self.transmit = self.transmit.saturating_sub(1);
    }

    pub(crate) fn received(&mut self) {
        self.receive = match self.receive {
            passive if passive > PASSIVE_ABOVE => RECEIVE_AFTER_PASSIVE,
            active => active.saturating_sub(1),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_begin_at_128_and_256() {
        let of = |transmit, receive| Counters { transmit, receive }.mode();
        assert_eq!([of(127, 127), of(128, 0), of(0, 128)], [Mode::Active, Mode::Passive, Mode::Passive]);
        assert_eq!([of(255, 255), of(256, 0)], [Mode::Passive, Mode::Off]);
    }

    #[test]
    fn a_passive_receiver_that_hears_a_frame_is_active_again() {
        let mut counters = Counters::default();
        (0..60).for_each(|_| counters.failed(false, 8));
        assert_eq!(counters.receive, 255);
        counters.received();
        assert_eq!((counters.receive, counters.mode()), (119, Mode::Active));
        (0..200).for_each(|_| counters.received());
        assert_eq!(counters, Counters::default());
    }
}
