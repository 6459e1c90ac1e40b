//! Requests of a session to the storage of its board: what is kept for the next start, what is staged, and
//! what a commit makes of it.

use super::Session;
use crate::model::Model;
use crate::node::adopt::Lasting;
use crate::params::Params;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{ConfigError, TimeRules};
use funnelnet_protocol::message::{FaultCode, Target, TickStamp};
use funnelnet_protocol::refusal::Refusal;
use funnelnet_protocol::service::{Key, Reply, StageError, StoreError};

/// Task of the app with its storage. The buffer is the session's, so that no app needs one for a whole
/// configuration.
#[derive(Debug, PartialEq)]
pub enum Task<'a> {
    /// Keep this configuration for the next start. The key stays.
    Store(&'a NodeConfig),
    /// Be blank at the next start, without a key.
    Erase,
    /// Keep this configuration beside the stored one, which stays.
    Stage(&'a NodeConfig),
    /// Make what is staged the stored one, and put it into the buffer. A tick may wait for it.
    Commit(&'a mut Option<NodeConfig>),
    /// Keep this key. The stored configuration stays, and can be put into the buffer meanwhile.
    Key(Key, &'a mut Option<NodeConfig>),
}

/// A [`Task`] without what it is about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum StorageRequest {
    Store,
    Erase,
    Stage,
    Commit,
    Key(Key),
}

/// Mark of the configuration that waits in the storage for a commit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Staged {
    checksum: u32,
    lasting: Lasting,
    time: TimeRules,
}

impl<M: Model> Session<M> {
    /// Task that [`Output::StorageRequest`](super::Output::StorageRequest) is about; `None` where nothing was
    /// asked for.
    pub fn task(&mut self) -> Option<Task<'_>> {
        Some(match self.performing? {
            StorageRequest::Store => Task::Store(self.config.as_ref()?),
            StorageRequest::Erase => Task::Erase,
            StorageRequest::Stage => Task::Stage(self.config_buffer.as_ref()?),
            StorageRequest::Commit => Task::Commit(&mut self.config_buffer),
            StorageRequest::Key(key) => Task::Key(key, &mut self.config_buffer),
        })
    }

    /// Takes how the [task](Self::task) went: the epoch of what is stored now, or why not.
    pub fn performed(&mut self, outcome: Result<u32, StoreError>) {
        let Some(request) = self.performing.take() else { return };
        self.reply = match request {
            StorageRequest::Store => Some(Reply::Stored(outcome)),
            StorageRequest::Erase => {
                self.identity.has_key &= outcome.is_err();
                Some(Reply::Erased(outcome.map(|_| ())))
            }
            StorageRequest::Key(_) => {
                self.identity.has_key |= outcome.is_ok();
                Some(Reply::Keyed(outcome))
            }
            StorageRequest::Stage => Some(Reply::Staged(self.note_staged(outcome))),
            StorageRequest::Commit => {
                self.note_committed(outcome.is_ok());
                None
            }
        };
        self.config_buffer = None;
    }

    /// Whether the storage keeps a key, for IDENTITY.
    pub fn note_key(&mut self, has_key: bool) {
        self.identity.has_key = has_key;
    }

    fn note_staged(&mut self, outcome: Result<u32, StoreError>) -> Result<u32, StageError> {
        outcome.map_err(StageError::Store)?;
        let config = self.config_buffer.as_ref().ok_or(StageError::Store(StoreError::Failed))?;
        let staged = Staged { checksum: config.checksum(), lasting: Lasting::of(config), time: config.time };
        self.staged = Some(staged);
        Ok(staged.checksum)
    }

    /// Has a node that runs go on with what was committed, at the tick that the commit has named; any other
    /// one is ready with it. Where the storage has failed it goes on as it was, and says so.
    fn note_committed(&mut self, stored: bool) {
        let expected = self.staged.take().map(|staged| staged.checksum);
        let sound = stored && expected == self.config_buffer.as_ref().map(NodeConfig::checksum);
        let done = sound && if self.is_running() { self.adopt() } else { self.configure().is_ok() };
        match self.node.as_mut() {
            _ if done => {}
            Some(node) => {
                node.keep_on();
                node.warn(FaultCode::COMMIT, 0);
            }
            // A blank node has no id to say it with.
            None => self.counters.refuse(Refusal::Phase),
        }
    }

    // Not inlined because its caller would need stack for this beside all else that it does.
    #[inline(never)]
    fn adopt(&mut self) -> bool {
        let (Some(config), Some(node)) = (&self.config_buffer, self.node.as_mut()) else { return false };
        let Ok(params) = Params::of_model(config, &self.model) else { return false };
        if node.adopt(params, &config.neighbours).is_err() {
            return false;
        }
        if let Some(timing) = &mut self.timing {
            timing.hold_over(config);
        }
        // Of the tick before there is nothing more to tell.
        self.teller.pass_over(node.tick());
        self.settle();
        true
    }

    /// Whether a running node waits for what is staged.
    pub(super) fn take_commit(&mut self) -> bool {
        let due = self.node.as_mut().is_some_and(|node| node.take_commit());
        if due {
            self.performing = Some(StorageRequest::Commit);
        }
        due
    }

    /// Takes a commit: a node that runs becomes what is staged later, any other one now. A blank node has no
    /// id to be meant by.
    pub(super) fn on_commit(&mut self, target: Target, at_tick: u16) {
        let meant = self.node.as_ref().map_or(target == Target::All, |node| target.includes(node.id()));
        let (running, waits) = (self.is_running(), self.waits_for_tick());
        let other_time = self.staged.is_some_and(|staged| !self.keeps_time_by(&staged.time));
        match (self.staged, self.node.as_mut()) {
            _ if !meant => {}
            _ if self.storage_request.is_some() || self.performing.is_some() => self.refuse(Refusal::Phase),
            // It has been started, and would wait no more with what is staged.
            _ if waits => self.refuse(Refusal::Phase),
            (None, _) => self.refuse(Refusal::Phase),
            // A keeper goes by the rules that it was started with.
            _ if running && other_time => self.refuse(Refusal::Value),
            // The node counts what it refuses.
            (Some(Staged { lasting, .. }), Some(node)) if running => {
                let _ = node.commit_at(TickStamp::low(at_tick.into(), 16), lasting);
            }
            _ => self.storage_request = Some(StorageRequest::Commit),
        }
    }

    fn keeps_time_by(&self, rules: &TimeRules) -> bool {
        self.config.as_ref().is_some_and(|config| config.time == *rules)
    }

    pub(super) fn may_store(&self) -> Result<(), StoreError> {
        match self.config {
            _ if self.is_running() => Err(StoreError::Running),
            None => Err(StoreError::Blank),
            Some(_) => Ok(()),
        }
    }

    /// Whether what is in the buffer can be staged.
    #[inline(never)]
    pub(super) fn may_stage(&self) -> Result<(), StageError> {
        if self.is_running() {
            return Err(StageError::Store(StoreError::Running));
        }
        let config = self.config_buffer.as_ref().ok_or(StageError::Config(ConfigError::Malformed))?;
        Params::of_model(config, &self.model).map(|_| ()).map_err(StageError::Config)
    }

    /// Has the app asked. All requests use the half of the storage in which something may be staged.
    pub(super) fn request_storage(&mut self, request: StorageRequest) -> Result<(), Refusal> {
        self.staged = None;
        self.storage_request = Some(request);
        Ok(())
    }
}
