//! How a configuration is written, and how older firmware wrote it.
//!
//! postcard writes the fields of a struct one after the other, and each of those that [`NodeConfig`] has gained since is an integer, or
//! a `bool`, that means "as before" at 0 and is one zero byte then. So an older configuration is read as if its missing bytes were zeros.

use funnel_protocol::NodeConfig;
use postcard::Deserializer;
use postcard::de_flavors::Flavor;
use postcard::{Error, Result};

/// What is written now; the number and what it stands for are in the commit record. 1 was the first. A field more at the end
/// of `NodeConfig` changes the bytes, and needs a new number, an arm in [`missing`] and golden bytes in tests/layout.rs.
pub const LAYOUT: u8 = 2;

/// Fields of `NodeConfig` that a layout does not have; `None` for one that is not known.
fn missing(layout: u8) -> Option<u8> {
    match layout {
        // lost_neighbours, holdover_ns
        1 => Some(2),
        LAYOUT => Some(0),
        _ => None,
    }
}

/// The configuration that `bytes` are in this layout, `None` for a blank node; `Err` where they are none.
pub fn read(layout: u8, bytes: &[u8]) -> Result<Option<NodeConfig>> {
    let missing = missing(layout).ok_or(Error::DeserializeBadEncoding)?;
    let mut reader = Deserializer::from_flavor(Lengthened { bytes, missing });
    let config: Option<NodeConfig> = serde::Deserialize::deserialize(&mut reader)?;
    let Lengthened { bytes, missing } = reader.finalize()?;
    let whole = bytes.is_empty() && (missing == 0 || config.is_none());
    if whole { Ok(config) } else { Err(Error::DeserializeBadEncoding) }
}

/// Bytes, and so many zeros after them.
struct Lengthened<'a> {
    bytes: &'a [u8],
    missing: u8,
}

impl<'a> Flavor<'a> for Lengthened<'a> {
    type Remainder = Self;
    type Source = &'a [u8];

    fn pop(&mut self) -> Result<u8> {
        if let Some((&byte, rest)) = self.bytes.split_first() {
            self.bytes = rest;
            return Ok(byte);
        }
        self.missing = self.missing.checked_sub(1).ok_or(Error::DeserializeUnexpectedEnd)?;
        Ok(0)
    }

    fn try_take_n(&mut self, count: usize) -> Result<&'a [u8]> {
        let (taken, rest) = self.bytes.split_at_checked(count).ok_or(Error::DeserializeUnexpectedEnd)?;
        self.bytes = rest;
        Ok(taken)
    }

    fn finalize(self) -> Result<Self> {
        Ok(self)
    }
}
