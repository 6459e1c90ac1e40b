//! The report as people read it: a line per finding, what to change below it, then a table of the nodes.
//!
//! `{report:60}` has lines of 60 characters.

use std::fmt;

use super::{Finding, NodeRow, Report, Status, about, figure};
use crate::scenario::format_duration;

/// Characters of a line, where nothing else is asked for, and the fewest that are heeded.
const WIDTH: usize = 117;
const LEAST: usize = 40;
/// Where the text of a finding begins.
const INDENT: usize = 31;
/// The same below its title, where lines are shorter than this.
const NARROW: usize = 80;
const NARROW_INDENT: usize = 4;
/// The most nodes that the table shows.
const MOST_ROWS: usize = 16;

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = f.width().unwrap_or(WIDTH).clamp(LEAST, WIDTH);
        let tick = format_duration((self.tick_s * 1e9).round() as u64);
        paragraph(f, &format!("{} ({})", self.scenario, self.path), width)?;
        let (nodes, edges) = (plural(self.nodes, "node"), plural(self.edges, "edge"));
        let ticks = plural(self.ticks as usize, "tick");
        paragraph(f, &format!("{nodes}, {edges}, {ticks} of {tick}, seed {}", self.seed), width)?;
        writeln!(f)?;
        for finding in &self.findings {
            write(f, finding, width)?;
        }
        if (1..=MOST_ROWS).contains(&self.per_node.len()) {
            tables(f, &self.per_node, width)?;
        }
        if let Some(bus) = &self.bus {
            writeln!(f)?;
            bus.told().iter().try_for_each(|line| writeln!(f, "{line}"))?;
        }
        let (warnings, failures) = (self.count(Status::Warn), self.count(Status::Fail));
        let (held, notes, unknown) =
            (self.count(Status::Ok), self.count(Status::Note), self.count(Status::NotChecked));
        let counts = format!(
            "{held} ok, {}, {unknown} not checked, {} and {}",
            plural(notes, "note"),
            plural(warnings, "warning"),
            plural(failures, "failure")
        );
        write!(f, "\n{}", wrapped(&counts, width).join("\n"))
    }
}

fn paragraph(f: &mut fmt::Formatter<'_>, text: &str, width: usize) -> fmt::Result {
    wrapped(text, width).iter().try_for_each(|line| writeln!(f, "{line}"))
}

fn write(f: &mut fmt::Formatter<'_>, finding: &Finding, width: usize) -> fmt::Result {
    let mark = match finding.status {
        Status::Ok => "ok",
        Status::Note => "note",
        Status::NotChecked => "NOT CHECKED",
        Status::Warn => "WARN",
        Status::Fail => "FAIL",
    };
    let begin = format!("{mark:<12} {:<18}", finding.title);
    let indent = if width < NARROW { NARROW_INDENT } else { INDENT };
    if width < NARROW {
        writeln!(f, "{}", begin.trim_end())?;
    }
    for (index, line) in wrapped(&finding.text, width - indent).iter().enumerate() {
        match index {
            0 if width >= NARROW => writeln!(f, "{begin}{line}")?,
            _ => writeln!(f, "{:indent$}{line}", "")?,
        }
    }
    let advice = finding.advice.as_ref().map_or("", |advice| &advice.text);
    for (index, line) in wrapped(advice, width - indent - 3).iter().enumerate() {
        writeln!(f, "{:indent$}{} {line}", "", if index == 0 { "->" } else { "  " })?;
    }
    Ok(())
}

/// The words of a text in lines of so many characters; no line for no words.
fn wrapped(text: &str, width: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// A column of the table: what stands above it, its characters, and its entries.
type Column = (&'static str, usize, fn(&NodeRow) -> String);

const COLUMNS: [Column; 7] = [
    ("degree", 8, |row| figure(row.degree)),
    ("start |nu|/psi", 16, |row| about(row.start_ratio)),
    ("narrowest psi", 15, |row| about(row.psi_min)),
    ("tick holds", 12, |row| optional(row.tick_floor)),
    ("f32 holds", 11, |row| optional(row.resolution)),
    ("largest |u|", 13, |row| optional(row.input)),
    ("margin 1 - |s|", 16, |row| optional(row.margin)),
];
/// Characters of the column of ids.
const IDS: usize = 5;

fn optional(value: Option<f64>) -> String {
    value.map_or("-".to_owned(), about)
}

/// One table, or several one below the other where the lines have no room for all columns.
fn tables(f: &mut fmt::Formatter<'_>, rows: &[NodeRow], width: usize) -> fmt::Result {
    let mut rest = &COLUMNS[..];
    while !rest.is_empty() {
        let mut used = IDS;
        let fits = |(_, wide, _): &&Column| {
            used += 1 + wide;
            used <= width
        };
        let (columns, others) = rest.split_at(rest.iter().take_while(fits).count().max(1));
        table(f, rows, columns)?;
        rest = others;
    }
    Ok(())
}

fn table(f: &mut fmt::Formatter<'_>, rows: &[NodeRow], columns: &[Column]) -> fmt::Result {
    write!(f, "\n{:>IDS$}", "node")?;
    columns.iter().try_for_each(|(head, wide, _)| write!(f, " {head:>wide$}"))?;
    writeln!(f)?;
    for row in rows {
        write!(f, "{:>IDS$}", row.id)?;
        columns.iter().try_for_each(|(_, wide, entry)| write!(f, " {:>wide$}", entry(row)))?;
        writeln!(f)?;
    }
    Ok(())
}

pub(super) fn plural(count: usize, word: &str) -> String {
    if count == 1 { format!("1 {word}") } else { format!("{count} {word}s") }
}

#[cfg(test)]
mod tests {
    use super::wrapped;

    #[test]
    fn lines_break_between_words() {
        assert_eq!(wrapped("one two three", 7), ["one two", "three"]);
        assert_eq!(wrapped("one two three", 6), ["one", "two", "three"]);
        assert_eq!(wrapped("", 7), [""; 0]);
    }

    #[test]
    fn lines_are_as_long_as_is_asked_for_and_say_the_same() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
        let scenario = crate::scenario::Scenario::load(&path, &[]).unwrap();
        let report = super::super::check(&scenario);
        let words = |text: &str| {
            let mut words: Vec<String> = text.split_whitespace().map(str::to_owned).collect();
            words.retain(|word| !["node", "1", "2", "3", "4", "5"].contains(&word.as_str()));
            words.sort();
            words
        };
        let whole = report.to_string();
        assert_eq!(whole, format!("{report:200}"));
        for width in [40, 60, 79, 80, 100, 117] {
            let text = format!("{report:width$}");
            let longest = text.lines().map(|line| line.chars().count()).max();
            // A path is one word.
            let path = report.path.chars().count() + 2;
            assert!(longest <= Some(width.max(path)), "{longest:?} of {width}:\n{text}");
            assert_eq!(words(&text), words(&whole), "{width}");
        }
    }
}
