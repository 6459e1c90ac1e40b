//! The committed schema of the scenario file against the reader: every key, both ways, and every scenario of the repository.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Map, Value, json};
use sim_host::scenario::{Diagnostics, Problem, Scenario};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn printed() -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_sim-host")).arg("schema").output().unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap()
}

fn schema() -> Value {
    serde_json::from_str(&printed()).unwrap()
}

#[test]
fn the_committed_schema_is_the_printed_one() {
    let path = repository().join("docs/scenario.schema.json");
    let printed = printed();
    if std::env::var_os("UPDATE_SNAPSHOTS").is_some() {
        fs::write(&path, &printed).unwrap();
    }
    assert!(
        fs::read_to_string(&path).unwrap_or_default() == printed,
        "docs/scenario.schema.json is not what `sim-host schema` prints. If the change is meant: UPDATE_SNAPSHOTS=1 cargo test \
         --package sim-host --test schema"
    );
}

#[test]
fn every_scenario_passes() {
    let validator = jsonschema::validator_for(&schema()).unwrap();
    let mut count = 0;
    for entry in fs::read_dir(repository().join("scenarios")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let document: Value = toml::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
        let errors: Vec<_> = validator
            .iter_errors(&document)
            .map(|error| format!("{}: {error}", error.instance_path()))
            .collect();
        assert!(errors.is_empty(), "{}: {errors:#?}", path.display());
        count += 1;
    }
    assert!(count > 20);
}

/// What walks the schema: each section of each kind is put into a scenario, and read.
struct Walk {
    validator: jsonschema::Validator,
    folder: tempfile::TempDir,
    keys: usize,
    accepted: usize,
    refused: usize,
    wrong: Vec<String>,
}

/// Puts a section into a scenario around it.
type Around<'a> = &'a dyn Fn(Value) -> Value;

#[test]
fn every_key_is_the_readers_both_ways() {
    let schema = schema();
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("load.csv"), "t,p_kw\n0,1\n100,2\n").unwrap();
    let validator = jsonschema::validator_for(&schema).unwrap();
    let mut walk = Walk { validator, folder, keys: 0, accepted: 0, refused: 0, wrong: Vec::new() };
    walk.section(&schema, "", &|section| section);
    println!("{} keys, {} values accepted, {} refused", walk.keys, walk.accepted, walk.refused);
    assert!(walk.wrong.is_empty(), "{} wrong:\n{}", walk.wrong.len(), walk.wrong.join("\n"));
    assert!(walk.keys > 150 && walk.refused > walk.keys);
}

/// A scenario that has everything that one needs, and nothing else.
fn base() -> Value {
    json!({
        "version": 1,
        "time": { "tick": "1ms", "duration": "1s" },
        "graph": { "kind": "ring", "nodes": 5 },
        "coupling": {
            "kind": "node-wise",
            "gain": { "kind": "reciprocal", "scale": 1.0 },
            "funnel": { "kind": "constant", "width": 1.0 },
        },
        "agent": { "dynamics": { "kind": "affine", "slope": -1.0 } },
    })
}

fn object(value: &Value) -> &Map<String, Value> {
    value.as_object().unwrap()
}

/// The kinds of a section: those of `oneOf`, or the section itself.
fn branches(schema: &Value) -> Vec<&Value> {
    schema["oneOf"].as_array().map_or_else(|| vec![schema], |all| all.iter().collect())
}

/// Names that the key which tells kinds apart may have; the key.
fn names(branch: &Value) -> Option<(&'static str, Vec<String>)> {
    let key = ["kind", "model"].into_iter().find(|key| branch["properties"].get(key).is_some())?;
    let schema = &branch["properties"][key];
    let one = schema["const"].as_str().map(|name| vec![name.to_owned()]);
    let all =
        || schema["enum"].as_array().unwrap().iter().map(|name| name.as_str().unwrap().to_owned()).collect();
    Some((key, one.unwrap_or_else(all)))
}

/// What a key may be: the alternatives of `anyOf`, or the one.
fn alternatives(schema: &Value) -> Vec<&Value> {
    schema["anyOf"].as_array().map_or_else(|| vec![schema], |all| all.iter().collect())
}

fn is_section(schema: &Value) -> bool {
    schema.get("properties").is_some() || schema.get("oneOf").is_some()
}

