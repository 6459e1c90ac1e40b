//! A network without a bus: quantiles over all nodes, in the picture that the run drew and in numbers.

use super::digest::SAMPLES;
use super::figures::{known, list, short};
use super::folder::Folder;
use super::page::wide;
use super::pictures::{Picture, figure};
use crate::run::names;
use csv::ReaderBuilder;
use maud::{Markup, html};
use serde_json::Value;

/// What is shown: the column of the file, and its name on the page.
const SHOWN: [(&str, &str); 8] = [
    ("x_q00", "lowest state"),
    ("x_q25", "quarter below"),
    ("x_q50", "median state"),
    ("x_q75", "three quarters below"),
    ("x_q100", "highest state"),
    ("ratio_q50", "median |\u{3BD}|/\u{3C8}"),
    ("ratio_q100", "largest |\u{3BD}|/\u{3C8}"),
    ("u_q100", "largest |u|"),
];

/// Time, and then what is shown.
type Row = [f64; SHOWN.len() + 1];

/// Picture and table of the quantiles in a folder; `None` where it has none.
///
/// # Errors
/// The file cannot be read, or is not what its name says, in words with the line.
pub(super) fn quantiles(folder: &Folder, summary: &Value) -> Result<Option<Markup>, String> {
    let Some(file) = folder.file(names::QUANTILES)? else { return Ok(None) };
    let rows = read(file).map_err(|why| format!("{}: {why}", folder.place(names::QUANTILES)))?;
    let picture = Picture {
        file: names::QUANTILES_PICTURE,
        id: "quantiles-words",
        words: words(&rows, summary),
        table: wide("Quantiles over time", table(&rows)),
    };
    let figure = figure(folder, picture)?;
    let left_out: Vec<&str> = list(summary, "left_out").iter().filter_map(Value::as_str).collect();
    Ok(Some(html! {
        (figure)
        @if !left_out.is_empty() { p { "Such a run leaves out: " (left_out.join("; ")) "." } }
    }))
}

fn read(file: impl std::io::Read) -> Result<Vec<Row>, String> {
    let mut reader = ReaderBuilder::new().from_reader(file);
    let head = reader.headers().map_err(|error| error.to_string())?.clone();
    let place =
        |name: &str| head.iter().position(|column| column == name).ok_or(format!("has no column {name}"));
    let mut places = [place("t")?; SHOWN.len() + 1];
    for (slot, (column, _)) in places.iter_mut().skip(1).zip(SHOWN) {
        *slot = place(column)?;
    }
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| error.to_string())?;
        let line = record.position().map_or(0, csv::Position::line);
        let mut row = [f64::NAN; SHOWN.len() + 1];
        for (value, place) in row.iter_mut().zip(places) {
            let text = record.get(place).unwrap_or_default();
            *value = text.parse().map_err(|_| format!("line {line}: {text:?} is no number"))?;
        }
        rows.push(row);
    }
    Ok(rows)
}

fn words(rows: &[Row], summary: &Value) -> String {
    let [Some(first), Some(last)] = [rows.first(), rows.last()] else {
        return "The run ended before its first row.".to_owned();
    };
    format!(
        "States of all nodes from {} to {} s: their median, the half around it, nine tenths, and all. At the begin they lie between {} and {}, \
         at the end between {} and {}, with the median at {}. The largest |\u{3BD}|/\u{3C8} of all ticks is {}; {} node-ticks are outside.",
        short(first[0]),
        short(last[0]),
        short(first[1]),
        short(first[5]),
        short(last[1]),
        short(last[5]),
        short(last[3]),
        known(summary, "funnel.max_ratio"),
        known(summary, "funnel.breaches")
    )
}

fn table(rows: &[Row]) -> Markup {
    // The first, the last, and those evenly between.
    let most = SAMPLES.min(rows.len());
    let shown = (0..most).filter_map(|k| rows.get(k * (rows.len() - 1) / (most - 1).max(1)));
    html! {
        table {
            caption { "Quantiles over all nodes, states in state units, inputs in state units per second" }
            thead { tr { th.n scope="col" { "t, s" } @for (_, name) in SHOWN { th.n scope="col" { (name) } } } }
            tbody { @for row in shown { tr {
                th.n scope="row" { (short(row[0])) }
                @for value in row.iter().skip(1) { td.n { (short(*value)) } }
            } } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str =
        "t,x_mean,x_q00,x_q05,x_q25,x_q50,x_q75,x_q95,x_q100,ratio_q50,ratio_q95,ratio_q100,u_q50,u_q100";

    #[test]
    fn columns_are_found_by_their_names_and_what_is_no_number_by_its_line() {
        let rows = read(format!("{HEAD}\n0,9,1,9,2,3,4,9,5,6,9,7,9,8\n").as_bytes());
        assert_eq!(rows, Ok(vec![[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]]));
        assert_eq!(read("t,x_q00\n".as_bytes()), Err("has no column x_q25".to_owned()));
        let broken = read(format!("{HEAD}\n0,9,1,9,2,3,x,9,5,6,9,7,9,8\n").as_bytes());
        assert_eq!(broken, Err("line 2: \"x\" is no number".to_owned()));
    }

    #[test]
    fn a_table_has_the_first_row_and_the_last_and_no_more_than_a_page_bears() {
        let rows: Vec<Row> = (0..1000u16).map(|k| [f64::from(k); SHOWN.len() + 1]).collect();
        let html = table(&rows).into_string();
        assert_eq!(html.matches("scope=\"row\"").count(), SAMPLES);
        assert!(html.contains(">0<") && html.contains(">999<"));
        for few in [0, 1, 2] {
            assert_eq!(table(&rows[..few]).into_string().matches("scope=\"row\"").count(), few);
        }
        assert_eq!(words(&[], &Value::Null), "The run ended before its first row.");
    }
}
