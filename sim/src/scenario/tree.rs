//! The TOML tree with the origin of every value, so that a late check can still point at the line.
//!
//! It is the `toml` crate's spanned tree, owned, with byte spans turned into lines and with values from the
//! command line beside values from the file.

use std::collections::BTreeMap;
use std::sync::Arc;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::diagnostic::{Diagnostic, Problem};

/// Keys of one table, in a fixed order.
pub type Table = BTreeMap<String, Item>;

/// Where something was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    /// File name, or the command-line option.
    pub file: Arc<str>,
    /// From 1; 0 on the command line.
    pub line: usize,
    /// From 1, in characters; 0 on the command line.
    pub column: usize,
}

impl Place {
    /// A place that has no line: a command-line option, or a file as a whole.
    pub fn whole(file: &str) -> Self {
        Self { file: Arc::from(file), line: 0, column: 0 }
    }

    /// A diagnostic at this place.
    pub fn diagnostic(&self, problem: Problem, key: &str, allowed: impl Into<String>) -> Box<Diagnostic> {
        Box::new(Diagnostic {
            file: self.file.to_string(),
            line: self.line,
            column: self.column,
            problem,
            key: key.to_owned(),
            found: None,
            allowed: allowed.into(),
            hint: None,
        })
    }
}

/// One value with its origin.
#[derive(Clone, Debug)]
pub struct Item {
    /// What it is.
    pub value: Value,
    /// Where the key stands.
    pub key_place: Place,
    /// Where the value stands.
    pub place: Place,
    /// Full key, such as `coupling.funnel.rate` or `node.3.state`.
    pub path: String,
    /// The value as written, shortened.
    pub raw: String,
}

/// A TOML value; numbers are resolved, dates are kept only as a type that nothing accepts.
#[derive(Clone, Debug)]
pub enum Value {
    /// A whole number.
    Integer(i128),
    /// Any other number.
    Float(f64),
    /// True or false.
    Bool(bool),
    /// A string.
    Text(String),
    /// A date or a time, which no key takes.
    Date,
    /// A list.
    Array(Vec<Item>),
    /// Keys and what stands for them.
    Table(Table),
}

impl Item {
    /// A diagnostic about this value.
    pub fn diagnostic(&self, problem: Problem, allowed: impl Into<String>) -> Box<Diagnostic> {
        let mut diagnostic = self.place.diagnostic(problem, &self.path, allowed);
        diagnostic.found = Some(self.raw.clone());
        diagnostic
    }

    /// The entry `key` of a table.
    pub fn get(&self, key: &str) -> Option<&Item> {
        match &self.value {
            Value::Table(table) => table.get(key),
            _ => None,
        }
    }

    /// The text of a string value.
    pub fn text(&self) -> Option<&str> {
        match &self.value {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// An empty table for a section that was not written.
    pub fn empty_table(place: &Place, path: &str) -> Self {
        Self {
            value: Value::Table(Table::new()),
            key_place: place.clone(),
            place: place.clone(),
            path: path.to_owned(),
            raw: "{}".to_owned(),
        }
    }
}

impl Value {
    /// The type's name for messages.
    pub fn type_name(&self) -> &'static str {
        match self {
            Self::Integer(_) => "an integer",
            Self::Float(_) => "a number",
            Self::Bool(_) => "a boolean",
            Self::Text(_) => "a string",
            Self::Date => "a date",
            Self::Array(_) => "an array",
            Self::Table(_) => "a table",
        }
    }
}

/// Parses a whole file.
///
/// # Errors
/// The first syntax error, at its line and column.
pub fn parse_file(text: &str, file: &str) -> Result<Item, Box<Diagnostic>> {
    let source = Source::new(text, file, false);
    match DeTable::parse(text) {
        Ok(table) => Ok(Item {
            value: Value::Table(source.table(table.get_ref(), "")),
            key_place: source.place(0),
            place: source.place(0),
            path: String::new(),
            raw: String::new(),
        }),
        Err(error) => {
            let at = source.place(error.span().map_or(0, |span| span.start));
            let message = format!("not valid TOML: {}", error.message());
            Err(at.diagnostic(Problem::Whole, "", message))
        }
    }
}

/// Parses one value from the command line; what is not TOML is taken as a bare string.
pub fn parse_argument(text: &str, option: &str, path: &str) -> Item {
    let source = Source::new(text, option, true);
    let place = Place::whole(option);
    match DeValue::parse(text) {
        Ok(value) => source.item(&value, place, path.to_owned()),
        Err(_) => Item {
            value: Value::Text(text.to_owned()),
            key_place: place.clone(),
            place,
            path: path.to_owned(),
            raw: shorten(text),
        },
    }
}

/// The text that spans refer to.
struct Source<'t> {
    text: &'t str,
    file: Arc<str>,
    on_command_line: bool,
    /// Where each line ends, ascending: a file of thousands of nodes is not counted through for every value.
    line_ends: Vec<usize>,
}

