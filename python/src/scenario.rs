//! A scenario that has been read and checked.

use crate::errors;
use pyo3::prelude::*;
use sim_host::scenario::{AnyScenario, Override, Scenario as Wired, Source};
use std::path::PathBuf;
use std::sync::Arc;

/// A scenario, as the simulator has it.
#[pyclass(frozen, module = "funnelnet._native")]
pub struct Scenario {
    pub inner: Arc<AnyScenario>,
    /// The text that was read, before anything was set.
    pub source: Source,
    pub settings: Vec<Override>,
}

#[pymethods]
impl Scenario {
    /// Reads a file, or `text` that is named `path` in messages; `sets` are pairs of a key and its TOML.
    #[new]
    #[pyo3(signature = (path, text, sets))]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        text: Option<String>,
        sets: Vec<(String, String)>,
    ) -> PyResult<Self> {
        let read = || {
            let source = match text {
                Some(text) => Source { text, path },
                None => Source::read(&path)?,
            };
            let settings = sets.iter().map(|(key, value)| {
                Override::from_option(&format!("set[{key:?}]"), &format!("{key}={value}"))
            });
            let settings = settings.collect::<Result<Vec<_>, _>>()?;
            let inner = source.any_scenario(&settings)?;
            Ok(Self { inner: Arc::new(inner), source, settings })
        };
        read().map_err(|found| errors::of_scenario(py, found))
    }

    #[getter]
    fn title(&self) -> &str {
        self.inner.title()
    }

    #[getter]
    fn seed(&self) -> u64 {
        match &*self.inner {
            AnyScenario::Wired(scenario) => scenario.seed,
            AnyScenario::Large(scenario) => scenario.seed,
        }
    }

    #[getter]
    fn nodes(&self) -> usize {
        match &*self.inner {
            AnyScenario::Wired(scenario) => scenario.nodes.len(),
            AnyScenario::Large(scenario) => scenario.nodes(),
        }
    }

    /// Tick in seconds.
    #[getter]
    fn tick(&self) -> f64 {
        match &*self.inner {
            AnyScenario::Wired(scenario) => scenario.time.tick_s(),
            AnyScenario::Large(scenario) => scenario.time.tick_s(),
        }
    }

    /// Duration in seconds.
    #[getter]
    fn duration(&self) -> f64 {
        match &*self.inner {
            AnyScenario::Wired(scenario) => scenario.time.end_s(),
            AnyScenario::Large(scenario) => scenario.time.end_s(),
        }
    }

    /// The TOML that gives it again, with everything set.
    #[getter]
    fn toml(&self) -> &str {
        self.inner.as_run()
    }
}

impl Scenario {
    /// The scenario of a network whose every node is simulated.
    pub fn wired(&self, py: Python<'_>) -> PyResult<&Wired> {
        match &*self.inner {
            AnyScenario::Wired(scenario) => Ok(scenario),
            AnyScenario::Large(_) => Err(errors::of_run(
                py,
                &sim_host::run::RunError::bad_input(
                    "bus.model = \"none\": such a network runs to its end; take run",
                ),
            )),
        }
    }
}
