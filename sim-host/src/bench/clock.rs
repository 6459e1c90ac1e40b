//! Whose clock the nodes of a bench tick by, and for how long clocks of their own agree.

use super::file::BenchNode;
use crate::hub::OnLoss;
use crate::scenario::Problem;
use crate::scenario::reader::{Choice, Log, ready};
use crate::scenario::tree::Item;
use funnel_core::neighbour::WINDOW_AHEAD;

/// What the key may say.
pub(super) const CLOCKS: [Choice<Clock>; 2] = [ready("host", Clock::Host), ready("own", Clock::Own)];

/// How far the frequency of a board's crystal may be off, over its range of temperature.
const CRYSTAL: f64 = 50e-6;

/// Whose clock the nodes tick by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Clock {
    /// This program's: a SYNC per tick, and all wait for all.
    #[default]
    Host,
    /// Each by its own timer, in real time.
    Own,
}

/// Reports what does not go together with clocks of their own, at the key.
pub(super) fn check(key: &Item, on_loss: OnLoss, nodes: &[BenchNode], log: &Log) {
    let refuse = |why: &str| log.report(key.diagnostic(Problem::Value, why));
    if on_loss == OnLoss::GoOn {
        refuse(
            "must be \"host\" with on_loss = \"go-on\": a start cannot tell a node the tick that the others are at",
        );
    }
    if nodes.iter().any(|node| node.can) {
        refuse(
            "must be \"host\" with nodes on CAN: this version carries frames in real time between lines only",
        );
    }
}

/// Ticks after which two crystals, each as far off as it may be, are as far apart as a receiver allows.
///
/// They part by `2 p t`, and a receiver takes states up to [`WINDOW_AHEAD`] ticks ahead: `t / T = WINDOW_AHEAD / (2 p)`, whatever T is.
pub fn ticks_until_apart() -> u64 {
    (f64::from(WINDOW_AHEAD) / (2.0 * CRYSTAL)) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crystals_of_50_ppm_are_two_ticks_apart_after_twenty_thousand() {
        assert_eq!(ticks_until_apart(), 20_000);
    }
}