impl<'t> Source<'t> {
    fn new(text: &'t str, file: &str, on_command_line: bool) -> Self {
        let line_ends = text.match_indices('\n').map(|(at, _)| at).collect();
        Self { text, file: Arc::from(file), on_command_line, line_ends }
    }

    fn place(&self, offset: usize) -> Place {
        if self.on_command_line {
            return Place { file: self.file.clone(), line: 0, column: 0 };
        }
        let ends_before = self.line_ends.partition_point(|end| *end < offset);
        let start =
            ends_before.checked_sub(1).and_then(|last| self.line_ends.get(last)).map_or(0, |end| end + 1);
        let column = self.text.get(start..offset).unwrap_or("").chars().count() + 1;
        Place { file: self.file.clone(), line: ends_before + 1, column }
    }

    fn table(&self, table: &DeTable<'_>, path: &str) -> Table {
        let convert = |(key, value): (&Spanned<_>, &Spanned<DeValue<'_>>)| {
            let name: &std::borrow::Cow<'_, str> = key.get_ref();
            let path = if path.is_empty() { name.to_string() } else { format!("{path}.{name}") };
            (name.to_string(), self.item(value, self.place(key.span().start), path))
        };
        table.iter().map(convert).collect()
    }

    fn item(&self, value: &Spanned<DeValue<'_>>, key_place: Place, path: String) -> Item {
        let span = value.span();
        let raw = shorten(self.text.get(span.clone()).unwrap_or(""));
        Item {
            value: self.value(value.get_ref(), &path),
            key_place,
            place: self.place(span.start),
            path,
            raw,
        }
    }

    fn value(&self, value: &DeValue<'_>, path: &str) -> Value {
        match value {
            DeValue::String(text) => Value::Text(text.to_string()),
            DeValue::Integer(digits) => match i128::from_str_radix(digits.as_str(), digits.radix()) {
                Ok(integer) => Value::Integer(integer),
                Err(_) => Value::Float(f64::INFINITY),
            },
            DeValue::Float(digits) => Value::Float(digits.as_str().parse().unwrap_or(f64::NAN)),
            DeValue::Boolean(value) => Value::Bool(*value),
            DeValue::Datetime(_) => Value::Date,
            DeValue::Array(array) => {
                let items = array.iter().enumerate().map(|(n, item)| self.element(item, n, path));
                Value::Array(items.collect())
            }
            DeValue::Table(table) => Value::Table(self.table(table, path)),
        }
    }

    /// An array element; `[[node]]` tables are named by their id, as `--set` does.
    fn element(&self, item: &Spanned<DeValue<'_>>, index: usize, path: &str) -> Item {
        let id = item.get_ref().as_table().filter(|_| path == "node").and_then(|node| node.get("id"));
        let name = match id.and_then(|id| id.get_ref().as_integer()) {
            Some(id) => format!("{path}.{}", id.as_str()),
            None => format!("{path}[{index}]"),
        };
        self.item(item, self.place(item.span().start), name)
    }
}

/// The first line of a value, at most 60 characters of it.
fn shorten(raw: &str) -> String {
    let line = raw.lines().next().unwrap_or("");
    let whole = line.len() == raw.len() && line.chars().count() <= 60;
    if whole { line.to_owned() } else { line.chars().take(57).chain("...".chars()).collect() }
}
