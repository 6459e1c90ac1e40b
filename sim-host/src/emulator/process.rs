//! One QEMU process: started, connected, and ended whatever happens.

use super::{EmulatorError, EmulatorOptions};
use crate::interrupt::Interrupt;
use std::fs::File;
use std::io::ErrorKind;
use std::os::unix::net::{UnixListener, UnixStream};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The emulator's files, in a temporary folder of its own: serial line, defmt log, its own complaints.
const SOCKET: &str = "uart";
const LOG: &str = "log";
const ERRORS: &str = "stderr";

/// A running emulator; dropping it ends it.
pub struct Process {
    id: u8,
    child: Child,
    listener: UnixListener,
    /// Socket, log and error output live here, and go with it.
    folder: TempDir,
}

impl Process {
    /// Starts the emulator of node `id`.
    ///
    /// # Errors
    /// No such emulator, or the operating system's.
    pub fn start(id: u8, options: &EmulatorOptions) -> Result<Self, EmulatorError> {
        let folder = tempfile::Builder::new()
            .prefix("funnelnet-")
            .tempdir()
            .map_err(EmulatorError::io("make a temporary folder"))?;
        let listener = UnixListener::bind(folder.path().join(SOCKET))
            .and_then(|listener| listener.set_nonblocking(true).map(|()| listener))
            .map_err(EmulatorError::io("listen for the emulator's serial line"))?;
        let log = File::create(folder.path().join(LOG)).map_err(EmulatorError::io("make the log file"))?;
        let errors = File::create(folder.path().join(ERRORS))
            .map_err(EmulatorError::io("make the emulator's error file"))?;
        let child = command(&options.qemu, &options.image, folder.path())
            .stdin(Stdio::null())
            .stdout(log)
            .stderr(errors)
            .process_group(0)
            .spawn()
            .map_err(|source| match source.kind() {
                ErrorKind::NotFound => EmulatorError::NoQemu { command: options.qemu.clone() },
                _ => EmulatorError::Io { what: "start the emulator", source },
            })?;
        Ok(Self { id, child, listener, folder })
    }

    /// Waits until the emulator connects its serial line.
    ///
    /// # Errors
    /// It ends, or does not connect within `limit`, or an interrupt.
    pub fn connect(&mut self, limit: Duration, interrupt: &Interrupt) -> Result<UnixStream, EmulatorError> {
        let begin = Instant::now();
        loop {
            match self.listener.accept() {
                Ok((stream, _)) => {
                    stream.set_nonblocking(false).map_err(EmulatorError::io("use the serial line"))?;
                    return Ok(stream);
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) => {
                    return Err(EmulatorError::Io { what: "accept the serial line", source: error });
                }
            }
            if interrupt.is_set() {
                return Err(EmulatorError::Interrupted);
            }
            if let Ok(Some(status)) = self.child.try_wait() {
                return Err(EmulatorError::Died {
                    node: self.id,
                    detail: format!("{status}{}", self.errors()),
                });
            }
            if begin.elapsed() > limit {
                return Err(EmulatorError::NoAnswer { node: self.id, awaited: "serial line", waited: limit });
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Ends the emulator and gives the raw log that the node wrote.
    pub fn into_log(mut self) -> Vec<u8> {
        self.end();
        // No log is an empty log: the node may have had nothing to say.
        std::fs::read(self.folder.path().join(LOG)).unwrap_or_default()
    }

    fn errors(&self) -> String {
        match std::fs::read_to_string(self.folder.path().join(ERRORS)) {
            Ok(text) if !text.trim().is_empty() => format!(": {}", text.trim()),
            _ => String::new(),
        }
    }

    fn end(&mut self) {
        // Already ended is as good.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end();
    }
}

/// The emulator's command line. `setpriv`, where there is one, makes the kernel end the emulator should this program be
/// killed; a process group of its own lets Ctrl-C reach only this program, which then stops in order.
fn command(qemu: &str, image: &Path, folder: &Path) -> Command {
    let mut command = match Path::new("/usr/bin/setpriv").exists() && runs(qemu) {
        true => {
            let mut command = Command::new("/usr/bin/setpriv");
            command.args(["--pdeathsig", "KILL", "--"]).arg(qemu);
            command
        }
        false => Command::new(qemu),
    };
    let socket = folder.join(SOCKET).display().to_string();
    command.args(["-M", "mps2-an386", "-display", "none", "-monitor", "none", "-kernel"]).arg(image);
    command.args(["-chardev", &format!("socket,id=uart,path={socket}"), "-serial", "chardev:uart"]);
    // defmt's bytes come by semihosting, which QEMU writes to its own standard output.
    command.args(["-semihosting-config", "enable=on,target=native"]);
    command
}

/// Whether the emulator can be started at all; `setpriv` would hide that it cannot.
fn runs(qemu: &str) -> bool {
    let mut command = Command::new(qemu);
    command.arg("--version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command.status().is_ok()
}
