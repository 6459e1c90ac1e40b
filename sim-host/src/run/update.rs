//! An update of a bench: a new program for all its nodes or for none, and in which words this program says so.

use super::bench::lockstep_configs;
use super::commission::{bench_file, list};
use super::error::RunError;
use super::fidelity::needs_no_can;
use super::options::RunOptions;
use crate::bench::{BenchFile, Where, attach};
use crate::hub::{Failed, HubError, Known, Trial, UpdateStage, Updated, Updating};
use crate::loopback::ideal_bus_between;
use crate::program::Program;
use crate::scenario::Scenario;
use std::fmt;

/// What an update came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UpdateOutcome {
    /// What came of each node; empty where all had the program before.
    pub nodes: Vec<Updated>,
    /// How many there are.
    pub count: usize,
    /// Bytes of the program, and their checksum.
    pub program: (u32, u32),
}

impl fmt::Display for UpdateOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (length, crc) = self.program;
        let count = match self.count {
            1 => "1 node runs".to_owned(),
            count => format!("{count} nodes run"),
        };
        if self.nodes.is_empty() {
            return write!(f, "{count} program {crc:08x} ({length} bytes) already; nothing was sent");
        }
        self.nodes.iter().try_for_each(|node| writeln!(f, "{node}"))?;
        write!(f, "{count} program {crc:08x} ({length} bytes)")
    }
}

/// Gives the nodes of `options.bench` that `scenario` has this program, all of them or none. Their trial is a run of
/// the scenario in lockstep, as long as they want it to be.
///
/// # Errors
/// What happened, and which nodes have changed.
pub fn update(
    scenario: &Scenario,
    options: &RunOptions,
    program: &Program,
    tell: &mut dyn FnMut(&UpdateStage),
) -> Result<UpdateOutcome, RunError> {
    let file = bench_file(options)?;
    needs_no_can(scenario)?;
    file.covers(scenario).map_err(RunError::bad_input)?;
    // No bench makes events.
    let scenario = &Scenario { events: Vec::new(), ..scenario.clone() };
    let configs = lockstep_configs(scenario, file)?;
    let ids: Vec<_> = configs.iter().map(|config| config.id).collect();
    takes_updates(file, &ids)?;
    let trial = Trial { configs, bus: ideal_bus_between(scenario, |_, _| true) };
    let image = program.image();
    let outcome = |nodes| UpdateOutcome { nodes, count: ids.len(), program: (image.length, image.crc) };
    let unchanged = |error| told(Failed::Before(error));
    let attached = attach(file, &ids, &options.emulator()).map_err(unchanged)?;
    let patience = (file.patience(), file.swap_within());
    let mut back = Vec::new();
    let mut tell = |stage: &UpdateStage| {
        if let UpdateStage::WentBack(ids) = stage {
            back.clone_from(ids);
        }
        tell(stage);
    };
    let updating = Updating::new(attached, program, patience, &mut tell).map_err(unchanged)?;
    if updating.is_done() {
        return Ok(outcome(Vec::new()));
    }
    updating.update(program, trial).map(outcome).map_err(|failed| match failed {
        // They have answered once.
        Failed::Before(error) => told_after(RunError::in_the_run(error), &Known::default(), &back),
        Failed::After(error, known) => told_after(RunError::in_the_run(error), &known, &back),
    })
}

/// What a bench file names that no image with updates is for, before any node is touched.
fn takes_updates(file: &BenchFile, ids: &[u8]) -> Result<(), RunError> {
    let mut refused = Vec::new();
    for node in ids.iter().filter_map(|&id| file.node(id)) {
        let why = match node.at {
            Where::Emulator => Some("is an emulator of this program, whose image takes none"),
            Where::Host => Some("is a process on this computer, which runs this program"),
            Where::Serial(_) | Where::UsbSerial(_) if node.can.is_some() => {
                Some("is on CAN, and no image for CAN takes one")
            }
            Where::Serial(_) | Where::UsbSerial(_) => None,
        };
        refused.extend(why.map(|why| format!("node {} {why}", node.id)));
    }
    let is_wired = |wire: &crate::bench::Wire| ids.contains(&wire.between.0) && ids.contains(&wire.between.1);
    if let Some(wire) = file.wires.iter().find(|wire| is_wired(wire)) {
        let (one, other) = wire.between;
        refused.push(format!(
            "nodes {one} and {other} are wired to each other, and no image with lines takes one"
        ));
    }
    if refused.is_empty() {
        return Ok(());
    }
    Err(RunError::bad_input(format!(
        "{}: not all nodes can take a program over their lines:\n{}\nnothing was sent",
        file.path.display(),
        refused.join("\n")
    )))
}

