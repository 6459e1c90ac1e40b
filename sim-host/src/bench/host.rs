//! Nodes in processes of their own on this computer: `sim-host node`, with a pair of sockets for a line.

use super::file::BenchNode;
use crate::emulator::EmulatorOptions;
use crate::hub::{Attached, Device, HubError, Link, SLICE, Stream};
use std::fs::File;
use std::io::{Read, Seek};
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How much later than the end of its line the exit status of a process may come.
const EXIT: Duration = Duration::from_secs(1);

/// A running node; dropping it ends it.
struct HostProcess {
    command: Command,
    child: Child,
    /// Its standard error: a file without a name, which never fills up as a pipe does.
    errors: File,
}

/// Starts the node of this entry, on CAN if it is on an interface, in frames of CAN FD if `fd`. Its chip's
/// number is its id.
///
/// # Errors
/// The operating system's.
pub fn attach(node: &BenchNode, fd: bool, options: &EmulatorOptions) -> Result<Attached, HubError> {
    let errors = tempfile::tempfile().map_err(HubError::io("make a node's log file"))?;
    let shared = errors.try_clone().map_err(HubError::io("share a node's log file"))?;
    let mut command = command(node, fd)?;
    command.stderr(shared);
    let (line, child) = start(&mut command)?;
    let link = Link::new(node.id, "the process".to_owned(), Box::new(line), options.interrupt.clone());
    Ok(Attached { link, device: Box::new(HostProcess { command, child, errors }), uid: node.uid })
}

/// How the node of this entry is started, but for its line and its log.
fn command(node: &BenchNode, fd: bool) -> Result<Command, HubError> {
    let program = std::env::current_exe().map_err(HubError::io("find this program"))?;
    let mut command = Command::new(program);
    command.args(["node", "--inherited", "--uid", &format!("{:x}", node.id)]);
    if node.drift_ppb != 0 {
        command.arg(format!("--drift-ppm={}", node.drift_ppb as f64 / 1000.0));
    }
    if let Some(interface) = &node.can {
        command.args(["--can", interface]).args(fd.then_some("--can-fd"));
    }
    if let Some(storage) = &node.storage {
        command.arg("--storage").arg(storage);
    }
    // A group of its own: Ctrl-C reaches only this program, which then stops the nodes in order.
    command.stdout(Stdio::null()).process_group(0);
    Ok(command)
}

/// Starts a process on a line of its own, and gives our end of that.
fn start(command: &mut Command) -> Result<(UnixStream, Child), HubError> {
    let (ours, theirs) = UnixStream::pair().map_err(HubError::io("make a pair of sockets"))?;
    let slow = ours.set_read_timeout(Some(SLICE)).and_then(|()| ours.set_write_timeout(Some(SLICE)));
    slow.map_err(HubError::io("use a pair of sockets"))?;
    let child = command.stdin(OwnedFd::from(theirs)).spawn();
    // The command would keep their end open, and the line would never end.
    command.stdin(Stdio::null());
    Ok((ours, child.map_err(HubError::io("start a node's process"))?))
}

impl HostProcess {
    fn end(&mut self) {
        // Already ended is as good.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// What it has written to standard error.
    fn words(&mut self) -> String {
        let mut text = String::new();
        // What cannot be read is as good as not written.
        let _ = self.errors.rewind().and_then(|()| self.errors.read_to_string(&mut text));
        text
    }
}

impl Device for HostProcess {
    fn last_words(&mut self, ended: bool) -> Vec<String> {
        let begin = Instant::now();
        while ended && begin.elapsed() < EXIT && matches!(self.child.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let status = self.child.try_wait().ok().flatten().map(|status| format!("its process: {status}"));
        let words: Vec<_> = self.words().lines().map(|line| format!("its process: {line}")).collect();
        status.into_iter().chain(words).collect()
    }

    fn reopen(&mut self) -> Option<Box<dyn Stream>> {
        // One that has ended, by itself or by somebody's hand; any other one still has its line.
        self.child.try_wait().ok().flatten()?;
        let (line, child) = start(&mut self.command).ok()?;
        self.child = child;
        Some(Box::new(line))
    }

    fn switch(&mut self, on: bool) -> Result<Option<Box<dyn Stream>>, HubError> {
        self.end();
        if !on {
            return Ok(Some(Box::new(std::io::empty())));
        }
        let (line, child) = start(&mut self.command)?;
        self.child = child;
        Ok(Some(Box::new(line)))
    }

    fn into_log(mut self: Box<Self>) -> Option<String> {
        self.end();
        Some(self.words())
    }
}

impl Drop for HostProcess {
    fn drop(&mut self) {
        self.end();
    }
}
