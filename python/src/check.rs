//! `check`: what a scenario will do, without a run.

use crate::scenario::Scenario;
use crate::work::left_alone;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use sim_host::check as checks;
use sim_host::scenario::AnyScenario;
use std::sync::Arc;

/// Checks a scenario: the report as JSON, and as text for people.
#[pyfunction]
pub fn check(py: Python<'_>, scenario: &Scenario) -> PyResult<(String, String)> {
    let scenario = Arc::clone(&scenario.inner);
    let work = move || match &*scenario {
        AnyScenario::Wired(scenario) => checks::check(scenario),
        AnyScenario::Large(scenario) => checks::check_large(scenario),
    };
    let report = left_alone(py, work)?;
    let json = serde_json::to_string(&report).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
    Ok((json, report.to_string()))
}
