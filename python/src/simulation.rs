//! `Simulation`: a network that its user advances, for who owns the clock.
//!
//! The network borrows its scenario, so that both live in a thread of their own, which waits for times.

use crate::errors;
use crate::field::{self, Callables};
use crate::rows::array;
use crate::scenario::Scenario;
use crate::trouble::Trouble;
use crate::work::{defect, watched};
use pyo3::exceptions::{PyRuntimeError, PyStopIteration, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sim_host::loopback::Refused;
use sim_host::run::RunError;
use sim_host::scenario::Scenario as Wired;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;

/// What the thread is asked for.
enum Asked {
    /// All ticks up to this one.
    Until(u64),
    /// The verdict so far, which ends it.
    Verdict,
}

/// What it answers.
enum Answered {
    Started,
    Refused(Refused),
    Ticks(Ticks),
    Verdict { holds: bool, reasons: Vec<String>, max_ratio: f64, breaches: u64 },
}

/// What the nodes saw at some ticks, in columns.
#[derive(Default)]
struct Ticks {
    t: Vec<f64>,
    /// `x`, `nu`, `psi`, `u`.
    columns: [Vec<f64>; 4],
}

/// A network that runs.
#[pyclass(frozen, module = "funnelnet._native")]
pub struct Simulation {
    /// None once it has ended.
    ask: Mutex<Option<Sender<Asked>>>,
    /// Held by who waits for an answer: never by a thread with the interpreter's lock.
    answer: Mutex<Receiver<Answered>>,
    next: AtomicU64,
    trouble: Trouble,
    nodes: usize,
    components: usize,
    ticks: u64,
    step_s: f64,
}

#[pymethods]
impl Simulation {
    #[new]
    #[pyo3(signature = (scenario, fields))]
    fn new(py: Python<'_>, scenario: &Scenario, fields: &Bound<'_, PyAny>) -> PyResult<Self> {
        let wired = scenario.wired(py)?;
        let trouble = Trouble::default();
        let callables = field::callables(fields, wired, &trouble)?;
        let (nodes, components, ticks) = (wired.nodes.len(), wired.components(), wired.time.ticks);
        let step_s = wired.time.tick_s();
        let (ask, asked) = channel();
        let (answers, answer) = channel();
        let (wired, of_thread) = (wired.clone(), trouble.clone());
        thread::spawn(move || {
            Python::attach(|py| py.detach(move || live(&wired, &callables, &of_thread, asked, &answers)));
        });
        let (ask, answer, next) = (Mutex::new(Some(ask)), Mutex::new(answer), AtomicU64::new(0));
        let this = Self { ask, answer, next, trouble, nodes, components, ticks, step_s };
        match this.receive(py)? {
            Answered::Refused(refused) => Err(errors::of_run(py, &RunError::from(refused))),
            _ => Ok(this),
        }
    }

    /// Number of the tick that comes next, from 0.
    #[getter]
    fn next_tick(&self) -> u64 {
        self.next.load(Ordering::Relaxed)
    }

    /// Number of the last tick.
    #[getter]
    fn last_tick(&self) -> u64 {
        self.ticks
    }

    /// Runs all ticks up to `until` seconds, or the next one alone, and gives their columns.
    #[pyo3(signature = (until = None))]
    fn step<'py>(&self, py: Python<'py>, until: Option<f64>) -> PyResult<Bound<'py, PyDict>> {
        let next = self.next_tick();
        if next > self.ticks {
            return Err(PyStopIteration::new_err("all ticks of the scenario were run"));
        }
        let to = match until {
            Some(t) => self.tick_at(t)?,
            None => next,
        };
        self.ask(Asked::Until(to))?;
        let Answered::Ticks(ticks) = self.receive(py)? else { return Err(defect()) };
        self.next.fetch_add(ticks.t.len() as u64, Ordering::Relaxed);
        let dict = PyDict::new(py);
        let rows = ticks.t.len();
        dict.set_item("t", array(py, ticks.t, &[rows])?)?;
        let shape: &[usize] =
            if self.components == 1 { &[rows, self.nodes] } else { &[rows, self.nodes, self.components] };
        for (name, values) in ["x", "nu", "psi", "u"].into_iter().zip(ticks.columns) {
            dict.set_item(name, array(py, values, shape)?)?;
        }
        Ok(dict)
    }

    /// The verdict on the ticks so far, as (holds, reasons, `max_ratio`, breaches); it ends the simulation.
    fn verdict(&self, py: Python<'_>) -> PyResult<(bool, Vec<String>, f64, u64)> {
        self.ask(Asked::Verdict)?;
        let answered = self.receive(py)?;
        *self.sender() = None;
        match answered {
            Answered::Verdict { holds, reasons, max_ratio, breaches } => {
                Ok((holds, reasons, max_ratio, breaches))
            }
            _ => Err(defect()),
        }
    }
}

