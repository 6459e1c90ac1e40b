//! How far an update is: a bar on a terminal, a line for each of its parts elsewhere, and nothing where nobody wants to know.

use super::commission::list;
use crate::hub::UpdateStage;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::time::Duration;

/// Lines of a transfer where there is no terminal.
const LINES: u32 = 4;

/// Tells on standard error how far an update has come.
#[derive(Debug)]
pub struct UpdateProgress {
    way: Way,
}

#[derive(Debug)]
enum Way {
    Bar(ProgressBar),
    /// Parts of the transfer that were told.
    Lines(u32),
    Quiet,
}

impl UpdateProgress {
    /// For a terminal or a log, as standard error is; `quiet` says nothing.
    pub fn new(quiet: bool) -> Self {
        let way = match (quiet, std::io::stderr().is_terminal()) {
            (true, _) => Way::Quiet,
            (false, true) => Way::Bar(bar()),
            (false, false) => Way::Lines(0),
        };
        Self { way }
    }

    /// Takes note of how far it is.
    pub fn at(&mut self, stage: &UpdateStage) {
        match &mut self.way {
            Way::Bar(bar) => show(bar, stage),
            Way::Lines(told) => {
                if let Some(line) = line(stage, told) {
                    // Nobody is left to tell where standard error is closed.
                    let _ = writeln!(std::io::stderr(), "update: {line}");
                }
            }
            Way::Quiet => {}
        }
    }
}

impl Drop for UpdateProgress {
    fn drop(&mut self) {
        if let Way::Bar(bar) = &self.way {
            bar.finish_and_clear();
        }
    }
}

fn bar() -> ProgressBar {
    let bar = ProgressBar::new(1);
    let style = ProgressStyle::with_template("update [{bar:30}] {elapsed} {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("=> "));
    bar.enable_steady_tick(Duration::from_secs(1));
    bar
}

fn show(bar: &ProgressBar, stage: &UpdateStage) {
    let (done, all) = match stage {
        UpdateStage::Sent { done, all, .. } => (*done, *all),
        UpdateStage::Trial { left, all } => (all.saturating_sub(*left), *all),
        _ => (0, 1),
    };
    bar.set_length(all.into());
    bar.set_position(done.into());
    bar.set_message(words(stage));
}

/// What is said of it in a log, if anything.
fn line(stage: &UpdateStage, told: &mut u32) -> Option<String> {
    match stage {
        UpdateStage::Sent { done, all, .. } => {
            let part = (u64::from(*done) * u64::from(LINES) / u64::from(*all).max(1)) as u32;
            let is_due = *done == 0 || part > *told;
            *told = part;
            is_due.then(|| words(stage))
        }
        UpdateStage::Trial { left, all } if left < all => None,
        _ => Some(words(stage)),
    }
}

fn words(stage: &UpdateStage) -> String {
    match stage {
        UpdateStage::WentBack(nodes) => format!("on trial from another update, and taken back: {}", list(nodes)),
        UpdateStage::Sent { nodes, done: 0, all } => format!("sending {all} bytes to nodes: {}", list(nodes)),
        UpdateStage::Sent { done, all, .. } => {
            format!("sent: {} %", u64::from(*done) * 100 / u64::from(*all).max(1))
        }
        UpdateStage::Checked => "checked: all have read it back".to_owned(),
        UpdateStage::Swapping => "swapping: some seconds, during which no node answers".to_owned(),
        UpdateStage::OnTrial(nodes) => format!("on trial: {}", list(nodes)),
        UpdateStage::Trial { left, .. } => format!("ticks of the trial: {left} left"),
        UpdateStage::Confirmed => "the trial is completed: all stay, and are restarted".to_owned(),
        UpdateStage::GoingBack => {
            "going back: those on trial are restarted (stop this, and they go back when they are switched off and on)".to_owned()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_has_a_line_for_each_part_and_few_of_the_transfer() {
        let mut told = 0;
        let sent = |done| UpdateStage::Sent { nodes: vec![1, 2], done, all: 1_000 };
        let lines: Vec<_> = (0..=1_000).step_by(10).filter_map(|done| line(&sent(done), &mut told)).collect();
        assert_eq!(
            lines,
            ["sending 1000 bytes to nodes: 1, 2", "sent: 25 %", "sent: 50 %", "sent: 75 %", "sent: 100 %"]
        );
        let ticks =
            (0..100).filter_map(|left| line(&UpdateStage::Trial { left, all: 100 }, &mut told)).count();
        assert_eq!(ticks, 0);
        assert_eq!(line(&UpdateStage::OnTrial(vec![1, 2]), &mut told).unwrap(), "on trial: 1, 2");
    }
}
