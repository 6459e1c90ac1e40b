//! What a run was, beside what its nodes say of it at the end.

use super::Conductor;
use crate::judge::Account;
use funnelnet_protocol::config::Breach;

/// Ticks by which a clock may be ahead of this program's, and that a stop may take to be heard.
const CLOCK_SPARE: u64 = 4;

impl Conductor {
    /// Whether what a node reports is of the whole run: it has not been away.
    pub fn was_there_throughout(&self, index: usize) -> bool {
        let id = self.nodes.get(index).map(|node| node.contact.id());
        self.nodes.get(index).is_some_and(|node| !node.was_off)
            && self.absences.iter().all(|absence| Some(absence.node) != id)
    }

    /// Ticks that a node may have run beside those that were told of: those with clocks of their own go on
    /// until they hear the stop, and after an error a tick may be under way.
    pub fn unseen(&self, ended_early: bool) -> u64 {
        match &self.own {
            Some(_) => {
                let possible = self.now_ns().checked_div(self.tick_ns).unwrap_or(0);
                possible.saturating_sub(u64::from(self.tick)) + CLOCK_SPARE
            }
            None => u64::from(ended_early),
        }
    }

    /// What a node cannot have counted, of which every tick was seen.
    pub fn cannot_have_counted(&self, index: usize, account: &Account) -> Vec<String> {
        let (Some((_, counters)), Some(node)) = (&account.report, self.nodes.get(index)) else {
            return Vec::new();
        };
        let (id, mut found) = (account.id, Vec::new());
        let asked = matches!(node.config.on_breach, Breach::Reopen { .. });
        if counters.reopened > 0 && !asked {
            let times = counters.reopened;
            found.push(format!(
                "node {id} reports that it has reopened its funnel {times} times, which nobody has asked for"
            ));
        }
        // By SYNC only.
        if self.own.is_none() && account.whole && account.unknown == 0 {
            if counters.sync_gaps > 0 {
                let gaps = counters.sync_gaps;
                found.push(format!("node {id} reports {gaps} SYNC gaps, and was seen to run every tick"));
            }
            if counters.overruns > 0 {
                let late = counters.overruns;
                found.push(format!("node {id} reports {late} overruns, and was told when to tick"));
            }
        }
        found
    }
}
