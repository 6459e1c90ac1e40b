//! What is wrong with a scenario, where, and what would be right.

use std::fmt;

use crate::printable::printable;
use serde::Serialize;

/// The sort of mistake, which decides how the message is worded.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Problem {
    /// A value of the wrong type or outside its range.
    Value,
    /// A key that the section does not have.
    UnknownKey {
        /// The section as written, such as `[graph] of kind 'ring'`.
        section: String,
    },
    /// A key that the section needs and lacks.
    MissingKey {
        /// The section as written.
        section: String,
    },
    /// Anything about the file or the scenario as a whole.
    Whole,
}

/// One mistake in a scenario. `Display` gives one line that a person can act on.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Diagnostic {
    /// The file as the user named it, or the command-line option that brought the value in.
    pub file: String,
    /// Line, from 1; 0 where `file` is a command-line option or could not be read.
    pub line: usize,
    /// Column in characters, from 1; 0 like `line`.
    pub column: usize,
    /// Kind of mistake.
    pub problem: Problem,
    /// Full key, such as `coupling.funnel.rate`; empty where no key is concerned.
    pub key: String,
    /// The value as written, where there is one.
    pub found: Option<String>,
    /// Values that are allowed, with their unit.
    pub allowed: String,
    /// Change that would mend it, where one is known.
    pub hint: Option<String>,
}

impl Diagnostic {
    /// The last part of the key.
    fn leaf(&self) -> &str {
        self.key.rsplit('.').next().unwrap_or(&self.key)
    }

    fn place(&self) -> String {
        match self.line {
            0 => format!("{}: ", self.file),
            line => format!("{}:{line}:{}: ", self.file, self.column),
        }
    }

    fn mistake(&self) -> String {
        match (&self.problem, &self.found) {
            (Problem::UnknownKey { section }, _) => {
                format!("unknown key '{}' in {section}; known: {}", self.leaf(), self.allowed)
            }
            (Problem::MissingKey { section }, _) => {
                format!("missing key '{}' in {section}: {}", self.leaf(), self.allowed)
            }
            (_, Some(found)) => format!("{} = {found}: {}", self.key, self.allowed),
            (_, None) if self.key.is_empty() => self.allowed.clone(),
            (_, None) => format!("{}: {}", self.key, self.allowed),
        }
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let hint = self.hint.as_ref().map_or(String::new(), |hint| format!("; {hint}"));
        // File names, keys and values are others' text, and may hold what steers a terminal.
        f.write_str(&printable(&format!("{}{}{hint}", self.place(), self.mistake())))
    }
}

/// Every mistake found in one scenario, at least one, in the order of the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Diagnostics(pub Vec<Diagnostic>);

/// Mistakes that are spelt out; a large network can have one per node.
const MOST_SPELT_OUT: usize = 20;

impl fmt::Display for Diagnostics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (n, diagnostic) in self.0.iter().take(MOST_SPELT_OUT).enumerate() {
            if n > 0 {
                f.write_str("\n")?;
            }
            write!(f, "{diagnostic}")?;
        }
        match self.0.len().saturating_sub(MOST_SPELT_OUT) {
            0 => Ok(()),
            1 => f.write_str("\nand 1 more"),
            more => write!(f, "\nand {more} more"),
        }
    }
}

impl std::error::Error for Diagnostics {}

impl From<Box<Diagnostic>> for Diagnostics {
    fn from(diagnostic: Box<Diagnostic>) -> Self {
        Self(vec![*diagnostic])
    }
}
