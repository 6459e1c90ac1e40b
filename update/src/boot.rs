//! What a boot loader does before it starts a program. The image and the tests run this one.

use core::cell::RefCell;

use embassy_boot::{BootError, BootLoader, BootLoaderConfig, State};
use embassy_embedded_hal::flash::partition::BlockingPartition;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embedded_storage::nor_flash::NorFlash;

use crate::{Regions, Wide};

/// A flash that is shown in parts.
pub type Shared<F> = Mutex<NoopRawMutex, RefCell<F>>;

/// Swaps programs, forward or back, if that is due or was cut off; gives the state that it has found.
///
/// `buffer` is what is copied at once: it divides a page and is a multiple of a write.
///
/// # Errors
/// Of the flash. The next start goes on.
///
/// # Panics
/// Regions that do not [suit](Regions::suit) the flash, or a buffer that does not.
pub fn prepare<F: NorFlash>(
    flash: &Shared<F>,
    regions: &Regions,
    buffer: &mut [u8],
) -> Result<State, BootError> {
    prepare_with::<F, { crate::WORD }>(flash, regions, buffer)
}

/// The same with other words of the state.
///
/// # Errors
/// As for [`prepare`].
///
/// # Panics
/// As for [`prepare`].
pub fn prepare_with<F: NorFlash, const W: usize>(
    flash: &Shared<F>,
    regions: &Regions,
    buffer: &mut [u8],
) -> Result<State, BootError> {
    let part = |range: &core::ops::Range<u32>| {
        BlockingPartition::new(flash, range.start, range.end.saturating_sub(range.start))
    };
    let parts = BootLoaderConfig {
        active: part(&regions.active),
        dfu: part(&regions.spare),
        state: Wide::<_, W>(part(&regions.state)),
    };
    BootLoader::new(parts).prepare_boot(buffer)
}
