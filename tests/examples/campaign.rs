//! Worlds by chance for a night: `campaign [--runs N] [--from NUMBER]`, on all cores. What is broken is made small and written to
//! `campaign-NUMBER.toml`, which `sim-host run` takes.
#![allow(clippy::expect_used, reason = "a tool for those who work on this repository")]

use std::num::NonZero;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use system_tests::campaign::{Seen, draw, look, smaller};

/// A run hangs for which the program computes longer, by each of its threads, s. Not by the time that passes: a busy machine lets it wait.
const PATIENCE_S: f64 = 120.0;

#[derive(Default)]
struct Tally {
    seen: Vec<Seen>,
    broken: u64,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |name: &str, default: u64| {
        let at = arguments.iter().position(|argument| argument == name);
        let given = at.map(|at| arguments.get(at + 1).map_or("", String::as_str));
        given.map_or(default, |text| text.parse().expect("--runs and --from: whole numbers"))
    };
    let (runs, from) = (value("--runs", 200), value("--from", 1));
    let (next, done) = (AtomicU64::new(from), AtomicBool::new(false));
    let threads = std::thread::available_parallelism().map_or(1, NonZero::get);
    // What each thread is at, and since when.
    let at: Vec<Mutex<Option<(u64, f64)>>> = (0..threads).map(|_| Mutex::new(None)).collect();
    let tally = Mutex::new(Tally::default());
    std::thread::scope(|scope| {
        let workers: Vec<_> =
            at.iter().map(|at| scope.spawn(|| work(at, &next, from + runs, &tally))).collect();
        scope.spawn(|| watch(&at, &done));
        workers.into_iter().for_each(|worker| worker.join().expect("a worker"));
        done.store(true, Ordering::Relaxed);
    });
    let tally = tally.into_inner().expect("a tally");
    let count = |of: fn(&Seen) -> bool| tally.seen.iter().filter(|seen| of(seen)).count();
    println!(
        "{} worlds: {} with a promise of check, {} followed by it, {} judged after their events, {} with counted frames, {} with limits of what is heard, \
         {} with clocks that were judged; {} broken",
        runs,
        count(|seen| seen.promised),
        count(|seen| seen.foretold),
        count(|seen| seen.recovers),
        count(|seen| seen.counted),
        count(|seen| seen.limited),
        count(|seen| seen.timed),
        tally.broken
    );
    let sum = |of: fn(&Seen) -> u64| tally.seen.iter().map(of).sum::<u64>();
    println!(
        "{} edges to liars that had to go, {} nodes that are heard again, {} nodes that adopted or could not",
        sum(|seen| seen.noticed),
        sum(|seen| seen.renewed),
        sum(|seen| seen.adopted)
    );
    if tally.broken == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn work(at: &Mutex<Option<(u64, f64)>>, next: &AtomicU64, end: u64, tally: &Mutex<Tally>) {
    loop {
        let number = next.fetch_add(1, Ordering::Relaxed);
        if number >= end {
            *at.lock().expect("a place") = None;
            return;
        }
        *at.lock().expect("a place") = Some((number, computed_s()));
        // A night is long.
        if number.is_multiple_of(1_000) {
            eprintln!("world {number}");
        }
        let world = draw(number);
        match std::panic::catch_unwind(|| look(&world)) {
            Ok(Ok(seen)) => tally.lock().expect("a tally").seen.push(seen),
            Ok(Err(broken)) => {
                let (world, broken) = smaller(&world, &broken);
                found(number, &broken.to_string(), &world.text());
                tally.lock().expect("a tally").broken += 1;
            }
            Err(_) => {
                found(number, "a panic", &world.text());
                tally.lock().expect("a tally").broken += 1;
            }
        }
    }
}

fn found(number: u64, what: &str, text: &str) {
    let file = format!("campaign-{number}.toml");
    std::fs::write(&file, format!("# world {number}: {what}\n{text}")).expect("a file");
    println!("world {number}: {what} ({file})");
}

/// Time for which all threads of this program have computed, s; 0 where the system does not say.
fn computed_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name in parentheses may have blanks; behind it are the state and ten numbers, then the user's and the system's time, 1/100 s.
    let times = stat.rsplit(')').next().unwrap_or("").split_whitespace().skip(11).take(2);
    times.filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0
}

fn watch(at: &[Mutex<Option<(u64, f64)>>], done: &AtomicBool) {
    let patience = PATIENCE_S * at.len() as f64;
    while !done.load(Ordering::Relaxed) {
        let now = computed_s();
        for at in at {
            let slow = at.lock().expect("a place").filter(|(_, since)| now - since > patience);
            if let Some((number, _)) = slow {
                found(number, "it hangs", &draw(number).text());
                std::process::exit(1);
            }
        }
        std::thread::sleep(Duration::from_millis(200));
    }
}
