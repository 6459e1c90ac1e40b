//! Configurations that nodes adopt while they run, as events of kind `set` ask for them: staged before the start, and
//! committed at a tick (protocol/README.md, "Commit").
//!
//! Nodes are told one by one, each on its own line: what a node was asked there before, it has done when it answers. In
//! lockstep a commit goes out as early as the loopback engine hands it over, so that a node that is off by then misses it in
//! both. Nothing acknowledges a commit. What a node has now is asked of it, and one that has not adopted what was staged in it
//! is named, and goes on (docs/notes/2026-11-30-set-on-nodes.md).

use super::contact::TIMES;
use super::deadline::ns;
use super::member::Member;
use super::own_clock::OwnClock;
use super::{Conductor, HubError, Received, Task};
use crate::engine::{NodeEvent, TOLD_AHEAD};
use funnelnet_node::Event;
use funnelnet_protocol::config::NodeConfig;
use funnelnet_protocol::message::{Command, Message, NodeId, Target};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::report::Report;
use funnelnet_protocol::serial;
use funnelnet_protocol::service::{Identity, Reply, Request};

/// Ticks by which a commit to nodes with clocks of their own is early at most: half of what its 16 bits can tell, so that a
/// node that is behind takes it, too.
const EARLIEST: u64 = 1 << 14;

/// What a node is to adopt.
#[derive(Clone, Debug, PartialEq)]
pub struct Staged {
    /// The first tick with it.
    pub tick: u32,
    /// All of it.
    pub config: NodeConfig,
}

/// The same on its way.
pub(super) struct Commit {
    staged: Staged,
    stage: Stage,
    /// This program's count of ticks when it told the node, where that was past the tick.
    late: Option<u64>,
    /// The node has said that its storage has failed at it.
    storage_failed: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// The node keeps it, or is about to be given it.
    Staged,
    /// The node was off, and what was staged in it counts as gone.
    Lost,
    /// The same of a node that was lost once it was told: it may have adopted before that.
    LostOnceTold,
    /// The node was told to adopt it.
    Told,
    /// There is nothing to be done any more.
    Over,
}

impl Commit {
    pub(super) fn new(staged: Staged) -> Self {
        Self { staged, stage: Stage::Staged, late: None, storage_failed: false }
    }

    /// Takes note that the node is off. What it has adopted is stored for good.
    pub(super) fn lose(&mut self) {
        if self.stage != Stage::Over {
            self.stage = Stage::Lost;
        }
    }

    /// Takes note that the node is lost, and no event has taken it off.
    pub(super) fn lose_sight(&mut self) {
        match self.stage {
            Stage::Told => self.stage = Stage::LostOnceTold,
            _ => self.lose(),
        }
    }

    /// Whether nothing is left of what was staged.
    pub(super) fn is_lost(&self) -> bool {
        matches!(self.stage, Stage::Lost | Stage::LostOnceTold)
    }

    /// Takes note that the node's storage has failed at the commit (FAULT 9).
    pub(super) fn fail(&mut self) {
        self.storage_failed = true;
    }

    /// What tells one node to adopt what is staged in it.
    pub(super) fn message(&self) -> Message {
        let target = NodeId::new(self.staged.config.id).map_or(Target::All, Target::Node);
        // The low 16 bits, of which the node rebuilds the tick.
        let at_tick = self.staged.tick as u16;
        Message::Ctrl { target, command: Command::Commit, arg: 0, at_tick }
    }
}

impl Conductor {
    /// With configurations that nodes adopt while they run, by index.
    #[must_use]
    pub fn with_staged(mut self, staged: Vec<Option<Staged>>) -> Self {
        for (node, staged) in self.nodes.iter_mut().zip(staged) {
            node.commit = staged.map(Commit::new);
        }
        self
    }

    /// Nodes that were told to commit, or would have been, and had lost by then what was staged in them; by index.
    pub fn missed_commits(&self) -> &[usize] {
        &self.missed_commits
    }

