//! What every run must do, whether or not anything is expected of it.

use super::{Findings, ReferenceSummary};
use crate::engine::NodeEvent;
use crate::number_format::significant;
use crate::scenario::{FloorSpec, Scenario, Stoppable};
use funnelnet_node::Event;
use funnelnet_protocol::report::Counters;
use serde::Serialize;

/// One of them, and what the run made of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Check {
    /// Its name: `complete`, `stopped`, `absent`, `heard`, `floor`, `measured`, `resolved` or `consistent`.
    pub name: &'static str,
    /// Whether it held.
    pub pass: bool,
    /// What was found, as a sentence.
    pub text: String,
}

/// What one node said of itself, tick by tick and at the end.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Account {
    /// Its id.
    pub id: u16,
    /// Ticks that it was seen to run.
    pub ran: u64,
    /// The last of them, where it ticks by a clock of its own.
    pub last_tick: Option<u64>,
    /// Ticks at which its state was not recorded, or it was away.
    pub unknown: u64,
    /// The largest ratio that it believed at a tick that was seen.
    pub max_ratio: f32,
    /// Ticks that it believed to be outside, as far as they were seen.
    pub breaches: u64,
    /// The first tick at which its funnel was not the scenario's: tick, its own, the scenario's (state
    /// units).
    pub other_funnel: Option<(u64, f64, f64)>,
    /// The same where it was wider, and the node says that it has floored or reopened it.
    pub widened: Option<(u64, f64, f64)>,
    /// What it reported at the end.
    pub report: Option<(f32, Counters)>,
    /// Ticks that it may have run beside those that were seen or are unknown: after the last one, until it
    /// heard the stop.
    pub unseen: u64,
    /// What it reports is of the whole run: it was not restarted.
    pub whole: bool,
}

/// A node that stopped by itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stop {
    /// Its id.
    pub id: u16,
    /// When, in s of the scenario.
    pub at_s: f64,
    /// Why.
    pub why: String,
}

/// The time that a node was away.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct AbsenceSummary {
    /// Its id.
    pub node: u8,
    /// First tick that it has missed.
    pub from_tick: u32,
    /// First tick that it took part in again; `null` if it did not come back.
    pub to_tick: Option<u32>,
    /// Why it was given up.
    pub why: String,
}

impl Stop {
    /// The stop that an event of a node of `scenario` tells of, if it does.
    #[must_use]
    pub fn of(event: &NodeEvent, scenario: &Scenario) -> Option<Self> {
        let Event::Fault(code) = event.event else { return None };
        // Tick 0 is one tick after the start, when the announced states have arrived.
        let at_ns = scenario.time.from_clock(event.at.saturating_sub(scenario.time.tick_ns));
        Some(Self { id: scenario.nodes.get(event.node)?.id, at_s: at_ns as f64 / 1e9, why: code.to_string() })
    }
}

/// What the checks look at.
#[derive(Clone, Copy, Debug)]
pub struct Evidence<'a> {
    /// Of the judge.
    pub findings: &'a Findings,
    /// By index; empty where no f32 node ran.
    pub accounts: &'a [Account],
    /// In the order in which they stopped.
    pub stops: &'a [Stop],
    /// Of a bench.
    pub absences: &'a [AbsenceSummary],
    /// Ids of nodes that no neighbour has ever heard.
    pub unheard: &'a [u16],
    /// Ids of nodes that all their neighbours have lost at the end.
    pub silent: &'a [u16],
    /// Faults that contradict the run, as sentences; of a bench.
    pub contradictions: &'a [String],
    /// Where the run was compared with one, or is one.
    pub reference: Option<&'a ReferenceSummary>,
    /// After how many ticks the run ended, and why, where it did so before its last one.
    pub ended_early: Option<&'a str>,
}

/// All checks of a run of `scenario`.
#[must_use]
pub fn checks(scenario: &Scenario, evidence: &Evidence<'_>) -> Vec<Check> {
    vec![
        complete(evidence.ended_early),
        stopped(scenario, evidence.stops),
        absent(evidence.absences),
        heard(evidence),
        floor(scenario, evidence),
        measured(evidence.findings),
        resolved(evidence.reference),
        consistent(evidence),
    ]
}

/// Faults that a sentence names; a hundred nodes with the same one say no more than a few.
const NAMED: usize = 4;

fn check(name: &'static str, faults: Vec<String>, fine: &str) -> Check {
    let text = match faults.len() {
        0 => fine.to_owned(),
        count if count <= NAMED => faults.join("; "),
        count => format!("{}; and {} more of the kind", faults[..NAMED].join("; "), count - NAMED),
    };
    Check { name, pass: faults.is_empty(), text }
}

fn complete(ended_early: Option<&str>) -> Check {
    let tell = |why: &str| format!("the run ended {why}");
    check("complete", ended_early.map(tell).into_iter().collect(), "every tick was run")
}

