//! Typed reading of one section: every getter knows its key, its range and its unit.
//!
//! A getter that finds a mistake reports it and returns a placeholder, so that one pass finds many mistakes.
//! The caller throws the result away when the log is not empty.

use std::cell::RefCell;
use std::collections::BTreeSet;

use crate::printable::is_unprintable;
use funnelnet_node::params;

use super::diagnostic::{Diagnostic, Diagnostics, Problem};
use super::duration::{self, parse_duration};
use super::tree::{Item, Place, Table, Value};

/// The mistakes found so far, each once.
#[derive(Default)]
pub struct Log {
    all: RefCell<Vec<Diagnostic>>,
    /// The same, to look one up in: a scenario can have tens of thousands.
    seen: RefCell<BTreeSet<Diagnostic>>,
}

impl Log {
    /// Notes a mistake; one that is already there (a shared default) is not repeated.
    #[allow(clippy::boxed_local)] // as everyone has one who makes one
    pub fn report(&self, diagnostic: Box<Diagnostic>) {
        if self.seen.borrow_mut().insert((*diagnostic).clone()) {
            self.all.borrow_mut().push(*diagnostic);
        }
    }

    /// `Err` with everything noted so far, in the order of the file, if there is anything.
    pub fn checkpoint(&self) -> Result<(), Diagnostics> {
        let mut all = self.all.borrow().clone();
        all.sort_by_key(|diagnostic| (diagnostic.line, diagnostic.column));
        if all.is_empty() { Ok(()) } else { Err(Diagnostics(all)) }
    }
}

/// Where a range ends.
#[cfg(feature = "check")]
pub(super) struct Bounds {
    /// May be infinite.
    pub low: f64,
    /// Whether `low` itself is outside.
    pub low_open: bool,
    /// May be infinite.
    pub high: f64,
}

/// Allowed values of a number.
#[derive(Clone, Copy)]
pub struct Range {
    low: f64,
    low_open: bool,
    high: f64,
    unit: &'static str,
    /// Smallest and largest size that a node takes (zero apart), where the value goes to one.
    on_node: Option<(f64, f64)>,
}

impl Range {
    /// Any finite number.
    pub const fn any(unit: &'static str) -> Self {
        Self {
            low: f64::NEG_INFINITY,
            low_open: false,
            high: f64::INFINITY,
            unit,
            on_node: Some((0.0, params::LARGEST)),
        }
    }

    /// More than zero.
    pub const fn positive(unit: &'static str) -> Self {
        Self {
            low: 0.0,
            low_open: true,
            on_node: Some((params::SMALLEST, params::LARGEST)),
            ..Self::any(unit)
        }
    }

    /// From `low` to `high`, both allowed.
    pub const fn between(low: f64, high: f64, unit: &'static str) -> Self {
        Self { low, high, ..Self::any(unit) }
    }

    /// Zero or more.
    pub const fn non_negative(unit: &'static str) -> Self {
        Self { low: 0.0, ..Self::any(unit) }
    }

    /// From 0 to 1.
    pub const fn probability() -> Self {
        Self { high: 1.0, on_node: None, ..Self::non_negative("probability") }
    }

    /// More than 0, up to 1.
    pub const fn positive_probability() -> Self {
        Self { low_open: true, ..Self::probability() }
    }

    /// The value stays on the host, in f64.
    pub const fn on_host(self) -> Self {
        Self { on_node: None, ..self }
    }

    /// The smallest and the largest number, with what a node takes.
    #[cfg(feature = "check")]
    pub(super) fn bounds(&self) -> Bounds {
        let Some((smallest, largest)) = self.on_node else {
            return Bounds { low: self.low, low_open: self.low_open, high: self.high };
        };
        // Zero is a size that each node takes, where the range has it.
        let is_above_zero = self.low == 0.0 && self.low_open && smallest > 0.0;
        let low = if is_above_zero { smallest } else { self.low.max(-largest) };
        Bounds { low, low_open: self.low_open && !is_above_zero, high: self.high.min(largest) }
    }

