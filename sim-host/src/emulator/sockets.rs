//! Wires between emulators: a socket each, which the one makes that is started first, and the other connects
//! to.

use crate::hub::HubError;
use tempfile::TempDir;

/// Wires between emulated nodes. Their sockets have a folder of their own until this is dropped; who is
/// connected stays so.
pub struct Sockets {
    folder: TempDir,
    /// Ids, the lower one first.
    pairs: Vec<(u8, u8)>,
}

impl Sockets {
    /// For wires between these ids, the lower one first.
    ///
    /// # Errors
    /// The operating system's.
    pub fn new(pairs: impl Iterator<Item = (u8, u8)>) -> Result<Self, HubError> {
        let folder = tempfile::Builder::new().prefix("funnelnet-wires-").tempdir();
        let folder = folder.map_err(HubError::io("make a temporary folder"))?;
        Ok(Self { folder, pairs: pairs.collect() })
    }

    /// What the lines of node `id` lead to, as the emulator is told. The first of two that asks makes the
    /// socket, and must have done so before the other one asks.
    pub(super) fn lines_of(&self, id: u8) -> Vec<String> {
        let ends = |&(low, high): &(u8, u8)| {
            let path = self.folder.path().join(format!("{low}-{high}"));
            let makes = if path.exists() { "" } else { ",server=on,wait=off" };
            (id == low || id == high).then(|| format!("path={}{makes}", path.display()))
        };
        self.pairs.iter().filter_map(ends).collect()
    }
}
