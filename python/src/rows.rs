//! Rows of a run as columns that NumPy takes over.

use numpy::ndarray::{ArrayD, IxDyn};
use numpy::{IntoPyArray, PyArrayDyn, PyArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sim_host::record::Row;
use sim_host::run::{Rows, RunError};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Time that a run has come to, s, for who watches it from another thread.
#[derive(Clone, Default)]
pub struct Reached(Arc<AtomicU64>);

impl Reached {
    pub fn set(&self, t: f64) {
        self.0.store(t.to_bits(), Ordering::Relaxed);
    }

    pub fn get(&self) -> f64 {
        f64::from_bits(self.0.load(Ordering::Relaxed))
    }
}

/// Columns of a run, each in one piece.
#[derive(Default)]
pub struct Columns {
    pub reached: Reached,
    t: Vec<f64>,
    x: Vec<f64>,
    nu: Vec<f64>,
    psi: Vec<f64>,
    u: Vec<f64>,
    true_nu: Vec<f64>,
    asked_psi: Vec<f64>,
    xi: Vec<f64>,
    blended: Vec<f64>,
}

impl Rows for Columns {
    fn take(&mut self, row: Row) -> Result<(), RunError> {
        self.reached.set(row.t);
        self.t.push(row.t);
        self.x.extend(row.x);
        self.nu.extend(row.nu);
        self.psi.extend(row.psi);
        self.u.extend(row.u);
        self.true_nu.extend(row.true_nu);
        self.asked_psi.extend(row.asked_psi);
        self.xi.extend(row.xi);
        self.blended.extend(row.blended);
        Ok(())
    }
}

impl Columns {
    /// A dict of arrays, (time, node) or (time, node, component); `None` for what is not known.
    pub fn into_dict(self, py: Python<'_>, nodes: usize, components: usize) -> PyResult<Bound<'_, PyDict>> {
        let rows = self.t.len();
        let of_nodes: &[usize] = if components == 1 { &[rows, nodes] } else { &[rows, nodes, components] };
        let of_all: &[usize] = if components == 1 { &[rows] } else { &[rows, components] };
        let dict = PyDict::new(py);
        dict.set_item("t", array(py, self.t, &[rows])?)?;
        for (name, values, shape) in [
            ("x", self.x, of_nodes),
            ("nu", self.nu, of_nodes),
            ("psi", self.psi, of_nodes),
            ("u", self.u, of_nodes),
            ("true_nu", self.true_nu, of_nodes),
            ("asked_psi", self.asked_psi, of_nodes),
            ("xi", self.xi, of_all),
            ("blended", self.blended, of_all),
        ] {
            dict.set_item(name, if values.is_empty() { None } else { Some(array(py, values, shape)?) })?;
        }
        Ok(dict)
    }
}

/// An array that owns `values` where they are.
pub fn array<'py>(
    py: Python<'py>,
    mut values: Vec<f64>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    // A vector that grew may hold twice its length.
    values.shrink_to_fit();
    let array = ArrayD::from_shape_vec(IxDyn(shape), values).map_err(|error| {
        PyValueError::new_err(format!("a column has not one entry per node and row: {error}"))
    })?;
    let array = array.into_pyarray(py);
    array.readwrite().make_nonwriteable();
    Ok(array)
}
