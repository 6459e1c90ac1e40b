//! Stops nodes when a run cannot go on.

use super::{Hub, HubError, STOP, report};
use funnelnet_protocol::report::Report;
use funnelnet_protocol::serial;
use funnelnet_protocol::service::Request;
use std::fmt;
use std::time::{Duration, Instant};

/// How long all nodes together may take to confirm that they stopped.
const CONFIRM: Duration = Duration::from_secs(1);
/// How long one of them is listened to before it is the turn of the next.
const TURN: Duration = Duration::from_millis(1);
/// How long a node that reads nothing may hold up the stop of the others.
const WRITE: Duration = Duration::from_millis(100);

/// Which nodes confirmed that they stopped, by id.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Halted {
    /// They answered after the stop.
    pub confirmed: Vec<u8>,
    /// They did not.
    pub silent: Vec<u8>,
    /// What they reported, by index.
    pub reports: Vec<Option<Report>>,
}

impl Hub {
    /// Tells all nodes to stop, first, and only then waits for each to confirm it, a second at most for all of them.
    pub fn halt(&mut self) -> Halted {
        // Whether or not it is there any more; their lines are told, too.
        let _ = self.stop_on_can();
        let ask = |node: &mut super::HubNode| {
            node.link.hurry(WRITE);
            node.link.write(&serial::encode(&STOP)).and_then(|()| node.link.request(&Request::Report))
        };
        let asked: Vec<_> = self.nodes.iter_mut().map(|node| ask(node).is_ok()).collect();
        self.end_readers();
        let mut waiting: Vec<_> = asked.into_iter().zip(self.nodes.iter_mut().enumerate()).collect();
        let end = Instant::now() + CONFIRM;
        let mut halted = Halted { reports: vec![None; waiting.len()], ..Halted::default() };
        // In turns: a node that is silent must not use up the time of the others.
        while waiting.iter().any(|(asked, _)| *asked) && Instant::now() < end {
            waiting.retain_mut(|(asked, (index, node))| match node.link.wait_for(TURN, "report", report) {
                Ok(report) => {
                    halted.confirmed.push(node.link.id());
                    if let Some(slot) = halted.reports.get_mut(*index) {
                        *slot = Some(report);
                    }
                    false
                }
                Err(HubError::NoAnswer { .. }) => true,
                Err(_) => {
                    *asked = false;
                    true
                }
            });
        }
        halted.silent.extend(waiting.iter().map(|(_, (_, node))| node.link.id()));
        halted.confirmed.sort_unstable();
        halted
    }
}

impl fmt::Display for Halted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |ids: &[u8]| ids.iter().map(u8::to_string).collect::<Vec<_>>().join(", ");
        match (self.confirmed.as_slice(), self.silent.as_slice()) {
            (_, []) => f.write_str("all nodes confirmed that they stopped"),
            ([], _) => f.write_str("told to stop, but no node confirmed it"),
            (confirmed, silent) => {
                write!(
                    f,
                    "stopped: {}; told to stop, but did not confirm it: {}",
                    list(confirmed),
                    list(silent)
                )
            }
        }
    }
}
