//! A scenario as it was run, as TOML: what `--out` keeps, and what a run can be repeated from.

use super::tree::{Item, Table, Value};
use std::fmt::Write as _;

/// The first line of such a file, by which this program knows its own again.
pub const FIRST_LINE: &str = "# The scenario as it was run, written by sim-host.";

/// The text of a scenario with the values of the command line in it. It is the file itself where that says
/// everything: without `--set`, and with a title, which is otherwise the name of the file.
pub(super) fn as_run(text: &str, mut root: Item, title: &str, is_unchanged: bool) -> String {
    let body = match &mut root.value {
        Value::Table(table) if !is_unchanged || !table.contains_key("title") => {
            let place = root.place.clone();
            let written = Item { value: Value::Text(title.to_owned()), ..Item::empty_table(&place, "title") };
            table.entry("title".to_owned()).or_insert(written);
            document(table)
        }
        _ => text.trim_start_matches('\u{feff}').to_owned(),
    };
    let body =
        body.strip_prefix(FIRST_LINE).map_or(body.as_str(), |rest| rest.trim_start_matches(['\r', '\n']));
    format!("{FIRST_LINE}\n{body}")
}

/// Values first, then a section for each table and each element of an array of tables.
fn document(table: &Table) -> String {
    let mut text = String::new();
    let is_section = |item: &Item| matches!(item.value, Value::Table(_)) || tables(item).is_some();
    for (key, item) in table.iter().filter(|(_, item)| !is_section(item)) {
        entry(&mut text, key, item);
    }
    for (key, item) in table.iter().filter(|(_, item)| is_section(item)) {
        let key = quoted_key(key);
        if let Value::Table(section) = &item.value {
            section_of(&mut text, &format!("[{key}]"), section);
        }
        for section in tables(item).unwrap_or_default() {
            section_of(&mut text, &format!("[[{key}]]"), section);
        }
    }
    text
}

/// The elements of an array that has nothing but tables, and one at least.
fn tables<'i>(item: &'i Item) -> Option<Vec<&'i Table>> {
    let Value::Array(items) = &item.value else { return None };
    let table = |item: &'i Item| match &item.value {
        Value::Table(table) => Some(table),
        _ => None,
    };
    let tables: Vec<_> = items.iter().map_while(table).collect();
    (!items.is_empty() && tables.len() == items.len()).then_some(tables)
}

fn section_of(text: &mut String, header: &str, section: &Table) {
    // Writing to a string does not fail, here and below.
    let _ = writeln!(text, "\n{header}");
    section.iter().for_each(|(key, item)| entry(text, key, item));
}

fn entry(text: &mut String, key: &str, item: &Item) {
    let _ = writeln!(text, "{} = {}", quoted_key(key), inline(&item.value));
}

/// A value in one line, so that reading it gives the same again.
pub(super) fn inline(value: &Value) -> String {
    match value {
        Value::Integer(integer) => integer.to_string(),
        // `{:?}` has the fewest digits that read as the same number, and a point or an exponent.
        Value::Float(float) if float.is_nan() => "nan".to_owned(),
        Value::Float(float) => format!("{float:?}"),
        Value::Bool(value) => value.to_string(),
        Value::Text(text) => quoted(text),
        // No key accepts one.
        Value::Date => quoted("a date"),
        Value::Array(items) => {
            let items: Vec<_> = items.iter().map(|item| inline(&item.value)).collect();
            format!("[{}]", items.join(", "))
        }
        Value::Table(table) if table.is_empty() => "{}".to_owned(),
        Value::Table(table) => {
            let entry =
                |(key, item): (&String, &Item)| format!("{} = {}", quoted_key(key), inline(&item.value));
            format!("{{ {} }}", table.iter().map(entry).collect::<Vec<_>>().join(", "))
        }
    }
}

fn quoted_key(key: &str) -> String {
    let is_bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if !key.is_empty() && key.chars().all(is_bare) { key.to_owned() } else { quoted(key) }
}

/// A basic string.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(quoted, "\\u{:04X}", u32::from(c));
            }
            c => quoted.push(c),
        }
    }
    quoted + "\""
}

#[cfg(test)]
mod tests {
    use super::super::{Override, Scenario};
    use super::*;
    use std::path::Path;

    fn folder() -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios")
    }

    fn again(scenario: &Scenario) -> Scenario {
        // Beside nothing but what was written with it.
        let folder = tempfile::tempdir().unwrap();
        for file in &scenario.input_files {
            std::fs::write(folder.path().join(&file.name), &file.text).unwrap();
        }
        let again = Scenario::parse(&scenario.as_run, &folder.path().join("as-run.toml"), &[]).unwrap();
        let (path, as_run) = (scenario.path.clone(), scenario.as_run.clone());
        Scenario { path, as_run, input_files: scenario.input_files.clone(), ..again }
    }

    #[test]
    fn every_scenario_reads_as_itself_with_and_without_values_of_the_command_line() {
        let mut count = 0;
        for entry in std::fs::read_dir(folder()).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "toml") {
                continue;
            }
            for sets in [vec![], vec!["seed=7", "agent.noise=1e-9", "node.1.noise=0.1"]] {
                let overrides: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
                let scenario = Scenario::load(&path, &overrides).unwrap();
                assert_eq!(again(&scenario), scenario, "{}\n{}", path.display(), scenario.as_run);
                count += 1;
            }
        }
        assert!(count > 20);
    }

    #[test]
    fn a_file_that_says_everything_is_kept_with_its_comments() {
        let path = folder().join("five-agents.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let scenario = Scenario::load(&path, &[]).unwrap();
        assert_eq!(scenario.as_run, format!("{FIRST_LINE}\n{text}"));
        assert_eq!(Scenario::parse(&scenario.as_run, &path, &[]).unwrap().as_run, scenario.as_run);
    }

    #[test]
    fn a_missing_title_is_written_down() {
        let path = folder().join("five-agents.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let text: String =
            text.lines().filter(|line| !line.starts_with("title")).flat_map(|line| [line, "\n"]).collect();
        let scenario = Scenario::parse(&text, Path::new("mine \"1\".toml"), &[]).unwrap();
        assert_eq!(scenario.title, "mine \"1\"");
        assert_eq!(again(&scenario), scenario);
    }

    #[test]
    fn strings_and_numbers_are_written_so_that_they_read_as_they_were() {
        let text = |value: &str| Value::Text(value.to_owned());
        assert_eq!(inline(&text("a\"b\\c\n\u{7f}ψ")), r#""a\"b\\c\u000A\u007Fψ""#);
        for (float, written) in [(1.0, "1.0"), (1e-9, "1e-9"), (-0.0, "-0.0"), (f64::INFINITY, "inf")] {
            assert_eq!(inline(&Value::Float(float)), written);
        }
        assert_eq!(quoted_key("a.b"), "\"a.b\"");
    }
}
