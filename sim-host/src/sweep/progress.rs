//! How far a sweep has come: a bar on a terminal, a line a minute elsewhere.

use super::verdict::{Tally, Verdict};
use crate::printable::printable_lines;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

/// Time between two lines.
const MINUTE: Duration = Duration::from_secs(60);

/// Runs that are done and to be done, and how much work they are: node-steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Load {
    /// Runs.
    pub runs: u64,
    /// Node-steps.
    pub work: u64,
}

/// Tells on standard error how far a sweep has come.
#[derive(Debug)]
pub struct Progress {
    begin: Instant,
    /// What this process has to do.
    all: Load,
    done: Load,
    /// Runs of the table that were there before.
    before: u64,
    tally: Tally,
    way: Way,
}

#[derive(Debug)]
enum Way {
    Bar(ProgressBar),
    Lines { next: Duration },
    Quiet,
}

impl Progress {
    /// Of a process that has `all` to do; the table has the runs of `tally`.
    #[must_use]
    pub fn new(all: Load, tally: Tally, is_quiet: bool) -> Self {
        let before = tally.total();
        let way = match (is_quiet, std::io::stderr().is_terminal()) {
            (true, _) => Way::Quiet,
            (false, true) => Way::Bar(bar(before + all.runs, before)),
            (false, false) => Way::Lines { next: MINUTE },
        };
        Self { begin: Instant::now(), all, done: Load::default(), before, tally, way }
    }

    /// One more run of so much work is done.
    pub fn done(&mut self, work: u64, verdict: Verdict) {
        self.done = Load { runs: self.done.runs + 1, work: self.done.work + work };
        self.tally.add(verdict);
    }

    /// Time has passed; nothing need have happened.
    pub fn show(&mut self) {
        let elapsed = self.begin.elapsed();
        let told = self.told(elapsed);
        match &mut self.way {
            Way::Bar(bar) => {
                bar.set_position(self.before + self.done.runs);
                bar.set_message(told);
            }
            Way::Lines { next } if elapsed >= *next => {
                *next = elapsed + MINUTE;
                let (done, all) = (self.before + self.done.runs, self.before + self.all.runs);
                self.tell(&format!("sweep: {done} of {all} runs, {told}"));
            }
            Way::Lines { .. } | Way::Quiet => {}
        }
    }

    /// A message of its own, beside the bar.
    pub fn tell(&self, message: &str) {
        // Nobody is left to tell where standard error is closed.
        let say = || drop(writeln!(std::io::stderr(), "{}", printable_lines(message)));
        match &self.way {
            Way::Bar(bar) => bar.suspend(say),
            _ => say(),
        }
    }

    /// The verdicts of all runs of the table.
    #[must_use]
    pub fn tally(&self) -> Tally {
        self.tally
    }

    fn told(&self, elapsed: Duration) -> String {
        let failed = self.tally.total() - self.tally.count(Verdict::Passed);
        let failed = if failed > 0 { format!("{failed} not passed, ") } else { String::new() };
        match left(self.done, self.all, elapsed) {
            Some(left) => format!("{failed}{} left", in_words(left)),
            None => format!("{failed}time left not known yet"),
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Way::Bar(bar) = &self.way {
            bar.finish_and_clear();
        }
    }
}

fn bar(runs: u64, before: u64) -> ProgressBar {
    let bar = ProgressBar::new(runs).with_position(before);
    let style = ProgressStyle::with_template("sweep [{bar:30}] {pos} of {len} runs, {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("=> "));
    bar.enable_steady_tick(Duration::from_secs(1));
    bar
}

/// Time for the rest, at the speed so far.
fn left(done: Load, all: Load, elapsed: Duration) -> Option<Duration> {
    let rest = all.work.saturating_sub(done.work) as f64;
    (done.work > 0).then(|| elapsed.mul_f64(rest / done.work as f64))
}

/// Two units are enough.
fn in_words(time: Duration) -> String {
    let s = time.as_secs_f64().ceil() as u64;
    match (s / 86_400, s / 3_600 % 24, s / 60 % 60, s % 60) {
        (0, 0, 0, s) => format!("{s} s"),
        (0, 0, min, s) => format!("{min} min {s} s"),
        (0, h, min, _) => format!("{h} h {min} min"),
        (d, h, _, _) => format!("{d} d {h} h"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_that_of_the_work_left() {
        let load = |runs, work| Load { runs, work };
        let left = |done| left(done, load(10, 1_000), Duration::from_secs(30));
        assert_eq!(left(load(0, 0)), None);
        // Nine short runs of ten are not nine tenths of the work.
        assert_eq!(left(load(9, 100)), Some(Duration::from_secs(270)));
        assert_eq!(left(load(10, 1_000)), Some(Duration::ZERO));
    }

    #[test]
    fn times_are_told_in_two_units() {
        for (s, words) in [
            (0.2, "1 s"),
            (59.0, "59 s"),
            (130.0, "2 min 10 s"),
            (3_900.0, "1 h 5 min"),
            (180_000.0, "2 d 2 h"),
        ] {
            assert_eq!(in_words(Duration::from_secs_f64(s)), words);
        }
    }

    #[test]
    fn a_line_is_told_once_a_minute() {
        let mut progress = Progress::new(Load { runs: 4, work: 400 }, Tally::default(), true);
        progress.way = Way::Lines { next: MINUTE };
        let next = |progress: &Progress| match progress.way {
            Way::Lines { next } => next,
            _ => Duration::ZERO,
        };
        progress.done(100, Verdict::Failed);
        progress.show();
        assert_eq!(next(&progress), MINUTE);
        assert_eq!(progress.told(Duration::from_secs(20)), "1 not passed, 1 min 0 s left");
        progress.begin = Instant::now().checked_sub(Duration::from_secs(61)).unwrap();
        progress.show();
        assert!(next(&progress) >= MINUTE + Duration::from_secs(61));
    }
}
