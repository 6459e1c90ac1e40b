//! NOR flash of a chip without ECC: writing clears bits, erasing sets them, and the power can fail at every
//! byte of a write and in eight ways in an erase. As `store/tests/flash`, for drivers that wait, too; a
//! word may be written again, which clears more bits.
#![allow(dead_code, reason = "each test uses a part")]
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests fail so")]

use core::task::{Context, Poll, Waker};
use std::pin::pin;

use embedded_storage::nor_flash as blocking;
use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};

/// Bytes of a page, as small as a store takes.
pub const PAGE: usize = 2048;
/// Moments of an erase at which the power can fail; each leaves another mixture.
const ERASE_STEPS: u64 = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    PowerCut,
    Access(NorFlashErrorKind),
}

impl NorFlashError for Fault {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::PowerCut => NorFlashErrorKind::Other,
            Self::Access(kind) => *kind,
        }
    }
}

/// What a chip holds.
#[derive(Clone)]
pub struct Flash {
    pub bytes: Vec<u8>,
    /// Steps done since the start.
    pub steps: u64,
    /// Steps after which the power fails.
    pub cut_after: Option<u64>,
    /// Chooses the bits that an interrupted write or erase has changed.
    pub seed: u64,
}

impl Flash {
    pub fn new(pages: usize) -> Self {
        Self { bytes: vec![0xFF; pages * PAGE], steps: 0, cut_after: None, seed: 1 }
    }

    /// Power comes back, to be cut again after so many steps.
    pub fn restart(&mut self, cut_after: Option<u64>) {
        (self.steps, self.cut_after) = (0, cut_after);
    }

    fn step(&mut self) -> Result<(), Fault> {
        if self.cut_after.is_some_and(|n| self.steps >= n) {
            return Err(Fault::PowerCut);
        }
        self.steps += 1;
        Ok(())
    }

    fn check(&self, offset: u32, length: usize, unit: usize) -> Result<(), Fault> {
        let start = offset as usize;
        if !start.is_multiple_of(unit) || !length.is_multiple_of(unit) {
            return Err(Fault::Access(NorFlashErrorKind::NotAligned));
        }
        match start + length > self.bytes.len() {
            true => Err(Fault::Access(NorFlashErrorKind::OutOfBounds)),
            false => Ok(()),
        }
    }

    /// splitmix64.
    fn random(&mut self) -> u64 {
        self.seed = self.seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.seed;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn interrupted_erase(&mut self, page: usize, step: u64) {
        for i in 0..PAGE {
            let random = self.random();
            let old = self.bytes[page + i];
            self.bytes[page + i] = match step {
                1 if i < PAGE / 2 => 0xFF,
                2 if i >= PAGE / 2 => 0xFF,
                // Weak cells first: some bits of every byte.
                3 => old | random as u8,
                4 => old | random as u8 | (random >> 8) as u8 | (random >> 16) as u8,
                // What marks the page is last to go, or first.
                5 if (32..PAGE - 32).contains(&i) => 0xFF,
                6 if !(32..PAGE - 32).contains(&i) => 0xFF,
                7 if !random.is_multiple_of(100) => 0xFF,
                _ => old,
            };
        }
    }
}

impl ErrorType for Flash {
    type Error = Fault;
}

impl blocking::ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Fault> {
        self.check(offset, bytes.len(), 1)?;
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl blocking::NorFlash for Flash {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Fault> {
        self.check(from, to.saturating_sub(from) as usize, PAGE)?;
        for page in (from as usize..to as usize).step_by(PAGE) {
            for step in 0..ERASE_STEPS {
                if let Err(fault) = self.step() {
                    self.interrupted_erase(page, step);
                    return Err(fault);
                }
            }
            self.bytes[page..page + PAGE].fill(0xFF);
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Fault> {
        self.check(offset, bytes.len(), 1)?;
        let start = offset as usize;
        for (i, &byte) in bytes.iter().enumerate() {
            if let Err(fault) = self.step() {
                // Some of this byte's bits have been cleared already.
                self.bytes[start + i] &= byte | self.random() as u8;
                return Err(fault);
            }
            self.bytes[start + i] &= byte;
        }
        Ok(())
    }
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Fault> {
        blocking::ReadNorFlash::read(self, offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Fault> {
        blocking::NorFlash::erase(self, from, to)
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Fault> {
        blocking::NorFlash::write(self, offset, bytes)
    }
}

/// The result of a future that never waits.
pub fn now<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("flash in memory never waits"),
    }
}
