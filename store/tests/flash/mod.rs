//! NOR flash with the manners of the real one: writing clears bits, erasing sets them, and the power can fail
//! in between.
#![allow(dead_code)] // each test uses a part

use core::ops::Range;
use core::task::{Context, Poll, Waker};
use std::pin::pin;

use embedded_storage_async::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use funnelnet_protocol::NodeConfig;
use funnelnet_store::split::{Split, SplitError};
use funnelnet_store::{Error, Store};

/// Moments of an erase at which the power can fail, per page; each leaves another mixture.
pub const ERASE_STEPS: u64 = 8;

/// The power is off, or the access is one that the chip refuses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    PowerCut,
    Kind(NorFlashErrorKind),
    /// A word that is not erased was written: chips with ECC refuse that.
    NotErased,
}

impl NorFlashError for Fault {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Kind(kind) => *kind,
            _ => NorFlashErrorKind::Other,
        }
    }
}

/// `WORD` bytes are written at once, `PAGE` bytes erased.
#[derive(Clone)]
pub struct Flash<const WORD: usize, const PAGE: usize> {
    pub bytes: Vec<u8>,
    /// Bytes and erase steps done since the start.
    pub steps: u64,
    /// Steps after which the power fails.
    pub cut_after: Option<u64>,
    /// Chooses the bits that an interrupted write or erase has changed.
    pub seed: u64,
}

impl<const WORD: usize, const PAGE: usize> Flash<WORD, PAGE> {
    /// Erased pages.
    pub fn new(pages: usize) -> Self {
        Self { bytes: vec![0xFF; pages * PAGE], steps: 0, cut_after: None, seed: 1 }
    }

    /// One more step, or the power fails in it.
    fn step(&mut self) -> Result<(), Fault> {
        if self.cut_after.is_some_and(|n| self.steps >= n) {
            return Err(Fault::PowerCut);
        }
        self.steps += 1;
        Ok(())
    }

    /// Whole units within the flash.
    fn check(&self, offset: u32, length: usize, unit: usize) -> Result<(), Fault> {
        let start = offset as usize;
        if !start.is_multiple_of(unit) || !length.is_multiple_of(unit) {
            return Err(Fault::Kind(NorFlashErrorKind::NotAligned));
        }
        if start + length > self.bytes.len() {
            return Err(Fault::Kind(NorFlashErrorKind::OutOfBounds));
        }
        Ok(())
    }

    /// splitmix64.
    fn random(&mut self) -> u64 {
        self.seed = self.seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.seed;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// What an erase leaves that is interrupted in its step `step`.
    fn interrupted_erase(&mut self, page: usize, step: u64) {
        for i in 0..PAGE {
            let random = self.random();
            let old = self.bytes[page + i];
            self.bytes[page + i] = match step {
                0 => old,
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

impl<const WORD: usize, const PAGE: usize> ErrorType for Flash<WORD, PAGE> {
    type Error = Fault;
}

impl<const WORD: usize, const PAGE: usize> ReadNorFlash for Flash<WORD, PAGE> {
    const READ_SIZE: usize = 1;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Fault> {
        self.check(offset, bytes.len(), 1)?;
        bytes.copy_from_slice(&self.bytes[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes.len()
    }
}

impl<const WORD: usize, const PAGE: usize> NorFlash for Flash<WORD, PAGE> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Fault> {
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

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Fault> {
        self.check(offset, bytes.len(), WORD)?;
        let start = offset as usize;
        if self.bytes[start..start + bytes.len()].iter().any(|&byte| byte != 0xFF) {
            return Err(Fault::NotErased);
        }
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

/// A flash that a store is tried on, in a region between pages that belong to somebody else.
pub trait Chip: NorFlash + Clone {
    /// The whole flash, erased.
    fn erased() -> Self;
    /// Where the store is.
    fn region() -> Range<u32>;
    fn cells(&mut self) -> &mut dyn Cells;
    /// What went wrong in the cells.
    fn fault(error: Self::Error) -> Fault;

    /// Power comes back, to be cut again after `cut_after` steps.
    fn restarted(mut self, cut_after: Option<u64>) -> Self {
        self.cells().restart(cut_after);
        self
    }
}

/// What a test looks at and sets.
pub trait Cells {
    fn bytes(&self) -> &[u8];
    fn steps(&self) -> u64;
    fn restart(&mut self, cut_after: Option<u64>);
}

impl<const WORD: usize, const PAGE: usize> Cells for Flash<WORD, PAGE> {
    fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    fn steps(&self) -> u64 {
        self.steps
    }

    fn restart(&mut self, cut_after: Option<u64>) {
        (self.steps, self.cut_after) = (0, cut_after);
    }
}

impl<const WORD: usize, const PAGE: usize> Chip for Flash<WORD, PAGE> {
    fn erased() -> Self {
        Self::new(6)
    }

    fn region() -> Range<u32> {
        PAGE as u32..5 * PAGE as u32
    }

    fn cells(&mut self) -> &mut dyn Cells {
        self
    }

    fn fault(error: Fault) -> Fault {
        error
    }
}

/// Two erase pages are enough where each is shown as two.
impl<const WORD: usize, const PAGE: usize> Chip for Split<Flash<WORD, PAGE>, 2> {
    fn erased() -> Self {
        Self(Flash::new(4))
    }

    fn region() -> Range<u32> {
        PAGE as u32..3 * PAGE as u32
    }

    fn cells(&mut self) -> &mut dyn Cells {
        &mut self.0
    }

    fn fault(error: SplitError<Fault>) -> Fault {
        match error {
            SplitError::Flash(fault) => fault,
            error => panic!("{error}"),
        }
    }
}

/// What [`Store::load`] puts into a room.
pub async fn load<S: NorFlash>(store: &mut Store<S>) -> Result<Option<NodeConfig>, Error<S::Error>> {
    let mut room = None;
    store.load(&mut room).await.map(|()| room)
}

/// The result of a future that never waits.
pub fn now<T>(future: impl Future<Output = T>) -> T {
    match pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("flash in memory never waits"),
    }
}
