//! `check`: what a scenario will do, without a run.

use crate::scenario::Scenario;
use crate::trouble::Trouble;
use crate::work::watched;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use sim_host::check as checks;
use sim_host::scenario::AnyScenario;

/// Checks a scenario: the report as JSON, and as text for people.
#[pyfunction]
pub fn check(py: Python<'_>, scenario: &Scenario) -> PyResult<(String, String)> {
    let work = || match &*scenario.inner {
        AnyScenario::Wired(scenario) => checks::check(scenario),
        AnyScenario::Large(scenario) => checks::check_large(scenario),
    };
    let report = watched(py, &Trouble::default(), |_| Ok(()), work)?;
    let json = serde_json::to_string(&report).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    Ok((json, report.to_string()))
}
