//! Where a node keeps its configuration.

use funnelnet_node::Task;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::service::StoreError;
#[cfg(feature = "update")]
use funnelnet_protocol::update;

/// A place for one configuration and one key; beside them, until the next start, for a configuration that is
/// staged.
#[allow(async_fn_in_trait)] // as for Link
pub trait Storage {
    /// Puts the configuration to start with into `room`, `None` for a blank node. What is wrong with a stored
    /// one goes into the log.
    async fn load(&mut self, room: &mut Option<NodeConfig>);

    /// Whether there is a key.
    async fn has_key(&mut self) -> bool;

    /// Does what the session asks for; the epoch of what is stored then. After an error, or a power cut, the
    /// next start finds the one before or the new one, whole.
    async fn perform(&mut self, task: Task<'_>) -> Result<u32, StoreError>;

    /// Does what a host asks for the next program of the node; a node that runs only says how it is. Most
    /// storages take none.
    #[cfg(feature = "update")]
    async fn update(&mut self, request: &update::Request, _is_running: bool) -> update::Reply {
        request.refused(update::UpdateError::Absent)
    }

    /// Takes the number of ticks that the node has completed: a new program has to earn that it stays.
    #[cfg(feature = "update")]
    async fn note_ticks(&mut self, _completed: u32) {}

    /// Whether the node is to restart, now that the [answer](Self::update) is said.
    #[cfg(feature = "update")]
    fn wants_restart(&self) -> bool {
        false
    }

    /// Restarts the node: does not return on a chip.
    #[cfg(feature = "update")]
    fn restart(&mut self) {}
}

/// No storage: a node is blank after every start.
pub struct Absent;

impl Storage for Absent {
    async fn load(&mut self, room: &mut Option<NodeConfig>) {
        *room = None;
    }

    async fn has_key(&mut self) -> bool {
        false
    }

    async fn perform(&mut self, _: Task<'_>) -> Result<u32, StoreError> {
        Err(StoreError::Absent)
    }
}
