//! Long work in a thread of its own, while the calling thread looks at signals without holding the
//! interpreter's lock.

use crate::trouble::Trouble;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::thread;
use std::time::Duration;

/// Time between two looks at signals and at the progress.
const LOOK: Duration = Duration::from_millis(50);

/// Does `work`, and calls `look` every so often. An exception of a signal, of `look` or of a field stops the
/// work, by the flag of `trouble`, and is raised once it has ended.
pub fn watched<T: Send>(
    py: Python<'_>,
    trouble: &Trouble,
    mut look: impl FnMut(Python<'_>) -> PyResult<()> + Send,
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    let done = py.detach(|| {
        thread::scope(|scope| {
            let (send, receive) = sync_channel(1);
            // Attached once for all callables: a thread that attaches for each of them makes its state anew.
            let worker = scope.spawn(move || send.send(Python::attach(|py| py.detach(work))));
            loop {
                match receive.recv_timeout(LOOK) {
                    Ok(done) => return Some(done),
                    Err(RecvTimeoutError::Disconnected) => {
                        // A thread that is not joined hands its panic on to this one.
                        let _ = worker.join();
                        return None;
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                }
                let looked = Python::attach(|py| py.check_signals().and_then(|()| look(py)));
                if let Err(error) = looked {
                    trouble.put(error);
                }
            }
        })
    });
    match (trouble.take(), done) {
        (Some(error), _) => Err(error),
        (None, Some(done)) => Ok(done),
        // The panic is on standard error.
        (None, None) => Err(PyRuntimeError::new_err("a defect of funnelnet; please report it")),
    }
}
