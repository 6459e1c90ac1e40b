//! Long work in a thread of its own, while the calling thread looks at signals without holding the
//! interpreter's lock.
//!
//! What has a flag that stops it is waited for. What has none is left to itself when the user wants to stop.

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
        (None, None) => Err(defect()),
    }
}

/// Does `work`, which nothing can stop and which needs no interpreter. An exception of a signal is raised at once: the work goes on to its
/// end, and nobody sees what it comes to.
pub fn left_alone<T: Send + 'static>(
    py: Python<'_>,
    work: impl FnOnce() -> T + Send + 'static,
) -> PyResult<T> {
    let (send, receive) = sync_channel(1);
    // Where nobody waits any more there is nobody to tell.
    let worker = thread::spawn(move || drop(send.send(work())));
    py.detach(move || {
        loop {
            match receive.recv_timeout(LOOK) {
                Ok(done) => return Ok(done),
                Err(RecvTimeoutError::Disconnected) => {
                    let _ = worker.join();
                    return Err(defect());
                }
                Err(RecvTimeoutError::Timeout) => Python::attach(|py| py.check_signals())?,
            }
        }
    })
}

/// A thread has panicked; its words are on standard error.
pub fn defect() -> PyErr {
    PyRuntimeError::new_err("a defect of funnelnet; please report it")
}
