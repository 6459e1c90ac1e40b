//! How a configuration is written, and how older firmware wrote it.
//!
//! postcard writes the fields of a struct one after the other, and each of those that [`NodeConfig`] has gained since is an integer, or
//! a `bool`, that means "as before" at 0 and is one zero byte then. So an older configuration is read as if its missing bytes were zeros.

use funnel_protocol::NodeConfig;
use postcard::{Error, Result};

use crate::BUFFER;

/// What is written now; the number and what it stands for are in the commit record. 1 was the first. A field more at the end
/// of `NodeConfig` changes the bytes, and needs a new number, an arm in [`missing`] and golden bytes in tests/layout.rs.
pub const LAYOUT: u8 = 3;

/// Whether a key can be beside the configuration.
pub(crate) fn has_key(layout: u8) -> bool {
    layout >= 3
}

/// Fields of `NodeConfig` that a layout does not have; `None` for one that is not known.
fn missing(layout: u8) -> Option<usize> {
    match layout {
        // lost_neighbours, holdover_ns
        1 => Some(2),
        2 | LAYOUT => Some(0),
        _ => None,
    }
}

/// Puts the configuration that `bytes` are in this layout into `room`, `None` for a blank node; `Err` where they are none.
// Not into its callers: it needs a second copy of it on its stack.
#[inline(never)]
pub(crate) fn read(layout: u8, bytes: &[u8], room: &mut Option<NodeConfig>) -> Result<()> {
    let missing = missing(layout).ok_or(Error::DeserializeBadEncoding)?;
    // Copied, so that the image has one reader of configurations for storage and wire: a second one takes 6 KiB (2026-11-24).
    let mut lengthened = [0; BUFFER];
    let place = lengthened.get_mut(..bytes.len()).ok_or(Error::DeserializeBadEncoding)?;
    place.copy_from_slice(bytes);
    let lengthened = lengthened.get(..bytes.len() + missing).ok_or(Error::DeserializeBadEncoding)?;
    let (config, rest) = postcard::take_from_bytes::<Option<NodeConfig>>(lengthened)?;
    // A blank node lacks nothing.
    let left = if config.is_some() { 0 } else { missing };
    if rest.len() != left {
        return Err(Error::DeserializeBadEncoding);
    }
    *room = config;
    Ok(())
}
