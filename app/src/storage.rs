//! Where a node keeps its configuration.

use funnelnet_node::Task;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::service::StoreError;

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