    /// A node takes values up to this size.
    pub const fn up_to(self, largest: f64) -> Self {
        let smallest = match self.on_node {
            Some((smallest, _)) => smallest,
            None => 0.0,
        };
        Self { on_node: Some((smallest, largest)), ..self }
    }

    /// The diagnostic for something that is no number; `or` says what else is allowed.
    pub fn mismatch(&self, item: &Item, or: &str) -> Box<Diagnostic> {
        item.diagnostic(Problem::Value, format!("{}{or}, not {}", self.text(), item.value.type_name()))
    }

    fn text(&self) -> String {
        let range = match (self.low == f64::NEG_INFINITY, self.low_open, self.high == f64::INFINITY) {
            (true, ..) => "must be a finite number".to_owned(),
            (_, true, true) => format!("must be > {}", self.low),
            (_, false, true) => format!("must be >= {}", self.low),
            (_, true, false) => format!("must be > {} and <= {}", self.low, self.high),
            (_, false, false) => format!("must be from {} to {}", self.low, self.high),
        };
        format!("{range} ({})", self.unit)
    }

    /// The number, or what is wrong with it.
    pub(super) fn accept(&self, value: f64) -> Result<f64, String> {
        let below = if self.low_open { value <= self.low } else { value < self.low };
        if !value.is_finite() {
            let finite = if self.low.is_finite() { "must be finite and" } else { "must be" };
            return Err(self.text().replacen("must be", finite, 1));
        }
        if below || value > self.high {
            return Err(self.text());
        }
        match self.on_node {
            Some((smallest, largest)) if value != 0.0 && !(smallest..=largest).contains(&value.abs()) => {
                let least =
                    if smallest > 0.0 { format!("at least {smallest:e} and ") } else { String::new() };
                Err(format!("must be {least}at most {largest:e} in size, to suit a node ({})", self.unit))
            }
            _ => Ok(value),
        }
    }
}

/// One kind that a `kind` key may name.
pub struct Choice<T> {
    /// The name in the file.
    pub name: &'static str,
    /// What it stands for.
    pub value: T,
}

/// A kind that runs.
pub const fn ready<T>(name: &'static str, value: T) -> Choice<T> {
    Choice { name, value }
}

/// A table that is being read.
pub struct Section<'a> {
    item: &'a Item,
    table: &'a Table,
    log: &'a Log,
    known: Vec<&'static str>,
    variant: Option<String>,
}

impl<'a> Section<'a> {
    /// Starts reading `item`; `None`, reported, where it is not a table.
    pub fn open(item: &'a Item, log: &'a Log) -> Option<Self> {
        match &item.value {
            Value::Table(table) => Some(Self { item, table, log, known: Vec::new(), variant: None }),
            _ => {
                log.report(item.diagnostic(Problem::Value, "must be a table"));
                None
            }
        }
    }

