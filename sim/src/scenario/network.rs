//! `[graph]`: a named shape or a list of edges, checked to be one connected network.

use std::collections::BTreeMap;
use std::rc::Rc;

use super::diagnostic::Problem;
use super::graph::{Edge, Graph};
use super::graph_file::FileGraph;
use super::inputs::Files;
use super::reader::{Choice, Log, Range, Section, integer, number, ready};
use super::topology::Topology;
use super::tree::{Item, Place, Value};
use funnelnet_node::params;
use funnelnet_protocol::config::MAX_NEIGHBOURS;

/// The largest network without a bus.
pub(super) const MAX_NODES: u64 = 1_000_000;
/// The largest network with a bus that can be read, and checked. A run takes fewer: see [`super::LARGEST_RUN`].
pub(super) const MOST_WIRED: u64 = 2_000;
/// The most edges of a graph that is drawn or laid out: what a machine of some GiB holds.
const MOST_EDGES: f64 = 16_777_216.0;

/// The most parts, and nodes of each, that a message names.
const MOST_NAMED: usize = 100;

pub(super) const EDGE_WEIGHT: Range = Range::positive("edge weight").up_to(params::LARGEST_WEIGHT);

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Ring,
    Path,
    Star,
    Complete,
    Grid,
    Torus,
    RingLattice,
    RandomRegular,
    ErdosRenyi,
    Edges,
    File,
}

const KINDS: [Choice<Kind>; 11] = [
    ready("ring", Kind::Ring),
    ready("path", Kind::Path),
    ready("star", Kind::Star),
    ready("complete", Kind::Complete),
    ready("grid", Kind::Grid),
    ready("torus", Kind::Torus),
    ready("ring-lattice", Kind::RingLattice),
    ready("random-regular", Kind::RandomRegular),
    ready("erdos-renyi", Kind::ErdosRenyi),
    ready("edges", Kind::Edges),
    ready("file", Kind::File),
];

/// The shape as read; the graph itself is built once the whole file is known to be sound.
pub(super) struct Network<'a> {
    pub nodes: u64,
    weight: f64,
    shape: Option<Topology>,
    /// What a failed draw or an impossible parameter points at.
    parameter: Option<&'a Item>,
    edges: &'a [Item],
    file: Option<Rc<FileGraph>>,
    place: Place,
}

/// Reads `[graph]` of at most `largest` nodes, of which `why` says more; `None`, reported, where the kind is not known, or its file cannot
/// be read.
pub(super) fn read<'a>(
    mut section: Section<'a>,
    (largest, why): (u64, &str),
    files: &Files,
) -> Option<Network<'a>> {
    // A file says by itself what it is.
    let by_itself = section.has("file").then_some(Kind::File);
    let kind = section.choice("kind", &KINDS, by_itself)?;
    let file = if kind == Kind::File { Some(file(&mut section, files)?) } else { None };
    // Without edges a file does not say how many there are.
    let most = file.as_ref().map(|file| file.nodes).filter(|&nodes| nodes > 0);
    let nodes = section.integer("nodes", most, (1, largest), why);
    let weight = section.number("weight", Some(1.0), EDGE_WEIGHT);
    let mut network = Network {
        nodes,
        weight,
        shape: None,
        parameter: None,
        edges: &[],
        file,
        place: section.place().clone(),
    };
    network.shape = match kind {
        Kind::Ring => Some(Topology::Ring),
        Kind::Path => Some(Topology::Path),
        Kind::Star => Some(Topology::Star),
        Kind::Complete => Some(Topology::Complete),
        Kind::Grid => Some(Topology::Grid { columns: columns(&mut section, nodes) }),
        Kind::Torus => Some(Topology::Torus { columns: columns(&mut section, nodes) }),
        Kind::RingLattice => Some(Topology::RingLattice { degree: degree(&mut section) }),
        Kind::RandomRegular => Some(Topology::RandomRegular { degree: degree(&mut section) }),
        Kind::ErdosRenyi => {
            let probability = section.number("probability", None, Range::positive_probability());
            Some(Topology::ErdosRenyi { probability })
        }
        Kind::Edges => {
            section.need("edges", "must be an array such as [[1, 2, 1.0], [2, 3]]");
            network.edges = section.array("edges");
            None
        }
        Kind::File => None,
    };
    let keys = ["degree", "probability", "columns", "edges", "file"];
    network.parameter = keys.into_iter().find_map(|key| section.known(key));
    // A default is taken as it is.
    if nodes > largest && section.known("nodes").is_none() {
        let allowed = format!("must have {largest} nodes at most ({why}), and has {nodes}");
        complain(&network, allowed, section.log());
        return None;
    }
    section.finish();
    Some(network)
}

fn file(section: &mut Section<'_>, files: &Files) -> Option<Rc<FileGraph>> {
    let item = section.need("file", "must be a string, as \"grid.csv\" or \"grid.graphml\"")?;
    let Some(name) = item.text() else {
        section.log().report(item.diagnostic(Problem::Value, "must be a string"));
        return None;
    };
    let refuse = |why: String| section.log().report(item.diagnostic(Problem::Value, why));
    let graph = files.graph(name).map_err(refuse).ok()?;
    if graph.nodes == 0 && !section.has("nodes") {
        refuse("names no node; graph.nodes must say how many there are".to_owned());
        return None;
    }
    Some(graph)
}

fn degree(section: &mut Section<'_>) -> usize {
    section.integer("degree", None, (1, MAX_NODES - 1), "neighbours per node") as usize
}

/// As square as it gets where the file does not say.
fn columns(section: &mut Section<'_>, nodes: u64) -> usize {
    let square = (nodes.max(1) as f64).sqrt().ceil() as u64;
    section.integer("columns", Some(square), (1, MAX_NODES), "nodes per row") as usize
}

