//! One QEMU process: started, connected, and ended whatever happens.

use super::EmulatorOptions;
use crate::hub::{HubError, SLICE};
use crate::interrupt::Interrupt;
use std::fs::File;
use std::io::ErrorKind;
use std::os::unix::fs::FileExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// The serial line's socket, in a temporary folder of its own.
const SOCKET: &str = "uart";
/// Bytes of the emulator's complaints that are kept.
const MAX_ERRORS: usize = 2000;

/// A running emulator; dropping it ends it.
pub struct Process {
    id: u8,
    child: Child,
    listener: UnixListener,
    /// Of the socket, until it is connected.
    folder: Option<TempDir>,
    /// The defmt log and the emulator's complaints: files without a name, so that nothing is left behind even
    /// if this program is killed.
    log: File,
    errors: File,
}

impl Process {
    /// Starts the emulator of node `id`, whose further lines lead to these sockets. When it has connected its
    /// first line, it has made those that it makes.
    ///
    /// # Errors
    /// No such emulator, or the operating system's.
    pub fn start(id: u8, lines: &[String], options: &EmulatorOptions) -> Result<Self, HubError> {
        let folder = tempfile::Builder::new()
            .prefix(&format!("funnelnet-{id}-"))
            .tempdir()
            .map_err(HubError::io("make a temporary folder"))?;
        let listener = UnixListener::bind(folder.path().join(SOCKET))
            .and_then(|listener| listener.set_nonblocking(true).map(|()| listener))
            .map_err(HubError::io("listen for the emulator's serial line"))?;
        let file = || tempfile::tempfile().map_err(HubError::io("make the emulator's log file"));
        let (log, errors) = (file()?, file()?);
        let shared = |file: &File| file.try_clone().map_err(HubError::io("share the emulator's log file"));
        let child = command(&options.qemu, &options.image, folder.path(), lines)
            .stdin(Stdio::null())
            .stdout(shared(&log)?)
            .stderr(shared(&errors)?)
            .process_group(0)
            .spawn()
            .map_err(|source| match source.kind() {
                ErrorKind::NotFound => HubError::NoQemu { command: options.qemu.clone() },
                _ => HubError::Io { what: "start the emulator", source },
            })?;
        Ok(Self { id, child, listener, folder: Some(folder), log, errors })
    }

    /// Waits until the emulator connects its serial line.
    ///
    /// # Errors
    /// It ends, or does not connect within `limit`, or an interrupt.
    pub fn connect(&mut self, limit: Duration, interrupt: &Interrupt) -> Result<UnixStream, HubError> {
        let begin = Instant::now();
        loop {
            match self.listener.accept() {
                Ok((stream, _)) => {
                    self.folder = None;
                    slow_to_fail(&stream).map_err(HubError::io("use the serial line"))?;
                    return Ok(stream);
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(error) => {
                    return Err(HubError::Io { what: "accept the serial line", source: error });
                }
            }
            if interrupt.is_set() {
                return Err(HubError::Interrupted);
            }
            if let Ok(Some(status)) = self.child.try_wait() {
                return Err(HubError::Died {
                    node: self.id,
                    place: "the emulator".to_owned(),
                    detail: [vec![status.to_string()], self.complaints()].concat().join("; "),
                });
            }
            if begin.elapsed() > limit {
                return Err(HubError::NoAnswer { node: self.id, awaited: "serial line", waited: limit });
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// The raw log so far.
    pub fn log(&self) -> Vec<u8> {
        content(&self.log)
    }

    /// How the emulator ended, if it does within `patience`, and what it complained of; a line each.
    pub fn last_words(&mut self, patience: Duration) -> Vec<String> {
        let ended = self.status(patience).map(|status| format!("its emulator: {status}"));
        let complaints = self.complaints().into_iter().map(|line| format!("its emulator: {line}"));
        ended.into_iter().chain(complaints).collect()
    }

    fn status(&mut self, patience: Duration) -> Option<ExitStatus> {
        let begin = Instant::now();
        loop {
            if let Ok(Some(status)) = self.child.try_wait() {
                return Some(status);
            }
            if begin.elapsed() >= patience {
                return None;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    fn complaints(&self) -> Vec<String> {
        let mut bytes = content(&self.errors);
        bytes.truncate(MAX_ERRORS);
        let text = String::from_utf8_lossy(&bytes).into_owned();
        text.lines().filter(|line| !line.trim().is_empty()).map(str::to_owned).collect()
    }

    /// Ends the emulator.
    pub fn end(&mut self) {
        // Already ended is as good.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Makes it a stream as a link expects it.
fn slow_to_fail(stream: &UnixStream) -> std::io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_read_timeout(Some(SLICE))?;
    stream.set_write_timeout(Some(SLICE))
}

/// Everything in a file, without moving the position at which the emulator writes.
fn content(file: &File) -> Vec<u8> {
    let mut bytes = vec![0; file.metadata().map_or(0, |metadata| metadata.len() as usize)];
    // What cannot be read is as good as not written: a log is never why a run fails.
    let length = file.read_at(&mut bytes, 0).unwrap_or(0);
    bytes.truncate(length);
    bytes
}

impl Drop for Process {
    fn drop(&mut self) {
        self.end();
    }
}

/// The emulator's command line. `setpriv`, where there is one, makes the kernel end the emulator should this
/// program be killed; a process group of its own lets Ctrl-C reach only this program, which then stops in
/// order.
fn command(qemu: &str, image: &Path, folder: &Path, lines: &[String]) -> Command {
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
    for (number, line) in (1..).zip(lines) {
        command.args(["-chardev", &format!("socket,id=line{number},{line}")]);
    }
    command.args(["-chardev", &format!("socket,id=uart,path={socket}"), "-serial", "chardev:uart"]);
    for number in 1..=lines.len() {
        command.args(["-serial", &format!("chardev:line{number}")]);
    }
    // defmt's bytes come by semihosting, which QEMU writes to its own standard output.
    command.args(["-semihosting-config", "enable=on,target=native"]);
    command
}

/// Whether the emulator can be started at all; `setpriv` would hide that it cannot. It is not waited for:
/// what is called so may be anything, and may never end.
fn runs(qemu: &str) -> bool {
    let mut command = Command::new(qemu);
    command.arg("--version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let Ok(mut child) = command.spawn() else { return false };
    // Already ended is as good.
    let _ = child.kill();
    let _ = child.wait();
    true
}