    /// Where the section stands.
    pub fn place(&self) -> &'a Place {
        &self.item.place
    }

    /// The log that this section reports to.
    pub fn log(&self) -> &'a Log {
        self.log
    }

    /// The entry `key`, which from now on counts as known.
    pub fn take(&mut self, key: &'static str) -> Option<&'a Item> {
        if !self.known.contains(&key) {
            self.known.push(key);
        }
        self.table.get(key)
    }

    /// The entry `key`, if a getter has asked for it.
    pub fn known(&self, key: &str) -> Option<&'a Item> {
        self.table.get(key).filter(|_| self.known.contains(&key))
    }

    /// Whether the file has an entry `key`, whatever it is.
    pub fn has(&self, key: &str) -> bool {
        self.table.get(key).is_some()
    }

    /// The entry `key`, reported where it is missing.
    pub fn need(&mut self, key: &'static str, allowed: &str) -> Option<&'a Item> {
        let item = self.take(key);
        if item.is_none() {
            self.missing(key, allowed);
        }
        item
    }

    /// Reports that `key` is missing.
    pub fn missing(&self, key: &str, allowed: &str) {
        let problem = Problem::MissingKey { section: self.label() };
        self.log.report(self.item.place.diagnostic(problem, &self.full(key), allowed));
    }

    /// A number in `range`; without a default it is required.
    pub fn number(&mut self, key: &'static str, default: Option<f64>, range: Range) -> f64 {
        match (self.take(key), default) {
            (Some(item), _) => self.read(number(item, range), f64::NAN),
            (None, Some(default)) => default,
            (None, None) => {
                self.missing(key, &range.text());
                f64::NAN
            }
        }
    }

    /// A number in `range` that may be absent.
    pub fn optional_number(&mut self, key: &'static str, range: Range) -> Option<f64> {
        self.take(key).map(|item| self.read(number(item, range), f64::NAN))
    }

    /// An integer from `low` to `high`; without a default it is required. `why` ends the message.
    pub fn integer(&mut self, key: &'static str, default: Option<u64>, limits: (u64, u64), why: &str) -> u64 {
        match (self.take(key), default) {
            (Some(item), _) => self.read(integer(item, limits, why), 0),
            (None, Some(default)) => default,
            (None, None) => {
                self.missing(key, &integer_text(limits, why));
                0
            }
        }
    }

    /// A duration in nanoseconds; without a default it is required, and then it is more than zero.
    pub fn duration(&mut self, key: &'static str, default: Option<u64>) -> u64 {
        match (self.take(key), default) {
            (Some(item), _) => self.read(duration_ns(item, default.is_some()), 1),
            (None, Some(default)) => default,
            (None, None) => {
                self.missing(key, duration::ALLOWED);
                1
            }
        }
    }

    /// A required duration within `limits`, both included, in nanoseconds. `why` ends the message.
    pub fn duration_within(&mut self, key: &'static str, limits: (u64, u64), why: &str) -> u64 {
        let Some(item) = self.take(key) else {
            self.missing(key, duration::ALLOWED);
            return limits.0;
        };
        let inside = |ns: u64| match (limits.0..=limits.1).contains(&ns) {
            true => Ok(ns),
            false => {
                let [low, high] = [limits.0, limits.1].map(duration::format_duration);
                let allowed = format!("must be from {low} to {high}, {why}");
                Err(item.diagnostic(Problem::Value, allowed))
            }
        };
        self.read(duration_ns(item, false).and_then(inside), limits.0)
    }

    /// A string that may be absent. It is shown on terminals and in pictures, so that it must be printable.
    pub fn text(&mut self, key: &'static str) -> Option<String> {
        let item = self.take(key)?;
        match item.text() {
            None => self.log.report(item.diagnostic(Problem::Value, "must be a string")),
            Some(text) => {
                if let Some(bad) = text.chars().find(|&c| is_unprintable(c)) {
                    let allowed = format!(
                        "must be printable text in one line, without control characters such as {}",
                        bad.escape_unicode()
                    );
                    self.log.report(item.diagnostic(Problem::Value, allowed));
                }
            }
        }
        item.text().map(str::to_owned)
    }

    /// One of the named kinds. `None`, reported, where it is missing or unknown.
    pub fn choice<T: Copy>(
        &mut self,
        key: &'static str,
        kinds: &[Choice<T>],
        default: Option<T>,
    ) -> Option<T> {
        let names: Vec<_> = kinds.iter().map(|kind| kind.name).collect();
        let allowed = format!("must be one of {}", names.join(", "));
        let Some(item) = self.take(key) else {
            if default.is_none() {
                self.missing(key, &allowed);
            }
            return default;
        };
        let found = item.text().and_then(|text| kinds.iter().find(|kind| kind.name == text));
        let Some(kind) = found else {
            let mut diagnostic = item.diagnostic(Problem::Value, allowed);
            diagnostic.hint = item.text().and_then(|text| nearest(text, &names));
            self.log.report(diagnostic);
            return None;
        };
        self.variant = Some(format!(" of {key} '{}'", kind.name));
        Some(kind.value)
    }

    /// What `read` makes of the entry `key`; `default` where it is absent or, reported, wrong.
    pub fn value<T>(
        &mut self,
        key: &'static str,
        default: T,
        read: impl FnOnce(&Item) -> Result<T, Box<Diagnostic>>,
    ) -> T {
        match self.take(key).map(read) {
            Some(Ok(value)) => value,
            Some(Err(diagnostic)) => {
                self.log.report(diagnostic);
                default
            }
            None => default,
        }
    }

    /// A sub-table that may be absent.
    pub fn section(&mut self, key: &'static str) -> Option<Section<'a>> {
        let item = self.take(key)?;
        Section::open(item, self.log)
    }

    /// The elements of an array; empty where the key is absent.
    pub fn array(&mut self, key: &'static str) -> &'a [Item] {
        match self.take(key) {
            None => &[],
            Some(Item { value: Value::Array(items), .. }) => items,
            Some(item) => {
                self.log.report(item.diagnostic(Problem::Value, "must be an array"));
                &[]
            }
        }
    }

    /// Reports every key that no getter asked for.
    pub fn finish(self) {
        for (name, item) in self.table {
            if self.known.contains(&name.as_str()) {
                continue;
            }
            let problem = Problem::UnknownKey { section: self.label() };
            let mut diagnostic = item.key_place.diagnostic(problem, &item.path, self.known.join(", "));
            diagnostic.hint = nearest(name, &self.known);
            self.log.report(diagnostic);
        }
    }

    fn label(&self) -> String {
        let variant = self.variant.as_deref().unwrap_or("");
        match self.item.path.as_str() {
            "" => "the file".to_owned(),
            path => format!("[{path}]{variant}"),
        }
    }

    fn full(&self, key: &str) -> String {
        if self.item.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.item.path) }
    }

    fn read<T>(&self, result: Result<T, Box<Diagnostic>>, placeholder: T) -> T {
        result.unwrap_or_else(|diagnostic| {
            self.log.report(diagnostic);
            placeholder
        })
    }
}

