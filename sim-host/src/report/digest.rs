//! What tables and words need of a trajectory, read row by row: however long it is, only this is kept.

use crate::extremes::larger;
use csv::{ByteRecord, ReaderBuilder};
use std::io::Read;
use std::ops::Range;

/// Rows that a table of the page has at most.
pub(super) const SAMPLES: usize = 11;
/// Rows that are kept for it until the end is known: of more, every second one goes.
const KEPT: usize = 8 * SAMPLES;

/// The digest of a trajectory.
#[derive(Debug)]
pub(super) struct Digest {
    /// One per node and component, in the order of the columns.
    pub(super) nodes: Vec<Node>,
    /// Rows that were read.
    pub(super) rows: u64,
    /// First and last time, s.
    pub(super) span: (f64, f64),
    /// Rows from the first to the last, evenly apart.
    pub(super) samples: Vec<Sample>,
}

/// One component of one node.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Node {
    /// Its id, with the component of a vector: `3`, or `3, x1`.
    pub(super) name: String,
    /// First and last known state, state units; NaN where there is none.
    pub(super) first: f64,
    pub(super) last: f64,
    /// The largest `|nu| / psi` of the rows, and when, s; NaN where none is known.
    pub(super) ratio: f64,
    pub(super) ratio_at: f64,
    /// The largest `|u|` of the rows, state units per second; NaN where none is known.
    pub(super) input: f64,
}

/// One row.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sample {
    /// Time, s.
    pub(super) t: f64,
    /// States in the order of [`Digest::nodes`].
    pub(super) x: Vec<f64>,
    /// The emergent trajectory, its first component.
    pub(super) xi: f64,
    /// The largest distance of two nodes, over all components.
    pub(super) spread: f64,
    /// The largest `|nu| / psi`.
    pub(super) ratio: f64,
    /// The largest `|u|`.
    pub(super) input: f64,
}

/// Where the columns are.
struct Columns {
    t: usize,
    xi: Option<usize>,
    nodes: Vec<OfNode>,
    components: usize,
}

struct OfNode {
    x: usize,
    nu: Option<usize>,
    psi: Option<usize>,
    u: Option<usize>,
}

impl Digest {
    /// Reads a `trajectory.csv`.
    ///
    /// # Errors
    /// It is none, in words, with the line.
    pub(super) fn read(file: impl Read) -> Result<Self, String> {
        let mut reader = ReaderBuilder::new().from_reader(file);
        let head = reader.headers().map_err(|error| error.to_string())?.clone();
        let names: Vec<&str> = head.iter().collect();
        let columns = Columns::of(&names)?;
        let mut digest =
            Self { nodes: nodes(&names), rows: 0, span: (f64::NAN, f64::NAN), samples: Vec::new() };
        let (mut every, mut record, mut last) = (1, ByteRecord::new(), None);
        while reader.read_byte_record(&mut record).map_err(|error| error.to_string())? {
            let row = columns.row(&record, &mut digest.nodes, &names)?;
            let span = if digest.rows == 0 { (row.t, row.t) } else { (digest.span.0, row.t) };
            if digest.rows.is_multiple_of(every) {
                digest.samples.push(row.clone());
            }
            (digest.rows, digest.span, last) = (digest.rows + 1, span, Some(row));
            if digest.samples.len() > KEPT {
                every *= 2;
                let mut at = 0;
                digest.samples.retain(|_| (at % 2 == 0, at += 1).0);
            }
        }
        digest.thin(last);
        Ok(digest)
    }

    /// Keeps the first, the last, and those evenly between.
    fn thin(&mut self, last: Option<Sample>) {
        if let Some(last) = last.filter(|last| self.samples.last().map(|row| row.t) != Some(last.t)) {
            self.samples.push(last);
        }
        let (all, most) = (self.samples.len(), SAMPLES);
        if all > most {
            let chosen: Vec<usize> = (0..most).map(|k| k * (all - 1) / (most - 1)).collect();
            let mut at = 0;
            self.samples.retain(|_| (chosen.contains(&at), at += 1).0);
        }
    }

