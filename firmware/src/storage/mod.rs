//! Where a board keeps its node's configuration: in flash ([`flash::InFlash`]), unless it has no storage (`funnelnet_app::storage::Absent`).

#[cfg(feature = "flash")]
pub mod flash;
