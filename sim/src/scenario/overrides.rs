//! `--set section.key=value`: values from the command line, put into the tree before it is read.

use super::diagnostic::{Diagnostic, Problem};
use super::tree::{Item, Place, Table, Value, parse_argument};

/// One value from the command line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Override {
    path: Vec<String>,
    value: String,
    option: String,
}

impl Override {
    /// Reads `section.key=value`. The value is TOML, or a bare string where that fails (`time.tick=1ms`).
    /// `node.3.state=1` means the `[[node]]` with id 3; other arrays are indexed from 0.
    ///
    /// # Errors
    /// Where there is no `=`, or no key before it.
    pub fn parse(text: &str) -> Result<Self, Box<Diagnostic>> {
        Self::from_option(&format!("--set {text}"), text)
    }

    /// The same for a value that something else than `--set` brings in; messages name it as `option`.
    ///
    /// # Errors
    /// Where there is no `=`, or no key before it.
    pub fn from_option(option: &str, text: &str) -> Result<Self, Box<Diagnostic>> {
        let option = option.to_owned();
        let (key, value) = text.split_once('=').unwrap_or(("", ""));
        let path: Vec<_> = key.trim().split('.').map(|part| part.trim().to_owned()).collect();
        if path.iter().any(String::is_empty) {
            let allowed = "must be section.key=value, as in --set coupling.funnel.rate=2.0";
            return Err(Place::whole(&option).diagnostic(Problem::Whole, "", allowed));
        }
        Ok(Self { path, value: value.trim().to_owned(), option })
    }

    /// `--seed N`, the same as `--set seed=N`.
    #[must_use]
    pub fn seed(seed: u64) -> Self {
        Self { path: vec!["seed".to_owned()], value: seed.to_string(), option: format!("--seed {seed}") }
    }

    /// The full key, such as `coupling.funnel.rate`.
    #[must_use]
    pub fn key(&self) -> String {
        self.path.join(".")
    }

    /// `section.key=value`, as `--set` takes it.
    #[must_use]
    pub fn setting(&self) -> String {
        format!("{}={}", self.key(), self.value)
    }

    /// Puts the value into the tree, making the tables on the way.
    pub(super) fn apply(&self, root: &mut Item) -> Result<(), Box<Diagnostic>> {
        let place = Place::whole(&self.option);
        put(root, &self.path, &place, |key| parse_argument(&self.value, &self.option, key))
    }
}

/// Puts what `make` makes of the full key into the tree, making the tables on the way; messages point at `place`.
pub(super) fn put(
    root: &mut Item,
    path: &[String],
    place: &Place,
    make: impl FnOnce(&str) -> Item,
) -> Result<(), Box<Diagnostic>> {
    let mut current = root;
    let mut walked = String::new();
    for part in path {
        let longer = join(&walked, part);
        let parent = std::mem::replace(&mut walked, longer);
        current = step(current, part, &parent, &walked, place)?;
    }
    *current = make(&walked);
    Ok(())
}

fn join(path: &str, part: &str) -> String {
    if path.is_empty() { part.to_owned() } else { format!("{path}.{part}") }
}

/// The entry `part` of `item`, made where it is missing.
fn step<'i>(
    item: &'i mut Item,
    part: &str,
    parent: &str,
    path: &str,
    place: &Place,
) -> Result<&'i mut Item, Box<Diagnostic>> {
    let type_name = item.value.type_name();
    let index = part.parse::<usize>().ok();
    let (node_list, inside_list) = (parent.is_empty() && part == "node", parent == "node");
    match (&mut item.value, inside_list) {
        (Value::Table(table), _) => Ok(table.entry(part.to_owned()).or_insert_with(|| {
            let value = if node_list { Value::Array(Vec::new()) } else { Value::Table(Table::new()) };
            Item { value, ..Item::empty_table(place, path) }
        })),
        (Value::Array(items), true) => node(items, part, path, place),
        (Value::Array(items), false) => {
            let allowed = format!("no such element: {parent} has {}, counted from 0", items.len());
            let missing = place.diagnostic(Problem::Whole, path, allowed);
            index.and_then(|index| items.get_mut(index)).ok_or(missing)
        }
        _ => {
            let allowed = format!("{parent} is {type_name}, so it has no key '{part}'");
            Err(place.diagnostic(Problem::Whole, path, allowed))
        }
    }
}

/// The `[[node]]` with this id, made where the file has none.
fn node<'i>(
    items: &'i mut Vec<Item>,
    id: &str,
    path: &str,
    place: &Place,
) -> Result<&'i mut Item, Box<Diagnostic>> {
    let Ok(wanted) = id.parse::<i128>() else {
        let allowed = format!("nodes are named by their id, as in node.3.state; '{id}' is not an id");
        return Err(place.diagnostic(Problem::Whole, path, allowed));
    };
    let has_id =
        |item: &Item| matches!(item.get("id"), Some(Item { value: Value::Integer(id), .. }) if *id == wanted);
    let found = items.iter().position(has_id);
    let index = found.unwrap_or(items.len());
    if found.is_none() {
        let id = parse_argument(id, &place.file, &join(path, "id"));
        let table = Table::from([("id".to_owned(), id)]);
        items.push(Item { value: Value::Table(table), ..Item::empty_table(place, path) });
    }
    // The index is inside: either it was found, or the element was just pushed.
    items.get_mut(index).ok_or_else(|| place.diagnostic(Problem::Whole, path, "no such node"))
}