/// The least that a section of a kind says.
fn least(branch: &Value, name: Option<&str>, path: &str) -> Value {
    let mut section = Map::new();
    let needed = branch["required"].as_array().cloned().unwrap_or_default();
    for (key, schema) in object(&branch["properties"]) {
        // What is merged over a default of another kind starts afresh, and needs all.
        let is_fresh = path.starts_with("node[].") && name.is_some() && schema.get("default").is_none();
        if needed.contains(&json!(key)) || is_fresh {
            section.insert(key.clone(), example(schema, key));
        }
    }
    if let (Some((key, _)), Some(name)) = (names(branch), name) {
        section.insert(key.to_owned(), json!(name));
    }
    // What is needed of several keys that may each be left out.
    let more = match (path, name) {
        ("", _) => base(),
        ("agent", _) => base()["agent"].clone(),
        ("link[]", _) => json!({ "between": [1, 2], "loss": 0.1, "latency": "1us" }),
        ("event[]", Some("partition" | "repair")) => json!({ "groups": [[1, 2], [3, 4, 5]] }),
        ("event[]", Some(_)) => json!({ "node": 2 }),
        ("expect.window[]", _) => json!({ "spread": 10.0 }),
        _ => json!({}),
    };
    section.extend(object(&more).clone());
    Value::Object(section)
}

/// A value that is shown as an example, or that stands where there is none.
fn example(schema: &Value, key: &str) -> Value {
    let base = base();
    let shown = schema["examples"].get(0).or(schema.get("default")).or(base.get(key));
    match shown {
        Some(value) => value.clone(),
        None if schema["type"] == "array" => json!([]),
        None => json!({}),
    }
}

/// What else a scenario needs for a key to make sense, and keys that stand in its way.
fn fitted(mut document: Value) -> Value {
    if document.get("sync").is_some() && document.get("bus").is_none() {
        document["bus"] = json!({ "model": "can" });
    }
    if document["coupling"]["kind"] == "lambda-tracker" || document["coupling"]["kind"] == "linear" {
        if document["coupling"].get("gain").is_none() {
            document["coupling"]["gain"] = json!({ "kind": "linear", "slope": 1.0 });
        }
    }
    document
}

impl Walk {
    fn read(&self, document: &Value) -> Result<Scenario, Diagnostics> {
        let text: String =
            object(document).iter().map(|(key, value)| format!("{key} = {}\n", inline(value))).collect();
        Scenario::parse(&text, &self.folder.path().join("s.toml"), &[])
    }

    fn section(&mut self, schema: &Value, path: &str, around: Around<'_>) {
        self.kinds(schema, path, around);
        for branch in branches(schema) {
            match names(branch) {
                Some((_, names)) => names.iter().for_each(|name| self.kind(branch, Some(name), path, around)),
                None => self.kind(branch, None, path, around),
            }
        }
    }

    /// The names of kinds are those that the reader runs.
    fn kinds(&mut self, schema: &Value, path: &str, around: Around<'_>) {
        let Some((key, _)) = branches(schema).into_iter().find_map(names) else { return };
        let ours: BTreeSet<_> =
            branches(schema).into_iter().filter_map(names).flat_map(|(_, names)| names).collect();
        let found = self.read(&fitted(around(json!({ (key): "zzz" })))).unwrap_err();
        let listed =
            found.0.iter().find_map(|it| it.allowed.strip_prefix("must be one of ")).unwrap_or_default();
        let runs = |name: &&str| match self.read(&fitted(around(json!({ (key): name })))) {
            Ok(_) => true,
            Err(errors) => errors.0.iter().all(|error| error.problem != Problem::Unsupported),
        };
        let theirs: BTreeSet<_> = listed.split(", ").filter(runs).map(str::to_owned).collect();
        // Which gains, and ways out of a funnel, a coupling has is one level up.
        let is_part = path.ends_with("gain") || path.ends_with("on_breach");
        if ours != theirs && !(is_part && ours.is_subset(&theirs)) {
            self.wrong.push(format!("{path}: kinds {ours:?}, the reader has {theirs:?}"));
        }
    }