fn stopped(scenario: &Scenario, stops: &[Stop]) -> Check {
    let may = |id: u16| match &scenario.expect.stopped {
        Stoppable::Any => true,
        Stoppable::Ids(ids) => ids.contains(&id),
    };
    let tell = |stop: &Stop| {
        format!("node {} stopped by itself at {} s: {}", stop.id, significant(stop.at_s, 6), stop.why)
    };
    let faults = stops.iter().filter(|stop| !may(stop.id)).map(tell).collect();
    let fine = match stops.len() {
        0 => "no node stopped by itself".to_owned(),
        some => format!("{some} stopped by themselves, as expect.stopped allows"),
    };
    check("stopped", faults, &fine)
}

fn absent(absences: &[AbsenceSummary]) -> Check {
    let tell = |absence: &AbsenceSummary| {
        let until = absence.to_tick.map_or("to the end".to_owned(), |to| format!("to tick {to}"));
        format!("node {} was away from tick {} {until}: {}", absence.node, absence.from_tick, absence.why)
    };
    check("absent", absences.iter().map(tell).collect(), "no node was away")
}

fn heard(evidence: &Evidence<'_>) -> Check {
    let never = evidence.unheard.iter().map(|id| format!("no neighbour has ever heard node {id}"));
    let silent =
        evidence.silent.iter().map(|id| format!("all neighbours of node {id} have lost it at the end"));
    check("heard", never.chain(silent).collect(), "every node was heard to the end")
}

/// A node that floors its funnel does not do what the designer has drawn, unless the scenario says how narrow
/// it has to be.
fn floor(scenario: &Scenario, evidence: &Evidence<'_>) -> Check {
    let floored = |account: &Account| {
        let (_, counters) = account.report.as_ref()?;
        let count = counters.floored;
        match scenario.floor {
            FloorSpec::None if count > 0 => Some(format!(
                "node {} has floored its funnel at {count} ticks, and no coupling.floor accepts that",
                account.id
            )),
            FloorSpec::None => None,
            _ if counters.reopened > 0 => None,
            _ => account.widened.filter(|_| count > 0).map(|(k, own, asked)| {
                format!(
                    "node {} keeps its funnel at {} at tick {k}, wider than {}, which coupling.floor accepts",
                    account.id,
                    significant(own, 4),
                    significant(asked, 4)
                )
            }),
        }
    };
    let fine = match scenario.floor {
        FloorSpec::None => "no node has floored its funnel",
        FloorSpec::Width(_) | FloorSpec::F32 => "no funnel was wider than the accepted floor",
    };
    check("floor", evidence.accounts.iter().filter_map(floored).collect(), fine)
}

fn measured(findings: &Findings) -> Check {
    let mut faults = Vec::new();
    if findings.judged == 0 {
        faults.push("no diffusive term was known at any tick".to_owned());
    }
    for (name, value) in [
        ("the largest |nu| / psi", Some(findings.max_ratio)),
        ("the largest spread", findings.max_spread),
        ("the largest input", findings.max_input),
    ] {
        if value.is_some_and(f64::is_nan) {
            faults.push(format!("{name} is not a number"));
        }
    }
    if findings.last.iter().all(|x| x.is_nan()) {
        faults.push("no state was known at the end".to_owned());
    }
    check("measured", faults, "every figure is a number")
}

/// A reference that does not know its own solution measures nothing.
fn resolved(reference: Option<&ReferenceSummary>) -> Check {
    let unresolved = reference.filter(|reference| !reference.resolved).map(|reference| {
        let error = significant(reference.error_estimate, 3);
        format!("the continuous-time reference has not resolved the problem: it may be off by {error} itself")
    });
    let fine =
        if reference.is_some() { "the reference has resolved the problem" } else { "there is no reference" };
    check("resolved", unresolved.into_iter().collect(), fine)
}

/// What nodes say of themselves against what they were seen to do.
fn consistent(evidence: &Evidence<'_>) -> Check {
    let mut faults: Vec<String> = evidence.contradictions.to_vec();
    for account in evidence.accounts {
        faults.extend(contradictions(account));
        faults.extend(own_width(account));
        if let Some((k, own, asked)) = account.other_funnel {
            faults.push(format!(
                "node {} runs in another funnel than the scenario's: {} at tick {k}, where it is {}",
                account.id,
                significant(own, 6),
                significant(asked, 6)
            ));
        }
    }
    check("consistent", faults, "what nodes report is what they were seen to do")
}

/// What contradicts the run where the nodes with these indices have missed what they should have adopted.
#[must_use]
pub fn missed(scenario: &Scenario, nodes: &[usize]) -> Vec<String> {
    let tell = |index: &usize| {
        let staged = scenario.staged.get(*index)?.as_ref()?;
        let at = significant(scenario.time.at_s(staged.tick), 6);
        Some(format!(
            "node {} has missed what is set at {at} s and goes on as it was: what was staged in it was gone",
            index + 1
        ))
    };
    nodes.iter().filter_map(tell).collect()
}

