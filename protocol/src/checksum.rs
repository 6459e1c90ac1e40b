//! One number for a configuration, the same on host and node: both compare it instead of the bytes.

use crate::config::NodeConfig;
use crc::{CRC_32_ISO_HDLC, Crc, Digest, NoTable};
use postcard::ser_flavors::Flavor;

/// A table would cost a kilobyte, and a configuration is looked at once.
static CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISO_HDLC);

impl NodeConfig {
    /// CRC-32/ISO-HDLC over its bytes as CONFIGURE and STAGE carry them. Never 0, which stands for a blank
    /// node.
    pub fn checksum(&self) -> u32 {
        // Nothing that takes every byte can fail.
        postcard::serialize_with_flavor(self, Bytes(CRC.digest())).map_or(1, |crc| crc.max(1))
    }

    /// The same of bytes that are those of a configuration.
    pub fn checksum_of(bytes: &[u8]) -> u32 {
        CRC.checksum(bytes).max(1)
    }
}

/// Takes bytes without keeping them.
struct Bytes(Digest<'static, u32, NoTable>);

impl Flavor for Bytes {
    type Output = u32;

    fn try_push(&mut self, byte: u8) -> postcard::Result<()> {
        self.0.update(&[byte]);
        Ok(())
    }

    fn finalize(self) -> postcard::Result<u32> {
        Ok(self.0.finalize())
    }
}
