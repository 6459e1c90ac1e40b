//! Whose clock the nodes of a bench tick by, and for how long clocks of their own agree.

use crate::hub::OnLoss;
use crate::scenario::Problem;
use crate::scenario::reader::{Choice, Log, ready};
use crate::scenario::tree::Item;
use funnelnet_node::neighbour::WINDOW_AHEAD;

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
pub(super) fn check(key: &Item, on_loss: OnLoss, log: &Log) {
    if on_loss == OnLoss::GoOn {
        log.report(key.diagnostic(Problem::Value,
            "must be \"host\" with on_loss = \"go-on\": a start cannot tell a node the tick that the others are at",
        ));
    }
}

/// Ticks after which two crystals, each as far off as it may be, are as far apart as a receiver allows.
///
/// They part by `2 p t`, and a receiver takes states up to [`WINDOW_AHEAD`] ticks ahead:
/// `t / T = WINDOW_AHEAD / (2 p)`, whatever T is.
pub fn ticks_until_apart() -> u64 {
    (f64::from(WINDOW_AHEAD) / (2.0 * CRYSTAL)) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::BenchFile;
    use std::path::Path;

    fn parse(lines: &str) -> Result<BenchFile, String> {
        let text = format!("version = 1\n{lines}\n[[node]]\nid = 1\nhost = true\n");
        BenchFile::parse(&text, Path::new("bench.toml")).map_err(|errors| errors.to_string())
    }

    #[test]
    fn the_clock_is_the_hosts_unless_the_file_says_otherwise() {
        assert_eq!(parse("").unwrap().clock, Clock::Host);
        assert_eq!(parse("clock = \"host\"").unwrap().clock, Clock::Host);
        assert_eq!(parse("clock = \"own\"").unwrap().clock, Clock::Own);
        let drifting = |clock: &str| {
            let text = format!("version = 1\n{clock}\n[[node]]\nid = 1\nhost = true\ndrift_ppm = 50\n");
            BenchFile::parse(&text, Path::new("bench.toml")).map_err(|errors| errors.to_string())
        };
        assert_eq!(drifting("clock = \"own\"").unwrap().nodes[0].drift_ppb, 50_000);
        let error = drifting("").unwrap_err();
        assert!(error.contains("drift_ppm = 50: must come with clock = \"own\""), "{error}");
        let error = parse("clock = \"onw\"").unwrap_err();
        let expected = "bench.toml:2:9: clock = \"onw\": must be one of host, own; did you mean 'own'?";
        assert!(error.contains(expected), "{error}");
        assert!(parse("clok = \"own\"").unwrap_err().contains("did you mean 'clock'?"));
    }

    #[test]
    fn what_does_not_go_together_with_clocks_of_their_own_is_refused() {
        let error = parse("clock = \"own\"\non_loss = \"go-on\"").unwrap_err();
        assert!(error.contains("bench.toml:2:9: clock = \"own\": must be \"host\" with on_loss"), "{error}");
        assert!(parse("clock = \"host\"\non_loss = \"go-on\"").is_ok());
    }

    #[test]
    fn crystals_of_50_ppm_are_two_ticks_apart_after_twenty_thousand() {
        assert_eq!(ticks_until_apart(), 20_000);
    }
}
