//! Decodes the defmt log of a node with the symbols of its image.

use defmt_decoder::{DecodeError, Table};
use std::fmt::Write;

/// The log as text, one line per entry; says so where the bytes or the image do not fit.
pub fn decode(image: &[u8], log: &[u8]) -> String {
    match Table::parse(image) {
        Ok(Some(table)) => decode_with(&table, log),
        Ok(None) => "the image has no defmt data\n".to_owned(),
        Err(error) => format!("the image's defmt data cannot be read: {error}\n"),
    }
}

fn decode_with(table: &Table, log: &[u8]) -> String {
    let mut decoder = table.new_stream_decoder();
    decoder.received(log);
    let mut text = String::new();
    loop {
        let written = match decoder.decode() {
            Ok(frame) => writeln!(text, "{}", frame.display(false)),
            Err(DecodeError::UnexpectedEof) => return text,
            Err(DecodeError::Malformed) if table.encoding().can_recover() => {
                writeln!(text, "(malformed log entry skipped)")
            }
            Err(DecodeError::Malformed) => {
                text.push_str("(malformed log entry: the rest cannot be read)\n");
                return text;
            }
        };
        // Writing to a string does not fail.
        debug_assert!(written.is_ok());
    }
}
