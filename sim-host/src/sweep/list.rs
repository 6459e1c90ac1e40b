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
        let is_said = |(_, line): &(u64, &str)| !line.trim().is_empty() && !line.starts_with('#');
        let mut lines = (1..).zip(text.lines()).filter(is_said);
        let (first, header) = lines.next().ok_or_else(no_points)?;
        let keys = cells(header).iter().map(|key| key_of(key)).collect::<Result<Vec<_>, _>>();
        let keys = keys.map_err(|_| {
            format!(", line {first}: must name the keys of the columns, as in bus.loss,time.tick")
        })?;
        let mut rows = Vec::new();
        for (line, text) in lines {
            let row = cells(text);
            if row.len() != keys.len() {
                let (wanted, there) = (keys.len(), row.len());
                return Err(format!(", line {line}: has {there} values for {wanted} keys"));
            }
            if let Some((key, _)) = keys.iter().zip(&row).find(|(_, value)| value.is_empty()) {
                return Err(format!(", line {line}: has no value for {key}"));
            }
            rows.push((line, row));
        }
        if rows.is_empty() { Err(no_points()) } else { Ok(Self { keys, rows }) }
    }
}

fn no_points() -> String {
    " has no points: no line below its keys".to_owned()
}

/// The cells of one line, without blanks around them.
fn cells(line: &str) -> Vec<String> {
    let mut reader =
        csv::ReaderBuilder::new().has_headers(false).trim(csv::Trim::All).from_reader(line.as_bytes());
    let record = reader.records().find_map(Result::ok).unwrap_or_default();
    record.iter().map(str::to_owned).collect()
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
        assert_eq!(wrong("a,b\n\n1,2,3\n"), ", line 3: has 3 values for 2 keys");
    }
}