/// A number in `range`.
pub fn number(item: &Item, range: Range) -> Result<f64, Box<Diagnostic>> {
    let value = match item.value {
        Value::Integer(integer) => integer as f64,
        Value::Float(float) => float,
        _ => return Err(range.mismatch(item, "")),
    };
    range.accept(value).map_err(|allowed| item.diagnostic(Problem::Value, allowed))
}

/// An integer within `limits`, both included.
pub fn integer(item: &Item, limits: (u64, u64), why: &str) -> Result<u64, Box<Diagnostic>> {
    let found = match item.value {
        Value::Integer(integer) => u64::try_from(integer).ok(),
        _ => None,
    };
    let inside = found.filter(|value| (limits.0..=limits.1).contains(value));
    inside.ok_or_else(|| item.diagnostic(Problem::Value, integer_text(limits, why)))
}

fn integer_text((low, high): (u64, u64), why: &str) -> String {
    let range = match high {
        _ if low == high => format!("must be {low}"),
        u64::MAX => format!("must be an integer >= {low}"),
        _ => format!("must be an integer from {low} to {high}"),
    };
    if why.is_empty() { range } else { format!("{range} ({why})") }
}

pub(super) fn duration_ns(item: &Item, zero_allowed: bool) -> Result<u64, Box<Diagnostic>> {
    let text = item.text().ok_or_else(|| item.diagnostic(Problem::Value, duration::ALLOWED))?;
    match parse_duration(text) {
        Ok(0) if !zero_allowed => Err(item.diagnostic(Problem::Value, "must be longer than 0s")),
        Ok(ns) => Ok(ns),
        Err(allowed) => Err(item.diagnostic(Problem::Value, allowed)),
    }
}

/// `did you mean '...'?` for the nearest of `names`, where one is near.
fn nearest(word: &str, names: &[&str]) -> Option<String> {
    let scored = names.iter().map(|name| (strsim::damerau_levenshtein(word, name), name));
    let (distance, name): (usize, &&str) = scored.min_by_key(|(distance, _)| *distance)?;
    let near = distance <= 1 + word.chars().count() / 4 || name.starts_with(word) || word.starts_with(*name);
    near.then(|| format!("did you mean '{name}'?"))
}