/// Builds the graph and checks that it is connected. What is wrong is reported.
pub(super) fn build(network: &Network<'_>, seed: u64, log: &Log) -> Graph {
    let nodes = network.nodes as usize;
    let edges = match network.shape {
        None => match &network.file {
            Some(file) => file.edges(network.nodes, network.weight).unwrap_or_else(|why| {
                complain(network, why, log);
                Vec::new()
            }),
            None => listed(network, log),
        },
        Some(shape) if shape.expected_links(nodes) > MOST_EDGES => {
            let found = shape.expected_links(nodes);
            let allowed = format!(
                "must have {MOST_EDGES} edges at most; {nodes} nodes of this kind have some {found:.3e}"
            );
            complain(network, allowed, log);
            return Graph { nodes, edges: Vec::new() };
        }
        Some(shape) => match shape.links(nodes, seed) {
            Ok(links) => links.into_iter().map(|(a, b)| Edge { a, b, weight: network.weight }).collect(),
            Err(allowed) => {
                complain(network, allowed, log);
                return Graph { nodes, edges: Vec::new() };
            }
        },
    };
    let graph = Graph { nodes, edges };
    if log.checkpoint().is_ok() {
        connected(&graph, network, log);
        light(&graph, network, log);
    }
    graph
}

fn complain(network: &Network<'_>, allowed: String, log: &Log) {
    log.report(match network.parameter {
        Some(item) => item.diagnostic(Problem::Value, allowed),
        None => network.place.diagnostic(Problem::Whole, "graph", allowed),
    });
}

/// The weights of a node's edges do not add up to more than it takes.
fn light(graph: &Graph, network: &Network<'_>, log: &Log) {
    let degrees = graph.degrees();
    let heavy = degrees.iter().enumerate().find(|(_, degree)| **degree > params::LARGEST_WEIGHT);
    if let Some((index, degree)) = heavy {
        let (id, most) = (index + 1, params::LARGEST_WEIGHT);
        let allowed = format!("the weights of node {id} add up to {degree:e}; a node takes {most:e} at most");
        log.report(network.place.diagnostic(Problem::Whole, "graph", allowed));
    }
}

/// Every component of every neighbour has its place in a node's table.
pub(super) fn room(graph: &Graph, components: usize, network: &Network<'_>, log: &Log) {
    // One component always fits, and looking takes long.
    if components < 2 {
        return;
    }
    let crowded = (0..graph.nodes).find(|&index| graph.neighbours(index).len() * components > MAX_NEIGHBOURS);
    if let Some(index) = crowded {
        let (id, neighbours) = (index + 1, graph.neighbours(index).len());
        let allowed = format!(
            "node {id} has {neighbours} neighbours with {components} components each; a node has room for {MAX_NEIGHBOURS} in all"
        );
        log.report(network.place.diagnostic(Problem::Whole, "graph", allowed));
    }
}

fn connected(graph: &Graph, network: &Network<'_>, log: &Log) {
    let parts = graph.components();
    if parts.len() > 1 {
        let name = |part: &Vec<usize>| {
            let ids: Vec<_> = part.iter().take(MOST_NAMED).map(|index| (index + 1).to_string()).collect();
            let more = if part.len() > MOST_NAMED { ", ..." } else { "" };
            format!("{{{}{more}}}", ids.join(", "))
        };
        let names: Vec<_> = parts.iter().take(MOST_NAMED).map(name).collect();
        let allowed = format!(
            "must be connected (Assumption 1), but it falls into {} parts: {}",
            parts.len(),
            names.join(", ")
        );
        let place = network.parameter.map_or(&network.place, |item| &item.place);
        let mut diagnostic = place.diagnostic(Problem::Whole, "graph", allowed);
        diagnostic.hint = Some("add an edge between them".to_owned());
        log.report(diagnostic);
    }
}

/// The edges of `edges = [[a, b, weight], ...]`, sorted, each once.
fn listed(network: &Network<'_>, log: &Log) -> Vec<Edge> {
    let mut weights: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    for item in network.edges {
        let Some((a, b, weight)) = listed_edge(item, network, log) else { continue };
        let key = (a.min(b), a.max(b));
        let before = weights.insert(key, weight);
        if let Some(before) = before.filter(|before| *before != weight) {
            let allowed = format!(
                "must have one weight: {} and {} are already joined with weight {before}, and the \
                 graph is undirected",
                key.0, key.1
            );
            log.report(item.diagnostic(Problem::Value, allowed));
        }
    }
    weights.into_iter().map(|((a, b), weight)| Edge { a: a - 1, b: b - 1, weight }).collect()
}

/// One `[a, b]` or `[a, b, weight]`, ids from 1.
fn listed_edge(item: &Item, network: &Network<'_>, log: &Log) -> Option<(usize, usize, f64)> {
    let report = |diagnostic| log.report(diagnostic);
    let Value::Array(parts) = &item.value else {
        report(item.diagnostic(Problem::Value, "must be [id, id] or [id, id, weight]"));
        return None;
    };
    let (a, b, weight) = match parts.as_slice() {
        [a, b] => (a, b, None),
        [a, b, weight] => (a, b, Some(weight)),
        _ => {
            report(item.diagnostic(Problem::Value, "must be [id, id] or [id, id, weight]"));
            return None;
        }
    };
    let id = |end| integer(end, (1, network.nodes), "[graph] nodes").map_err(report).ok();
    let (a, b) = (id(a)?, id(b)?);
    if a == b {
        report(item.diagnostic(Problem::Value, "must join two different nodes (no self loops)"));
        return None;
    }
    let weight = weight.map_or(Ok(network.weight), |item| number(item, EDGE_WEIGHT));
    Some((a as usize, b as usize, weight.map_err(report).ok()?))
}
