//! The names of the files that this program leaves in a folder.

use crate::record::RECORDING;
use std::fs;
use std::path::{Path, PathBuf};

/// The scenario as it was run.
pub const SCENARIO: &str = "scenario.toml";
/// The summary.
pub const SUMMARY: &str = "summary.json";
/// The rows of a run.
pub const TRAJECTORY: &str = "trajectory.csv";
/// Quantiles of a run without a bus, as rows and as a picture.
pub const QUANTILES: &str = "quantiles.csv";
pub const QUANTILES_PICTURE: &str = "quantiles.svg";
/// The page that `report` makes of the others.
pub const REPORT: &str = "report.html";
/// Held locked while a run writes into the folder.
pub const LOCK: &str = ".sim-host.lock";

/// What the runs of a sweep have in common. A folder with it is cleared by no run.
pub const SWEEP: &str = "sweep.json";

/// Files of every command but `sweep`.
const FILES: [&str; 17] = [
    SUMMARY,
    TRAJECTORY,
    QUANTILES,
    QUANTILES_PICTURE,
    "events.txt",
    "states.svg",
    "funnels.svg",
    "agreement.svg",
    "inputs.svg",
    SCENARIO,
    "scenario-graph.csv",
    "bench.csv",
    "can.log",
    "can.pcapng",
    RECORDING,
    REPORT,
    LOCK,
];

/// Whether a file of this name in a folder of outputs is of this program.
pub fn is_ours(name: &str) -> bool {
    FILES.contains(&name) || is_numbered(name)
}

/// `node-N.log`, `scenario-input-N.csv`
fn is_numbered(name: &str) -> bool {
    let number = match name.strip_prefix("node-") {
        Some(rest) => rest.strip_suffix(".log"),
        None => name.strip_prefix("scenario-input-").and_then(|rest| rest.strip_suffix(".csv")),
    };
    number.is_some_and(|number| {
        !number.is_empty() && number.len() <= 3 && number.bytes().all(|byte| byte.is_ascii_digit())
    })
}

/// Every file that a run may write in `folder`, and every one that an earlier run has left there.
pub fn in_folder(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut numbered: Vec<_> = names.filter(|name| is_numbered(name)).collect();
    numbered.sort();
    FILES.into_iter().map(str::to_owned).chain(numbered).map(|name| folder.join(name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_others_are_not_ours() {
        for name in ["summary.json", "node-1.log", "node-127.log", "bench.csv", "scenario-input-12.csv"] {
            assert!(is_ours(name), "{name}");
        }
        for name in [
            "summary.json.bak",
            "Summary.json",
            "node-.log",
            "node-x.log",
            "node-1.log.gz",
            "input-1.csv",
            "scenario-input-1.log",
            "thesis.tex",
        ] {
            assert!(!is_ours(name), "{name}");
        }
    }
}
