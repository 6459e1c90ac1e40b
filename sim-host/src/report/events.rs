//! What happened, and what nodes said, in the order of time.

use super::folder::Folder;
use super::page::folded;
use crate::printable::printable;
use maud::{Markup, html};

/// Events that are shown.
const SHOWN: usize = 300;
/// Most rows of a table that is open on a screen.
const OPEN: usize = 20;

/// The begin of `events.txt` as a table.
pub(super) fn events(folder: &Folder) -> Result<Markup, String> {
    let Some((text, is_whole)) = folder.begin("events.txt")? else {
        return Ok(html! { p.note { "There is no events.txt in the folder." } });
    };
    Ok(table(&text, is_whole))
}

fn table(text: &str, is_whole: bool) -> Markup {
    let (notes, lines): (Vec<&str>, Vec<&str>) = text.lines().partition(|line| line.starts_with('#'));
    let heading = match (lines.len(), lines.len() > SHOWN || !is_whole) {
        (0, _) => return html! { p { "No event was recorded." } },
        (some, false) => format!("{some} events"),
        (_, true) => format!("the first {} events; all are in events.txt", lines.len().min(SHOWN)),
    };
    let split = |line: &str| {
        let (time, what) = line.split_once(" s, ").unwrap_or(("", line));
        (printable(time).into_owned(), printable(what).into_owned())
    };
    html! {
        @for note in &notes { p.note { (printable(note.trim_start_matches(['#', ' ']))) } }
        (folded(&heading, lines.len() <= OPEN, html! {
            table {
                caption { "Events" }
                thead { tr { th.n scope="col" { "t, s" } th scope="col" { "what" } } }
                tbody { @for (time, what) in lines.iter().take(SHOWN).map(|line| split(line)) {
                    tr { th.n scope="row" { (time) } td { (what) } }
                } }
            }
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_rows_and_their_words_are_escaped() {
        let text = table("# shortened\n0.5 s, node 3 stopped: <b>\n", true).into_string();
        assert!(
            text.contains("<th class=\"n\" scope=\"row\">0.5</th><td>node 3 stopped: &lt;b&gt;</td>"),
            "{text}"
        );
        assert!(text.contains("shortened") && text.contains("1 events"), "{text}");
        assert!(table("", true).into_string().contains("No event"));
    }

    #[test]
    fn of_a_long_list_it_is_said_how_much_is_shown() {
        let text = table(&"1 s, a\n".repeat(SHOWN + 1), true).into_string();
        assert!(text.contains(&format!("the first {SHOWN} events")), "{text}");
        assert_eq!(text.matches("<td>a</td>").count(), SHOWN);
    }
}