    /// Stages what nodes adopt while they run, and compares the checksums. Before they start: then it is too late.
    ///
    /// Its error: a node that does not stage what it is given, or does not answer.
    pub fn stage(&mut self) -> Task<'_, Result<(), HubError>> {
        let outside = self.outside.clone();
        Task::new(&outside, async move {
            let limit = self.patience.answer;
            for node in &mut self.nodes {
                if let Some(commit) = &node.commit {
                    node.contact.stage(&commit.staged.config, limit).await?;
                }
            }
            Ok(())
        })
    }

    /// In lockstep, once a tick has run: tells the nodes whose commit is near, and asks those that adopt it before the next
    /// tick what they have.
    pub(super) async fn commit(&mut self) -> Result<(), HubError> {
        let next = self.tick.saturating_add(1);
        for index in 0..self.nodes.len() {
            if let Err(error) = self.commit_one(index, next).await {
                // It has taken part in this tick.
                self.lose_from(index, error, next).await?;
            }
        }
        Ok(())
    }

    async fn commit_one(&mut self, index: usize, next: u32) -> Result<(), HubError> {
        let Some((stage, tick)) = self.waits_for_commit(index) else { return Ok(()) };
        if next.saturating_add(TOLD_AHEAD) < tick {
            return Ok(());
        }
        match stage {
            Stage::Staged => self.tell_to_commit(index).await?,
            // It was told when it came, and has refused.
            Stage::Lost | Stage::LostOnceTold => {
                self.note_missed(index, stage);
                return Ok(());
            }
            Stage::Told | Stage::Over => {}
        }
        if next >= tick { self.ask_what_it_has(index).await } else { Ok(()) }
    }

    /// Tells nodes with clocks of their own, by this program's count of ticks.
    pub(super) async fn commit_by_own_count(&mut self) -> Result<(), HubError> {
        let count = self.now_ns().checked_div(self.tick_ns).unwrap_or(0);
        // Twice as long as a node may take to answer: that is more than lines and hosts hold anything up.
        let answer = ns(self.patience.answer).checked_div(self.tick_ns).unwrap_or(0);
        let early = (2 * answer + u64::from(TOLD_AHEAD)).min(EARLIEST);
        for index in 0..self.nodes.len() {
            let Some((stage, tick)) = self.waits_for_commit(index) else { continue };
            if count + early < u64::from(tick) {
                continue;
            }
            match stage {
                // One that does not run would adopt it at once.
                Stage::Staged if self.own.as_ref().is_none_or(|own| own.telling(index) == 0) => continue,
                Stage::Staged => self.tell_to_commit(index).await?,
                // It was off. Nothing is sent: a board that keeps its power still has what was staged.
                Stage::Lost | Stage::LostOnceTold => {
                    self.note_missed(index, stage);
                    continue;
                }
                Stage::Told | Stage::Over => continue,
            }
            let is_late = count > u64::from(tick);
            if let Some(commit) = self.nodes.get_mut(index).and_then(|node| node.commit.as_mut()) {
                commit.late = is_late.then_some(count);
            }
        }
        Ok(())
    }

    /// At the end of a run: asks the nodes that were told to commit, and were not asked yet, what they have.
    pub(super) async fn ask_who_was_told(&mut self) -> Result<(), HubError> {
        for index in 0..self.nodes.len() {
            if self.has_to_say_what_it_has(index)
                && let Err(error) = self.ask_what_it_has(index).await
            {
                self.lose(index, error).await?;
            }
        }
        Ok(())
    }

    /// Whether a node was told, was not asked yet, and did not stop by itself before the tick: from such a one nobody awaits it.
    fn has_to_say_what_it_has(&self, index: usize) -> bool {
        let Some(node) = self.nodes.get(index).filter(|node| node.is_here()) else { return false };
        let Some(commit) = node.commit.as_ref().filter(|commit| commit.stage == Stage::Told) else {
            return false;
        };
        let has_run = |own: &OwnClock| own.recording.has_run(index, commit.staged.tick);
        !node.stopped || self.own.as_ref().is_some_and(has_run)
    }

    fn note_missed(&mut self, index: usize, stage: Stage) {
        match self.nodes.get(index) {
            Some(Member { contact, commit: Some(commit), .. }) if stage == Stage::LostOnceTold => {
                let what = "was lost once it was told to adopt what was staged in it, and goes on as it was";
                self.doubts.note(contact.id(), what, commit.staged.tick, || "that may be gone".to_owned());
            }
            _ => self.missed_commits.push(index),
        }
        self.end_commit(index);
    }

    /// What is left to be done with the commit of a node that runs, and its tick.
    fn waits_for_commit(&self, index: usize) -> Option<(Stage, u32)> {
        let node = self.nodes.get(index).filter(|node| node.is_here() && !node.stopped)?;
        let commit = node.commit.as_ref().filter(|commit| commit.stage != Stage::Over)?;
        Some((commit.stage, commit.staged.tick))
    }

    async fn tell_to_commit(&mut self, index: usize) -> Result<(), HubError> {
        let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
        let Some(commit) = &mut node.commit else { return Ok(()) };
        commit.stage = Stage::Told;
        node.contact.write(&serial::encode(&commit.message())).await?;
        self.hearing.command(index);
        Ok(())
    }

    /// Asks a node that was told to commit which configuration it has. It goes on whatever that is.
    async fn ask_what_it_has(&mut self, index: usize) -> Result<(), HubError> {
        let (patience, mut faults) = (self.patience.answer, Vec::new());
        let Some(node) = self.nodes.get_mut(index) else { return Ok(()) };
        let pick = |received| match received {
            Received::Message(message @ Message::Fault { .. }) => {
                faults.push(message);
                None
            }
            Received::Reply(Reply::Identity(identity)) => Some(identity),
            _ => None,
        };
        let every = patience / TIMES;
        let identity = node.contact.ask(&Request::Hello, (patience, every), "identity", pick).await;
        let relays = node.on_can.is_none() && self.own.is_none();
        let now = u64::from(self.tick).saturating_add(1).saturating_mul(self.tick_ns);
        for fault in faults {
            // On CAN the others have heard it.
            match relays {
                true => self.take_message(index, fault, now),
                false => self.note_fault(index, &fault, now),
            }
        }
        let identity = identity?;
        if self.has_adopted(index, identity) {
            self.note_adopted(index);
            return Ok(());
        }
        let report = self.ask_why(index).await?;
        self.note_not_adopted(index, identity, &report);
        Ok(())
    }

    fn has_adopted(&self, index: usize, identity: Identity) -> bool {
        let commit = self.nodes.get(index).and_then(|node| node.commit.as_ref());
        commit.is_some_and(|commit| commit.staged.config.checksum() == identity.checksum)
    }

    /// From now on the node has what was staged, also after its next start.
    fn note_adopted(&mut self, index: usize) {
        let Some(node) = self.nodes.get_mut(index) else { return };
        let Some(commit) = &mut node.commit else { return };
        let tick = commit.staged.tick;
        node.config = commit.staged.config.clone();
        commit.stage = Stage::Over;
        let at = u64::from(tick).saturating_mul(self.tick_ns);
        self.events.push(NodeEvent { at, node: index, event: Event::Adopted { tick } });
    }

    /// With clocks of their own nodes are asked at the end of the run. One that goes before it, and that has told of the tick,
    /// is taken to have adopted what it was told to: its next start is to be with that.
    pub(super) fn take_as_adopted(&mut self, index: usize, telling: u32) {
        let commit = self.nodes.get(index).and_then(|node| node.commit.as_ref());
        if commit.is_some_and(|commit| commit.stage == Stage::Told && telling > commit.staged.tick) {
            self.note_adopted(index);
        }
    }

    /// What a node reports that has not adopted what was staged in it.
    async fn ask_why(&mut self, index: usize) -> Result<Report, HubError> {
        let every = (self.patience.answer, self.patience.answer / TIMES);
        let Some(node) = self.nodes.get_mut(index) else { return Ok(Report::default()) };
        node.contact.ask(&Request::Report, every, "report", super::finish::report).await
    }

    fn note_not_adopted(&mut self, index: usize, identity: Identity, report: &Report) {
        let Some(node) = self.nodes.get(index) else { return };
        let Some(Commit { staged, late, storage_failed, .. }) = &node.commit else { return };
        let value = || {
            let (found, expected) = (identity.checksum, staged.config.checksum());
            let has = format!("its configuration is {found:08x} and not {expected:08x}");
            let why = match storage_failed {
                true => "since its storage has failed (FAULT 9)".to_owned(),
                false => format!("and it has refused {}", refused(report)),
            };
            let late = late.map_or(String::new(), |count| {
                format!("; it was told too late, when this program had counted to {count}")
            });
            format!("{has}, {why}{late}")
        };
        let what = match node.stopped {
            true => "had not adopted what was staged in it when it stopped",
            false => "has not adopted what was staged in it, and goes on as it was",
        };
        // Asked at the end of a run, it is about the tick all the same.
        self.doubts.note(node.contact.id(), what, self.tick.min(staged.tick), value);
        self.end_commit(index);
    }

    fn end_commit(&mut self, index: usize) {
        if let Some(commit) = self.nodes.get_mut(index).and_then(|node| node.commit.as_mut()) {
            commit.stage = Stage::Over;
        }
    }
}

/// What a node has refused by the reasons for which it may refuse a commit.
fn refused(report: &Report) -> String {
    let reasons = [Refusal::Phase, Refusal::TickWindow, Refusal::Value];
    let counted = reasons.into_iter().filter(|&reason| report.counters.refused(reason) > 0);
    let counted: Vec<_> =
        counted.map(|reason| format!("{} {}", reason.name(), report.counters.refused(reason))).collect();
    if counted.is_empty() { "no frame".to_owned() } else { format!("frames ({})", counted.join(", ")) }
}
