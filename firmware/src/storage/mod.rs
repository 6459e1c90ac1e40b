//! Where a board keeps its node's configuration: in flash ([`flash::OnFlash`]), unless it has no storage (`funnelnet_app::storage::Absent`).

#[cfg(feature = "flash")]
pub mod flash;
#[cfg(any(feature = "update", feature = "boot-loader"))]
pub mod programs;

use funnelnet_app::storage::{Absent, Storage};
use static_cell::StaticCell;

/// What a storage is on.
#[allow(async_fn_in_trait)] // One executor, one task: nobody needs the futures to be `Send`.
pub trait Medium {
    /// The storage.
    type Storage: Storage + 'static;

    /// The storage, made where it stays, and opened.
    ///
    /// # Panics
    /// `place` is taken.
    #[allow(clippy::mut_from_ref)] // A `StaticCell` gives its place once.
    async fn open(self, place: &'static StaticCell<Self::Storage>) -> &'static mut Self::Storage;
}

impl Medium for Absent {
    type Storage = Self;

    async fn open(self, place: &'static StaticCell<Self>) -> &'static mut Self {
        place.init(self)
    }
}
