//! Where a run comes from: all that somebody needs to make it again.

use super::figures::known;
use super::folder::Folder;
use super::page::folded;
use crate::printable::printable_lines;
use crate::run::names;
use maud::{Markup, html};
use serde_json::Value;

/// Command, seed, version, hash, the scenario as it was run, and the files of the folder.
pub(super) fn provenance(folder: &Folder, summary: &Value) -> Result<Markup, String> {
    let rows = [
        ("command", "command"),
        ("seed", "seed"),
        ("version", "version"),
        ("ran on", "on"),
        ("hash of all states", "trace_hash"),
        ("wall time, s", "wall_s"),
    ];
    let scenario = folder.begin(names::SCENARIO)?;
    let files = folder.files();
    Ok(html! {
        table.pairs {
            caption { "What made this run" }
            tbody { @for (name, path) in rows { tr {
                th scope="row" { (name) } td { code { (known(summary, path)) } }
            } } }
        }
        @match &scenario {
            Some((text, is_whole)) => (folded("The scenario as it was run", false, html! {
                pre tabindex="0" { code { (printable_lines(text)) } }
                @if !is_whole { p.note { "The rest is in " (names::SCENARIO) "." } }
            })),
            None => p.note { "There is no " (names::SCENARIO) " in the folder." },
        }
        (folded("Files of the run", false, html! {
            table {
                caption { "Files beside this page when it was written" }
                thead { tr { th scope="col" { "file" } th.n scope="col" { "bytes" } } }
                tbody { @for (name, bytes) in &files { tr { th scope="row" { (name) } td.n { (bytes) } } } }
            }
        }))
    })
}
