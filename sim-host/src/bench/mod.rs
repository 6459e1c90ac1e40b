//! Nodes behind serial ports: which they are, how they are opened, and what is kept of a run on them.

mod compare;
mod file;
mod list;
mod port;
mod record;

pub use compare::{Comparison, Difference};
pub use file::{BenchFile, BenchNode, Where};
pub use list::{Listed, list};
pub use record::Stampings;

use crate::emulator::{self, EmulatorOptions};
use crate::hub::{Attached, HubError};

/// Opens what the bench file names for `ids`, in that order; other entries of the file are left alone.
///
/// # Errors
/// The first port or emulator that cannot be used.
pub fn attach(file: &BenchFile, ids: &[u8], options: &EmulatorOptions) -> Result<Vec<Attached>, HubError> {
    let mut attached: Vec<Attached> = Vec::new();
    for node in ids.iter().filter_map(|&id| file.node(id)) {
        let one = match &node.at {
            Where::Emulator => emulator::attach(&[node.id], options)?,
            Where::Serial(path) => vec![port::attach(node, path, file.baud, &options.interrupt)?],
            Where::UsbSerial(number) => {
                let path = port::find(node.id, number)?;
                vec![port::attach(node, &path, file.baud, &options.interrupt)?]
            }
        };
        attached.extend(one);
    }
    Ok(attached)
}
