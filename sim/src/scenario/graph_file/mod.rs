//! `graph.file`: a graph from a file, as CSV with `from,to,weight` or as GraphML. What is wrong names file, line and value.

#[cfg(feature = "graphml")]
mod graphml;

use super::csv_line::{column, line_of, malformed};
use super::graph::Edge;
use super::network::{EDGE_WEIGHT, MAX_NODES};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

/// An edge as it was read, with ids from 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FileEdge {
    /// Where it stands, from 1.
    pub line: u64,
    pub from: u64,
    pub to: u64,
    /// `None`: that of `graph.weight`.
    pub weight: Option<f64>,
}

/// A graph as its file has it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FileGraph {
    /// How messages name the file.
    shown: String,
    /// The largest id; 0 where there is none.
    pub nodes: u64,
    edges: Vec<FileEdge>,
}

/// Name of the copy that a folder of outputs has.
pub(super) const COPY: &str = "scenario-graph.csv";
/// Most bytes of a file: a million nodes of degree four take less.
const LARGEST_FILE: u64 = 64 << 20;

/// Reads a file: GraphML where its name ends in .graphml or .xml, else CSV.
pub(super) fn read(path: &Path) -> Result<FileGraph, String> {
    let shown = path.display().to_string();
    let text = super::read_text_up_to(path, LARGEST_FILE).map_err(|error| error.to_string())?;
    let is_xml = path
        .extension()
        .is_some_and(|end| end.eq_ignore_ascii_case("graphml") || end.eq_ignore_ascii_case("xml"));
    let (nodes, edges) = if is_xml { graphml_edges(&text) } else { csv_edges(&text) }
        .map_err(|why| format!("{shown}{why}"))?;
    Ok(FileGraph { shown, nodes, edges })
}

/// The largest id, and edges; else ", line N: what is wrong".
type Found = Result<(u64, Vec<FileEdge>), String>;

#[cfg(feature = "graphml")]
fn graphml_edges(text: &str) -> Found {
    graphml::read(text)
}

#[cfg(not(feature = "graphml"))]
fn graphml_edges(_: &str) -> Found {
    Err(" is GraphML, which this build does not read: use CSV, or the feature graphml of funnelnet-sim"
        .to_owned())
}

fn csv_edges(text: &str) -> Found {
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
    let headers = reader.headers().map_err(|error| format!(": {error}"))?.clone();
    let first = line_of(text, &headers);
    let at = |name: &str| column(&headers, name).map_err(|why| format!(", line {first}: {why}"));
    let need = |name: &str| {
        let has = headers.iter().collect::<Vec<_>>().join(", ");
        at(name)?.ok_or_else(|| {
            format!(", line {first}: has no column '{name}', as in from,to,weight; it has {has}")
        })
    };
    let (from, to, weight) = (need("from")?, need("to")?, at("weight")?);
    let (mut nodes, mut edges) = (0, Vec::new());
    for record in reader.records() {
        let record = record.map_err(|error| malformed(text, &error))?;
        let line = line_of(text, &record);
        let field = |at: usize| record.get(at).unwrap_or("");
        let edge = edge(line, field(from), field(to), weight.map(field).filter(|text| !text.is_empty()))?;
        nodes = nodes.max(edge.from).max(edge.to);
        edges.push(edge);
    }
    Ok((nodes, edges))
}

fn edge(line: u64, from: &str, to: &str, weight: Option<&str>) -> Result<FileEdge, String> {
    let (from, to) = (id(line, from)?, id(line, to)?);
    if from == to {
        return Err(format!(", line {line}: {from} to {to} must join two different nodes (no self loops)"));
    }
    Ok(FileEdge { line, from, to, weight: weight.map(|text| number(line, text)).transpose()? })
}

fn id(line: u64, text: &str) -> Result<u64, String> {
    let id = text.parse().ok().filter(|id| (1..=MAX_NODES).contains(id));
    id.ok_or_else(|| format!(", line {line}: '{text}' must be an id, a whole number from 1 to {MAX_NODES}"))
}

fn number(line: u64, text: &str) -> Result<f64, String> {
    let accepted = match text.parse() {
        Ok(number) => EDGE_WEIGHT.accept(number),
        Err(_) => Err("must be a number (edge weight)".to_owned()),
    };
    accepted.map_err(|allowed| format!(", line {line}: weight '{text}' {allowed}"))
}

impl FileGraph {
    /// Whether there is one.
    pub fn has_edges(&self) -> bool {
        !self.edges.is_empty()
    }

