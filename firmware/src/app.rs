//! The app of every board.

use embedded_io_async::{Read, Write};

/// Sends back what it receives, until the link fails.
pub async fn run<L: Read + Write>(mut link: L) -> L::Error {
    defmt::info!("ready");
    loop {
        if let Err(error) = echo(&mut link).await {
            return error;
        }
    }
}

/// Sends back the bytes that are there.
pub(crate) async fn echo<L: Read + Write>(link: &mut L) -> Result<(), L::Error> {
    let mut buffer = [0; 256];
    let count = link.read(&mut buffer).await?;
    link.write_all(&buffer[..count]).await
}
