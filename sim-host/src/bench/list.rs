//! Who answers at which serial port.

use super::file::{BenchFile, DEFAULT_BAUD, Where};
use super::port;
use crate::hub::{Link, Talk};
use crate::interrupt::Interrupt;
use funnelnet_protocol::service::Identity;
use std::fmt;
use std::time::Duration;

/// How long a port may take to say who it is: a board restarts when its port is opened.
const ANSWER: Duration = Duration::from_secs(2);

/// A serial port, and what answered there.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Listed {
    /// Its path.
    pub path: String,
    /// Serial number of its USB adapter.
    pub usb_serial: Option<String>,
    /// The node there, or why there is none.
    pub answer: Result<Identity, String>,
}

/// Asks every serial port of this machine, and those that `file` names besides, who is there.
pub fn list(file: Option<&BenchFile>, interrupt: &Interrupt) -> Vec<Listed> {
    let baud = file.map_or(DEFAULT_BAUD, |file| file.baud);
    let mut ports: Vec<(String, Option<String>)> = port::ports()
        .iter()
        .map(|port| (port.port_name.clone(), port::usb_serial(port).map(str::to_owned)))
        .collect();
    for node in file.into_iter().flat_map(|file| &file.nodes) {
        match &node.at {
            Where::Serial(path) if ports.iter().all(|(known, _)| known != path) => {
                ports.push((path.clone(), None))
            }
            _ => {}
        }
    }
    let ask = |(path, usb_serial): (String, Option<String>)| {
        let answer = ask(&path, baud, interrupt);
        Listed { path, usb_serial, answer }
    };
    ports.into_iter().map(ask).collect()
}

fn ask(path: &str, baud: u32, interrupt: &Interrupt) -> Result<Identity, String> {
    let port = port::open(path, baud).map_err(|(problem, _)| problem)?;
    // No node has been given an id here; 0 stands for whoever answers.
    let link = Link::new(0, format!("the serial port {path}"), Box::new(port), interrupt.clone());
    let mut talk = Talk::new(link);
    talk.identify(ANSWER).map_err(|_| match talk.sound() {
        Some(sound) => format!("no node answers; {sound}"),
        None => "no node answers".to_owned(),
    })
}

impl fmt::Display for Listed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { path, usb_serial, answer } = self;
        write!(f, "{path}")?;
        if let Some(number) = usb_serial {
            write!(f, "  usb_serial = \"{number}\"")?;
        }
        match answer {
            Ok(Identity {
                wire_version,
                firmware: [major, minor, patch],
                id,
                uid,
                reset,
                starts,
                checksum,
                has_key,
            }) => {
                write!(
                    f,
                    "  uid = \"{uid:016x}\"  firmware {major}.{minor}.{patch}, wire version {wire_version}, "
                )?;
                if *id == 0 {
                    f.write_str("blank")?
                } else {
                    write!(f, "id {id} with configuration {checksum:08x}")?
                }
                if *has_key {
                    f.write_str(", a key")?;
                }
                write!(f, ", last reset: {reset}, starts: {starts}")
            }
            Err(why) => write!(f, "  {why}"),
        }
    }
}
