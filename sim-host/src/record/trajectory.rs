//! `trajectory.csv`.

use std::io::{self, Write};
use std::path::PathBuf;

use super::atomic::{AtomicFile, RecordError};
use crate::number::Precision;

/// One recorded instant; the vectors have one entry per node and component, by id and then by component.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Row {
    /// Time, in seconds.
    pub t: f64,
    /// States, in state units.
    pub x: Vec<f64>,
    /// Diffusive terms, in state units.
    pub nu: Vec<f64>,
    /// Funnels, in state units.
    pub psi: Vec<f64>,
    /// Coupling inputs, in state units per second.
    pub u: Vec<f64>,
    /// True diffusive terms, in state units: of the states of all nodes at this instant. NaN where one is not
    /// known.
    pub true_nu: Vec<f64>,
    /// The funnels that they are judged by, in state units: the scenario's, not narrower than the accepted
    /// floor.
    pub asked_psi: Vec<f64>,
    /// The emergent trajectory by component, in state units; empty where it is not known.
    pub xi: Vec<f64>,
    /// The blended dynamics by component, in state units; empty where they are not known.
    pub blended: Vec<f64>,
    /// Deliveries that were lost since the row before; no column.
    pub lost: u64,
}

/// Writes `trajectory.csv` row by row; the file gets its name on [`finish`](Self::finish).
///
/// Columns: `t`, then `x_1..x_N`, `nu_1..`, `psi_1..`, `u_1..`, `xi`, `blended`, `true_nu_1..`,
/// `asked_psi_1..`; for vector states `x_1_0, x_1_1, ...`, `xi_0, ...` and so on. What is not known is an
/// empty field.
#[derive(Debug)]
pub struct TrajectoryWriter {
    file: AtomicFile,
    shape: Shape,
    precision: Precision,
}

/// What a row consists of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Number of nodes.
    pub nodes: usize,
    /// Components of a state.
    pub components: usize,
}

impl TrajectoryWriter {
    /// Opens the file and writes the header. `precision` is that of the rows; `t`, `psi` and `xi` too.
    ///
    /// # Errors
    /// [`RecordError`], naming `path` and the reason.
    pub fn create(path: impl Into<PathBuf>, shape: Shape, precision: Precision) -> Result<Self, RecordError> {
        let mut file = AtomicFile::create(path)?;
        file.write(|out| header(out, shape))?;
        Ok(Self { file, shape, precision })
    }

    /// Appends a row.
    ///
    /// # Errors
    /// [`RecordError`] if it cannot be written, or if one of its vectors does not have one entry per node and
    /// component.
    pub fn write(&mut self, row: &Row) -> Result<(), RecordError> {
        let (shape, precision) = (self.shape, self.precision);
        self.file.write(|out| line(out, row, shape, precision))
    }