    /// The range of the states at a sample; none where none is known.
    pub(super) fn range(sample: &Sample) -> Option<Range<f64>> {
        let known = || sample.x.iter().copied().filter(|x| !x.is_nan());
        let low = known().min_by(f64::total_cmp)?;
        Some(low..known().max_by(f64::total_cmp)?)
    }

    /// The node that came nearest to its funnel, of those that are known.
    pub(super) fn nearest(&self) -> Option<&Node> {
        self.nodes.iter().filter(|node| !node.ratio.is_nan()).max_by(|a, b| a.ratio.total_cmp(&b.ratio))
    }

    /// The node with the largest input, of those that are known.
    pub(super) fn strongest(&self) -> Option<&Node> {
        self.nodes.iter().filter(|node| !node.input.is_nan()).max_by(|a, b| a.input.total_cmp(&b.input))
    }
}

/// The nodes of a header, of which nothing is known yet.
fn nodes(names: &[&str]) -> Vec<Node> {
    let node = |name: &&str| {
        let of = name.strip_prefix("x_")?;
        let name = match of.split_once('_') {
            Some((id, component)) => format!("{id}, x{component}"),
            None => of.to_owned(),
        };
        let unknown = f64::NAN;
        let [first, last, ratio, ratio_at, input] = [unknown; 5];
        Some(Node { name, first, last, ratio, ratio_at, input })
    };
    names.iter().filter_map(node).collect()
}

impl Columns {
    fn of(names: &[&str]) -> Result<Self, String> {
        let place = |name: &str| names.iter().position(|known| *known == name);
        let first_of = |names: [String; 2]| names.iter().find_map(|name| place(name));
        let node = |(x, name): (usize, &&str)| {
            let of = name.strip_prefix("x_")?;
            Some(OfNode {
                x,
                nu: first_of([format!("true_nu_{of}"), format!("nu_{of}")]),
                psi: first_of([format!("asked_psi_{of}"), format!("psi_{of}")]),
                u: place(&format!("u_{of}")),
            })
        };
        let nodes: Vec<_> = names.iter().enumerate().filter_map(node).collect();
        let ids: std::collections::BTreeSet<_> =
            names.iter().filter_map(|name| name.strip_prefix("x_")?.split('_').next()).collect();
        let t = place("t").filter(|_| !nodes.is_empty());
        let t = t.ok_or("is no trajectory: it has no column t, or no state x_1")?;
        Ok(Self {
            t,
            xi: first_of(["xi".to_owned(), "xi_0".to_owned()]),
            components: nodes.len() / ids.len(),
            nodes,
        })
    }

    fn row(&self, record: &ByteRecord, nodes: &mut [Node], names: &[&str]) -> Result<Sample, String> {
        let value = |column: usize| -> Result<f64, String> {
            let field = record.get(column).unwrap_or_default();
            if field.is_empty() {
                return Ok(f64::NAN);
            }
            let number = std::str::from_utf8(field).ok().and_then(|field| field.parse().ok());
            number.ok_or_else(|| {
                let line = record.position().map_or(0, csv::Position::line);
                format!("line {line}: {} is no number", names.get(column).unwrap_or(&"a field"))
            })
        };
        let known = |column: Option<usize>| column.map_or(Ok(f64::NAN), value);
        let t = value(self.t)?;
        let mut row = Sample {
            t,
            x: Vec::with_capacity(self.nodes.len()),
            xi: known(self.xi)?,
            spread: f64::NAN,
            ratio: f64::NAN,
            input: f64::NAN,
        };
        for (of, node) in self.nodes.iter().zip(nodes) {
            let (x, nu, psi, u) = (value(of.x)?, known(of.nu)?, known(of.psi)?, known(of.u)?);
            // As the judge has it: zero in a funnel that has closed is at its boundary.
            let ratio = if nu == 0.0 && psi == 0.0 { 1.0 } else { (nu / psi).abs() };
            node.take(t, x, ratio, u.abs());
            row.x.push(x);
            row.ratio = row.ratio.max(ratio);
            row.input = row.input.max(u.abs());
        }
        row.spread = spread(&row.x, self.components);
        Ok(row)
    }
}