    fn kind(&mut self, branch: &Value, name: Option<&str>, path: &str, around: Around<'_>) {
        let section = least(branch, name, path);
        let at = format!("{path}({})", name.unwrap_or(""));
        let document = fitted(around(section.clone()));
        self.accepts(&document, &at);
        let is_merged = path.starts_with("node[].")
            && name.is_none()
            && branch.get("required").is_none()
            && path != "node[].clock";
        if !is_merged {
            self.knows(branch, &section, &at, around);
        }
        for (key, schema) in object(&branch["properties"]) {
            self.keys += 1;
            let kind = names(branch).filter(|(kind, _)| kind == key);
            if kind.is_some() || is_merged {
                continue;
            }
            self.key(&section, schema, (key, &at, path), around);
        }
    }

    /// The reader's own list of the keys of a section is that of the schema.
    fn knows(&mut self, branch: &Value, section: &Value, at: &str, around: Around<'_>) {
        let mut unknown = section.clone();
        unknown["zzz"] = json!(1);
        let document = fitted(around(unknown));
        let errors = self.read(&document).map_or_else(|errors| errors.0, |_| Vec::new());
        let list = errors.iter().find(|error| matches!(error.problem, Problem::UnknownKey { .. }));
        let Some(list) = list else {
            return self.wrong.push(format!("{at}: an unknown key is no error: {errors:?}"));
        };
        let theirs: BTreeSet<_> = list.allowed.split(", ").collect();
        let ours: BTreeSet<_> = object(&branch["properties"]).keys().map(String::as_str).collect();
        if ours != theirs {
            self.wrong.push(format!("{at}: keys {ours:?}, the reader has {theirs:?}"));
        }
        self.refused_by_schema(&document, &format!("{at}.zzz"));
    }

    fn key(
        &mut self,
        section: &Value,
        schema: &Value,
        (key, at, path): (&str, &str, &str),
        around: Around<'_>,
    ) {
        let name = if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
        let at = format!("{at}.{key}");
        let with = |value: Value| {
            let mut section = section.clone();
            for other in beside(path, key) {
                section.as_object_mut().unwrap().remove(*other);
            }
            if (path, key) == ("link[]", "from") || (path, key) == ("link[]", "to") {
                section["from"] = json!(1);
                section["to"] = json!(2);
            }
            section[key] = value;
            fitted(around(section))
        };
        for value in [schema["examples"].get(0), schema.get("default")].into_iter().flatten() {
            self.accepts(&with(value.clone()), &format!("{at} = {value}"));
        }
        if let Some(default) = schema.get("default") {
            let mut without = with(default.clone());
            let told = self.read(&without);
            let mut bare = section.clone();
            bare.as_object_mut().unwrap().remove(key);
            without = fitted(around(bare));
            match (told, self.read(&without)) {
                (Ok(told), Ok(untold)) => {
                    if (Scenario { as_run: String::new(), ..told })
                        != (Scenario { as_run: String::new(), ..untold })
                    {
                        self.wrong.push(format!("{at}: the default is not {default}"));
                    }
                }
                (told, untold) => {
                    let why = told.err().or(untold.err());
                    self.wrong.push(format!("{at}: cannot be compared with its default: {why:?}"));
                }
            }
        }
        let kinds = alternatives(schema);
        for value in wrong_types(&kinds) {
            self.refuses(&with(value.clone()), &format!("{at} = {value}"));
        }
        for kind in kinds {
            for (value, is_right) in ends(kind) {
                let (document, at) = (with(value.clone()), format!("{at} = {value}"));
                if is_right { self.within(&document, &at, key) } else { self.refuses(&document, &at) }
            }
            if is_section(kind) {
                self.section(kind, &name, &with);
            } else if is_section(&kind["items"]) {
                self.section(&kind["items"], &format!("{name}[]"), &|item| with(json!([item])));
            } else if is_section(&kind["additionalProperties"]) {
                self.section(&kind["additionalProperties"], &format!("{name}.*"), &|item| {
                    with(json!({ "load": item }))
                });
            }
        }
    }

    /// Both the reader and the schema take it.
    fn accepts(&mut self, document: &Value, at: &str) {
        self.accepted += 1;
        if let Err(errors) = self.read(document) {
            self.wrong.push(format!("{at}: refused by the reader: {errors}"));
        }
        if let Err(error) = self.validator.validate(document) {
            self.wrong.push(format!("{at}: refused by the schema: {error}"));
        }
    }

