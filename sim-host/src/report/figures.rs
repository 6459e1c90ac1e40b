//! Reads figures out of a `summary.json` by the names of the contract. What is not there, or `null`, is not known.

use crate::number_format::significant;
use crate::printable::printable;
use maud::{Markup, html};
use serde_json::Value;

/// Digits of a figure.
const DIGITS: usize = 4;

/// The value at a place such as `funnel.max_ratio`.
pub(super) fn at<'a>(summary: &'a Value, path: &str) -> Option<&'a Value> {
    let found = path.split('.').try_fold(summary, |value, part| value.get(part))?;
    (!found.is_null()).then_some(found)
}

/// The number there.
pub(super) fn number(summary: &Value, path: &str) -> Option<f64> {
    at(summary, path)?.as_f64()
}

/// The text there, on one line.
pub(super) fn text(summary: &Value, path: &str) -> Option<String> {
    Some(printable(at(summary, path)?.as_str()?).into_owned())
}

/// The entries of the list there; none where there is no list.
pub(super) fn list<'a>(summary: &'a Value, path: &str) -> &'a [Value] {
    at(summary, path).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// The entries of a list, or the one object in its place, as `bus.can` has it.
pub(super) fn one_or_more<'a>(summary: &'a Value, path: &str) -> &'a [Value] {
    match at(summary, path) {
        Some(Value::Array(list)) => list,
        Some(one) => std::slice::from_ref(one),
        None => &[],
    }
}

/// A number as people write it.
pub(super) fn short(value: f64) -> String {
    if value.is_nan() { "not known".to_owned() } else { significant(value, DIGITS) }
}

/// The figure there, or that it is not known.
pub(super) fn known(summary: &Value, path: &str) -> String {
    at(summary, path).map_or("not known".to_owned(), shown)
}

/// Any value on one line: whole numbers with all their digits, others with as many as people read.
pub(super) fn shown(value: &Value) -> String {
    match value {
        Value::Null => "not known".to_owned(),
        Value::Bool(true) => "yes".to_owned(),
        Value::Bool(false) => "no".to_owned(),
        Value::Number(number) if number.is_f64() => short(number.as_f64().unwrap_or(f64::NAN)),
        Value::String(text) => printable(text).into_owned(),
        Value::Array(list) if list.is_empty() => "none".to_owned(),
        Value::Array(list) if list.iter().all(|entry| !entry.is_object()) => {
            list.iter().map(shown).collect::<Vec<_>>().join(", ")
        }
        other => printable(&other.to_string()).into_owned(),
    }
}

/// A part of a summary as a table of names and values, with what is 0 in one line; lists of objects are left to those who know them.
pub(super) fn part(value: &Value, caption: &str) -> Markup {
    let mut rows = Vec::new();
    collect("", value, &mut rows);
    let (zero, rows): (Vec<_>, Vec<_>) = rows.into_iter().partition(|(_, value)| value == "0");
    html! {
        @if !rows.is_empty() {
            table.pairs {
                caption { (caption) }
                tbody { @for (name, value) in &rows { tr { th scope="row" { (name) } td.n { (value) } } } }
            }
        }
        @if !zero.is_empty() { p.note { "0: " (zero.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ")) "." } }
    }
}

fn collect(name: &str, value: &Value, rows: &mut Vec<(String, String)>) {
    match value {
        Value::Object(map) => {
            for (key, value) in map {
                let key = printable(key);
                let name = if name.is_empty() { key.into_owned() } else { format!("{name}.{key}") };
                collect(&name, value, rows);
            }
        }
        Value::Array(list) if list.iter().any(Value::is_object) => {
            rows.push((name.to_owned(), format!("{} entries", list.len())));
        }
        _ => rows.push((name.to_owned(), shown(value))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_is_missing_or_null_is_not_known() {
        let summary =
            json!({ "funnel": { "max_ratio": 0.123_456, "reopened_ratio": null }, "ticks": 123_456_789 });
        assert_eq!(known(&summary, "funnel.max_ratio"), "0.1235");
        assert_eq!(known(&summary, "ticks"), "123456789");
        for path in ["funnel.reopened_ratio", "funnel.max", "sync.bound", "ticks.more"] {
            assert_eq!(known(&summary, path), "not known", "{path}");
        }
    }

    #[test]
    fn a_part_is_a_table_and_its_texts_are_escaped() {
        let text =
            part(&json!({ "a": { "b<i>": "</td>" }, "n": [{}, {}], "x": 0, "y": 0.0, "z": 1 }), "Part")
                .into_string();
        assert!(
            text.contains("<th scope=\"row\">a.b&lt;i&gt;</th><td class=\"n\">&lt;/td&gt;</td>"),
            "{text}"
        );
        assert!(text.contains("2 entries") && text.contains("<p class=\"note\">0: x, y.</p>"), "{text}");
    }
}
