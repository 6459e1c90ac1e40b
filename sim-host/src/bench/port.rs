//! Serial ports: found, opened, locked.

use super::file::{BenchNode, Where};
use crate::hub::{Attached, Device, HubError, Link, SLICE, Stream};
use crate::interrupt::Interrupt;
use serialport::{ClearBuffer, ErrorKind, SerialPort, SerialPortInfo, SerialPortType, TTYPort};
use std::path::Path;

/// Where Linux lists its terminals; without it there is nothing to find ports by.
const LIST: &str = "/sys/class/tty";

/// A board behind a serial port: it has no log that this program could read.
struct Board {
    at: Where,
    baud: u32,
}

impl Device for Board {
    fn last_words(&mut self, ended: bool) -> Vec<String> {
        vec![if ended {
            "unplugged, switched off, or its debugger restarted it: look at cable and power, then run again"
                .to_owned()
        } else {
            "is the right image on it, is its baud that of the bench file, are TX and RX crossed? `sim-host bench --list` shows who \
             answers where"
                .to_owned()
        }]
    }

    fn reopen(&mut self) -> Option<Box<dyn Stream>> {
        // By its number, if it is known by that: its path may be another one now.
        let path = match &self.at {
            Where::Serial(path) => path.clone(),
            Where::UsbSerial(number) => path_of(number)?,
            Where::Emulator => return None,
        };
        // While the port is still open it cannot be opened again, and need not be.
        Some(Box::new(open(&path, self.baud).ok()?))
    }

    fn into_log(self: Box<Self>) -> Option<String> {
        None
    }
}

/// Opens the port of a node.
///
/// # Errors
/// It does not exist, is in use, may not be opened, or is no serial port.
pub fn attach(node: &BenchNode, path: &str, baud: u32, interrupt: &Interrupt) -> Result<Attached, HubError> {
    let port = open(path, baud).map_err(|(problem, advice)| HubError::Port {
        node: node.id,
        port: path.to_owned(),
        problem,
        advice,
    })?;
    let place = format!("the serial port {path}");
    let link = Link::new(node.id, place, Box::new(port), interrupt.clone());
    Ok(Attached { link, device: Box::new(Board { at: node.at.clone(), baud }), uid: node.uid })
}

/// Opens and locks a port; what came before is thrown away.
///
/// # Errors
/// What the problem is, to follow the port's name, and what to try.
pub fn open(path: &str, baud: u32) -> Result<TTYPort, (String, &'static str)> {
    if !Path::new(path).exists() {
        let advice = "Is the board plugged in? `sim-host bench --list` shows the ports that there are";
        return Err(("does not exist".to_owned(), advice));
    }
    // Exclusive, which is the default: by TIOCEXCL against everybody, by flock against root too.
    let opened = serialport::new(path, baud).timeout(SLICE).open_native();
    let cleared = opened.and_then(|port| port.clear(ClearBuffer::All).map(|()| port));
    cleared.map_err(|error| match error.kind() {
        ErrorKind::NoDevice => (
            "is in use".to_owned(),
            "Another node of the bench file, a terminal program, or another run has it: end that first",
        ),
        ErrorKind::Io(std::io::ErrorKind::PermissionDenied) => (
            "may not be opened".to_owned(),
            "Join the group that owns it: sudo usermod -aG dialout $USER, then log in anew",
        ),
        _ => (
            format!("cannot be opened: {error}"),
            "Is it a serial port? `sim-host bench --list` shows those that there are",
        ),
    })
}

/// The path of the port whose USB adapter has this serial number.
///
/// # Errors
/// There is none.
pub fn find(node: u8, number: &str) -> Result<String, HubError> {
    path_of(number).ok_or_else(|| HubError::Port {
        node,
        port: format!("with the USB serial number {number}"),
        problem: "is not there".to_owned(),
        advice: "Is the board plugged in? `sim-host bench --list` shows the numbers that there are",
    })
}

fn path_of(number: &str) -> Option<String> {
    let found = ports().into_iter().find(|port| usb_serial(port) == Some(number));
    found.map(|port| port.port_name)
}

/// All serial ports of this machine, by name.
pub fn ports() -> Vec<SerialPortInfo> {
    // The library panics without the list, and a list that cannot be read is as good as empty.
    let mut ports = match Path::new(LIST).is_dir() || cfg!(not(target_os = "linux")) {
        true => serialport::available_ports().unwrap_or_default(),
        false => Vec::new(),
    };
    ports.sort_by(|a, b| a.port_name.cmp(&b.port_name));
    ports
}

/// The serial number of a port's USB adapter.
pub fn usb_serial(port: &SerialPortInfo) -> Option<&str> {
    match &port.port_type {
        SerialPortType::UsbPort(usb) => usb.serial_number.as_deref(),
        _ => None,
    }
}
