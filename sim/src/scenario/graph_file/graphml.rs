//! GraphML: nodes, undirected edges, and the edges' attribute `weight`.

use super::{FileEdge, Found, edge, id, number};
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

/// What is being read.
#[derive(Default)]
struct State {
    nodes: u64,
    edges: Vec<FileEdge>,
    graphs: usize,
    is_directed: bool,
    /// The key of the edges' weights, and what stands for those that have none.
    weight_key: Option<String>,
    default: Option<f64>,
    /// Inside the key of the weights.
    in_weight_key: bool,
    /// The edge that is open.
    open: Option<FileEdge>,
    /// Where the text is a number, and what has come of it.
    wanted: Option<Wanted>,
    number: String,
}

#[derive(Clone, Copy, PartialEq)]
enum Wanted {
    Weight,
    Default,
}

/// Lines of a text up to a place that only goes forward.
struct Lines<'t> {
    text: &'t str,
    at: usize,
    line: u64,
}

impl Lines<'_> {
    fn up_to(&mut self, place: usize) -> u64 {
        let between = self.text.as_bytes().get(self.at..place).unwrap_or_default();
        self.line += between.iter().filter(|byte| **byte == b'\n').count() as u64;
        self.at = place.max(self.at);
        self.line
    }
}

/// Reads a document.
pub(super) fn read(text: &str) -> Found {
    let mut reader = Reader::from_str(text);
    reader.config_mut().expand_empty_elements = true;
    let mut lines = Lines { text, at: 0, line: 1 };
    let (mut state, mut depth) = (State::default(), 0u64);
    loop {
        let event = reader.read_event();
        let line = lines.up_to(reader.buffer_position() as usize);
        match event {
            Ok(Event::Start(tag)) => {
                depth += 1;
                state.start(line, &tag)?;
            }
            Ok(Event::Text(text)) => {
                let text = text.decode().map_err(|error| wrong(line, &error))?;
                state.text(&text);
            }
            Ok(Event::CData(text)) => {
                let text = text.decode().map_err(|error| wrong(line, &error))?;
                state.text(&text);
            }
            Ok(Event::GeneralRef(_)) if state.wanted.is_some() => {
                return Err(format!(", line {line}: a weight must be written in digits, without entities"));
            }
            Ok(Event::End(tag)) => {
                depth = depth.saturating_sub(1);
                state.end(line, tag.local_name().as_ref())?;
            }
            Ok(Event::Eof) if depth > 0 => {
                return Err(format!(", line {line}: the file ends within an element"));
            }
            Ok(Event::Eof) => break,
            Ok(_) => {}
            Err(error) => return Err(wrong(line, &error)),
        }
    }
    if state.graphs != 1 {
        return Err(format!(" must have one <graph>, and has {}", state.graphs));
    }
    let default = state.default;
    let with_default = |edge: FileEdge| FileEdge { weight: edge.weight.or(default), ..edge };
    Ok((state.nodes, state.edges.into_iter().map(with_default).collect()))
}

fn wrong(line: u64, error: &impl std::fmt::Display) -> String {
    format!(", line {line}: not valid XML: {error}")
}

fn attribute(line: u64, tag: &BytesStart<'_>, name: &str) -> Result<Option<String>, String> {
    let found = tag.try_get_attribute(name).map_err(|error| wrong(line, &error))?;
    let text =
        found.map(|found| found.normalized_value(XmlVersion::Implicit1_0).map(|text| text.into_owned()));
    text.transpose().map_err(|error| wrong(line, &error))
}

fn needed(line: u64, tag: &BytesStart<'_>, name: &str) -> Result<String, String> {
    let tag_name = String::from_utf8_lossy(tag.local_name().as_ref()).into_owned();
    attribute(line, tag, name)?.ok_or_else(|| format!(", line {line}: <{tag_name}> must have '{name}'"))
}

impl State {
    fn start(&mut self, line: u64, tag: &BytesStart<'_>) -> Result<(), String> {
        match tag.local_name().as_ref() {
            b"key" => self.key(line, tag)?,
            b"default" if self.in_weight_key => self.wanted = Some(Wanted::Default),
            b"graph" => {
                self.graphs += 1;
                self.is_directed = attribute(line, tag, "edgedefault")?.as_deref() == Some("directed");
            }
            b"node" => self.nodes = self.nodes.max(id(line, &needed(line, tag, "id")?)?),
            b"edge" => self.edge(line, tag)?,
            b"data" if self.open.is_some() => {
                let key = needed(line, tag, "key")?;
                self.wanted = (self.weight_key.as_ref() == Some(&key)).then_some(Wanted::Weight);
            }
            b"hyperedge" => {
                return Err(format!(", line {line}: <hyperedge> must not be there: an edge has two ends"));
            }
            _ => {}
        }
        Ok(())
    }

