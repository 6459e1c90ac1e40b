//! A graph as GraphML, which networkx, igraph, Gephi and others read; `graph.file` reads it back.

use crate::scenario::Graph;
use std::fmt::Write as _;

/// The document: ids from 1 on, undirected edges, and their weights as the fewest digits that read as the same number.
#[must_use]
pub fn graphml(graph: &Graph) -> String {
    let mut text = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<graphml xmlns=\"http://graphml.graphdrawing.org/xmlns\">\n".to_owned();
    text += "  <key id=\"weight\" for=\"edge\" attr.name=\"weight\" attr.type=\"double\"/>\n  <graph edgedefault=\"undirected\">\n";
    for id in 1..=graph.nodes {
        // Writing to a string does not fail, here and below.
        let _ = writeln!(text, "    <node id=\"{id}\"/>");
    }
    for edge in &graph.edges {
        let (a, b, weight) = (edge.a + 1, edge.b + 1, edge.weight);
        let _ = writeln!(
            text,
            "    <edge source=\"{a}\" target=\"{b}\"><data key=\"weight\">{weight:?}</data></edge>"
        );
    }
    text + "  </graph>\n</graphml>\n"
}