    /// Brings everything to the disk, so that nothing but the name is missing.
    ///
    /// # Errors
    /// [`RecordError`], for example on a full disk.
    pub fn settle(&mut self) -> Result<(), RecordError> {
        self.file.settle()
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// [`RecordError`], naming the file and the reason; no half file is left.
    pub fn finish(self) -> Result<(), RecordError> {
        self.file.commit()
    }
}

fn header(out: &mut dyn Write, Shape { nodes, components }: Shape) -> io::Result<()> {
    write!(out, "t")?;
    for name in ["x", "nu", "psi", "u"] {
        for id in 1..=nodes {
            columns(out, &format!("{name}_{id}"), components)?;
        }
    }
    columns(out, "xi", components)?;
    columns(out, "blended", components)?;
    for name in ["true_nu", "asked_psi"] {
        for id in 1..=nodes {
            columns(out, &format!("{name}_{id}"), components)?;
        }
    }
    writeln!(out)
}

/// `name`, or `name_0, name_1, ...` for vector states.
fn columns(out: &mut dyn Write, name: &str, components: usize) -> io::Result<()> {
    match components {
        1 => write!(out, ",{name}"),
        _ => (0..components).try_for_each(|component| write!(out, ",{name}_{component}")),
    }
}

fn line(out: &mut dyn Write, row: &Row, shape: Shape, precision: Precision) -> io::Result<()> {
    // Time is counted in ticks and stays exact to f64 whatever the states are.
    Precision::Double.write(out, row.t)?;
    for table in [&row.x, &row.nu, &row.psi, &row.u] {
        values(out, table, row.t, shape, precision)?;
    }
    for prediction in [&row.xi, &row.blended] {
        for component in 0..shape.components {
            out.write_all(b",")?;
            if let Some(&value) = prediction.get(component) {
                Precision::Double.write(out, value)?;
            }
        }
    }
    // Of the judge, which computes in f64 whatever the nodes do.
    for table in [&row.true_nu, &row.asked_psi] {
        values(out, table, row.t, shape, Precision::Double)?;
    }
    out.write_all(b"\n")
}

/// A value of each node and component. One that is not known has an empty field: a last value in its place
/// would pass for a measurement.
fn values(out: &mut dyn Write, table: &[f64], t: f64, shape: Shape, precision: Precision) -> io::Result<()> {
    let Shape { nodes, components } = shape;
    if table.len() != nodes * components {
        let each = if components == 1 { String::new() } else { format!(" of {components} components") };
        let what = format!("a row has {} entries for {nodes} nodes{each} at t = {t} s", table.len());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    for &value in table {
        out.write_all(b",")?;
        if !value.is_nan() {
            precision.write(out, value)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::atomic::tests::Folder;
    use super::*;

    fn row(t: f64, xi: &[f64], blended: &[f64]) -> Row {
        let single = |v: f32| f64::from(v);
        let pair = |a, b| vec![single(a), single(b)];
        Row {
            t,
            x: pair(0.1, -2.0),
            nu: pair(1e-9, 3.0),
            psi: pair(4.0, 40.0),
            u: pair(0.25, 1e20),
            true_nu: vec![1e-9, f64::NAN],
            asked_psi: vec![4.0, 40.0],
            xi: xi.to_vec(),
            blended: blended.to_vec(),
            lost: 0,
        }
    }

    #[test]
    fn the_file_is_the_one_of_the_contract() {
        let folder = Folder::new("trajectory");
        let path = folder.0.join("trajectory.csv");
        let mut writer =
            TrajectoryWriter::create(&path, Shape { nodes: 2, components: 1 }, Precision::Single).unwrap();
        writer.write(&row(0.0, &[], &[-1.5])).unwrap();
        writer.write(&row(0.001, &[0.3], &[])).unwrap();
        assert!(!path.exists());
        writer.finish().unwrap();
        let expected = "t,x_1,x_2,nu_1,nu_2,psi_1,psi_2,u_1,u_2,xi,blended,true_nu_1,true_nu_2,asked_psi_1,asked_psi_2\n\
                        0.0,0.1,-2.0,1e-9,3.0,4.0,40.0,0.25,1e20,,-1.5,1e-9,,4.0,40.0\n\
                        0.001,0.1,-2.0,1e-9,3.0,4.0,40.0,0.25,1e20,0.3,,1e-9,,4.0,40.0\n";
        assert_eq!(std::fs::read_to_string(&path).unwrap(), expected);
    }

    #[test]
    fn components_have_columns_of_their_own() {
        let folder = Folder::new("components");
        let path = folder.0.join("trajectory.csv");
        let shape = Shape { nodes: 1, components: 2 };
        let mut writer = TrajectoryWriter::create(&path, shape, Precision::Single).unwrap();
        writer.write(&row(0.0, &[], &[])).unwrap();
        writer.write(&row(0.001, &[0.3, 0.4], &[0.7, 0.8])).unwrap();
        writer.finish().unwrap();
        let expected = "t,x_1_0,x_1_1,nu_1_0,nu_1_1,psi_1_0,psi_1_1,u_1_0,u_1_1,xi_0,xi_1,blended_0,blended_1,true_nu_1_0,true_nu_1_1,asked_psi_1_0,asked_psi_1_1\n\
                        0.0,0.1,-2.0,1e-9,3.0,4.0,40.0,0.25,1e20,,,,,1e-9,,4.0,40.0\n\
                        0.001,0.1,-2.0,1e-9,3.0,4.0,40.0,0.25,1e20,0.3,0.4,0.7,0.8,1e-9,,4.0,40.0\n";
        assert_eq!(std::fs::read_to_string(&path).unwrap(), expected);
    }

    #[test]
    fn a_row_of_another_size_is_refused() {
        let folder = Folder::new("size");
        let path = folder.0.join("trajectory.csv");
        let mut writer =
            TrajectoryWriter::create(&path, Shape { nodes: 3, components: 1 }, Precision::Double).unwrap();
        let error = writer.write(&row(0.5, &[], &[])).unwrap_err();
        assert!(error.to_string().contains("2 entries for 3 nodes at t = 0.5 s"), "{error}");
    }
}
