//! What happened, and what nodes said, in the order of time.

use super::figures::{list, number, short, text};
use super::folder::Folder;
use super::page::{folded, wide};
use crate::printable::printable;
use maud::{Markup, html};
use serde_json::Value;

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

/// What each event did, out of the summary; nothing where none happened.
pub(super) fn judged(summary: &Value) -> Markup {
    let events = list(summary, "events");
    let figure = |event: &Value, key: &str| number(event, key).map_or("\u{2013}".to_owned(), short);
    if events.is_empty() {
        return html! {};
    }
    html! {
        (wide("What each event did", html! {
            table {
                caption { "What each event did, from its begin to the first event that begins after its end" }
                thead { tr {
                    th.n scope="col" { "t, s" } th scope="col" { "event" } th.n scope="col" { "end, s" }
                    th.n scope="col" { "largest |\u{3bd}|/\u{3c8}" } th.n scope="col" { "breaches" }
                    th.n scope="col" { "inside after, s" }
                } }
                tbody { @for event in events.iter().take(SHOWN) { tr {
                    td.n { (figure(event, "from_s")) }
                    th scope="row" { (text(event, "event").unwrap_or_default()) }
                    td.n { (figure(event, "to_s")) }
                    td.n { (figure(event, "max_ratio")) }
                    td.n { (figure(event, "breaches")) }
                    td.n { @match number(event, "recovered_s") { Some(s) => (short(s)), None => (text(event, "recovery").unwrap_or_default()) } }
                } } }
            }
        }))
        @if events.len() > SHOWN { p.note { "The first " (SHOWN) " of " (events.len()) "; all are in summary.json." } }
    }
}

fn table(text: &str, is_whole: bool) -> Markup {
    let (notes, lines): (Vec<&str>, Vec<&str>) = text.lines().partition(|line| line.starts_with('#'));
    let is_long = lines.len() > OPEN;
    let (usual, lines): (Vec<&str>, Vec<&str>) =
        lines.into_iter().partition(|line| is_long && is_usual(line));
    let heading = match (lines.len(), lines.len() > SHOWN || !is_whole) {
        (0, _) if usual.is_empty() => return html! { p { "No event was recorded." } },
        (0, _) => {
            return html! { p { (usual.len()) " starts and first hearings at t = 0, and no other event." } };
        }
        (some, false) => format!("{some} events"),
        (_, true) => format!("the first {} events; all are in events.txt", lines.len().min(SHOWN)),
    };
    let split = |line: &str| {
        let (time, what) = line.split_once(" s, ").unwrap_or(("", line));
        (printable(time).into_owned(), printable(what).into_owned())
    };
    html! {
        @for note in &notes { p.note { (printable(note.trim_start_matches(['#', ' ']))) } }
        @if !usual.is_empty() { p.note { (usual.len()) " starts and first hearings at t = 0 are left out; they are in events.txt." } }
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

/// Whether it is what every run begins with: in a large network that would hide all others.
fn is_usual(line: &str) -> bool {
    let at_begin = line.split_once(" s, ").filter(|(time, _)| time.parse() == Ok(0.0));
    at_begin.is_some_and(|(_, what)| what.ends_with(" started") || what.contains(" hears node "))
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
    fn in_a_long_list_the_begin_of_a_run_hides_nothing() {
        let begin = "0.000000 s, node 1 started\n0.000000 s, node 1 hears node 2\n".repeat(200);
        let text = table(&format!("{begin}3.5 s, node 4 started\n"), true).into_string();
        assert!(text.contains("node 4 started") && !text.contains("node 1 started"), "{text}");
        assert!(text.contains("400 starts and first hearings at t = 0 are left out"), "{text}");
        assert!(table(&begin, true).into_string().contains("and no other event"));
    }

    #[test]
    fn of_a_long_list_it_is_said_how_much_is_shown() {
        let text = table(&"1 s, a\n".repeat(SHOWN + 1), true).into_string();
        assert!(text.contains(&format!("the first {SHOWN} events")), "{text}");
        assert_eq!(text.matches("<td>a</td>").count(), SHOWN);
    }
}
