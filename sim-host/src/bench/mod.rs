//! Nodes behind serial ports, on CAN or in processes: which they are, how they are opened, and what is kept
//! of a run on them.

mod clock;
mod compare;
mod file;
mod host;
mod list;
mod port;
mod record;
mod skew;
mod wires;

pub use clock::{Clock, ticks_until_apart};
pub use compare::{Comparison, Difference};
pub use file::{BenchFile, BenchNode, DEFAULT_BAUD, Where};
pub use list::{Listed, list};
pub use port::open as open_port;
pub use record::Stampings;
pub use skew::Skew;
pub use wires::Wire;

use crate::can::{CanPort, Own};
use crate::emulator::{self, EmulatorOptions, Sockets};
use crate::hub::{Attached, CanSide, HubError};

/// Opens those CAN interfaces of the file that one of `ids` is on, in the order of the file.
///
/// # Errors
/// The first that cannot be used.
pub fn can_sides(file: &BenchFile, ids: &[u8]) -> Result<Vec<CanSide>, HubError> {
    let open = |interface: &String| {
        let port = CanPort::open(interface, Own::Heard, file.can_fd);
        let port = port.map_err(|error| HubError::NoCan { problem: error.to_string() })?;
        Ok(CanSide::new(interface.clone(), port, file.can_fd))
    };
    file.interfaces(ids).into_iter().map(open).collect()
}

/// Opens what the bench file names for `ids`, in that order; other entries of the file are left alone.
///
/// # Errors
/// The first port or emulator that cannot be used.
pub fn attach(file: &BenchFile, ids: &[u8], options: &EmulatorOptions) -> Result<Vec<Attached>, HubError> {
    let pairs = file
        .wires
        .iter()
        .map(|wire| wire.between)
        .filter(|(one, other)| ids.contains(one) && ids.contains(other));
    let ports = ports(file, ids)?;
    // Until all are connected.
    let sockets = Sockets::new(pairs)?;
    let mut attached: Vec<Attached> = Vec::new();
    for node in ids.iter().filter_map(|&id| file.node(id)) {
        let one = match &node.at {
            Where::Emulator => emulator::attach_wired(node.id, &sockets, options)?,
            Where::Host => host::attach(node, file.can_fd, options)?,
            Where::Serial(_) | Where::UsbSerial(_) => {
                let Some((_, path)) = ports.iter().find(|(id, _)| *id == node.id) else { continue };
                port::attach(node, path, file.baud, &options.interrupt)?
            }
        };
        attached.push(one);
    }
    Ok(attached)
}

/// The serial ports of those of `ids` that have one, by id.
///
/// # Errors
/// A number that no port has, or several have; a port that two nodes have.
fn ports(file: &BenchFile, ids: &[u8]) -> Result<Vec<(u8, String)>, HubError> {
    let mut ports = Vec::new();
    for node in ids.iter().filter_map(|&id| file.node(id)) {
        match &node.at {
            Where::Serial(path) => ports.push((node.id, path.clone())),
            Where::UsbSerial(number) => ports.push((node.id, port::find(node.id, number)?)),
            Where::Emulator | Where::Host => {}
        }
    }
    port::distinct(&ports)?;
    Ok(ports)
}
