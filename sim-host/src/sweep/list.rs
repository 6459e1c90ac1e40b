//! `--list FILE`: points from a table, a row each.

use super::values::key_of;
use crate::scenario::read_text;
use std::path::Path;

/// Points as a file lists them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct List {
    /// The keys, as the first line has them.
    pub keys: Vec<String>,
    /// The values of each point, in that order, with the line that they stand in.
    pub rows: Vec<(u64, Vec<String>)>,
}

impl List {
    /// Reads a CSV file: keys in the first line, then a line for each point. Lines that begin with # are left out.
    ///
    /// # Errors
    /// What is wrong with it, with the file's name and the line.
    pub fn load(path: &Path) -> Result<Self, String> {
        let text = read_text(path).map_err(|error| error.to_string())?;
        Self::parse(&text).map_err(|error| format!("{}{error}", path.display()))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let mut reader =
            csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(text.as_bytes());
        let failed = |error: csv::Error| format!(": {error}");
        let keys = reader.headers().map_err(failed)?.iter().map(key_of).collect::<Result<Vec<_>, _>>();
        let keys =
            keys.map_err(|_| ", line 1: must name the keys of the columns, as in bus.loss,time.tick")?;
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record.map_err(failed)?;
            let line = record.position().map_or(0, csv::Position::line);
            let row: Vec<_> = record.iter().map(str::to_owned).collect();
            if let Some((key, _)) = keys.iter().zip(&row).find(|(_, value)| value.is_empty()) {
                return Err(format!(", line {line}: has no value for {key}"));
            }
            rows.push((line, row));
        }
        if rows.is_empty() {
            Err(" has no points: no line below its keys".to_owned())
        } else {
            Ok(Self { keys, rows })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_of_points_is_read_with_its_lines() {
        let list = List::parse("bus.loss, graph.kind\n# none\n0.1,ring\n0.2,\"star\"\n").unwrap();
        assert_eq!(list.keys, ["bus.loss", "graph.kind"]);
        assert_eq!(list.rows[0], (3, vec!["0.1".to_owned(), "ring".to_owned()]));
        assert_eq!(list.rows[1], (4, vec!["0.2".to_owned(), "star".to_owned()]));
    }

    #[test]
    fn what_is_no_table_of_points_is_refused() {
        let wrong = |text: &str| List::parse(text).unwrap_err();
        assert!(wrong("bus.loss\n").contains("has no points"));
        assert!(wrong("").contains("has no points"));
        assert!(wrong("bus.loss,\n1,2\n").contains("line 1: must name the keys"));
        assert_eq!(wrong("a,b\n1,2\n1,\n"), ", line 3: has no value for b");
        assert!(wrong("a,b\n1,2,3\n").contains("line: 2"));
    }
}
