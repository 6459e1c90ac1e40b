//! What nodes have said that cannot be so: refused, counted, and named with what came first.

use std::fmt;

/// One kind of it, of one node.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Doubt {
    node: u8,
    /// What it has done, to follow its name.
    what: &'static str,
    /// The value that came first, and the tick at which it did.
    first: String,
    tick: u32,
    count: u64,
}

/// All of them, in the order in which they began.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Doubts(Vec<Doubt>);

impl Doubts {
    /// Takes note that `node` has done `what`; `value` says with what.
    pub(crate) fn note(&mut self, node: u8, what: &'static str, tick: u32, value: impl FnOnce() -> String) {
        match self.0.iter_mut().find(|doubt| doubt.node == node && doubt.what == what) {
            Some(doubt) => doubt.count = doubt.count.saturating_add(1),
            None => self.0.push(Doubt { node, what, first: value(), tick, count: 1 }),
        }
    }

    /// A sentence for each.
    pub(crate) fn sentences(&self) -> Vec<String> {
        self.0.iter().map(Doubt::to_string).collect()
    }

    /// The same for one node.
    pub(crate) fn of(&self, node: u8) -> Vec<String> {
        self.0.iter().filter(|doubt| doubt.node == node).map(Doubt::to_string).collect()
    }
}

impl fmt::Display for Doubt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { node, what, first, tick, count } = self;
        write!(f, "node {node} {what}: {first} at tick {tick}")?;
        if *count > 1 { write!(f, ", {count} times") } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_named_once_with_its_first_value_and_counted() {
        let mut doubts = Doubts::default();
        for (node, value) in [(2, "nu = NaN"), (2, "u = inf"), (3, "psi = 0")] {
            doubts.note(node, "sent telemetry that is no measurement", 50, || value.to_owned());
        }
        doubts.note(2, "spoke as another node", 51, || "a state of node 7".to_owned());
        let expected = [
            "node 2 sent telemetry that is no measurement: nu = NaN at tick 50, 2 times",
            "node 3 sent telemetry that is no measurement: psi = 0 at tick 50",
            "node 2 spoke as another node: a state of node 7 at tick 51",
        ];
        assert_eq!(doubts.sentences(), expected);
        assert_eq!(doubts.of(3), [expected[1]]);
    }
}