/// An error before anything was sent.
fn told(failed: Failed) -> RunError {
    let (Failed::Before(error) | Failed::After(error, _)) = failed;
    let hint = match error {
        HubError::CannotUpdate { .. } => "; docs/book/src/update.md says which images can",
        _ => "",
    };
    RunError::of_nodes(error)
        .and(format_args!("nothing was sent: every node has the program that it had{hint}"))
}

/// An error with what it leaves behind. `back`: those whose earlier trial was ended.
fn told_after(error: RunError, known: &Known, back: &[u8]) -> RunError {
    if known.done.is_empty() && known.unsure.is_empty() {
        return match back {
            [] => error.and("no node has changed: each has the program that it had"),
            back => error.and(format_args!(
                "each has the program that it had, but for those that went back from an earlier trial: {}",
                list(back)
            )),
        };
    }
    let groups = [
        ("have the new program", &known.done),
        ("not known", &known.unsure),
        ("have the program that they had", &known.unchanged),
    ];
    let groups = groups.iter().filter(|(_, nodes)| !nodes.is_empty());
    let groups = groups.map(|(name, nodes)| format!("{name}: {}", list(nodes))).collect::<Vec<_>>();
    let error = error.and(groups.join("; "));
    let error = match back {
        [] => error,
        back => error.and(format_args!("went back from an earlier trial: {}", list(back))),
    };
    let error = match known.unsure.as_slice() {
        [] => error,
        unsure => error.and(format_args!(
            "switch off and on: {}; a program that has not completed its trial goes back then, and the same command tells which one it is",
            list(unsure)
        )),
    };
    match known.done.as_slice() {
        [] => error,
        _ => error.and("the same command again sends it to those that do not have it"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(known: Known) -> String {
        let error = RunError::in_the_run(HubError::OldProgram { node: 2 });
        told_after(error, &known, &[]).message.split_once('\n').unwrap().1.to_owned()
    }

    #[test]
    fn every_node_is_named_with_what_is_known_of_it_and_what_to_do() {
        let unchanged = Known { unchanged: vec![1, 2, 3], ..Known::default() };
        assert_eq!(lines(unchanged), "no node has changed: each has the program that it had");
        let unsure = Known { unsure: vec![2], unchanged: vec![1, 3], ..Known::default() };
        let words = lines(unsure);
        assert!(
            words.starts_with("not known: 2; have the program that they had: 1, 3\nswitch off and on: 2; "),
            "{words}"
        );
        let words = lines(Known { done: vec![1], unsure: vec![2], unchanged: vec![3] });
        assert!(
            words.starts_with("have the new program: 1; not known: 2; have the program that they had: 3\n"),
            "{words}"
        );
        assert!(words.ends_with("\nthe same command again sends it to those that do not have it"), "{words}");
        // One was lost as an earlier trial ended, and another one has gone back from it.
        let known = Known { unsure: vec![2], unchanged: vec![1, 3], ..Known::default() };
        let error = told_after(RunError::in_the_run(HubError::OldProgram { node: 2 }), &known, &[1]).message;
        assert!(
            error.contains("not known: 2; have the program that they had: 1, 3\nwent back from an earlier trial: 1\nswitch off and on: 2"),
            "{error}"
        );
    }

    #[test]
    fn nodes_that_no_image_with_updates_is_for_are_all_named() {
        let text = "version = 1\ncan = \"can0\"\n[[node]]\nid = 1\nserial = \"/dev/a\"\n[[node]]\nid = 2\nemulator = true\n[[node]]\nid = 3\nhost = true\n\
                    [[node]]\nid = 4\nserial = \"/dev/b\"\ncan = true\n[[node]]\nid = 5\nserial = \"/dev/c\"\n[[wire]]\nbetween = [1, 5]\n";
        let file = BenchFile::parse(text, std::path::Path::new("bench.toml")).unwrap();
        let words = takes_updates(&file, &[1, 2, 3, 4, 5]).unwrap_err().message;
        for word in [
            "node 2 is an emulator",
            "node 3 is a process",
            "node 4 is on CAN",
            "nodes 1 and 5 are wired",
            "nothing was sent",
        ] {
            assert!(words.contains(word), "no '{word}' in: {words}");
        }
        assert_eq!(takes_updates(&file, &[1]), Ok(()));
    }
}
