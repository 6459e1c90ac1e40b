//! Stops nodes when a run cannot go on.

use super::contact::Contact;
use super::deadline::ns;
use super::finish::report;
use super::task::Task;
use super::{Conductor, HubError, STOP};
use funnelnet_protocol::report::Report;
use funnelnet_protocol::serial;
use funnelnet_protocol::service::Request;
use std::fmt;
use std::time::Duration;

/// How long all nodes together may take to confirm that they stopped.
const CONFIRM: Duration = Duration::from_secs(1);
/// How long one of them is listened to before it is the turn of the next.
const TURN: Duration = Duration::from_millis(1);

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

impl Conductor {
    /// Tells all nodes to stop, first, and only then waits for each to confirm it, a second at most for all
    /// of them.
    pub fn halt(&mut self) -> Task<'_, Halted> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            // Whether or not it is there any more; their lines are told, too.
            let _ = self.stop_on_can().await;
            let mut waiting = Vec::new();
            for (index, node) in self.nodes.iter_mut().enumerate().filter(|(_, node)| !node.off) {
                waiting.push(Waiting { index, listening: ask(&mut node.contact).await.is_ok() });
            }
            self.hear_who_stopped(waiting).await
        })
    }

    /// Listens in turns: a node that is silent must not use up the time of the others.
    async fn hear_who_stopped(&mut self, mut waiting: Vec<Waiting>) -> Halted {
        let end = self.outside.now().saturating_add(ns(CONFIRM));
        let mut halted = Halted { reports: vec![None; self.nodes.len()], ..Halted::default() };
        while waiting.iter().any(|node| node.listening) && self.outside.now() < end {
            for mut node in std::mem::take(&mut waiting) {
                let Some(contact) = self.nodes.get_mut(node.index).map(|node| &mut node.contact) else {
                    continue;
                };
                match contact.wait_for(TURN, "report", report).await {
                    Ok(report) => {
                        halted.confirmed.push(contact.id());
                        if let Some(slot) = halted.reports.get_mut(node.index) {
                            *slot = Some(report);
                        }
                        continue;
                    }
                    Err(HubError::NoAnswer { .. }) => {}
                    Err(_) => node.listening = false,
                }
                waiting.push(node);
            }
        }
        let silent = waiting.iter().filter_map(|node| self.nodes.get(node.index));
        halted.silent.extend(silent.map(|node| node.contact.id()));
        halted.confirmed.sort_unstable();
        halted
    }
}

/// A node that has not confirmed that it stopped.
struct Waiting {
    index: usize,
    /// Its line is there.
    listening: bool,
}

/// Tells a node to stop, and asks for its report, which confirms it.
async fn ask(contact: &mut Contact) -> Result<(), HubError> {
    contact.drop_queued();
    contact.write(&serial::encode(&STOP)).await?;
    contact.request(&Request::Report).await
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
