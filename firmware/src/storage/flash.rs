//! Storage in the flash that a board sets apart: the region STORAGE of its memory map.

use core::ops::Range;

use embedded_storage::nor_flash as blocking;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use funnelnet_app::storage::Storage;
use funnelnet_node::Task;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::service::StoreError;
#[cfg(feature = "update")]
use funnelnet_protocol::update;
use funnelnet_store::{Error, Store};
#[cfg(feature = "update")]
use funnelnet_update::Updater;
use static_cell::StaticCell;

use super::Medium;

#[allow(unsafe_code)] // Declared, and never read.
unsafe extern "C" {
    /// Their addresses are those of the region STORAGE; nothing is there to be read.
    static __storage_start: u8;
    static __storage_end: u8;
}

/// The region STORAGE, for a driver that counts from `base`.
pub fn region(base: u32) -> Range<u32> {
    let (start, end) = (&raw const __storage_start as u32, &raw const __storage_end as u32);
    start.wrapping_sub(base)..end.wrapping_sub(base)
}

/// A driver of flash that counts from `base`, with the region STORAGE in it.
pub struct OnFlash<F> {
    flash: F,
    base: u32,
}

impl<F> OnFlash<F> {
    /// Nothing is read or written yet.
    pub const fn new(flash: F, base: u32) -> Self {
        Self { flash, base }
    }
}

impl<F: NorFlash + 'static> Medium for OnFlash<F> {
    type Storage = InFlash<F>;

    async fn open(self, place: &'static StaticCell<InFlash<F>>) -> &'static mut InFlash<F> {
        let storage = place.init_with(|| InFlash::new(self.flash, region(self.base)));
        storage.open().await;
        #[cfg(feature = "update")]
        storage.take_programs(self.base).await;
        storage
    }
}

/// A configuration and a key in flash.
pub struct InFlash<S> {
    store: Store<S>,
    /// Not before [`InFlash::open`], nor where that has failed.
    is_open: bool,
    /// Not before [`InFlash::take_programs`].
    #[cfg(feature = "update")]
    updater: Option<Updater>,
}

impl<S: NorFlash> InFlash<S> {
    /// Storage in `region` of `flash`, still to be opened where it stays.
    pub const fn new(flash: S, region: Range<u32>) -> Self {
        Self {
            store: Store::new(flash, region),
            is_open: false,
            #[cfg(feature = "update")]
            updater: None,
        }
    }

    /// The driver, and so many bytes that nothing stored is in, to be tried; `None` where the storage is not open, cannot tell, or has not so many.
    pub async fn spare_page(&mut self, bytes: u32) -> Option<(&mut S, Range<u32>)> {
        if !self.is_open {
            return None;
        }
        let half = self.store.spare().await.inspect_err(failed).ok()?;
        let begin = half.end.checked_sub(bytes).filter(|begin| *begin >= half.start)?;
        Some((self.store.flash(), begin..half.end))
    }

    /// Looks for a configuration. Where that fails, the storage is as one that refuses everything.
    pub async fn open(&mut self) {
        self.is_open = self.store.find().await.inspect_err(failed).is_ok();
    }
}

impl<S: NorFlash> Storage for InFlash<S> {
    async fn load(&mut self, room: &mut Option<NodeConfig>) {
        *room = None;
        if self.is_open {
            let _ = self.store.load(room).await.inspect_err(failed);
        }
    }

    async fn has_key(&mut self) -> bool {
        self.is_open && matches!(self.store.key().await, Ok(Some(_)))
    }

    async fn perform(&mut self, task: Task<'_>) -> Result<u32, StoreError> {
        if !self.is_open {
            return Err(StoreError::Failed);
        }
        self.store.perform(task).await.inspect_err(failed).map_err(|_| StoreError::Failed)
    }

    #[cfg(feature = "update")]
    async fn update(&mut self, request: &update::Request, is_running: bool) -> update::Reply {
        match self.updater.as_mut() {
            Some(updater) => updater.answer(self.store.flash(), request, is_running).await,
            None => request.refused(update::UpdateError::Absent),
        }
    }

    #[cfg(feature = "update")]
    async fn note_ticks(&mut self, completed: u32) {
        if let Some(updater) = self.updater.as_mut() {
            updater.note_ticks(self.store.flash(), completed).await;
        }
    }

    #[cfg(feature = "update")]
    fn wants_restart(&self) -> bool {
        self.updater.as_ref().is_some_and(Updater::restarts)
    }

    #[cfg(feature = "update")]
    fn restart(&mut self) {
        crate::reset::restart()
    }
}

#[cfg(feature = "update")]
impl<S: NorFlash> InFlash<S> {
    /// From now on it takes new programs, for a driver that counts from `base`.
    async fn take_programs(&mut self, base: u32) {
        let board = update::board_number(env!("FUNNELNET_BOARD"));
        let updater = self.updater.insert(Updater::new(super::programs::regions(base), board));
        updater.look(self.store.flash()).await;
    }
}

fn failed<E: core::fmt::Debug>(error: &Error<E>) {
    defmt::error!("storage: {}", error);
}

/// A driver that waits by itself. A node that runs does nothing else meanwhile: it reads and writes at a commit, and never erases.
pub struct Blocking<F>(pub F);

impl<F: blocking::ErrorType> ErrorType for Blocking<F> {
    type Error = F::Error;
}

impl<F: blocking::ReadNorFlash> ReadNorFlash for Blocking<F> {
    const READ_SIZE: usize = F::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<F: blocking::NorFlash> NorFlash for Blocking<F> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        self.0.erase(from, to)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.0.write(offset, bytes)
    }
}
