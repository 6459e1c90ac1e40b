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
            Where::UsbSerial(number) => one_of(0, number, paths_of(number)).ok()?,
            Where::Emulator | Where::Host => return None,
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
/// There is none, or several.
pub fn find(node: u8, number: &str) -> Result<String, HubError> {
    one_of(node, number, paths_of(number))
}

fn one_of(node: u8, number: &str, mut ports: Vec<String>) -> Result<String, HubError> {
    match (ports.pop(), ports.is_empty()) {
        (Some(path), true) => Ok(path),
        (Some(path), false) => {
            ports.push(path);
            Err(HubError::Ambiguous { node, number: number.to_owned(), ports })
        }
        (None, _) => Err(HubError::Port {
            node,
            port: format!("with the USB serial number {number}"),
            problem: "is not there".to_owned(),
            advice: "Is the board plugged in? `sim-host bench --list` shows the numbers that there are",
        }),
    }
}

/// Checks that no two nodes are behind one port, by whatever names.
///
/// # Errors
/// The first port that another node has already.
pub fn distinct(places: &[(u8, String)]) -> Result<(), HubError> {
    // A path that leads nowhere is told of as it is opened.
    let real = |path: &str| std::fs::canonicalize(path).ok();
    for (n, (node, path)) in places.iter().enumerate() {
        let same = |(_, other): &&(u8, String)| real(path).is_some() && real(other) == real(path);
        if let Some(&(other, _)) = places.iter().take(n).find(same) {
            return Err(HubError::OnePort { node: *node, other, port: path.clone() });
        }
    }
    Ok(())
}

/// The ports whose USB adapters have this serial number, by name. macOS has two names for each.
fn paths_of(number: &str) -> Vec<String> {
    let ports = ports().into_iter().filter(|port| usb_serial(port) == Some(number));
    let mut names: Vec<_> = ports.map(|port| port.port_name).collect();
    let twin = |name: &str| name.strip_prefix("/dev/tty.").map(|rest| format!("/dev/cu.{rest}"));
    let all = names.clone();
    names.retain(|name| twin(name).is_none_or(|twin| !all.contains(&twin)));
    names
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_adapters_of_one_number_are_refused_and_both_are_named() {
        let ports = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        assert_eq!(one_of(2, "0001", ports(&["/dev/ttyUSB0"])).unwrap(), "/dev/ttyUSB0");
        let error = one_of(2, "0001", ports(&["/dev/ttyUSB0", "/dev/ttyUSB1"])).unwrap_err().to_string();
        assert!(
            error.starts_with("node 2: the USB serial number 0001 is that of several ports: "),
            "{error}"
        );
        assert!(error.contains("/dev/ttyUSB0, /dev/ttyUSB1"), "{error}");
        let way_out = "in the bench file, in place of usb_serial: serial = \"/dev/ttyUSB0\"";
        assert!(error.ends_with(way_out), "{error}");
        assert!(one_of(2, "0001", Vec::new()).unwrap_err().to_string().contains("is not there"));
    }

    #[test]
    fn one_port_by_two_names_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let (port, link) = (folder.path().join("port"), folder.path().join("link"));
        std::fs::write(&port, "").unwrap();
        std::os::unix::fs::symlink(&port, &link).unwrap();
        let place = |node, path: &Path| (node, path.to_str().unwrap().to_owned());
        let nowhere = (3, "/dev/no-such-port".to_owned());
        assert!(distinct(&[place(1, &port), nowhere.clone(), (4, nowhere.1.clone())]).is_ok());
        let error = distinct(&[place(1, &port), nowhere, place(2, &link)]).unwrap_err().to_string();
        assert!(error.contains("node 2: the serial port") && error.contains("is that of node 1"), "{error}");
    }
}
