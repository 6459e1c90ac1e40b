//! The firmware image on one QEMU per node.

pub mod log;
mod process;
mod sockets;

pub use log::decode as decode_log;
pub use sockets::Sockets;

use crate::hub::{Attached, Device, HubError, Link, Patience, Stream};
use crate::interrupt::Interrupt;
use process::Process;
use std::path::PathBuf;
use std::time::Duration;

/// How long the hub waits for emulated nodes.
pub const PATIENCE: Patience = Patience { boot: Duration::from_secs(10), answer: Duration::from_secs(5) };
/// Lines to neighbours of the emulated board, in the image that has them.
pub const LINES: usize = 4;
/// That image, beside the one without them.
const WITH_LINES: &str = "mps2_peers";
/// How much later than the end of its serial line a dead emulator's exit status may come.
const EXIT: Duration = Duration::from_secs(1);
/// Lines of a node's log that an error quotes.
const LAST_LINES: usize = 5;

/// Where the pieces are.
#[derive(Clone, Debug)]
pub struct EmulatorOptions {
    /// Firmware image (ELF) for `mps2-an386`.
    pub image: PathBuf,
    /// Name or path of the emulator.
    pub qemu: String,
    /// Set when the user wants to stop.
    pub interrupt: Interrupt,
}

/// What an emulated node runs on.
struct Emulated {
    id: u8,
    process: Process,
    options: EmulatorOptions,
    /// The log of its emulators that were switched off.
    earlier: String,
}

/// Starts one emulator per id, all at once, and connects their serial lines.
///
/// # Errors
/// No emulator, no image, an emulator that ends or does not connect in time.
pub fn attach(ids: &[u8], options: &EmulatorOptions) -> Result<Vec<Attached>, HubError> {
    check_image(options)?;
    let mut processes = Vec::new();
    for &id in ids {
        processes.push((id, Process::start(id, &[], options)?));
    }
    processes.into_iter().map(|(id, process)| connect(id, process, options)).collect()
}

/// Starts and connects one emulator whose further lines lead to other ones, where it is wired.
///
/// # Errors
/// As for [`attach`].
pub fn attach_wired(id: u8, sockets: &Sockets, options: &EmulatorOptions) -> Result<Attached, HubError> {
    let lines = sockets.lines_of(id);
    let mut options = options.clone();
    if !lines.is_empty() && options.image.ends_with("mps2_an386") {
        options.image.set_file_name(WITH_LINES);
    }
    check_image(&options)?;
    connect(id, Process::start(id, &lines, &options)?, &options)
}

fn check_image(options: &EmulatorOptions) -> Result<(), HubError> {
    if options.image.is_file() { Ok(()) } else { Err(HubError::NoImage { path: options.image.clone() }) }
}

fn connect(id: u8, mut process: Process, options: &EmulatorOptions) -> Result<Attached, HubError> {
    let stream = process.connect(PATIENCE.boot, &options.interrupt)?;
    let link = Link::new(id, "the emulator".to_owned(), Box::new(stream), options.interrupt.clone());
    let device = Box::new(Emulated { id, process, options: options.clone(), earlier: String::new() });
    Ok(Attached { link, device, uid: None })
}

impl Emulated {
    /// The log so far; without the image it cannot be read.
    fn log(&self) -> String {
        let image = std::fs::read(&self.options.image).unwrap_or_default();
        self.earlier.clone() + &decode_log(&image, &self.process.log())
    }
}

impl Device for Emulated {
    fn last_words(&mut self, ended: bool) -> Vec<String> {
        let mut words = self.process.last_words(if ended { EXIT } else { Duration::ZERO });
        let log = self.log();
        let lines: Vec<_> = log.lines().collect();
        words.extend(lines.iter().rev().take(LAST_LINES).rev().map(|line| format!("its log: {line}")));
        if !ended {
            words.push("an image of another version? Build it with: ./ci.sh firmware".to_owned());
        }
        words
    }

    fn switch(&mut self, on: bool) -> Result<Option<Box<dyn Stream>>, HubError> {
        self.process.end();
        if !on {
            return Ok(Some(Box::new(std::io::empty())));
        }
        self.earlier = self.log();
        self.process = Process::start(self.id, &[], &self.options)?;
        let stream = self.process.connect(PATIENCE.boot, &self.options.interrupt)?;
        Ok(Some(Box::new(stream)))
    }

    fn into_log(mut self: Box<Self>) -> Option<String> {
        self.process.end();
        Some(self.log())
    }
}
