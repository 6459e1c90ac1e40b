//! The record that makes a configuration current. Its nine bytes are the same in every layout.

use crc::{CRC_32_ISO_HDLC, Crc, NoTable};
use funnelnet_protocol::service::Key;

use crate::layout;

/// Bytes of a commit record.
pub const LENGTH: usize = 9;

/// A table would save microseconds at a start and cost a kilobyte.
const CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

/// `layout u8, epoch u32, crc u32`, little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Commit {
    /// [Layout](crate::layout) of the configuration.
    pub layout: u8,
    /// How new the configuration is: the larger one counts.
    pub epoch: u32,
    /// [`checksum`] of the configuration and the key.
    pub crc: u32,
}

/// CRC-32/ISO-HDLC over layout, epoch, from layout 3 on 0 or 1 and the key, and the bytes of a configuration.
pub fn checksum(layout: u8, epoch: u32, key: Option<&Key>, config: &[u8]) -> u32 {
    let mut digest = CRC.digest();
    digest.update(&[layout]);
    digest.update(&epoch.to_le_bytes());
    if layout::has_key(layout) {
        digest.update(&[u8::from(key.is_some())]);
        digest.update(key.map_or(&[], |key| &key.0));
    }
    digest.update(config);
    digest.finalize()
}

impl Commit {
    /// Its bytes.
    pub fn encode(&self) -> [u8; LENGTH] {
        let [e0, e1, e2, e3] = self.epoch.to_le_bytes();
        let [c0, c1, c2, c3] = self.crc.to_le_bytes();
        [self.layout, e0, e1, e2, e3, c0, c1, c2, c3]
    }

    /// Reads them; `None` for anything that is no commit record.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let &[layout, e0, e1, e2, e3, c0, c1, c2, c3] = bytes else { return None };
        let (epoch, crc) = (u32::from_le_bytes([e0, e1, e2, e3]), u32::from_le_bytes([c0, c1, c2, c3]));
        // No firmware has written either.
        (layout != 0 && epoch != 0).then_some(Self { layout, epoch, crc })
    }
}
