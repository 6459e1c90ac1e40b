//! What goes wrong, as exceptions of `funnelnet._errors`.

use pyo3::exceptions::{PyKeyboardInterrupt, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use sim_host::exit::Exit;
use sim_host::run::RunError;
use sim_host::scenario::{Diagnostic, Diagnostics};

/// `ScenarioError`, with every mistake of the scenario.
pub fn of_scenario(py: Python<'_>, found: Diagnostics) -> PyErr {
    let found = Diagnostics(found.0.into_iter().map(without_lines_of_dict).collect());
    let build = || {
        let mistakes = found.0.iter().map(|one| mistake(py, one)).collect::<PyResult<Vec<_>>>()?;
        made(py, "ScenarioError", (found.to_string(), PyList::new(py, mistakes)?))
    };
    build().unwrap_or_else(|error| error)
}

/// How messages name a scenario that stands in no file: as `funnelnet._scenario` does.
const IN_A_DICT: &str = "<dict>";

/// The lines of a dict are those of a text that nobody has seen.
fn without_lines_of_dict(one: Diagnostic) -> Diagnostic {
    if one.file == IN_A_DICT { Diagnostic { line: 0, column: 0, ..one } } else { one }
}

fn mistake<'py>(py: Python<'py>, one: &Diagnostic) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("file", &one.file)?;
    // Lines count from 1, and what has none has 0.
    dict.set_item("line", Some(one.line).filter(|&line| line > 0))?;
    dict.set_item("column", Some(one.column).filter(|&column| column > 0))?;
    dict.set_item("key", &one.key)?;
    dict.set_item("found", &one.found)?;
    dict.set_item("allowed", &one.allowed)?;
    dict.set_item("hint", &one.hint)?;
    dict.set_item("message", one.to_string())?;
    Ok(dict)
}

/// `RunError`, `KeyboardInterrupt` where the user has stopped it, or what a defect is.
pub fn of_run(py: Python<'_>, error: &RunError) -> PyErr {
    match error.exit {
        Exit::Interrupted | Exit::HungUp => PyKeyboardInterrupt::new_err(()),
        Exit::Defect => PyRuntimeError::new_err(error.message.clone()),
        exit => made(py, "RunError", (error.message.clone(), exit as u8)).unwrap_or_else(|error| error),
    }
}

fn made<'py>(py: Python<'py>, class: &str, arguments: impl pyo3::call::PyCallArgs<'py>) -> PyResult<PyErr> {
    let class = py.import("funnelnet._errors")?.getattr(class)?;
    Ok(PyErr::from_value(class.call1(arguments)?))
}
