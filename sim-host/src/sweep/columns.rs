//! The columns of a table, in an order that their names alone decide.

use std::cmp::Ordering;

/// Columns of the verdict, and of what depends on the machine, at the end.
pub const TAIL: [&str; 4] = ["verdict", "why", "wall_s", "cpu_s"];
/// Parts of the summary, in its order.
const PARTS: [&str; 16] = [
    "trace_hash",
    "nodes",
    "ticks",
    "tick_s",
    "funnel",
    "sync",
    "emergent",
    "reference",
    "bus",
    "clocks",
    "counters",
    "max_input",
    "expect",
    "check",
    "stopped",
    "overruns",
];

/// Columns: number, parameters and seed, then figures, then the verdict.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Columns {
    head: Vec<String>,
    figures: Vec<String>,
}

impl Columns {
    /// Without figures.
    #[must_use]
    pub fn new(parameters: &[String]) -> Self {
        let names = [&["run".to_owned()], parameters, &["repetition".to_owned(), "seed".to_owned()]];
        Self { head: names.concat(), figures: Vec::new() }
    }

    /// Makes room for figures; whether there was none for one of them.
    pub fn add<'n>(&mut self, names: impl IntoIterator<Item = &'n String>) -> bool {
        let before = self.figures.len();
        for name in names {
            if self.is_fixed(name) {
                continue;
            }
            if let Err(at) = self.figures.binary_search_by(|other| compare(other, name)) {
                self.figures.insert(at, name.clone());
            }
        }
        self.figures.len() > before
    }

    fn is_fixed(&self, name: &str) -> bool {
        TAIL.contains(&name) || self.head.iter().any(|it| it == name)
    }

    /// Whether a table with this header is of the same sweep; its figures are made room for.
    pub fn takes(&mut self, header: &[String]) -> bool {
        let has_head = header.starts_with(&self.head);
        let mut other = Self { figures: Vec::new(), ..self.clone() };
        other.add(header);
        self.add(&other.figures);
        has_head && other.names() == header
    }

    /// All names, in order.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        let tail = TAIL.iter().map(|&name| name.to_owned());
        self.head.iter().chain(&self.figures).cloned().chain(tail).collect()
    }
}

/// By part of the summary, then by name, with numbers in names as numbers.
fn compare(a: &str, b: &str) -> Ordering {
    let rank = |name: &str| {
        let part = name.split('.').next().unwrap_or(name);
        PARTS.iter().position(|it| *it == part).unwrap_or(PARTS.len())
    };
    rank(a).cmp(&rank(b)).then_with(|| natural(a).cmp(&natural(b))).then_with(|| a.cmp(b))
}

/// A name in parts: text, and the number after it.
fn natural(name: &str) -> Vec<(&str, u64)> {
    let part = |part: &'_ str| part.parse::<u64>().ok();
    name.split('.')
        .map(|text| (if part(text).is_some() { "" } else { text }, part(text).unwrap_or(0)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(list: &[&str]) -> Vec<String> {
        list.iter().map(|&name| name.to_owned()).collect()
    }

    #[test]
    fn the_order_does_not_depend_on_which_came_first() {
        let figures = names(&[
            "emergent.ratio.10",
            "expect.a.pass",
            "zeta",
            "emergent.ratio.9",
            "funnel.max_ratio",
            "bus.sent",
        ]);
        let expected = [
            "run",
            "bus.loss",
            "repetition",
            "seed",
            "funnel.max_ratio",
            "emergent.ratio.9",
            "emergent.ratio.10",
            "bus.sent",
            "expect.a.pass",
            "zeta",
            "verdict",
            "why",
            "wall_s",
            "cpu_s",
        ];
        for turn in 0..figures.len() {
            let mut columns = Columns::new(&names(&["bus.loss"]));
            for at in 0..figures.len() {
                assert!(columns.add([&figures[(at + turn) % figures.len()]]));
            }
            assert!(!columns.add(&figures));
            assert_eq!(columns.names(), expected);
        }
    }

    #[test]
    fn a_header_of_another_sweep_is_not_taken() {
        let mut columns = Columns::new(&names(&["bus.loss"]));
        columns.add(&names(&["ticks"]));
        let whole = columns.names();
        let mut fresh = Columns::new(&names(&["bus.loss"]));
        assert!(fresh.takes(&whole) && fresh == columns);
        assert!(!Columns::new(&names(&["time.tick"])).takes(&whole));
        assert!(!Columns::new(&names(&["bus.loss"])).takes(&whole[..3]));
    }
}
