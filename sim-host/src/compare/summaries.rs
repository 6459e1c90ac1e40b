//! Summaries: which of their figures differ.

use crate::printable::printable;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt;

/// A figure that differs.
#[derive(Clone, Debug, Serialize)]
pub struct Figure {
    /// Its place in the summary, as `funnel.max_ratio`.
    pub key: String,
    /// Value in A; none where it is not there.
    pub a: Option<Value>,
    /// Value in B.
    pub b: Option<Value>,
}

impl fmt::Display for Figure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = |value: &Option<Value>| {
            value.as_ref().map_or("not there".to_owned(), |value| printable(&value.to_string()).into_owned())
        };
        write!(f, "{}: {} in A, {} in B", printable(&self.key), word(&self.a), word(&self.b))
    }
}

/// Whether a figure says how a run was made rather than what came of it: it differs from repetition to
/// repetition.
fn is_of_the_machine(key: &str) -> bool {
    let leaf = key.rsplit('.').next().unwrap_or(key);
    leaf.starts_with("wall_") || leaf.starts_with("cpu_") || key == "command" || key == "version"
}

/// The figures that differ, in the order of their keys.
pub(super) fn differing(a: &Value, b: &Value) -> Vec<Figure> {
    let (mut left, mut right) = (BTreeMap::new(), BTreeMap::new());
    flatten("", a, &mut left);
    flatten("", b, &mut right);
    let keys: std::collections::BTreeSet<&String> = left.keys().chain(right.keys()).collect();
    let figure = |key: &String| Figure {
        key: key.clone(),
        a: left.get(key).map(|value| (*value).clone()),
        b: right.get(key).map(|value| (*value).clone()),
    };
    keys.into_iter()
        .filter(|key| !is_of_the_machine(key))
        .map(figure)
        .filter(|figure| figure.a != figure.b)
        .collect()
}

fn flatten<'a>(key: &str, value: &'a Value, all: &mut BTreeMap<String, &'a Value>) {
    let deeper = |part: &str| if key.is_empty() { part.to_owned() } else { format!("{key}.{part}") };
    match value {
        Value::Object(map) if !map.is_empty() => {
            map.iter().for_each(|(part, value)| flatten(&deeper(part), value, all));
        }
        Value::Array(list) if !list.is_empty() => {
            list.iter().enumerate().for_each(|(n, value)| flatten(&deeper(&n.to_string()), value, all));
        }
        _ => {
            all.insert(key.to_owned(), value);
        }
    }
}
