//! Columns of CSV by their names, and the line of a record. The reader gives where it began to look for the record, which is before empty lines
//! and comments.

use csv::{Error, ErrorKind, Position, StringRecord};

/// The column with this name; none where there is none.
///
/// # Errors
/// There are several: nobody knows which one is meant.
pub(super) fn column(headers: &StringRecord, name: &str) -> Result<Option<usize>, String> {
    let mut places = (0..headers.len()).filter(|&at| headers.get(at) == Some(name));
    match (places.next(), places.next()) {
        (_, Some(_)) => Err(format!("has the column '{name}' more than once; rename all but one")),
        (place, None) => Ok(place),
    }
}

/// Line of `record` in `text`, from 1.
pub(super) fn line_of(text: &str, record: &StringRecord) -> u64 {
    record.position().map_or(1, |position| line_at(text, position))
}

/// What is wrong with a text of CSV itself, as the end of a sentence that begins with its file.
pub(super) fn malformed(text: &str, error: &Error) -> String {
    match error.kind() {
        ErrorKind::UnequalLengths { pos: Some(position), expected_len, len } => {
            format!(
                ", line {}: has {len} fields, and the first line has {expected_len}",
                line_at(text, position)
            )
        }
        _ => format!(": {error}"),
    }
}

fn line_at(text: &str, position: &Position) -> u64 {
    let rest = usize::try_from(position.byte()).ok().and_then(|byte| text.get(byte..)).unwrap_or("");
    // Where lines end in two characters the reader has taken the first and counts lines by the second, which is an empty line here.
    let skipped = rest.lines().take_while(|line| line.is_empty() || line.starts_with('#')).count();
    position.line() + skipped as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Vec<(String, u64)> {
        let mut reader =
            csv::ReaderBuilder::new().comment(Some(b'#')).has_headers(false).from_reader(text.as_bytes());
        reader
            .records()
            .map(|record| record.unwrap())
            .map(|record| (record[0].to_owned(), line_of(text, &record)))
            .collect()
    }

    #[test]
    fn empty_lines_and_comments_are_lines() {
        for end in ["\n", "\r\n"] {
            let text = ["# what", "a", "", "# why", "", "b", "c", "# end", "d"].join(end);
            let expected =
                [("a", 2), ("b", 6), ("c", 7), ("d", 9)].map(|(name, line)| (name.to_owned(), line));
            assert_eq!(lines(&text), expected, "{end:?}");
        }
    }
}
