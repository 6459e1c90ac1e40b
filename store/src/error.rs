//! Why a configuration could not be stored or read.

use core::fmt;

/// `E` is the error of the flash driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error<E> {
    /// The region does not suit the pages of the flash.
    Region,
    /// Nothing has been staged since the start.
    NotStaged,
    /// Epochs grow with each commit.
    Epoch {
        /// The present one.
        present: u32,
    },
    /// Stored by later firmware, in a layout that this one does not know.
    Newer {
        /// Which.
        layout: u8,
    },
    /// What is in the flash is not what was written.
    Corrupt,
    /// The flash driver's.
    Flash(E),
}

impl<E: fmt::Debug> fmt::Display for Error<E> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Region => write!(f, "the region for storage does not consist of enough whole pages"),
            Self::NotStaged => write!(f, "no configuration is staged"),
            Self::Epoch { present } => write!(f, "the epoch must be larger than the present one, {present}"),
            Self::Newer { layout } => write!(f, "stored by later firmware (layout {layout})"),
            Self::Corrupt => write!(f, "the flash does not hold what was written"),
            Self::Flash(error) => write!(f, "flash: {error:?}"),
        }
    }
}

impl<E: fmt::Debug> core::error::Error for Error<E> {}

#[cfg(feature = "defmt")]
impl<E: fmt::Debug> defmt::Format for Error<E> {
    fn format(&self, f: defmt::Formatter<'_>) {
        match self {
            Self::Region => defmt::write!(f, "region"),
            Self::NotStaged => defmt::write!(f, "nothing staged"),
            Self::Epoch { present } => defmt::write!(f, "epoch not above {=u32}", present),
            Self::Newer { layout } => defmt::write!(f, "newer layout {=u8}", layout),
            Self::Corrupt => defmt::write!(f, "corrupt"),
            Self::Flash(_) => defmt::write!(f, "flash driver"),
        }
    }
}
