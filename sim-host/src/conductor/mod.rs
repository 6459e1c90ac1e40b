//! The pure part of the hub: bytes and time come in as arguments, and nothing here waits, reads a clock or knows a port
//! (docs/notes/2026-11-28-conductor.md).

pub(crate) mod doubt;
mod line;
pub(crate) mod measure;
pub(crate) mod recording;
mod sound;
pub(crate) mod watch;

pub use line::{Line, Received};

use funnelnet_node::Observation;
use funnelnet_protocol::report::Telemetry;
use std::time::Duration;

/// When the host sent and read what belongs to a tick of a node, since the start. In lockstep the host reads nodes in the order of their
/// ids, so a time is at or after the arrival.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamps {
    /// Its SYNC was sent.
    pub sync: Option<Duration>,
    /// Its state was read.
    pub state: Option<Duration>,
    /// Its telemetry was read.
    pub telemetry: Option<Duration>,
    /// Its state was on CAN, by the kernel's clock.
    pub bus: Option<Duration>,
}

/// What a node does that names a component which no state has.
pub(crate) const OTHER_COMPONENT: &str = "spoke of a component that its state does not have";

/// What a node saw at a tick: its state from the bus, the rest from its telemetry. The ratio is one f32 division, which
/// has the same bits here and there.
pub(crate) fn observation(x: f32, telemetry: &Telemetry) -> Observation<f32> {
    let Telemetry { tick, nu, psi, u, .. } = *telemetry;
    Observation { tick, x, nu, psi, ratio: nu.abs() / psi, u }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    /// What tells the time, waits, or is a port.
    const OUTSIDE: [&str; 11] = [
        "Instant",
        "SystemTime",
        "elapsed",
        "sleep",
        "thread",
        "park",
        "recv_timeout",
        "mpsc",
        "Interrupt",
        "TTYPort",
        "UnixStream",
    ];

    /// Words of a source text that belong outside, up to its tests.
    fn outside(text: &str) -> Vec<&'static str> {
        let logic = text.split("#[cfg(test)]\nmod tests").next().unwrap_or(text);
        let words: Vec<_> = logic.split(|c: char| !c.is_alphanumeric() && c != '_').collect();
        OUTSIDE.into_iter().filter(|word| words.contains(word)).collect()
    }

    #[test]
    fn no_file_here_reads_a_clock_waits_or_knows_a_port() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/conductor");
        let (mut files, mut folders) = (0, vec![folder]);
        while let Some(path) = folders.pop() {
            if path.is_dir() {
                folders.extend(fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
                continue;
            }
            let found = outside(&fs::read_to_string(&path).unwrap());
            assert!(found.is_empty(), "{}: {found:?}", path.display());
            files += 1;
        }
        assert!(files >= 6, "{files} files");
        assert_eq!(
            outside("let begin = Instant::now(); std::thread::sleep(SLICE)"),
            ["Instant", "sleep", "thread"]
        );
    }
}
