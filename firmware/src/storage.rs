//! Where a node keeps its configuration: nowhere ([`Absent`]), or in flash ([`flash::InFlash`]).

#[cfg(feature = "flash")]
pub mod flash;

use funnel_protocol::NodeConfig;
use funnel_protocol::service::StoreError;

/// Keeps one configuration.
#[allow(async_fn_in_trait)] // as for Link
pub trait Storage {
    /// The configuration to start with, `None` for a blank node. What is wrong with a stored one goes into the log.
    async fn load(&mut self) -> Option<NodeConfig>;

    /// Keeps a configuration; the epoch. After an error, or a power cut, the one before is still there.
    async fn store(&mut self, config: &NodeConfig) -> Result<u32, StoreError>;

    /// Makes the node blank at its next start; as safe as `store`.
    async fn erase(&mut self) -> Result<(), StoreError>;
}

/// A board without storage: its nodes are blank after every start.
pub struct Absent;

impl Storage for Absent {
    async fn load(&mut self) -> Option<NodeConfig> {
        None
    }

    async fn store(&mut self, _config: &NodeConfig) -> Result<u32, StoreError> {
        Err(StoreError::Absent)
    }

    async fn erase(&mut self) -> Result<(), StoreError> {
        Err(StoreError::Absent)
    }
}
