//! `[expect]` and `[[expect.window]]`: what a run must keep.

use super::diagnostic::Problem;
use super::duration::format_duration;
use super::model::{Expect, FinalValue, Stoppable, TimeSpec, Window};
use super::reader::{Log, Range, Section};
use super::tree::{Item, Value};

/// Reads `[expect]`; windows are not yet known to lie within the run.
pub(super) fn read(file: &mut Section<'_>, nodes: u64) -> Expect {
    let Some(mut section) = file.section("expect") else { return Expect::default() };
    let length = Range::positive("state units").on_host();
    let expect = Expect {
        funnel_ratio: section.optional_number("funnel_ratio", ratio()),
        final_spread: section.optional_number("final_spread", length),
        emergent_error: section.optional_number("emergent_error", length),
        blended_error: section.optional_number("blended_error", length),
        reference_error: section.optional_number("reference_error", length),
        final_value: section.section("final_value").map(|mut value| {
            let final_value = FinalValue {
                is: value.number("is", None, Range::any("state units").on_host()),
                within: value.number("within", None, length),
            };
            value.finish();
            final_value
        }),
        max_input: section.optional_number("max_input", input()),
        recovered_within_ns: section
            .take("recovered_within")
            .map(|_| section.duration("recovered_within", None)),
        stopped: section.value("stopped", Stoppable::default(), |item| stoppable(item, nodes)),
        windows: {
            let log = section.log();
            section.array("window").iter().filter_map(|item| window(item, log)).collect()
        },
    };
    section.finish();
    expect
}

fn ratio() -> Range {
    Range::positive("|nu| / psi").on_host()
}

fn input() -> Range {
    Range::positive("state units per second").on_host()
}

fn stoppable(item: &Item, nodes: u64) -> Result<Stoppable, Box<super::Diagnostic>> {
    let allowed = format!("must be an array of node ids from 1 to {nodes}, or \"any\"");
    let refuse = || item.diagnostic(Problem::Value, allowed.clone());
    match &item.value {
        Value::Text(text) if text == "any" => Ok(Stoppable::Any),
        Value::Array(items) => {
            let id = |item: &Item| match item.value {
                Value::Integer(id) => {
                    u16::try_from(id).ok().filter(|id| (1..=nodes).contains(&u64::from(*id)))
                }
                _ => None,
            };
            let ids: Option<Vec<u16>> = items.iter().map(id).collect();
            ids.map(Stoppable::Ids).ok_or_else(refuse)
        }
        _ => Err(refuse()),
    }
}

/// Times in ns until [`in_ticks`] makes ticks of them.
fn window(item: &Item, log: &Log) -> Option<Window> {
    let mut section = Section::open(item, log)?;
    let length = Range::positive("state units").on_host();
    let window = Window {
        from_tick: section.duration("from", Some(0)),
        to_tick: section.duration("to", None),
        funnel_ratio: section.optional_number("funnel_ratio", ratio()),
        spread: section.optional_number("spread", length),
        emergent_error: section.optional_number("emergent_error", length),
        reference_error: section.optional_number("reference_error", length),
        max_input: section.optional_number("max_input", input()),
    };
    section.finish();
    let limits =
        [window.funnel_ratio, window.spread, window.emergent_error, window.reference_error, window.max_input];
    if limits.iter().all(Option::is_none) {
        let allowed =
            "must limit something: funnel_ratio, spread, emergent_error, reference_error or max_input";
        log.report(item.diagnostic(Problem::Value, allowed));
    }
    Some(window)
}

/// Makes ticks of the times of all windows: those at and between `from` and `to`. Reports a window that the
/// run does not have.
pub(super) fn in_ticks(expect: &mut Expect, time: &TimeSpec, section: Option<&Item>, log: &Log) {
    let items = match section.and_then(|section| section.get("window")).map(|item| &item.value) {
        Some(Value::Array(items)) => items.as_slice(),
        _ => &[],
    };
    let end_ns = time.end_ns();
    for (window, item) in expect.windows.iter_mut().zip(items) {
        let (from, to) = (window.from_tick, window.to_tick);
        (window.from_tick, window.to_tick) = (time.first_tick(from), time.last_tick(to));
        let report = |key: &str, allowed: String| {
            let at = item.get(key).unwrap_or(item);
            log.report(at.diagnostic(Problem::Value, allowed));
        };
        if to > end_ns {
            report("to", format!("must not be later than the end of the run, {}", format_duration(end_ns)));
        } else if window.from_tick > window.to_tick {
            report("from", format!("must leave a whole tick of {} before to", format_duration(time.tick_ns)));
        }
    }
}
