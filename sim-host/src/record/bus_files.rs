//! `can.log`, as `candump -L` writes it, and `can.pcapng`, as Wireshark reads it: what was on the buses of a
//! run, written as it comes.

use super::atomic::{AtomicFile, RecordError};
use funnelnet_can_bus::{Capture, Line, Record};
use std::path::Path;

/// What was on a bus: its index among the interfaces, and what.
pub type OnBus = (usize, Record);

/// Which files are wanted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BusLogs {
    /// `can.log`
    pub log: bool,
    /// `can.pcapng`
    pub capture: bool,
}

impl Default for BusLogs {
    fn default() -> Self {
        Self { log: true, capture: false }
    }
}

impl BusLogs {
    /// Whether there is any.
    #[must_use]
    pub fn any(self) -> bool {
        self.log || self.capture
    }
}

/// The files of a run, which get their names at its end.
pub struct BusFiles {
    interfaces: Vec<String>,
    log: Option<AtomicFile>,
    capture: Option<Capture<AtomicFile>>,
}

impl BusFiles {
    /// Opens those of `wanted` in `folder`, for these interfaces; none where there is no interface.
    ///
    /// # Errors
    /// [`RecordError`], naming the file and the reason.
    pub fn create(folder: &Path, wanted: BusLogs, interfaces: Vec<String>) -> Result<Self, RecordError> {
        let wanted = if interfaces.is_empty() { BusLogs { log: false, capture: false } } else { wanted };
        let create = |name: &str| AtomicFile::create(folder.join(name));
        let log = wanted.log.then(|| create("can.log")).transpose()?;
        let capture = wanted.capture.then(|| {
            let file = create("can.pcapng")?;
            let path = file.path().to_owned();
            let names: Vec<_> = interfaces.iter().map(String::as_str).collect();
            Capture::new(file, &names).map_err(|reason| RecordError { path, reason })
        });
        Ok(Self { capture: capture.transpose()?, interfaces, log })
    }

    /// Appends what was on the buses.
    ///
    /// # Errors
    /// [`RecordError`], for example on a full disk.
    pub fn write(&mut self, heard: &[OnBus]) -> Result<(), RecordError> {
        let Self { interfaces, log, capture } = self;
        if let Some(log) = log {
            log.write(|out| {
                let named = heard.iter().filter_map(|(bus, record)| Some((interfaces.get(*bus)?, record)));
                named
                    .into_iter()
                    .try_for_each(|(interface, record)| writeln!(out, "{}", Line { interface, record }))
            })?;
        }
        if let Some(capture) = capture {
            let written = heard.iter().try_for_each(|(bus, record)| capture.write(*bus as u32, record));
            written.map_err(|reason| RecordError { path: "can.pcapng".into(), reason })?;
        }
        Ok(())
    }

    /// The whole files, under their temporary names.
    pub fn into_files(self) -> impl Iterator<Item = AtomicFile> {
        self.log.into_iter().chain(self.capture.map(|capture| capture.into_inner()))
    }
}
