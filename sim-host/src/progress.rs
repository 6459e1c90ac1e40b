//! A progress bar on a terminal, and nothing anywhere else.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

/// Shows how far a run has come, on standard error, if that is a terminal.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
    end: f64,
}

/// Steps of the bar: finer than any terminal shows.
const STEPS: u64 = 1000;

impl Progress {
    /// A bar for a run of `end` seconds of simulated time; `quiet` hides it (`-q`).
    pub fn new(what: &'static str, end: f64, quiet: bool) -> Self {
        let shown = !quiet && std::io::stderr().is_terminal();
        let target = if shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(Some(STEPS), target);
        let template = "{prefix} [{bar:40}] {percent:>3} % {msg}, {eta} left";
        let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
        bar.set_style(style.progress_chars("=> "));
        bar.set_prefix(what);
        Self { bar, end }
    }

    /// `t` seconds of simulated time are done. Cheap enough for every tick.
    pub fn at(&self, t: f64) {
        let done = (t / self.end * STEPS as f64) as u64;
        if done != self.bar.position() {
            self.bar.set_message(format!("t = {t:.1} s"));
            self.bar.set_position(done.min(STEPS));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
