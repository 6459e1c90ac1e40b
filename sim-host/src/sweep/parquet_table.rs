//! `runs.parquet`: the table of a whole sweep with a type for each column, for whoever has more rows than a text of
//! them is good for.

use super::PARQUET;
use super::merge::Recorded;
use super::table::Row;
use crate::record::{AtomicFile, RecordError};
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::{ParquetError, Result};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use std::io;
use std::path::Path;
use std::sync::Arc;

/// Rows that are together in the file, so that a reader can leave some of them out.
const GROUP: usize = 65_536;

/// What all values of a column can be read as, the narrowest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Bool,
    Whole,
    Real,
    Text,
}

impl Kind {
    fn of(rows: &[Row], name: &str) -> Self {
        let all =
            |is: fn(&str) -> bool| rows.iter().all(|row| row.cells.get(name).is_none_or(|text| is(text)));
        if TEXTS.contains(&name) {
            Kind::Text
        } else if all(|text| text.parse::<bool>().is_ok()) {
            Kind::Bool
        } else if all(is_whole) {
            Kind::Whole
        } else if all(is_real) {
            Kind::Real
        } else {
            Kind::Text
        }
    }

    fn physical(self) -> Physical {
        match self {
            Kind::Bool => Physical::BOOLEAN,
            Kind::Whole => Physical::INT64,
            Kind::Real => Physical::DOUBLE,
            Kind::Text => Physical::BYTE_ARRAY,
        }
    }
}

/// Columns that are text, though their values may look like numbers.
const TEXTS: [&str; 4] = ["trace_hash", "stopped", "verdict", "why"];

/// Whether a text is a whole number as it would be written: `007` is a name.
fn is_whole(text: &str) -> bool {
    text.parse::<i64>().is_ok_and(|number| number.to_string() == text)
}

/// Whether a text is a number that an `f64` has all digits of: a whole one has no more than 53 bits. Words such as `inf` are text.
fn is_real(text: &str) -> bool {
    let digits = text.strip_prefix('-').unwrap_or(text);
    match digits.bytes().all(|byte| byte.is_ascii_digit()) {
        true => is_whole(text) && digits.parse::<u64>().is_ok_and(|number| number <= 1 << 53),
        false => {
            digits.starts_with(|c: char| c.is_ascii_digit()) && text.parse::<f64>().is_ok_and(f64::is_finite)
        }
    }
}

/// Writes the table of the sweep in `folder`.
///
/// # Errors
/// [`RecordError`], naming the file.
pub fn write(folder: &Path, recorded: &Recorded) -> std::result::Result<(), RecordError> {
    let path = folder.join(PARQUET);
    let mut file = AtomicFile::create(&path)?;
    let bytes = bytes(&recorded.columns(), &recorded.rows)
        .map_err(|error| RecordError { path: path.clone(), reason: reason(error) })?;
    file.write(|out| out.write_all(&bytes))?;
    file.commit()
}

fn reason(error: ParquetError) -> io::Error {
    io::Error::other(error)
}

fn bytes(names: &[String], rows: &[Row]) -> Result<Vec<u8>> {
    // A column without a value has no type to be seen; it is text.
    let has_value = |name: &String| rows.iter().any(|row| row.cells.contains_key(name));
    let kind = |name: &String| if has_value(name) { Kind::of(rows, name) } else { Kind::Text };
    let columns: Vec<_> = names.iter().map(|name| (name.as_str(), kind(name))).collect();
    let fields = columns.iter().map(|&(name, kind)| field(name, kind)).collect::<Result<_>>()?;
    let schema = Type::group_type_builder("runs").with_fields(fields).build()?;
    let creator = concat!("funnelnet ", env!("CARGO_PKG_VERSION")).to_owned();
    let properties = WriterProperties::builder().set_created_by(creator).build();
    let mut writer = SerializedFileWriter::new(Vec::new(), Arc::new(schema), Arc::new(properties))?;
    for rows in rows.chunks(GROUP) {
        let mut group = writer.next_row_group()?;
        let mut columns = columns.iter();
        while let (Some(mut column), Some(&(name, kind))) = (group.next_column()?, columns.next()) {
            fill(column.untyped(), rows, name, kind)?;
            column.close()?;
        }
        group.close()?;
    }
    writer.into_inner()
}

fn field(name: &str, kind: Kind) -> Result<Arc<Type>> {
    let builder = Type::primitive_type_builder(name, kind.physical()).with_repetition(Repetition::OPTIONAL);
    let text = matches!(kind, Kind::Text).then_some(LogicalType::String);
    Ok(Arc::new(builder.with_logical_type(text).build()?))
}

