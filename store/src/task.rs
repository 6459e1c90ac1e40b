//! What a node's session asks of its storage, in one step.
//!
//! One function for all of it, with one place where something is staged and one where it is committed: each
//! further one is some kilobytes of state machine in the image (docs/notes/2026-11-25-real-nodes-2.md).

use embedded_storage_async::nor_flash::NorFlash;
use funnelnet_node::Task;

use crate::{Change, Error, Store};

impl<S: NorFlash> Store<S> {
    /// Does it, and gives the epoch of what is current then.
    ///
    /// # Errors
    /// As for [`Store::stage`], [`Store::staged`] and [`Store::commit`].
    pub async fn perform(&mut self, task: Task<'_>) -> Result<u32, Error<S::Error>> {
        let (change, commits) = match task {
            Task::Store(config) => (Some(Change::Config(config)), true),
            Task::Erase => (Some(Change::Blank), true),
            Task::Key(key, room) => (Some(Change::Key(key, room)), true),
            Task::Stage(config) => (Some(Change::Config(config)), false),
            Task::Commit(room) => {
                // Before, so that nothing is committed that cannot be handed over.
                self.staged(room).await?;
                (None, true)
            }
        };
        if let Some(change) = change {
            self.stage(change).await?;
        }
        let epoch = self.epoch().saturating_add(u32::from(commits));
        if commits {
            self.commit(epoch).await?;
        }
        Ok(epoch)
    }
}
