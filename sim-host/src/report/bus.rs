//! What the bus carried: how busy it was, what was lost, and how long each frame took.

use super::figures::{at, known, number, one_or_more, part, short, shown};
use super::page::wide;
use crate::printable::printable;
use maud::{Markup, html};
use serde_json::Value;

/// The bus of a run; `None` where it has none.
pub(super) fn bus(summary: &Value) -> Option<Markup> {
    let bus = at(summary, "bus")?;
    let cans = one_or_more(bus, "can");
    let load = number(bus, "utilisation").filter(|load| *load > 0.0);
    Some(html! {
        p {
            (known(bus, "sent")) " frames were sent, " (known(bus, "lost")) " deliveries were lost. "
            @match load {
                Some(load) => { "The bus was busy for " (short(100.0 * load)) " % of the time." },
                None => { "This bus has no bit rate, and so neither load nor latency." },
            }
        }
        @for can in cans { (identifiers(can)) }
        (counts(bus))
    })
}

/// All counts but those of the tables above, which are lists.
fn counts(bus: &Value) -> Markup {
    let mut rest = bus.clone();
    if let Some(map) = rest.as_object_mut() {
        map.remove("can");
    }
    part(&rest, "Bus: counts")
}

/// One CAN bus: a row for each identifier.
fn identifiers(can: &Value) -> Markup {
    let name = at(can, "interface").map_or("CAN".to_owned(), shown);
    let share = number(can, "utilisation")
        .map_or("not known".to_owned(), |load| format!("{} %", short(100.0 * load)));
    let us = |row: &Value, path: &str| number(row, path).map_or("not known".to_owned(), |s| short(1e6 * s));
    let from = at(can, "latency_from").and_then(Value::as_str).unwrap_or("tick");
    html! {
        p {
            (name) ": load " (share) " at " (known(can, "bitrate")) " bit/s, " (known(can, "error_frames")) " error frames, "
            (known(can, "fifo_overflows")) " FIFO overflows, " (known(can, "queue_overflows")) " queue overflows, "
            (known(can, "bus_off")) " times bus-off."
        }
        (wide(&format!("Identifiers on {name}"), html! {
            table {
                caption { "Identifiers on " (name) ", the most urgent first; latency from " (printable(from)) " to the last bit" }
                thead { tr {
                    th scope="col" { "id" } th.n scope="col" { "node" } th.n scope="col" { "frames" } th.n scope="col" { "errors" }
                    th.n scope="col" { "unsent" } th.n scope="col" { "half, \u{B5}s" } th.n scope="col" { "99 %, \u{B5}s" }
                    th.n scope="col" { "longest, \u{B5}s" } th.n scope="col" { "lost arbitrations" }
                } }
                tbody { @for row in super::figures::list(can, "identifiers") { tr {
                    th scope="row" { (known(row, "id")) }
                    @for path in ["node", "frames", "errors", "unsent"] { td.n { (known(row, path)) } }
                    @for path in ["latency_s.p50", "latency_s.p99", "latency_s.max"] { td.n { (us(row, path)) } }
                    td.n { (known(row, "lost")) }
                } } }
            }
        }))
    }
}