/// A node whose funnel was wider than the scenario's, and that has not said why.
fn own_width(account: &Account) -> Option<String> {
    let (k, own, asked) = account.widened?;
    let told =
        account.report.as_ref().is_some_and(|(_, counters)| counters.floored > 0 || counters.reopened > 0);
    (!told).then(|| {
        format!(
            "node {} runs in another funnel than the scenario's: {} at tick {k}, where it is {}",
            account.id,
            significant(own, 6),
            significant(asked, 6)
        )
    })
}

fn contradictions(account: &Account) -> Vec<String> {
    let Some((max_ratio, counters)) = &account.report else { return Vec::new() };
    let (id, mut faults) = (account.id, Vec::new());
    let spare = account.unknown + account.unseen;
    // Nothing that was seen is missing in a report of the whole run.
    let fits = |reported: u32, seen: u64| {
        let reported = u64::from(reported);
        reported <= seen + spare && (reported >= seen || !account.whole)
    };
    if !fits(counters.breaches, account.breaches) {
        faults.push(format!(
            "node {id} reports {} breaches, and was seen to have {}",
            counters.breaches, account.breaches
        ));
    }
    // Written so that NaN contradicts. A ratio has the same bits here and there.
    let known = *max_ratio <= account.max_ratio || spare > 0;
    let whole = *max_ratio >= account.max_ratio || !account.whole;
    if !known || !whole || !max_ratio.is_finite() {
        faults.push(format!(
            "node {id} reports a largest |nu| / psi of {max_ratio}, and was seen to have {}",
            account.max_ratio
        ));
    }
    if !fits(counters.ticks, account.ran) {
        faults
            .push(format!("node {id} reports {} ticks, and was seen to run {}", counters.ticks, account.ran));
    }
    if counters.weights_differ > 0 {
        faults.push(format!(
            "node {id} was announced other weights {} times: the graph is not undirected",
            counters.weights_differ
        ));
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(max_ratio: f32, change: impl FnOnce(&mut Counters)) -> Account {
        let mut counters = Counters { ticks: 11, ..Counters::default() };
        change(&mut counters);
        Account { id: 3, ran: 11, max_ratio: 0.5, report: Some((max_ratio, counters)), ..Account::default() }
    }

    #[test]
    fn a_report_that_agrees_with_what_was_seen_contradicts_nothing() {
        assert_eq!(contradictions(&report(0.5, |_| {})), Vec::<String>::new());
        // A node that was restarted has counted less.
        assert_eq!(contradictions(&report(0.25, |c| c.ticks = 4)), Vec::<String>::new());
    }

    #[test]
    fn each_lie_of_a_report_is_named() {
        for (account, words) in [
            (report(0.5, |c| c.breaches = 4321), "reports 4321 breaches, and was seen to have 0"),
            (report(0.75, |_| {}), "reports a largest |nu| / psi of 0.75, and was seen to have 0.5"),
            (report(f32::NAN, |_| {}), "reports a largest |nu| / psi of NaN"),
            (report(0.5, |c| c.ticks = 12), "reports 12 ticks, and was seen to run 11"),
            (report(0.5, |c| c.weights_differ = 2), "announced other weights 2 times"),
        ] {
            let found = contradictions(&account);
            assert!(found.len() == 1 && found[0].contains(words), "{found:?}");
        }
    }

    #[test]
    fn a_report_of_the_whole_run_has_all_that_was_seen() {
        let whole = |account: Account| Account { whole: true, breaches: 1, ..account };
        assert_eq!(contradictions(&whole(report(0.5, |c| c.breaches = 1))), Vec::<String>::new());
        for (account, words) in [
            (report(0.5, |_| {}), "reports 0 breaches, and was seen to have 1"),
            (
                report(0.25, |c| c.breaches = 1),
                "reports a largest |nu| / psi of 0.25, and was seen to have 0.5",
            ),
            (report(0.5, |c| (c.breaches, c.ticks) = (1, 4)), "reports 4 ticks, and was seen to run 11"),
        ] {
            let found = contradictions(&whole(account));
            assert!(found.len() == 1 && found[0].contains(words), "{found:?}");
        }
        // A clock of its own ticks on until the node hears the stop.
        let late = Account { unseen: 2, ..whole(report(0.75, |c| (c.breaches, c.ticks) = (2, 13))) };
        assert_eq!(contradictions(&late), Vec::<String>::new());
        assert_eq!(contradictions(&Account { unseen: 1, ..late }).len(), 1);
    }

    #[test]
    fn what_was_not_recorded_may_have_been_a_breach() {
        let account = Account { unknown: 2, ran: 9, ..report(0.9, |c| c.breaches = 2) };
        assert_eq!(contradictions(&account), Vec::<String>::new());
    }
}
