//! The report of a run.

use super::digest::Digest;
use super::figures::{at, known, number, part, short};
use super::folder::Folder;
use super::page::{Page, section};
use super::verdict::{Verdict, judged};
use super::{bus, events, nodes, pictures, provenance, quantiles};
use crate::printable::printable;
use crate::run::names;
use maud::{Markup, html};
use serde_json::Value;

/// What a run has left.
pub(super) struct Run {
    pub(super) folder: Folder,
    /// `null` where there is none.
    pub(super) summary: Value,
    pub(super) digest: Option<Digest>,
}

impl Run {
    /// Reads the folder.
    ///
    /// # Errors
    /// A file cannot be read, or is not what its name says, in words.
    pub(super) fn read(folder: Folder) -> Result<Self, String> {
        let summary = match folder.text(names::SUMMARY)? {
            Some(text) => parse(&text).map_err(|why| format!("{}: {why}", folder.place(names::SUMMARY)))?,
            None => Value::Null,
        };
        let digest = folder.file(names::TRAJECTORY)?.map(Digest::read).transpose();
        let digest = digest.map_err(|why| format!("{}: {why}", folder.place(names::TRAJECTORY)))?;
        Ok(Self { folder, summary, digest: digest.filter(|digest| digest.rows > 0) })
    }

    /// The summary, where there is one.
    pub(super) fn judged(&self) -> Option<&Value> {
        (!self.summary.is_null()).then_some(&self.summary)
    }

    pub(super) fn verdict(&self) -> Verdict {
        Verdict::of(self.judged())
    }

    /// The title of its scenario.
    pub(super) fn title(&self) -> String {
        super::figures::text(&self.summary, "scenario")
            .filter(|title| !title.is_empty())
            .unwrap_or("A run".to_owned())
    }

    /// The page.
    ///
    /// # Errors
    /// A file cannot be read, in words.
    pub(super) fn page(&self) -> Result<Page, String> {
        let summary = &self.summary;
        let verdict = self.verdict();
        let body = html! {
            h1 { (self.title()) }
            (verdict.banner(self.judged()))
            (self.glance())
            @if !summary.is_null() { (section("verdict", "Expectations and checks", judged(summary))) }
            @let of_all = quantiles::quantiles(&self.folder, summary)?;
            @if let Some(quantiles) = &of_all { (section("pictures", "Quantiles over all nodes", html! { (quantiles) })) }
            @match &self.digest {
                // Its columns are of nodes that were asked for: their largest values are not those of all.
                Some(digest) if of_all.is_some() => {
                    (section("nodes", "Nodes that were asked for", nodes::nodes(digest, summary)))
                },
                None if of_all.is_some() => {},
                Some(digest) => {
                    (section("pictures", "States, funnels, inputs, agreement", pictures::pictures(&self.folder, summary, digest)?))
                    (section("nodes", "Nodes and margins", nodes::nodes(digest, summary)))
                },
                None => p.note { "There is no trajectory in the folder: no picture, and nothing about single nodes." },
            }
            (section("events", "Events", html! { (events::judged(summary)) (events::events(&self.folder)?) }))
            @if let Some(bus) = bus::bus(summary) { (section("bus", "Bus", bus)) }
            (self.others())
            (section("provenance", "Provenance", provenance::provenance(&self.folder, summary)?))
        };
        Ok(Page { title: format!("{}: {}", verdict.word(), self.title()), body, sorts: false })
    }

    /// The figures that come first.
    fn glance(&self) -> Markup {
        if self.summary.is_null() {
            return html! {};
        }
        html! { dl.glance { @for (name, value) in glance(&self.summary) { div { dt { (name) } dd { (value) } } } } }
    }

    /// Parts that not every run has, and what nodes counted.
    fn others(&self) -> Markup {
        let parts =
            [("counters", "Counters"), ("clocks", "Clocks"), ("bench", "Bench"), ("reference", "Reference")];
        html! {
            @for (key, heading) in parts {
                @if let Some(value) = at(&self.summary, key) {
                    (section(key, heading, html! {
                        (part(value, heading))
                        @if key == "bench" { (bench_nodes(value)) }
                    }))
                }
            }
        }
    }
}

fn parse(text: &str) -> Result<Value, String> {
    let summary: Value = serde_json::from_str(text).map_err(|error| format!("is no summary: {error}"))?;
    if summary.is_object() { Ok(summary) } else { Err("is no summary: it is no object".to_owned()) }
}

/// Names and values of the figures that come first.
pub(super) fn glance(summary: &Value) -> Vec<(&'static str, String)> {
    let per_cent = |path: &str| number(summary, path).map(|share| format!("{} %", short(100.0 * share)));
    let duration =
        number(summary, "ticks").zip(number(summary, "tick_s")).map(|(ticks, tick)| short(ticks * tick));
    let mut all = vec![
        ("nodes", known(summary, "nodes")),
        ("simulated time, s", duration.unwrap_or("not known".to_owned())),
        ("tick, s", known(summary, "tick_s")),
        ("ran on", known(summary, "on")),
        ("largest |\u{3BD}|/\u{3C8}", known(summary, "funnel.max_ratio")),
        ("node-ticks outside", known(summary, "funnel.breaches")),
        ("final spread", known(summary, "sync.final_spread")),
        ("its bound", known(summary, "sync.bound")),
        ("largest |u|", known(summary, "max_input")),
        ("distance to emergent \u{3BE}", known(summary, "emergent.final_error")),
        ("error to the reference", known(summary, "reference.max_error")),
        ("deliveries lost", known(summary, "bus.lost")),
    ];
    if let Some(load) = per_cent("bus.utilisation").filter(|_| number(summary, "bus.utilisation") > Some(0.0))
    {
        all.push(("bus load", load));
    }
    all
}

/// The nodes of a bench: what each is, and where it left loopback.
fn bench_nodes(bench: &Value) -> Markup {
    let rows = super::figures::list(bench, "nodes");
    let keys = [
        "node",
        "place",
        "uid",
        "firmware",
        "unreadable",
        "unrecorded",
        "first_difference",
        "largest_deviation",
    ];
    super::page::wide(
        "Nodes of the bench",
        html! {
            table {
                caption { "Nodes of the bench, beside loopback" }
                thead { tr { @for key in keys { th scope="col" { (key.replace('_', " ")) } } } }
                tbody { @for row in rows { tr { @for key in keys {
                    td { @if key == "first_difference" && at(row, key).is_none() { "none" } @else { (printable(&known(row, key))) } }
                } } } }
            }
        },
    )
}
