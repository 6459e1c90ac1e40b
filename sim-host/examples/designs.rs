//! How well `check` predicts: random designs, each checked and then run.
//!
//! Usage: `designs [COUNT] [SEED]`, 600 and 1 unless said otherwise. Every design has nodes that start alike,
//! a constant funnel of 1e-3 to 1, fields whose amplitudes span three decades, and an ideal bus without
//! noise. A design leaves its funnel where `|nu| / psi` passes 1.01 in the run; it is called clean where no
//! finding is WARN or FAIL. A design that is warned of and leaves is cured by its own advice, at most three
//! times: each time the settings of the first finding that has some, the law's own word first.

use funnelnet_law::math;
use rand_pcg::Pcg64;
use sim_host::check::{Report, Status, check};
use sim_host::interrupt::Interrupt;
use sim_host::random::{Purpose, below, stream, uniform};
use sim_host::run::{Fidelity, RunOptions, Verbosity, simulate};
use sim_host::scenario::{Override, Scenario};
use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Ratio from which on a design counts as having left its funnel.
const LEFT: f64 = 1.01;

fn main() -> ExitCode {
    let argument = |index: usize| std::env::args().nth(index).and_then(|text| text.parse::<u64>().ok());
    let (count, seed) = (argument(1).unwrap_or(600), argument(2).unwrap_or(1));
    match (0..count).map(|index| tried(seed, index)).collect::<Result<Vec<_>, _>>() {
        Ok(designs) => {
            say("check", &designs, |design| design.clean);
            say_cures(&designs);
            say_keys(&designs);
            say("the sum of sizes and the start kick alone", &designs, |design| design.by_formula);
            say("these and the first tenth of a second", &designs, |design| design.by_formula && design.calm);
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

/// One design, checked and run.
#[derive(Clone, Debug)]
pub struct Design {
    /// It leaves its funnel by more than 1 %.
    pub left: bool,
    /// No finding is WARN or FAIL.
    pub clean: bool,
    by_formula: bool,
    calm: bool,
    /// What its advice makes of it, where it is warned of and leaves.
    pub cure: Option<Cured>,
    /// What was advised first, as `key=value` each.
    pub advised: Vec<String>,
}

/// What its own advice makes of a design that is warned of and leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cured {
    /// Inside, after so many rounds.
    After(u32),
    /// Still outside, or nothing is advised any more; whether the start is named as the cause.
    Not {
        /// A finding says so.
        start_is_named: bool,
    },
}

/// Rounds of advice.
const ROUNDS: u32 = 3;

/// Makes the design of an index, checks it, runs it, and cures it where that is called for.
///
/// # Errors
/// The scenario is refused, or does not run.
pub fn tried(seed: u64, index: u64) -> Result<Design, String> {
    let text = design(&mut stream(seed, Purpose::Graph, index));
    let scenario =
        Scenario::parse(&text, Path::new("design.toml"), &[]).map_err(|error| format!("{error}\n{text}"))?;
    let report = check(&scenario);
    let outcome = simulate(&scenario, &options()).map_err(|error| format!("{error}\n{text}"))?;
    let funnel = outcome.judge(&scenario, Fidelity::Loopback).funnel;
    // What is not a number has left.
    let inside = funnel.is_some_and(|funnel| funnel.max_ratio <= LEFT);
    let stands = |status| report.findings.iter().any(|found| found.status == status);
    let clean = !stands(Status::Warn) && !stands(Status::Fail);
    let cure = (!clean && !inside).then(|| cured(&text, &report)).transpose()?;
    let advised = advised(&report).filter(|_| cure.is_some()).unwrap_or_default();
    if clean && !inside {
        println!("# called clean and left: design {index}\n{text}");
    }
    Ok(Design { left: !inside, clean, by_formula: by_formula(&report), calm: calm(&report), cure, advised })
}

/// Applies the advice of a report, and that of what comes of it.
fn cured(text: &str, report: &Report) -> Result<Cured, String> {
    let (mut text, mut report) = (text.to_owned(), report.clone());
    for round in 1..=ROUNDS {
        let Some(settings) = advised(&report) else { break };
        let overrides = settings.iter().map(|set| Override::parse(set));
        let overrides = overrides.collect::<Result<Vec<_>, _>>().map_err(|error| error.to_string())?;
        let scenario = Scenario::parse(&text, Path::new("design.toml"), &overrides)
            .map_err(|error| format!("{error}\n{text}"))?;
        let outcome = simulate(&scenario, &options()).map_err(|error| format!("{error}\n{text}"))?;
        let funnel = outcome.judge(&scenario, Fidelity::Loopback).funnel;
        if funnel.is_some_and(|funnel| funnel.max_ratio <= LEFT) {
            return Ok(Cured::After(round));
        }
        (text, report) = (scenario.as_run.clone(), check(&scenario));
    }
    let start_is_named = report.findings.iter().any(|found| {
        let open = matches!(found.status, Status::Warn | Status::Fail);
        let text = found.advice.as_ref().map_or("", |advice| &advice.text);
        open && (found.name == "kick" || text.contains("at the start"))
    });
    println!("# not cured: {report}\n{text}");
    Ok(Cured::Not { start_is_named })
}

/// The settings of the first warning that has some, as `key=value` each.
fn advised(report: &Report) -> Option<Vec<String>> {
    let open = report.findings.iter().filter(|found| matches!(found.status, Status::Warn | Status::Fail));
    let mut open: Vec<_> = open.collect();
    open.sort_by_key(|found| found.name != "sampled");
    open.into_iter().find_map(|found| {
        let settings = found.advice.as_ref()?.settings();
        let settings: Vec<_> = settings.map(|set| format!("{}={}", set.key, set.value)).collect();
        (!settings.is_empty()).then_some(settings)
    })
}

fn say_cures(designs: &[Design]) {
    let cures: Vec<_> = designs.iter().filter_map(|design| design.cure).collect();
    let count = |wanted: Cured| cures.iter().filter(|cure| **cure == wanted).count();
    let after: Vec<_> = (1..=ROUNDS).map(|round| count(Cured::After(round))).collect();
    let cured: usize = after.iter().sum();
    println!(
        "  warned of and left: {}, cured by their advice {cured}, {:.1} % (after one, two, three rounds {after:?}); of the rest the start is \
         named as the cause in {}",
        cures.len(),
        100.0 * cured as f64 / cures.len().max(1) as f64,
        count(Cured::Not { start_is_named: true })
    );
}

/// By which keys designs are cured, and how far funnels are widened at most.
fn say_keys(designs: &[Design]) {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let mut factors: Vec<f64> = Vec::new();
    for design in designs.iter().filter(|design| !design.advised.is_empty()) {
        let (keys, values): (Vec<_>, Vec<_>) =
            design.advised.iter().filter_map(|set| set.split_once('=')).unzip();
        *counts.entry(keys.join(" and ")).or_default() += 1;
        let wider = keys.iter().zip(values).find(|(key, _)| key.ends_with("factor"));
        factors.extend(wider.and_then(|(_, value)| value.trim().parse::<f64>().ok()));
    }
    factors.sort_by(f64::total_cmp);
    println!(
        "  advised first: {counts:?}; funnels wider by {:?} (median), {:?} (largest)",
        factors.get(factors.len() / 2),
        factors.last()
    );
}

/// Whether the law, followed over the first tenth of a second only, stays inside: what a run that is too
/// large to follow gets.
fn calm(report: &Report) -> bool {
    let found = |name: &str| report.findings.iter().find(|found| found.name == name);
    let ratio = found("sampled").and_then(|found| found.values["start"]["ratio"].as_f64());
    let steady = found("input").and_then(|found| found.values["steady_ratio"].as_f64());
    ratio.zip(steady).is_some_and(|(ratio, steady)| ratio < 1.0 && ratio < (steady + 0.02).max(0.95))
}

/// Whether the formulas alone call it clean.
fn by_formula(report: &Report) -> bool {
    let below = |name: &str, key: &str, limit: f64| {
        let found = report.findings.iter().find(|found| found.name == name);
        found.is_some_and(|found| found.values[key].as_f64().is_some_and(|value| value < limit))
    };
    below("narrowest-funnel", "predicted_ratio", 1.0) && below("kick", "kick", 0.5)
}

fn say(what: &str, designs: &[Design], clean: impl Fn(&Design) -> bool) {
    let count = |test: &dyn Fn(&&Design) -> bool| designs.iter().filter(test).count();
    let (called, good) = (count(&|design| clean(design)), count(&|design| !design.left));
    let missed = count(&|design| clean(design) && design.left);
    let warned = count(&|design| !clean(design) && !design.left);
    let share = |part: usize, whole: usize| 100.0 * part as f64 / whole.max(1) as f64;
    println!("{what}: {} designs, {good} stay inside", designs.len());
    println!("  called clean and left: {missed} of {called}, {:.1} %", share(missed, called));
    println!("  good and warned of: {warned} of {good}, {:.1} %", share(warned, good));
}

fn options() -> RunOptions {
    RunOptions {
        on: Fidelity::Loopback,
        out: None,
        every_ticks: Some(1_000_000),
        json: None,
        junit: None,
        image: PathBuf::new(),
        bench: None,
        bus_logs: Default::default(),
        mcap: false,
        verbosity: Verbosity::Quiet,
        interrupt: Interrupt::default(),
        repeat: String::new(),
    }
}

/// The text of a random scenario.
fn design(random: &mut Pcg64) -> String {
    let between = |random: &mut Pcg64, low: f64, high: f64| low + (high - low) * uniform(random);
    let nodes = 3 + below(random, 10);
    let graph = ["ring", "path", "star", "complete"][below(random, 4)];
    let tick = [500, 1000, 2000, 5000, 10000][below(random, 5)];
    let scale = math::exp10(between(random, -0.5, 1.0));
    let gain = match below(random, 4) {
        0 => format!("kind = \"logarithmic\", scale = {scale}"),
        1 => format!("kind = \"algebraic\", scale = {scale}"),
        _ => format!("kind = \"reciprocal\", scale = {scale}"),
    };
    let width = math::exp10(between(random, -3.0, 0.0));
    let amplitude = math::exp10(between(random, -1.0, 2.0));
    let mut text = format!(
        "version = 1\n[time]\ntick = \"{tick}us\"\nduration = \"5s\"\n[graph]\nkind = \"{graph}\"\nnodes = {nodes}\n[coupling]\n\
         kind = \"node-wise\"\ngain = {{ {gain} }}\nfunnel = {{ kind = \"constant\", width = {width} }}\n"
    );
    for id in 1..=nodes {
        let (slope, offset) = (-between(random, 0.2, 2.0), amplitude * between(random, -1.0, 1.0));
        let (swing, frequency) = (amplitude * between(random, -1.0, 1.0), between(random, 0.5, 10.0));
        let phase = between(random, 0.0, TAU);
        let _ = writeln!(
            text,
            "[[node]]\nid = {id}\n[node.dynamics]\nkind = \"affine\"\nslope = {slope}\noffset = {offset}\n\
             sines = [{{ amplitude = {swing}, frequency = {frequency}, phase = {phase} }}]"
        );
    }
    text
}
