//! The verdict of a run, before all else: whether it did what was asked, and how much room each limit has left.

use super::figures::{at, list, number, short, shown, text};
use super::page::{mark, wide};
use crate::printable::printable;
use maud::{Markup, html};
use serde_json::Value;

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    Passed,
    Failed,
    /// It was interrupted, or a network that it ran on has gone.
    EndedEarly,
    /// There is no summary, which is written last.
    Unfinished,
}

impl Verdict {
    /// Of what a run has left.
    pub(super) fn of(summary: Option<&Value>) -> Self {
        let Some(summary) = summary else { return Self::Unfinished };
        match at(summary, "passed").and_then(Value::as_bool) {
            _ if at(summary, "ended_early").is_some() => Self::EndedEarly,
            Some(true) => Self::Passed,
            Some(false) => Self::Failed,
            None => Self::Unfinished,
        }
    }

    pub(super) fn word(self) -> &'static str {
        match self {
            Self::Passed => "Passed",
            Self::Failed => "Failed",
            Self::EndedEarly => "Ended early",
            Self::Unfinished => "Not finished",
        }
    }

    fn class(self) -> &'static str {
        if self == Self::Passed { "verdict good" } else { "verdict bad" }
    }

    fn sign(self) -> &'static str {
        match self {
            Self::Passed => "\u{2714}",
            Self::Failed => "\u{2718}",
            Self::EndedEarly => "\u{25D0}",
            Self::Unfinished => "?",
        }
    }

    /// What it means, as a sentence.
    fn sentence(self, summary: Option<&Value>) -> String {
        match self {
            Self::Passed if list_of(summary, "expect").is_empty() => {
                "The scenario expects nothing; every check that each run has to pass holds.".to_owned()
            }
            Self::Passed => "Every expectation of the scenario and every check holds.".to_owned(),
            Self::Failed => match failing(summary) {
                0 => "The summary calls it failed.".to_owned(),
                1 => "One expectation or check does not hold.".to_owned(),
                some => format!("{some} expectations and checks do not hold."),
            },
            Self::EndedEarly => {
                let why = summary.and_then(|summary| text(summary, "ended_early")).unwrap_or_default();
                format!("The run did not come to its last tick: {why}. All figures are of the part that ran.")
            }
            Self::Unfinished => {
                "There is no summary with a verdict: the run did not come to its end. What it has left is shown.".to_owned()
            }
        }
    }

    /// The verdict in its own right, first on a page.
    pub(super) fn banner(self, summary: Option<&Value>) -> Markup {
        html! {
            p class=(self.class()) {
                strong { span aria-hidden="true" { (self.sign()) } " " (self.word()) }
                " " (self.sentence(summary))
            }
        }
    }
}

fn list_of<'a>(summary: Option<&'a Value>, path: &str) -> &'a [Value] {
    summary.map_or(&[], |summary| list(summary, path))
}

fn passes(entry: &Value) -> bool {
    at(entry, "pass").and_then(Value::as_bool) == Some(true)
}

fn failing(summary: Option<&Value>) -> usize {
    ["expect", "checks"].iter().flat_map(|part| list_of(summary, part)).filter(|entry| !passes(entry)).count()
}

/// Expectations and checks, those that do not hold first.
pub(super) fn judged(summary: &Value) -> Markup {
    let failures_first = |part| {
        let mut entries: Vec<&Value> = list(summary, part).iter().collect();
        entries.sort_by_key(|entry| passes(entry));
        entries
    };
    let (expected, checks) = (failures_first("expect"), failures_first("checks"));
    let word = |entry: &Value| if passes(entry) { mark(true, "holds") } else { mark(false, "fails") };
    let name = |entry: &Value| text(entry, "name").unwrap_or_default();
    html! {
        @if !expected.is_empty() {
            (wide("Expectations", html! {
                table {
                    caption { "Expectations: each value must stay below its limit" }
                    thead { tr {
                        th scope="col" { "expectation" } th scope="col" { "verdict" } th.n scope="col" { "value" }
                        th.n scope="col" { "limit" } th.n scope="col" { "room left" }
                    } }
                    tbody { @for entry in expected { tr {
                        th scope="row" { (name(entry)) }
                        td { (word(entry)) }
                        td.n { (at(entry, "value").map_or("not measured".to_owned(), shown)) }
                        td.n { (at(entry, "limit").map_or("not known".to_owned(), shown)) }
                        td.n { (room(entry)) }
                    } } }
                }
            }))
        }
        @if !checks.is_empty() {
            table {
                caption { "Checks that every run has to pass" }
                thead { tr { th scope="col" { "check" } th scope="col" { "verdict" } th scope="col" { "what was found" } } }
                tbody { @for check in checks { tr {
                    th scope="row" { (name(check)) }
                    td { (word(check)) }
                    td { (printable(at(check, "text").and_then(Value::as_str).unwrap_or_default())) }
                } } }
            }
        }
    }
}

/// How much of a limit is left, in per cent of it; what is over it is negative.
fn room(entry: &Value) -> String {
    match (number(entry, "value"), number(entry, "limit")) {
        (Some(value), Some(limit)) if limit > 0.0 => format!("{} %", short(100.0 * (1.0 - value / limit))),
        _ => "not known".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn an_end_before_the_last_tick_is_no_pass() {
        let verdict = |summary: Value| Verdict::of(Some(&summary));
        assert_eq!(verdict(json!({ "passed": true, "ended_early": null })), Verdict::Passed);
        assert_eq!(verdict(json!({ "passed": false })), Verdict::Failed);
        assert_eq!(verdict(json!({ "passed": true, "ended_early": "interrupted" })), Verdict::EndedEarly);
        assert_eq!(verdict(json!({})), Verdict::Unfinished);
        assert_eq!(Verdict::of(None), Verdict::Unfinished);
    }

    #[test]
    fn what_fails_stands_first_and_says_so_in_words() {
        let summary = json!({ "passed": false, "expect": [
            { "name": "a", "limit": 2.0, "value": 0.5, "pass": true },
            { "name": "b", "limit": 2.0, "value": 3.0, "pass": false },
            { "name": "c", "limit": 2.0, "value": null, "pass": false },
        ], "checks": [{ "name": "silent", "pass": true, "text": "no <node> is" }] });
        let text = judged(&summary).into_string();
        let place = |name: &str| text.find(&format!("<th scope=\"row\">{name}</th>")).unwrap();
        assert!(place("b") < place("a") && place("c") < place("a"), "{text}");
        assert!(text.contains("75 %") && text.contains("-50 %") && text.contains("not measured"), "{text}");
        assert!(text.contains("no &lt;node&gt; is"), "{text}");
        let banner = Verdict::of(Some(&summary)).banner(Some(&summary)).into_string();
        assert!(banner.contains("Failed") && banner.contains("2 expectations and checks"), "{banner}");
    }
}
