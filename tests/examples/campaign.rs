//! Worlds by chance for a night: `campaign [--runs N] [--from NUMBER]`, on all cores. What is broken is made small and written to
//! `campaign-NUMBER.toml`, which `sim-host run` takes.
#![allow(clippy::expect_used, reason = "a tool for those who work on this repository")]

use std::num::NonZero;
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};
use system_tests::campaign::{Seen, draw, look, smaller};

/// A run that takes longer hangs, unless the machine has left this program no time meanwhile.
const PATIENCE: Duration = Duration::from_secs(120);
/// Processor time of all threads without which no run can be said to hang. One that waits for ever uses none: it is found
/// after [`ASLEEP`].
const BUSY: Duration = Duration::from_secs(60);
const ASLEEP: Duration = Duration::from_secs(3_600);

/// A run that a thread is at.
#[derive(Clone, Copy)]
struct Begun {
    number: u64,
    at: Instant,
    /// Processor time of this program by then.
    used: Duration,
}

impl Begun {
    fn hangs(&self) -> bool {
        let waited = self.at.elapsed();
        waited > ASLEEP || waited > PATIENCE && processor_time().saturating_sub(self.used) > BUSY
    }
}

/// Processor time of all threads of this program; zero where the system does not tell it.
fn processor_time() -> Duration {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name of the program, in parentheses, may have blanks. User and system time are the 14th and 15th field, in hundredths of
    // a second.
    let rest = stat.rsplit_once(')').map_or("", |(_, rest)| rest);
    let ticks: u64 =
        rest.split_whitespace().skip(11).take(2).filter_map(|field| field.parse::<u64>().ok()).sum();
    Duration::from_millis(10 * ticks)
}

#[derive(Default)]
struct Tally {
    seen: Vec<Seen>,
    broken: u64,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().collect();
    let value = |name: &str, default: u64| {
        let at = arguments.iter().position(|argument| argument == name);
        at.and_then(|at| arguments.get(at + 1)?.parse().ok()).unwrap_or(default)
    };
    let (runs, from) = (value("--runs", 200), value("--from", 1));
    let (next, done) = (AtomicU64::new(from), AtomicBool::new(false));
    let threads = std::thread::available_parallelism().map_or(1, NonZero::get);
    // What each thread is at, and since when.
    let at: Vec<Mutex<Option<Begun>>> = (0..threads).map(|_| Mutex::new(None)).collect();
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

fn work(at: &Mutex<Option<Begun>>, next: &AtomicU64, end: u64, tally: &Mutex<Tally>) {
    loop {
        let number = next.fetch_add(1, Ordering::Relaxed);
        if number >= end {
            *at.lock().expect("a place") = None;
            return;
        }
        *at.lock().expect("a place") = Some(Begun { number, at: Instant::now(), used: processor_time() });
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

fn watch(at: &[Mutex<Option<Begun>>], done: &AtomicBool) {
    while !done.load(Ordering::Relaxed) {
        for at in at {
            let slow = at.lock().expect("a place").filter(Begun::hangs);
            if let Some(Begun { number, .. }) = slow {
                found(number, "it hangs", &draw(number).text());
                std::process::exit(1);
            }
        }
        std::thread::sleep(Duration::from_millis(200));
    }
}