impl Simulation {
    fn sender(&self) -> MutexGuard<'_, Option<Sender<Asked>>> {
        self.ask.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn ask(&self, asked: Asked) -> PyResult<()> {
        if self.trouble.interrupt().is_set() {
            return Err(self.gone());
        }
        let is_asked = self.sender().as_ref().is_some_and(|ask| ask.send(asked).is_ok());
        if is_asked { Ok(()) } else { Err(self.gone()) }
    }

    /// Why there is nobody to ask: it has given its verdict, or was stopped; else its thread has panicked.
    fn gone(&self) -> PyErr {
        let has_ended = self.trouble.interrupt().is_set() || self.sender().is_none();
        if has_ended { PyRuntimeError::new_err("this simulation has ended") } else { defect() }
    }

    /// The answer, with a look at signals while it takes its time.
    fn receive(&self, py: Python<'_>) -> PyResult<Answered> {
        let wait = || self.answer.lock().unwrap_or_else(PoisonError::into_inner).recv().ok();
        watched(py, &self.trouble, |_| Ok(()), wait)?.ok_or_else(|| self.gone())
    }

    /// The last tick that is not after `t` (s); a millionth of a tick of rounding is allowed for.
    fn tick_at(&self, t: f64) -> PyResult<u64> {
        if !(t.is_finite() && t >= 0.0) {
            return Err(PyValueError::new_err(format!("until = {t}: must be a time in seconds, at least 0")));
        }
        Ok((t / self.step_s + 1e-6).floor() as u64)
    }
}

/// Runs the network for who asks, until nobody does.
fn live(
    scenario: &Wired,
    callables: &Callables,
    trouble: &Trouble,
    asked: Receiver<Asked>,
    answers: &Sender<Answered>,
) {
    let hosted = callables.put_into(scenario);
    trouble.arm();
    let scenario = hosted.as_ref().unwrap_or(scenario);
    let started = funnelnet_sim::Simulation::new(scenario);
    let mut network = match started {
        Ok(network) => network,
        Err(refused) => return drop(answers.send(Answered::Refused(refused))),
    };
    if answers.send(Answered::Started).is_err() {
        return;
    }
    let mut next = 0;
    while let Ok(asked) = asked.recv() {
        let answered = match asked {
            Asked::Until(last) => Answered::Ticks(ticks(scenario, &mut network, (&mut next, last), trouble)),
            Asked::Verdict => {
                let verdict = network.verdict();
                let (reasons, findings) = (verdict.reasons(), verdict.findings);
                let (max_ratio, breaches) = (findings.max_ratio, findings.breaches);
                let holds = reasons.is_empty();
                drop(answers.send(Answered::Verdict { holds, reasons, max_ratio, breaches }));
                return;
            }
        };
        if answers.send(answered).is_err() {
            return;
        }
    }
}

/// Runs ticks until `last` is done, the run has ended, or the user stops it.
fn ticks(
    scenario: &Wired,
    network: &mut funnelnet_sim::Simulation<'_>,
    (next, last): (&mut u64, u64),
    trouble: &Trouble,
) -> Ticks {
    let mut ticks = Ticks::default();
    while *next <= last && !trouble.interrupt().is_set() {
        let Some(k) = network.step() else { break };
        *next = k + 1;
        ticks.t.push(scenario.time.at_s(k));
        let ids = 1..=u16::try_from(scenario.nodes.len()).unwrap_or(u16::MAX);
        for seen in ids.flat_map(|id| network.node(id)) {
            let values = [seen.x, seen.nu, seen.psi, seen.u].map(f64::from);
            ticks.columns.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
        }
    }
    ticks
}
