//! Vector fields that are callables of Python.

use crate::ring::{Answer, Ring};
use crate::trouble::Trouble;
use numpy::ndarray::{ArrayD, IxDyn};
use numpy::{AllowTypeChange, IntoPyArray, PyArrayLikeDyn};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use sim_host::scenario::{Dynamics, HostField, Hosted, Scenario};
use std::sync::{Arc, Mutex, PoisonError};

/// A callable `f(t, x)` for some nodes together: `t` in seconds, `x` a float or an array.
struct Callable {
    call: Py<PyAny>,
    /// Whether it takes all nodes of the group at once.
    is_vectorised: bool,
    /// Indices of its nodes; a scalar one has one.
    nodes: Vec<usize>,
    components: usize,
    /// States at the start, for entries that nobody has asked for yet.
    start: Vec<f64>,
    recent: Mutex<Ring>,
    trouble: Trouble,
}

impl Callable {
    /// Rates of all its nodes, of each by component.
    fn rates(&self, t: f64, x: &[f64]) -> PyResult<Vec<f64>> {
        Python::attach(|py| {
            if x.len() == 1 && !self.is_vectorised {
                return Ok(vec![self.call.call1(py, (t, x[0]))?.extract::<f64>(py)?]);
            }
            let shape: &[usize] = match (self.is_vectorised, self.components) {
                (true, 1) => &[self.nodes.len()],
                (true, components) => &[self.nodes.len(), components],
                (false, components) => &[components],
            };
            let states = ArrayD::from_shape_vec(IxDyn(shape), x.to_vec())
                .map_err(|error| PyValueError::new_err(error.to_string()))?;
            let answer = self.call.call1(py, (t, states.into_pyarray(py)))?;
            let answer: PyArrayLikeDyn<'_, f64, AllowTypeChange> = answer.extract(py)?;
            let rates = answer.as_array();
            if rates.shape() != shape {
                let found = rates.shape();
                return Err(PyValueError::new_err(format!(
                    "{}: gives an array of shape {found:?}, and its x has shape {shape:?}",
                    self.name(py)
                )));
            }
            Ok(rates.iter().copied().collect())
        })
    }

    fn name(&self, py: Python<'_>) -> String {
        let of = if self.is_vectorised { "vectorised field" } else { "field" };
        let nodes: Vec<_> = self.nodes.iter().map(|index| (index + 1).to_string()).collect();
        let call = self.call.bind(py).repr().map(|repr| repr.to_string()).unwrap_or_default();
        format!("{of} {call} of node {}", nodes.join(", "))
    }

    /// The same where what goes wrong ends the run; not a number then.
    fn answer(&self, t: f64, x: &[f64]) -> Vec<f64> {
        // Whoever wants to stop waits for no more calls.
        if self.trouble.interrupt().is_set() {
            return vec![f64::NAN; x.len()];
        }
        self.rates(t, x).unwrap_or_else(|error| {
            self.trouble.of_field(error);
            vec![f64::NAN; x.len()]
        })
    }

    fn recent(&self) -> std::sync::MutexGuard<'_, Ring> {
        self.recent.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// One component of the rate of one of its nodes, at its place in the group.
    fn component(&self, place: usize, component: usize, t: f64, x: &[f64]) -> f64 {
        // Nothing is kept of what is called once for one number.
        if x.len() == 1 && !self.is_vectorised {
            return self.answer(t, x).first().copied().unwrap_or(f64::NAN);
        }
        let first = place * self.components;
        if let Some(rates) = self.recent().find(t, first, x) {
            return rates.get(component).copied().unwrap_or(f64::NAN);
        }
        // The others' states do not matter to this node; those that were there last are in the field's domain.
        let mut states = self.recent().last_states().unwrap_or(&self.start).to_vec();
        if let Some(own) = states.get_mut(first..first + x.len()) {
            own.copy_from_slice(x);
        }
        let rates = self.answer(t, &states);
        let rate = rates.get(first + component).copied().unwrap_or(f64::NAN);
        self.recent().keep(Answer { t, x: states, rates });
        rate
    }

    /// All its nodes will be asked at `t`, each at its state of `x`.
    fn announce(&self, t: f64, x: &[f64]) {
        if !self.is_vectorised {
            return;
        }
        let n = self.components;
        let states: Vec<f64> = self
            .nodes
            .iter()
            .flat_map(|index| x.get(index * n..(index + 1) * n).unwrap_or(&[]))
            .copied()
            .collect();
        let is_there = self.recent().find(t, 0, &states).is_some();
        if states.len() == self.start.len() && !is_there {
            let rates = self.answer(t, &states);
            self.recent().keep(Answer { t, x: states, rates });
        }
    }
}

/// One node of a callable.
struct Member {
    callable: Arc<Callable>,
    place: usize,
}

impl HostField for Member {
    fn component(&self, component: usize, t: f64, x: &[f64]) -> f64 {
        self.callable.component(self.place, component, t, x)
    }

    fn announce(&self, t: f64, x: &[f64]) {
        // Once for the whole group.
        if self.place == 0 {
            self.callable.announce(t, x);
        }
    }
}

/// All callables of a run.
pub struct Callables(Vec<Arc<Callable>>);

/// The callables of `fields`: triples of a callable, whether it is vectorised, and the ids of its nodes.
pub fn callables(fields: &Bound<'_, PyAny>, scenario: &Scenario, trouble: &Trouble) -> PyResult<Callables> {
    let nodes = scenario.nodes.len();
    let (components, start) = (scenario.components(), scenario.initial_states());
    let mut seen = vec![false; nodes];
    let mut list = Vec::new();
    for (call, is_vectorised, ids) in fields.extract::<Vec<(Py<PyAny>, bool, Vec<i64>)>>()? {
        let index = |&id: &i64| {
            let index = usize::try_from(id - 1).ok().filter(|&index| index < nodes);
            let index = index.ok_or_else(|| {
                PyValueError::new_err(format!("fields: node {id}: ids are 1 to {nodes} here"))
            })?;
            match std::mem::replace(&mut seen[index], true) {
                true => Err(PyValueError::new_err(format!("fields: node {id} has two"))),
                false => Ok(index),
            }
        };
        let indices = ids.iter().map(index).collect::<PyResult<Vec<_>>>()?;
        let groups = if is_vectorised {
            vec![indices]
        } else {
            indices.into_iter().map(|index| vec![index]).collect()
        };
        for nodes in groups {
            let start =
                nodes.iter().flat_map(|i| &start[i * components..(i + 1) * components]).copied().collect();
            let call = Python::attach(|py| call.clone_ref(py));
            let (recent, trouble) = (Mutex::default(), trouble.clone());
            list.push(Arc::new(Callable { call, is_vectorised, nodes, components, start, recent, trouble }));
        }
    }
    Ok(Callables(list))
}

impl Callables {
    /// The scenario with these fields; `None` where there are none. Long: each field is looked at in many
    /// states.
    pub fn put_into(&self, scenario: &Scenario) -> Option<Scenario> {
        if self.0.is_empty() {
            return None;
        }
        let mut scenario = scenario.clone();
        let end = scenario.time.end_s();
        for callable in &self.0 {
            for (place, &index) in callable.nodes.iter().enumerate() {
                let member = Arc::new(Member { callable: Arc::clone(callable), place });
                let node = &mut scenario.nodes[index];
                node.dynamics = Dynamics::Hosted(Hosted::new(member, &node.state, end));
            }
        }
        Some(scenario)
    }
}
