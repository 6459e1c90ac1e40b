//! The table of a sweep: `run`, what was swept, `repetition`, `seed`, figures, `verdict`, `why`, times of the machine.

use super::super::folder::{Folder, RUNS, shards};
use csv::ReaderBuilder;
use std::collections::BTreeMap;

/// Columns that are neither swept nor a figure.
const FRAME: [&str; 5] = ["run", "repetition", "seed", "verdict", "why"];

/// A table with a cell for each row and column; empty where there is no value.
#[derive(Debug, Default, PartialEq, Eq)]
pub(in super::super) struct Table {
    pub(in super::super) names: Vec<String>,
    pub(in super::super) rows: Vec<Vec<String>>,
    /// Shards that are not there, by number.
    pub(in super::super) missing: Vec<u32>,
    /// Whether it was put together out of shards.
    pub(in super::super) merged: bool,
}

impl Table {
    /// Reads `runs.csv`, or puts the shards together where that is not there.
    ///
    /// # Errors
    /// It is no table of a sweep, or the shards are of two, in words.
    pub(in super::super) fn read(folder: &Folder) -> Result<Self, String> {
        if let Some(text) = folder.text(RUNS)? {
            return Self::parse(&text).map_err(|why| format!("{}: {why}", folder.place(RUNS)));
        }
        let shards = shards(&folder.path);
        let of = shards.first().map_or(0, |&(_, n)| n);
        if let Some((i, n)) = shards.iter().find(|&&(i, n)| n != of || !(1..=n).contains(&i)) {
            let name = format!("runs-{i}-of-{n}.csv");
            return Err(format!("{}: is no shard of the {of} of the others", folder.place(&name)));
        }
        let mut tables = Vec::new();
        for (i, n) in &shards {
            let name = format!("runs-{i}-of-{n}.csv");
            let text = folder.text(&name)?.unwrap_or_default();
            tables.push(Self::parse(&text).map_err(|why| format!("{}: {why}", folder.place(&name)))?);
        }
        let missing = (1..=of).filter(|i| !shards.contains(&(*i, of))).collect();
        Ok(Self { missing, ..Self::merge(tables)? })
    }

    /// Reads the text of a table. The rest of a row whose end is missing goes: it was being written when the process ended.
    fn parse(text: &str) -> Result<Self, String> {
        let whole = text.rfind('\n').map_or("", |end| &text[..end + 1]);
        let mut reader = ReaderBuilder::new().from_reader(whole.as_bytes());
        let names: Vec<String> =
            reader.headers().map_err(|error| error.to_string())?.iter().map(str::to_owned).collect();
        if !["seed", "verdict"].iter().all(|name| names.iter().any(|known| known == name)) {
            return Err("is no table of a sweep: it has no column seed, or no verdict".to_owned());
        }
        let rows: Result<Vec<Vec<String>>, csv::Error> =
            reader.records().map(|row| Ok(row?.iter().map(str::to_owned).collect())).collect();
        let rows = rows.map_err(|error| format!("is no table of a sweep: {error}"))?;
        Ok(Self { names, rows, ..Self::default() })
    }

    /// One table out of several: every column that one of them has, and the rows in the order of their numbers.
    fn merge(tables: Vec<Self>) -> Result<Self, String> {
        let swept =
            |table: &Self| table.swept().iter().map(|&at| table.names[at].clone()).collect::<Vec<_>>();
        if tables.windows(2).any(|pair| swept(&pair[0]) != swept(&pair[1])) {
            return Err("the shards are of different sweeps: what was swept is not the same".to_owned());
        }
        let mut names: Vec<String> = Vec::new();
        for table in &tables {
            let mut after = 0;
            for name in &table.names {
                match names.iter().position(|known| known == name) {
                    Some(at) => after = at + 1,
                    // Where it stands in its own table: behind the column before it.
                    None => (names.insert(after, name.clone()), after += 1).0,
                }
            }
        }
        let mut rows: Vec<Vec<String>> = Vec::new();
        for table in &tables {
            let places: BTreeMap<&str, usize> =
                table.names.iter().enumerate().map(|(at, name)| (name.as_str(), at)).collect();
            for row in &table.rows {
                let cell = |name: &String| places.get(name.as_str()).and_then(|&at| row.get(at)).cloned();
                rows.push(names.iter().map(|name| cell(name).unwrap_or_default()).collect());
            }
        }
        let mut merged = Self { names, rows, merged: true, ..Self::default() };
        if let Some(run) = merged.place("run") {
            merged.rows.sort_by_key(|row| row[run].parse::<u64>().unwrap_or(u64::MAX));
        }
        Ok(merged)
    }

