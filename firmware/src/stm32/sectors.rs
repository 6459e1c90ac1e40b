//! The first four sectors of an STM32F4's flash, 16 KiB each, with two traps of embassy-stm32 0.6 worked
//! round: its driver of the whole flash knows only the largest size of a sector, and erases byte by byte,
//! since every write leaves PSIZE at 8 bits.
//!
//! Longest erase of a sector (data sheet): 500 ms by words, 800 ms by bytes. Single bank: the core stands
//! still meanwhile. The data cache does not notice an erase: it is off meanwhile, and emptied.

use embassy_stm32::flash::{self, Bank1Region1, Blocking, Flash};
use embassy_stm32::pac::FLASH;
use embassy_stm32::pac::flash::vals::Psize;
use embassy_stm32::{Peri, peripherals};
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

use super::stalls;

/// RM0390, FLASH_KEYR.
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// Sectors 0 to 3.
pub struct Sectors(Bank1Region1<'static, Blocking>);

impl Sectors {
    /// The driver; nothing is read or written yet.
    pub fn new(flash: Peri<'static, peripherals::FLASH>) -> Self {
        Self(Flash::new_blocking(flash).into_blocking_regions().bank1_region1)
    }
}

/// Erases by words, from 2.7 V on. The driver takes the open lock as it is, keeps the size, and locks.
fn erase_by_words() {
    if FLASH.cr().read().lock() {
        KEYS.iter().for_each(|key| FLASH.keyr().write_value(*key));
    }
    FLASH.cr().modify(|cr| cr.set_psize(Psize::PSIZE32));
}

/// Reads flash through its caches, and ahead: with 5 wait states at 160 MHz the core would wait for most of its instructions. embassy leaves them off.
pub fn use_caches() {
    FLASH.acr().modify(|acr| {
        acr.set_prften(true);
        acr.set_icen(true);
        acr.set_dcen(true);
    });
}

/// Erases with the data cache off, and empties it. The cache of instructions has none of what is erased: no program is there. RM0390, "Flash memory erase".
fn without_data_cache<R>(erase: impl FnOnce() -> R) -> R {
    FLASH.acr().modify(|acr| acr.set_dcen(false));
    let done = erase();
    FLASH.acr().modify(|acr| acr.set_dcrst(true));
    FLASH.acr().modify(|acr| acr.set_dcrst(false));
    FLASH.acr().modify(|acr| acr.set_dcen(true));
    done
}

impl ErrorType for Sectors {
    type Error = flash::Error;
}

impl ReadNorFlash for Sectors {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), flash::Error> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for Sectors {
    const WRITE_SIZE: usize = <Bank1Region1<'static, Blocking> as NorFlash>::WRITE_SIZE;
    const ERASE_SIZE: usize = <Bank1Region1<'static, Blocking> as NorFlash>::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), flash::Error> {
        erase_by_words();
        without_data_cache(|| stalls::over(|| self.0.erase(from, to)))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), flash::Error> {
        self.0.write(offset, bytes)
    }
}
