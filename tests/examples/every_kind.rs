//! The table of the book's page of faults: one event of each kind at random places and times, `every_kind [--runs N] [--kind NAME]`;
//! so many runs on each of three graphs, on all cores. A run that a node has not come back from is written to `every-kind-NUMBER.toml`
//! with `--keep`.
#![allow(clippy::expect_used, clippy::panic, reason = "a tool for those who work on this repository")]

use funnelnet_sim::judge::Recovered;
use std::num::NonZero;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use system_tests::campaign::kinds::{GRAPHS, KINDS, Kind, Run, happen};

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |name: &str| {
        let at = arguments.iter().position(|argument| argument == name);
        at.and_then(|at| arguments.get(at + 1))
    };
    let runs = value("--runs").map_or(20, |text| text.parse().expect("--runs: a whole number"));
    let keep = arguments.iter().any(|argument| argument == "--keep");
    let known = |name: &String| KINDS.iter().any(|kind| kind.name == name);
    if let Some(name) = value("--kind").filter(|name| !known(name)) {
        let names: Vec<_> = KINDS.iter().map(|kind| kind.name).collect();
        panic!("--kind {name:?}: must be one of {names:?}");
    }
    println!(
        "| one event | never outside | back inside after its end: median, 99 %, longest | outside at the end, and nobody has stopped | a node has stopped | largest input |"
    );
    println!("|---|---:|---:|---:|---:|---:|");
    for kind in KINDS.iter().filter(|kind| value("--kind").is_none_or(|name| name == kind.name)) {
        println!("{}", row(kind.name, &all(kind, runs), keep));
    }
}

/// Runs of a kind on all graphs, in the order of their numbers.
fn all(kind: &Kind, runs: u64) -> Vec<(u64, Run)> {
    let next = AtomicU64::new(0);
    let threads = std::thread::available_parallelism().map_or(1, NonZero::get);
    let found = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let number = next.fetch_add(1, Ordering::Relaxed);
                    let Some(&graph) = GRAPHS.get((number / runs.max(1)) as usize) else { return };
                    let run = happen(kind, graph, number)
                        .unwrap_or_else(|why| panic!("{}, {number}: {why}", kind.name));
                    found.lock().expect("a list").push((number, run));
                }
            });
        }
    });
    let mut found = found.into_inner().expect("a list");
    found.sort_by_key(|(number, _)| *number);
    found
}

fn row(name: &str, runs: &[(u64, Run)], keep: bool) -> String {
    let share = |of: &dyn Fn(&Run) -> bool| {
        let count = runs.iter().filter(|(_, run)| of(run)).count();
        match count {
            0 => "0".to_owned(),
            1 if runs.len() > 1_000 => "1 run".to_owned(),
            few if few * 1_000 < runs.len() => format!("{few} runs"),
            _ => format!("{:.1} %", 100.0 * count as f64 / runs.len() as f64),
        }
    };
    // A node that has stopped holds its state, and nobody can come back to it.
    let all_run = |run: &Run| run.stopped == 0;
    let mut back: Vec<f64> = runs
        .iter()
        .filter(|(_, run)| !run.is_borne() && all_run(run))
        .filter_map(|(_, run)| run.recovery.after_s())
        .collect();
    back.sort_by(f64::total_cmp);
    let at = |share: f64| back.get((share * back.len().saturating_sub(1) as f64).round() as usize);
    let ms = |share: f64| at(share).map_or("-".to_owned(), |s| format!("{:.0} ms", s * 1e3));
    let outside = |run: &Run| run.recovery == Recovered::Outside && all_run(run);
    if keep {
        for (number, run) in runs.iter().filter(|(_, run)| outside(run)) {
            std::fs::write(format!("every-kind-{number}.toml"), &run.text).expect("a file");
        }
    }
    let input = runs.iter().map(|(_, run)| run.input).fold(0.0, f64::max);
    format!(
        "| {name} | {} | {}, {}, {} | {} | {} | {input:.1} |",
        share(&Run::is_borne),
        ms(0.5),
        ms(0.99),
        ms(1.0),
        share(&outside),
        share(&|run| run.stopped > 0),
    )
}