    /// The edges between `nodes` nodes, sorted, each once; those without a weight have this one.
    pub fn edges(&self, nodes: u64, weight: f64) -> Result<Vec<Edge>, String> {
        let mut weights: BTreeMap<(u64, u64), f64> = BTreeMap::new();
        for edge in &self.edges {
            let (a, b) = (edge.from.min(edge.to), edge.from.max(edge.to));
            let (shown, line) = (&self.shown, edge.line);
            if b > nodes {
                return Err(format!(
                    "{shown}, line {line}: '{b}' must be an id from 1 to {nodes} ([graph] nodes)"
                ));
            }
            let weight = edge.weight.unwrap_or(weight);
            let before = weights.insert((a, b), weight).filter(|before| *before != weight);
            if let Some(before) = before {
                return Err(format!(
                    "{shown}, line {line}: weight {weight}: {a} and {b} are already joined with weight {before}, and the graph is undirected"
                ));
            }
        }
        Ok(weights
            .into_iter()
            .map(|((a, b), weight)| Edge { a: a as usize - 1, b: b as usize - 1, weight })
            .collect())
    }

    /// The same as CSV, so that a run can be repeated without the file. Edges without a weight stay so.
    pub fn copy(&self) -> String {
        let mut text = "from,to,weight\n".to_owned();
        for FileEdge { from, to, weight, .. } in &self.edges {
            // The fewest digits that read as the same number. Writing to a string does not fail.
            let _ = match weight {
                Some(weight) => writeln!(text, "{from},{to},{weight:?}"),
                None => writeln!(text, "{from},{to},"),
            };
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(name: &str, text: &str) -> Result<FileGraph, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let graph = read(&path).map_err(|error| error.replace(&path.display().to_string(), "F"))?;
        Ok(FileGraph { shown: "F".to_owned(), ..graph })
    }

    fn csv(text: &str) -> Result<Vec<Edge>, String> {
        found("g.csv", text).and_then(|graph| graph.edges(graph.nodes, 2.0))
    }

    #[test]
    fn edges_of_csv_are_sorted_and_each_once() {
        let edge = |a, b, weight| Edge { a, b, weight };
        let text = "# a comment\nto, from, weight, name\n2, 3, 0.5, x\n1, 2, , y\n3, 2, 0.5, z\n";
        assert_eq!(csv(text), Ok(vec![edge(0, 1, 2.0), edge(1, 2, 0.5)]));
        assert_eq!(csv("from,to\n1,2\n"), Ok(vec![edge(0, 1, 2.0)]));
    }

    #[test]
    fn what_is_wrong_with_csv_names_line_and_value() {
        let wrong = |text: &str| csv(text).unwrap_err();
        assert_eq!(wrong("1,2\n2,3\n"), "F, line 1: has no column 'from', as in from,to,weight; it has 1, 2");
        let unequal = "F, line 5: has 3 fields, and the first line has 2";
        assert_eq!(wrong("from,to\n1,2\n# c\n\n2,3,9\n"), unequal);
        assert!(wrong("# a\n\nto\n1\n").starts_with("F, line 3: has no column 'from'"));
        assert!(wrong("# a\nfrom,to\n# b\n1,2\n\n0,1\n").starts_with("F, line 6: '0' must be"));
        assert_eq!(
            wrong("from,to\n1,2\n0,1\n"),
            "F, line 3: '0' must be an id, a whole number from 1 to 1000000"
        );
        assert_eq!(wrong("from,to\n1,b\n"), "F, line 2: 'b' must be an id, a whole number from 1 to 1000000");
        assert_eq!(
            wrong("from,to\n2,2\n"),
            "F, line 2: 2 to 2 must join two different nodes (no self loops)"
        );
        assert_eq!(wrong("from,to,weight\n1,2,-1\n"), "F, line 2: weight '-1' must be > 0 (edge weight)");
        assert_eq!(wrong("from,to,weight\n1,2,x\n"), "F, line 2: weight 'x' must be a number (edge weight)");
        assert!(wrong("from,to,weight\n1,2,nan\n").starts_with("F, line 2: weight 'nan' must be"));
        assert_eq!(
            wrong("from,to,weight\n1,2,1\n2,1,3\n"),
            "F, line 3: weight 3: 1 and 2 are already joined with weight 1, and the graph is undirected"
        );
        assert_eq!(
            wrong("from,to,weight,to\n1,2,1,3\n"),
            "F, line 1: has the column 'to' more than once; rename all but one"
        );
        // The scenario may say how many nodes there are.
        assert_eq!(found("g.csv", "from,to\n").map(|graph| graph.nodes), Ok(0));
        let graph = found("g.csv", "from,to\n1,2\n2,3\n").unwrap();
        assert_eq!(
            graph.edges(2, 1.0).unwrap_err(),
            "F, line 3: '3' must be an id from 1 to 2 ([graph] nodes)"
        );
    }

    #[test]
    fn a_copy_reads_as_the_same_graph() {
        let graph = found("g.csv", "from,to,weight\n1,2,0.1\n3,2,\n").unwrap();
        let again = found("copy.csv", &graph.copy()).unwrap();
        assert_eq!((again.nodes, again.edges), (graph.nodes, graph.edges));
    }
}