    /// The schema takes it, and the reader has nothing against this key's value: what it does to the whole is another matter.
    fn within(&mut self, document: &Value, at: &str, key: &str) {
        self.accepted += 1;
        if let Err(errors) = self.read(document) {
            let range = |text: &str| {
                ["must be from", "must be >", "must be at most", "must be at least 1e"]
                    .iter()
                    .any(|it| text.starts_with(it))
            };
            let mut of_key =
                errors.0.iter().filter(|error| error.key.ends_with(key) && range(&error.allowed));
            if let Some(error) = of_key.next() {
                self.wrong.push(format!("{at}: refused by the reader: {error}"));
            }
        }
        if let Err(error) = self.validator.validate(document) {
            self.wrong.push(format!("{at}: refused by the schema: {error}"));
        }
    }

    fn refuses(&mut self, document: &Value, at: &str) {
        self.refused += 1;
        if self.read(document).is_ok() {
            self.wrong.push(format!("{at}: accepted by the reader"));
        }
        self.refused_by_schema(document, at);
    }

    fn refused_by_schema(&mut self, document: &Value, at: &str) {
        if self.validator.is_valid(document) {
            self.wrong.push(format!("{at}: accepted by the schema"));
        }
    }
}

/// Keys that say the same in another way, of which there may be only one.
fn beside(path: &str, key: &str) -> &'static [&'static str] {
    match (path, key) {
        ("link[]", "from" | "to") => &["between"],
        ("event[]", "nodes") => &["node"],
        ("event[]", "link") => &["groups"],
        _ => &[],
    }
}

/// A value of each type that none of the alternatives has.
fn wrong_types(kinds: &[&Value]) -> Vec<Value> {
    let has =
        |name: &str| kinds.iter().any(|kind| kind["type"] == name || (name == "object" && is_section(kind)));
    let mut wrong = vec![];
    if !has("boolean") {
        wrong.push(json!(true));
    }
    if !has("number") && !has("integer") {
        wrong.push(json!(1.5));
    }
    if has("integer") && !has("number") {
        wrong.push(json!(1.5));
    }
    if !has("array") {
        wrong.push(json!([[[1]]]));
    }
    if !has("object") {
        wrong.push(json!({ "zzz": 1 }));
    }
    let takes_any_text = kinds.iter().any(|kind| {
        kind["type"] == "string" && kind.get("pattern").or(kind.get("const")).or(kind.get("enum")).is_none()
    });
    if !takes_any_text {
        wrong.push(json!("zzz"));
    }
    wrong
}

/// The ends of a range and what is next beyond them; whether it is right.
fn ends(kind: &Value) -> Vec<(Value, bool)> {
    let mut found = Vec::new();
    let beyond = |end: &Value, up: f64| match end.as_i64().filter(|_| kind["type"] == "integer") {
        Some(end) => json!(end + up as i64),
        None => {
            let end = end.as_f64().unwrap();
            json!(if end == 0.0 { up * 1e-3 } else { end + up * end.abs() * 1e-3 })
        }
    };
    if let Some(low) = kind.get("minimum") {
        found.extend([(low.clone(), true), (beyond(low, -1.0), false)]);
    }
    if let Some(low) = kind.get("exclusiveMinimum") {
        found.extend([(beyond(low, 1.0), true), (low.clone(), false)]);
    }
    if let Some(high) = kind.get("maximum") {
        found.extend([(high.clone(), true), (beyond(high, 1.0), false)]);
    }
    if kind.get("pattern").is_some() {
        found.extend(["1", "1 parsec", "ms", "1e3s", ""].map(|text| (json!(text), false)));
        let is_above_zero = kind["pattern"].as_str().unwrap().contains("[1-9]");
        found.push((json!("0s"), !is_above_zero));
    }
    if let Some(most) = kind["maxLength"].as_u64() {
        found.extend([
            (json!("x".repeat(most as usize)), true),
            (json!("x".repeat(most as usize + 1)), false),
            (json!(""), false),
        ]);
    }
    found
}

/// A value as TOML.
fn inline(value: &Value) -> String {
    match value {
        Value::Array(items) => format!("[{}]", items.iter().map(inline).collect::<Vec<_>>().join(", ")),
        Value::Object(table) => {
            let entries: Vec<_> =
                table.iter().map(|(key, value)| format!("{key} = {}", inline(value))).collect();
            format!("{{ {} }}", entries.join(", "))
        }
        value => value.to_string(),
    }
}