impl Node {
    fn take(&mut self, t: f64, x: f64, ratio: f64, input: f64) {
        if !x.is_nan() {
            self.first = if self.first.is_nan() { x } else { self.first };
            self.last = x;
        }
        if ratio > self.ratio || self.ratio.is_nan() && !ratio.is_nan() {
            (self.ratio, self.ratio_at) = (ratio, t);
        }
        self.input = self.input.max(input);
    }
}

/// The largest distance of two states that are known, in the component in which it is largest; NaN where fewer than two are.
fn spread(x: &[f64], components: usize) -> f64 {
    let components = components.max(1);
    let apart = |component: usize| {
        let states = || x.iter().skip(component).step_by(components).copied().filter(|x| !x.is_nan());
        states().fold(f64::NEG_INFINITY, f64::max) - states().fold(f64::INFINITY, f64::min)
    };
    let known = x.iter().step_by(components).filter(|x| !x.is_nan()).count();
    if known > 1 { (0..components).map(apart).fold(0.0, larger) } else { f64::NAN }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_judged_by_true_terms_and_what_is_not_known_is_no_number() {
        let text = "t,x_1,x_2,nu_1,nu_2,psi_1,psi_2,u_1,u_2,xi,true_nu_1,true_nu_2,asked_psi_1,asked_psi_2\n\
                    0.0,1,-2,9,9,1,1,-7,3,0,-2,,4,4\n\
                    1.0,0.5,,0,0,1,1,1,,0.25,3,1,4,2\n";
        let digest = Digest::read(text.as_bytes()).unwrap();
        let [one, two] = digest.nodes.as_slice() else { panic!("{digest:?}") };
        assert_eq!((one.first, one.last, one.ratio, one.ratio_at, one.input), (1.0, 0.5, 0.75, 1.0, 7.0));
        assert_eq!((two.first, two.last, two.ratio, two.input), (-2.0, -2.0, 0.5, 3.0));
        assert_eq!((digest.rows, digest.span), (2, (0.0, 1.0)));
        assert_eq!((digest.samples[0].spread, digest.samples[0].ratio), (3.0, 0.5));
        assert!(digest.samples[1].spread.is_nan());
    }

    #[test]
    fn of_a_long_trajectory_a_few_rows_are_kept_with_the_first_and_the_last() {
        for rows in [1, 2, SAMPLES, SAMPLES + 1, KEPT, KEPT + 1, 10_007] {
            let body: String = (0..rows).map(|k| format!("{k},{k}\n")).collect();
            let digest = Digest::read(format!("t,x_1\n{body}").as_bytes()).unwrap();
            let times: Vec<f64> = digest.samples.iter().map(|sample| sample.t).collect();
            assert_eq!(times.len(), rows.min(SAMPLES), "{rows}");
            assert_eq!((times[0], times[times.len() - 1]), (0.0, (rows - 1) as f64), "{rows}");
            let even = (rows - 1) as f64 / (times.len().max(2) - 1) as f64;
            // Of a few rows one more or less is much.
            let most = (1.6 * even).max(even + 1.0);
            let apart = |pair: &[f64]| pair[1] - pair[0];
            assert!(times.windows(2).all(|pair| apart(pair) > 0.5 * even && apart(pair) < most), "{times:?}");
        }
    }

    #[test]
    fn components_belong_to_their_node() {
        let digest = Digest::read("t,x_1_0,x_1_1,x_2_0,x_2_1\n0,0,5,1,9\n".as_bytes()).unwrap();
        assert_eq!(digest.samples[0].spread, 4.0);
        assert_eq!(digest.nodes[3].name, "2, x1");
    }

    #[test]
    fn what_is_no_trajectory_is_refused_with_its_line() {
        let refused = |text: &str| Digest::read(text.as_bytes()).unwrap_err();
        assert!(refused("a,b\n1,2\n").contains("no column t"));
        assert!(refused("").contains("no column t"));
        assert!(refused("t,x_1\n0,1\n1,abc\n").contains("line 3: x_1 is no number"));
        assert!(refused("t,x_1\n0,1\n1\n").contains('3'), "{}", refused("t,x_1\n0,1\n1\n"));
    }
}