    /// The text of `runs.csv`.
    pub(in super::super) fn csv(&self) -> Vec<u8> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        // Writing to memory does not fail, and rows are as long as the header.
        for row in std::iter::once(&self.names).chain(&self.rows) {
            let _ = writer.write_record(row);
        }
        writer.into_inner().unwrap_or_default()
    }

    pub(super) fn place(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }

    /// A cell of a row; empty where there is none.
    pub(super) fn cell<'a>(&self, row: &'a [String], name: &str) -> &'a str {
        self.place(name).and_then(|at| row.get(at)).map_or("", String::as_str)
    }

    pub(super) fn passes(&self, row: &[String]) -> bool {
        matches!(self.cell(row, "verdict"), "passed" | "pass")
    }

    /// Columns of what was swept: those before the seed, but for numbers of runs.
    pub(super) fn swept(&self) -> Vec<usize> {
        let seed = self.place("seed").unwrap_or(0);
        (0..seed).filter(|&at| !FRAME.contains(&self.names[at].as_str())).collect()
    }

    /// Those of it that have more than one value, with their values: numbers ascending, words in order of the rows.
    pub(super) fn axes(&self) -> Vec<(usize, Vec<String>)> {
        let axes = self.swept().into_iter().map(|at| (at, self.values(at)));
        axes.filter(|(_, values)| values.len() > 1).collect()
    }

    fn values(&self, at: usize) -> Vec<String> {
        let mut values: Vec<String> = Vec::new();
        let mut known = std::collections::BTreeSet::new();
        for row in &self.rows {
            if known.insert(row[at].as_str()) {
                values.push(row[at].clone());
            }
        }
        let numbers: Option<Vec<f64>> = values.iter().map(|value| number(value)).collect();
        if numbers.is_some() {
            values.sort_by(|a, b| number(a).unwrap_or(0.0).total_cmp(&number(b).unwrap_or(0.0)));
        }
        values
    }

    /// Columns of figures that are numbers and differ, those that people ask for first.
    pub(super) fn figures(&self) -> Vec<usize> {
        const ASKED: [&str; 9] = [
            "funnel.max_ratio",
            "funnel.breaches",
            "sync.final_spread",
            "sync.max_spread",
            "max_input",
            "emergent.final_error",
            "reference.max_error",
            "bus.lost",
            "bus.utilisation",
        ];
        let seed = self.place("seed").unwrap_or(0);
        let end = self.place("verdict").unwrap_or(self.names.len());
        let varies = |at: &usize| {
            let mut known = self.rows.iter().map(|row| row[*at].as_str()).filter(|cell| !cell.is_empty());
            let first = known.next();
            first.is_some_and(|first| number(first).is_some() && known.any(|cell| cell != first))
        };
        let of_machine =
            |at: &usize| ["wall_", "cpu_"].iter().any(|begin| self.names[*at].starts_with(begin));
        let mut figures: Vec<usize> = (seed + 1..end).filter(|at| varies(at) && !of_machine(at)).collect();
        figures
            .sort_by_key(|&at| ASKED.iter().position(|name| *name == self.names[at]).unwrap_or(ASKED.len()));
        figures
    }
}

/// A cell as a number: of a duration such as `5ms`, in seconds.
pub(super) fn number(cell: &str) -> Option<f64> {
    let plain = cell.parse::<f64>().ok().filter(|value| !value.is_nan());
    plain.or_else(|| crate::scenario::parse_duration(cell).ok().map(|ns| ns as f64 / 1e9))
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str = "run,bus.loss,repetition,seed,max_input,verdict,why,wall_s,cpu_s\n";

    #[test]
    fn shards_become_the_table_of_one_process() {
        let whole = format!(
            "{HEAD}1,0,1,1,2,passed,,1,1\n2,0.1,1,1,3,failed,\"a, b\",1,1\n3,0.2,1,1,4,passed,,1,1\n"
        );
        let odd =
            Table::parse(&format!("{HEAD}1,0,1,1,2,passed,,1,1\n3,0.2,1,1,4,passed,,1,1\n4,0")).unwrap();
        let even = Table::parse(&format!("{HEAD}2,0.1,1,1,3,failed,\"a, b\",1,1\n")).unwrap();
        let merged = Table::merge(vec![even, odd]).unwrap();
        assert_eq!(String::from_utf8(merged.csv()).unwrap(), whole);
    }

    #[test]
    fn a_figure_that_only_one_shard_has_keeps_its_place() {
        let one = Table::parse("run,a,seed,ticks,verdict\n2,1,1,9,passed\n").unwrap();
        let other = Table::parse("run,a,seed,nodes,ticks,verdict\n1,1,1,5,8,passed\n").unwrap();
        let merged = Table::merge(vec![one, other]).unwrap();
        assert_eq!(
            String::from_utf8(merged.csv()).unwrap(),
            "run,a,seed,nodes,ticks,verdict\n1,1,1,5,8,passed\n2,1,1,,9,passed\n"
        );
    }

    #[test]
    fn what_was_swept_and_what_came_of_it_are_told_apart() {
        let table = Table::parse(&format!(
            "{HEAD}1,0.5,1,1,2,passed,,1,1\n2,0.05,1,2,3,failed,x,1,1\n3,0.5,2,2,4,passed,,1,1\n"
        ))
        .unwrap();
        assert_eq!(table.axes(), [(1, vec!["0.05".to_owned(), "0.5".to_owned()])]);
        assert_eq!(
            table.figures().iter().map(|&at| table.names[at].as_str()).collect::<Vec<_>>(),
            ["max_input"]
        );
        assert!(table.passes(&table.rows[0]) && !table.passes(&table.rows[1]));
    }

    #[test]
    fn what_is_no_table_is_refused() {
        assert!(Table::parse("t,x_1\n0,1\n").unwrap_err().contains("no column seed"));
        assert!(Table::parse("a,seed,verdict\n1,2\n").unwrap_err().contains("no table of a sweep"));
        let tables = ["a,seed,verdict\n1,1,passed\n", "b,seed,verdict\n1,1,passed\n"]
            .map(|text| Table::parse(text).unwrap());
        assert!(Table::merge(tables.into()).unwrap_err().contains("different sweeps"));
    }
}