fn fill(column: &mut ColumnWriter<'_>, rows: &[Row], name: &str, kind: Kind) -> Result<()> {
    let cells: Vec<Option<&str>> = rows.iter().map(|row| row.cells.get(name).map(String::as_str)).collect();
    // 1 where there is a value.
    let levels: Vec<i16> = cells.iter().map(|cell| i16::from(cell.is_some())).collect();
    let texts = cells.into_iter().flatten();
    match (column, kind) {
        (ColumnWriter::BoolColumnWriter(to), Kind::Bool) => to.write_batch(
            &texts.filter_map(|text| text.parse().ok()).collect::<Vec<_>>(),
            Some(&levels),
            None,
        ),
        (ColumnWriter::Int64ColumnWriter(to), Kind::Whole) => to.write_batch(
            &texts.filter_map(|text| text.parse().ok()).collect::<Vec<_>>(),
            Some(&levels),
            None,
        ),
        (ColumnWriter::DoubleColumnWriter(to), Kind::Real) => to.write_batch(
            &texts.filter_map(|text| text.parse().ok()).collect::<Vec<_>>(),
            Some(&levels),
            None,
        ),
        (ColumnWriter::ByteArrayColumnWriter(to), _) => {
            to.write_batch(&texts.map(ByteArray::from).collect::<Vec<_>>(), Some(&levels), None)
        }
        _ => Err(ParquetError::General(format!("column {name} is not of the type that was chosen for it"))),
    }
    .map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::file::reader::{FileReader, SerializedFileReader};
    use parquet::record::Field;

    fn row(number: u64, more: &[(&str, &str)]) -> Row {
        let cells = more.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect();
        Row { number, cells }
    }

    #[test]
    fn columns_have_types_and_what_is_missing_is_null() {
        let names = ["run", "loss", "on", "kind", "seed", "none"].map(str::to_owned);
        let rows = [
            row(
                1,
                &[
                    ("run", "1"),
                    ("loss", "0.1"),
                    ("on", "true"),
                    ("kind", "ring"),
                    ("seed", "18446744073709551615"),
                ],
            ),
            row(2, &[("run", "2"), ("loss", "3"), ("kind", "true")]),
        ];
        let file = bytes::Bytes::from(bytes(&names, &rows).unwrap());
        let reader = SerializedFileReader::new(file).unwrap();
        let read: Vec<Vec<(String, Field)>> = reader
            .get_row_iter(None)
            .unwrap()
            .map(|row| {
                row.unwrap().get_column_iter().map(|(name, field)| (name.clone(), field.clone())).collect()
            })
            .collect();
        let text = |text: &str| Field::Str(text.to_owned());
        let expected = [
            vec![
                Field::Long(1),
                Field::Double(0.1),
                Field::Bool(true),
                text("ring"),
                text("18446744073709551615"),
                Field::Null,
            ],
            vec![Field::Long(2), Field::Double(3.0), Field::Null, text("true"), Field::Null, Field::Null],
        ];
        for (read, expected) in read.iter().zip(expected) {
            let expected: Vec<_> = names.iter().cloned().zip(expected).collect();
            assert_eq!(*read, expected);
        }
        assert_eq!(read.len(), 2);
    }

    #[test]
    fn what_looks_like_a_number_and_is_none_stays_as_it_is() {
        let kind = |name: &str, values: &[&str]| {
            let rows: Vec<_> = (1..).zip(values).map(|(n, value)| row(n, &[(name, value)])).collect();
            Kind::of(&rows, name)
        };
        assert_eq!(kind("trace_hash", &["0000123456789012", "12345678901234e5"]), Kind::Text);
        assert_eq!(kind("stopped", &["3"]), Kind::Text);
        assert_eq!((kind("a", &["7", "-1"]), kind("a", &["007"])), (Kind::Whole, Kind::Text));
        assert_eq!((kind("a", &["7", "0.5", "-1e-7"]), kind("a", &["inf", "nan"])), (Kind::Real, Kind::Text));
        assert_eq!(kind("a", &["9007199254740993", "0.5"]), Kind::Text);
        assert_eq!(kind("a", &["9007199254740992", "0.5"]), Kind::Real);
    }

    #[test]
    fn a_table_of_more_rows_than_a_group_is_whole() {
        let rows: Vec<_> = (1..=GROUP as u64 + 3).map(|n| row(n, &[("run", &n.to_string())])).collect();
        let file = bytes::Bytes::from(bytes(&["run".to_owned()], &rows).unwrap());
        let reader = SerializedFileReader::new(file).unwrap();
        assert_eq!((reader.num_row_groups(), reader.get_row_iter(None).unwrap().count()), (2, rows.len()));
    }
}