    fn key(&mut self, line: u64, tag: &BytesStart<'_>) -> Result<(), String> {
        let of = attribute(line, tag, "for")?;
        let is_of_edges = of.is_none_or(|of| of == "edge" || of == "all");
        if is_of_edges && attribute(line, tag, "attr.name")?.as_deref() == Some("weight") {
            if self.graphs > 0 {
                return Err(format!(", line {line}: the <key> of the weights must come before <graph>"));
            }
            self.weight_key = Some(needed(line, tag, "id")?);
            self.in_weight_key = true;
        }
        Ok(())
    }

    fn edge(&mut self, line: u64, tag: &BytesStart<'_>) -> Result<(), String> {
        let (from, to) = (needed(line, tag, "source")?, needed(line, tag, "target")?);
        let is_directed = match attribute(line, tag, "directed")?.as_deref() {
            Some(said @ ("true" | "1" | "false" | "0")) => said == "true" || said == "1",
            Some(said) => {
                return Err(format!(", line {line}: directed='{said}' must be true, 1, false or 0"));
            }
            None => self.is_directed,
        };
        if is_directed {
            return Err(format!(
                ", line {line}: the edge from {from} to {to} is directed, and the graph must be undirected (Assumption 1)"
            ));
        }
        let edge = edge(line, &from, &to, None)?;
        self.nodes = self.nodes.max(edge.from).max(edge.to);
        self.open = Some(edge);
        Ok(())
    }

    /// A piece of a number: comments part it.
    fn text(&mut self, text: &str) {
        if self.wanted.is_some() {
            self.number += text;
        }
    }

    fn end(&mut self, line: u64, name: &[u8]) -> Result<(), String> {
        match name {
            b"edge" => self.edges.extend(self.open.take()),
            b"key" => self.in_weight_key = false,
            b"data" | b"default" => {
                let (wanted, text) = (self.wanted.take(), std::mem::take(&mut self.number));
                match (wanted, &mut self.open) {
                    (Some(Wanted::Default), _) => self.default = Some(number(line, text.trim())?),
                    (Some(Wanted::Weight), Some(open)) => open.weight = Some(number(line, text.trim())?),
                    _ => {}
                }
            }
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As networkx writes it.
    const TWO: &str = r#"<?xml version='1.0' encoding='utf-8'?>
<graphml xmlns="http://graphml.graphdrawing.org/xmlns">
  <key id="d0" for="edge" attr.name="weight" attr.type="double" />
  <key id="d1" for="edge" attr.name="length" attr.type="double"><default>7</default></key>
  <graph edgedefault="undirected">
    <node id="1" />
    <node id="2" /><node id="3" />
    <edge source="1" target="2"><data key="d1">9</data>
      <data key="d0">0.5</data></edge>
    <edge source="2" target="3" />
  </graph>
</graphml>
"#;

    #[test]
    fn weights_are_those_of_their_key() {
        let edge = |line, from, to, weight| FileEdge { line, from, to, weight };
        assert_eq!(read(TWO), Ok((3, vec![edge(8, 1, 2, Some(0.5)), edge(10, 2, 3, None)])));
        for same in ["<![CDATA[0.5]]>", "0.<!-- five -->5", " 0.5\n"] {
            assert_eq!(read(&TWO.replace(">0.5<", &format!(">{same}<"))).unwrap().1[0].weight, Some(0.5));
        }
        let text =
            TWO.replace(r#"attr.type="double" />"#, r#"attr.type="double"><default>4</default></key>"#);
        assert_eq!(read(&text).unwrap().1.last().unwrap().weight, Some(4.0));
    }

    #[test]
    fn what_is_wrong_names_line_and_value() {
        let wrong = |from: &str, to: &str| {
            assert!(TWO.contains(from), "{from}");
            read(&TWO.replace(from, to)).unwrap_err()
        };
        assert_eq!(
            wrong("\"undirected\"", "\"directed\""),
            ", line 8: the edge from 1 to 2 is directed, and the graph must be undirected (Assumption 1)"
        );
        assert_eq!(
            wrong("<node id=\"1\"", "<node id=\"n0\""),
            ", line 6: 'n0' must be an id, a whole number from 1 to 1000000"
        );
        assert_eq!(wrong(">0.5<", ">-2<"), ", line 9: weight '-2' must be > 0 (edge weight)");
        assert_eq!(wrong("source=\"2\" ", ""), ", line 10: <edge> must have 'source'");
        assert!(wrong("</graph>", "").starts_with(", line 12: not valid XML: "));
        assert_eq!(wrong("  </graph>\n</graphml>\n", ""), ", line 11: the file ends within an element");
        assert_eq!(
            wrong("<edge source=\"2\"", "<edge directed=\"1\" source=\"2\""),
            ", line 10: the edge from 2 to 3 is directed, and the graph must be undirected (Assumption 1)"
        );
        assert!(wrong(">0.5<", ">0&#46;5<").contains("without entities"));
        assert_eq!(read("<graphml/>"), Err(" must have one <graph>, and has 0".to_owned()));
        assert!(wrong("<node id=\"1\" />", "<hyperedge/>").starts_with(", line 6: <hyperedge>"));
    }
}
