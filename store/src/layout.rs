//! How a configuration is written, and how older firmware wrote it.
//!
//! postcard writes the fields of a struct one after the other, and each of those that [`NodeConfig`] has
//! gained since is a number, a `bool` or a list, that means "as before" at 0, or empty, and is nothing but
//! zero bytes then. So an older configuration is read as if its missing bytes were zeros.
//!
//! Limits of what is heard come behind all of that and are written only where there are any. They need no new
//! layout. Firmware that does not know them finds such a configuration too long, and does not run by it.

use funnelnet_protocol::{NodeConfig, Refusal};

/// What is written now; the number and what it stands for are in the commit record. 1 was the first. A field
/// more at the end of `NodeConfig` changes the bytes, and needs a new number, an arm in `missing` and golden
/// bytes in tests/layout.rs.
pub const LAYOUT: u8 = 4;

/// Whether a key can be beside the configuration.
pub(crate) fn has_key(layout: u8) -> bool {
    layout >= 3
}

/// Bytes of a `NodeConfig` that a layout does not have; `None` for one that is not known.
fn missing(layout: u8) -> Option<usize> {
    /// Four f32, a u8, and a u16 that is a byte at zero.
    const TUNING: usize = 18;
    /// Two lists without entries, and two f32.
    const PROGRAM: usize = 10;
    match layout {
        // lost_neighbours, holdover_ns, one byte each at zero
        1 => Some(2 + TUNING + PROGRAM),
        2 | 3 => Some(TUNING + PROGRAM),
        LAYOUT => Some(0),
        _ => None,
    }
}

/// Puts the configuration that `bytes` are in this layout into `room`, `None` for a blank node.
///
/// # Errors
/// They are none; the room is empty then.
pub(crate) fn read(layout: u8, bytes: &[u8], room: &mut Option<NodeConfig>) -> Result<(), Refusal> {
    *room = None;
    let missing = missing(layout).ok_or(Refusal::Value)?;
    match bytes {
        // A blank node lacks nothing.
        [0] => Ok(()),
        [1, bytes @ ..] => {
            let read = room.insert(NodeConfig::empty()).read_older(bytes, missing);
            if read.is_err() {
                *room = None;
            }
            read
        }
        _ => Err(Refusal::Value),
    }
}
