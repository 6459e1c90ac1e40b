//! The report as people read it: a line per finding, what to change below it, then a table of the nodes.

use std::fmt;

use super::{Finding, NodeRow, Report, Status, about, figure};
use crate::scenario::format_duration;

/// Characters of a line.
const WIDTH: usize = 117;
/// Where the text of a finding begins.
const INDENT: usize = 31;
/// The most nodes that the table shows.
const MOST_ROWS: usize = 16;

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tick = format_duration((self.tick_s * 1e9).round() as u64);
        writeln!(f, "{} ({})", self.scenario, self.path)?;
        let (nodes, edges) = (plural(self.nodes, "node"), plural(self.edges, "edge"));
        writeln!(
            f,
            "{nodes}, {edges}, {} of {tick}, seed {}\n",
            plural(self.ticks as usize, "tick"),
            self.seed
        )?;
        for finding in &self.findings {
            write(f, finding)?;
        }
        if self.per_node.len() <= MOST_ROWS {
            table(f, &self.per_node)?;
        }
        if let Some(bus) = &self.bus {
            writeln!(f)?;
            bus.told().iter().try_for_each(|line| writeln!(f, "{line}"))?;
        }
        let (warnings, failures) = (self.count(Status::Warn), self.count(Status::Fail));
        let (held, notes, unknown) =
            (self.count(Status::Ok), self.count(Status::Note), self.count(Status::NotChecked));
        write!(
            f,
            "\n{held} ok, {}, {unknown} not checked, {} and {}",
            plural(notes, "note"),
            plural(warnings, "warning"),
            plural(failures, "failure")
        )
    }
}

fn write(f: &mut fmt::Formatter<'_>, finding: &Finding) -> fmt::Result {
    let mark = match finding.status {
        Status::Ok => "ok",
        Status::Note => "note",
        Status::NotChecked => "NOT CHECKED",
        Status::Warn => "WARN",
        Status::Fail => "FAIL",
    };
    let lines = wrapped(&finding.text, WIDTH - INDENT);
    for (index, line) in lines.iter().enumerate() {
        let (mark, title) = if index == 0 { (mark, finding.title) } else { ("", "") };
        writeln!(f, "{mark:<12} {title:<18}{line}")?;
    }
    let advice = finding.advice.as_ref().map_or("", |advice| &advice.text);
    for (index, line) in wrapped(advice, WIDTH - INDENT - 3).iter().enumerate() {
        writeln!(f, "{:INDENT$}{} {line}", "", if index == 0 { "->" } else { "  " })?;
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

fn table(f: &mut fmt::Formatter<'_>, rows: &[NodeRow]) -> fmt::Result {
    writeln!(
        f,
        "\n node   degree   start |nu|/psi   narrowest psi   tick holds   f32 holds   largest |u|   margin 1 - |s|"
    )?;
    for row in rows {
        let optional = |value: Option<f64>| value.map_or("-".to_owned(), about);
        writeln!(
            f,
            "{:>5} {:>8} {:>16} {:>15} {:>12} {:>11} {:>13} {:>16}",
            row.id,
            figure(row.degree),
            about(row.start_ratio),
            about(row.psi_min),
            optional(row.tick_floor),
            optional(row.resolution),
            optional(row.input),
            optional(row.margin)
        )?;
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
}
