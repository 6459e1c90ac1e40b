//! The page around a report: one file, which loads nothing and, but for the table that sorts, runs nothing.

use crate::printable::printable;
use maud::{Markup, PreEscaped, html};

/// The first line of a report, by which a later one knows what it may replace.
pub(super) const FIRST_LINE: &str = "<!DOCTYPE html><!-- report of sim-host -->";

const STYLE: &str = include_str!("style.css");
const SORT: &str = include_str!("sort.js");
/// The hash of [`SORT`], which is the only script that a reader may run, whatever a file of the folder says.
const SORT_HASH: &str = "sha256-Z/GKBsmzmxqvca46siHkWlEg1LMBOlJDqExYADXL7TM=";

/// A report without its frame.
pub(super) struct Page {
    /// What it is of.
    pub(super) title: String,
    pub(super) body: Markup,
    /// Whether it has tables that sort.
    pub(super) sorts: bool,
}

impl Page {
    /// The text of the file.
    pub(super) fn html(self) -> String {
        let Self { title, body, sorts } = self;
        let title = printable(&title);
        let script = if sorts { format!("'{SORT_HASH}'") } else { "'none'".to_owned() };
        let policy = format!(
            "default-src 'none'; style-src 'unsafe-inline'; script-src {script}; base-uri 'none'; form-action 'none'"
        );
        let page = html! {
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta http-equiv="Content-Security-Policy" content=(policy);
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    meta name="generator" content=(concat!("sim-host ", env!("CARGO_PKG_VERSION")));
                    title { (title) }
                    style { (PreEscaped(STYLE)) }
                }
                body {
                    main { (body) }
                    footer { p { "Written by sim-host " (env!("CARGO_PKG_VERSION")) ". This page loads nothing." } }
                    @if sorts { script { (PreEscaped(SORT)) } }
                }
            }
        };
        format!("{FIRST_LINE}\n{}\n", page.into_string())
    }
}

/// A part of the page with its heading.
pub(super) fn section(id: &str, heading: &str, body: Markup) -> Markup {
    html! { section id=(id) { h2 { (heading) } (body) } }
}

/// A table or list that takes room: folded on a screen, open on paper.
pub(super) fn folded(summary: &str, is_open: bool, body: Markup) -> Markup {
    html! { details open[is_open] { summary { (summary) } (body) } }
}

/// A wide thing that scrolls by itself, by keys as well.
pub(super) fn wide(label: &str, body: Markup) -> Markup {
    html! { div.wide role="region" tabindex="0" aria-label=(printable(label)) { (body) } }
}

/// A verdict as a word with a sign; its colour only repeats it.
pub(super) fn mark(is_good: bool, word: &str) -> Markup {
    let (class, sign) = if is_good { ("good", "\u{2714}") } else { ("bad", "\u{2718}") };
    html! { span class=(class) { span aria-hidden="true" { (sign) } " " (word) } }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sha2::{Digest, Sha256};

    /// Base 64 with its padding.
    fn base64(bytes: &[u8]) -> String {
        const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
        let group = |group: &[u8]| {
            let bits = (0..3).fold(0, |bits, at| bits << 8 | u32::from(group.get(at).copied().unwrap_or(0)));
            let digit = |at: usize| match at <= group.len() {
                true => char::from(DIGITS[(bits >> (18 - 6 * at)) as usize & 63]),
                false => '=',
            };
            (0..4).map(digit).collect::<String>()
        };
        bytes.chunks(3).map(group).collect()
    }

    #[test]
    fn the_only_script_that_may_run_is_the_one_of_the_page() {
        assert_eq!(base64(b"any carnal pleas"), "YW55IGNhcm5hbCBwbGVhcw==");
        assert_eq!(SORT_HASH, format!("sha256-{}", base64(&Sha256::digest(SORT))));
        let page = |sorts| Page { title: "a <b>".to_owned(), body: html! { p { "c" } }, sorts }.html();
        assert!(page(true).contains(&format!("script-src '{SORT_HASH}'")) && page(true).contains(SORT));
        assert!(page(false).contains("script-src 'none'") && !page(false).contains("<script"));
        assert!(page(false).starts_with(FIRST_LINE) && page(false).contains("<title>a &lt;b&gt;</title>"));
    }
}
