//! The figures of a summary as cells of a row: every number, verdict and hash, by its path.

use crate::record::Summary;
use serde_json::Value;
use std::collections::BTreeMap;

/// What is no figure, or is another one in every repetition, or has paths in it.
const LEFT_OUT: [&str; 9] =
    ["scenario", "seed", "on", "passed", "expect", "checks", "version", "command", "wall_s"];

/// The cells of a summary by the names of their columns; what it does not have has no cell.
#[must_use]
pub fn figures(summary: &Summary) -> BTreeMap<String, String> {
    let mut cells = BTreeMap::new();
    let Ok(Value::Object(parts)) = serde_json::to_value(summary) else { return cells };
    for (name, value) in parts.iter().filter(|(name, _)| !LEFT_OUT.contains(&name.as_str())) {
        flatten(name, value, &mut cells);
    }
    for expected in &summary.expect {
        let mut cell = |what: &str, value: Value| {
            flatten(&format!("expect.{}.{what}", expected.name), &value, &mut cells)
        };
        cell("limit", expected.limit.into());
        cell("value", expected.value.into());
        cell("pass", expected.pass.into());
    }
    for check in &summary.checks {
        flatten(&format!("check.{}", check.name), &check.pass.into(), &mut cells);
    }
    cells
}

fn flatten(name: &str, value: &Value, cells: &mut BTreeMap<String, String>) {
    match value {
        Value::Null => {}
        // Ids: how many there are differs from run to run.
        Value::Array(ids) if name == "stopped" => {
            let ids: Vec<_> = ids.iter().map(Value::to_string).collect();
            insert(name, ids.join(" "), cells);
        }
        // As many as there are events, which may be drawn.
        Value::Array(_) if name == "events" => {}
        // Who won how often over an identifier, which is the sum of others.
        Value::Array(_) if name.ends_with(".lost_to") => {}
        Value::Array(items) => {
            for (index, item) in items.iter().enumerate() {
                flatten(
                    &format!("{name}.{}", label(item).unwrap_or_else(|| (index + 1).to_string())),
                    item,
                    cells,
                );
            }
        }
        Value::Object(parts) => {
            for (part, value) in parts.iter().filter(|(part, _)| part.as_str() != "id") {
                // Identifiers are columns of the bus.
                let is_table = part == "identifiers";
                flatten(&if is_table { name.to_owned() } else { format!("{name}.{part}") }, value, cells);
            }
        }
        Value::String(text) => insert(name, crate::printable::printable(text).into_owned(), cells),
        Value::Bool(_) | Value::Number(_) => insert(name, value.to_string(), cells),
    }
}

/// How an element of a list is called.
fn label(item: &Value) -> Option<String> {
    item.get("id").and_then(Value::as_str).map(str::to_owned)
}

fn insert(name: &str, text: String, cells: &mut BTreeMap<String, String>) {
    if !text.is_empty() {
        cells.insert(name.to_owned(), text);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::table::{BusTable, BusTables, IdentifierRow};
    use crate::judge::Check;
    use crate::record::{BusSummary, Expectation, FunnelSummary};

    #[test]
    fn every_figure_has_a_cell_and_words_and_paths_have_none() {
        let identifier = IdentifierRow {
            id: "18a".into(),
            frames: 7,
            lost_to: vec![("181".into(), 1)],
            ..Default::default()
        };
        let can = BusTables(vec![BusTable {
            interface: "can0".into(),
            identifiers: vec![identifier],
            ..Default::default()
        }]);
        let summary = Summary {
            scenario: "Five".into(),
            command: "/home/me/sim-host".into(),
            wall_s: 1.5,
            trace_hash: Some("00000000deadbeef".into()),
            funnel: Some(FunnelSummary {
                max_ratio: 0.1,
                reopened_ratio: Some(f64::NAN),
                ..Default::default()
            }),
            expect: vec![Expectation::below("final_spread", 0.1, Some(0.25))],
            checks: vec![Check { name: "heard", pass: true, text: "all".into() }],
            stopped: vec![3, 11],
            bus: Some(BusSummary { can, sent: 12, ..Default::default() }),
            ..Default::default()
        };
        let cells = figures(&summary);
        let cell = |name: &str| cells.get(name).map(String::as_str);
        for (name, text) in [
            ("trace_hash", "00000000deadbeef"),
            ("funnel.max_ratio", "0.1"),
            ("expect.final_spread.limit", "0.1"),
            ("expect.final_spread.value", "0.25"),
            ("expect.final_spread.pass", "false"),
            ("check.heard", "true"),
            ("stopped", "3 11"),
            ("bus.sent", "12"),
            ("bus.can.18a.frames", "7"),
        ] {
            assert_eq!(cell(name), Some(text), "{name}");
        }
        assert_eq!(cell("funnel.reopened_ratio"), None);
        assert!(cells.values().all(|text| !text.contains("home") && text != "1.5" && text != "Five"));
        assert!(cells.keys().all(|name| !name.contains("lost_to")));
    }
}
