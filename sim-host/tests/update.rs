//! An update of a bench: all nodes or none, whatever goes wrong with one of them, and whenever the user stops it.
//! The nodes are played, with the updater, the boot loader and the app of every board.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

mod boards;
mod updates;

use boards::{Bench, Ended, SCENARIO, end, entry, terminal};
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::update::UpdateError;
use sim_host::configure::{Drive, node_configs};
use sim_host::hub::{Failed, HubError, Patience, Trial, UpdateStage, Updated, Updating};
use sim_host::interrupt::Interrupt;
use sim_host::loopback::ideal_bus_between;
use sim_host::program::Program;
use sim_host::scenario::{Scenario, Source};
use std::io::Read;
use std::path::Path;
use std::process::Command;
use std::time::Duration;
use updates::{Flaw, Made, Moment, Runs, TICKS, Updatable, another, new};

const PATIENCE: Patience = Patience { boot: Duration::from_secs(5), answer: Duration::from_millis(1_500) };
const SWAP: Duration = Duration::from_secs(3);

/// Of all nodes, in their order.
struct Outcome {
    nodes: Vec<Updatable>,
    /// What came of it.
    ended: Result<Vec<Updated>, Failed>,
    stages: Vec<UpdateStage>,
}

impl Outcome {
    fn runs(&self) -> Vec<Runs> {
        self.nodes.iter().map(Updatable::runs_after_power_off).collect()
    }

    /// All have the new program, and keep it.
    fn all_new(&self) -> &[Updated] {
        assert_eq!(self.runs(), [Runs::New; 3], "{:?}", self.ended);
        self.ended.as_ref().unwrap()
    }

    /// None has it, and this is what the user is told: the error, and the ids of those of which nothing is known.
    fn all_old(&self) -> (&HubError, Vec<u8>) {
        assert_eq!(self.runs(), [Runs::Old; 3], "{:?}", self.ended);
        match self.ended.as_ref().unwrap_err() {
            Failed::Before(error) => (error, Vec::new()),
            Failed::After(error, known) => {
                assert_eq!(known.done, [0; 0], "{error}");
                assert_eq!(known.unchanged.len() + known.unsure.len(), 3, "{known:?}");
                (error, known.unsure.clone())
            }
        }
    }
}

fn scenario() -> Scenario {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scenario.toml");
    std::fs::write(&path, SCENARIO).unwrap();
    let source = Source::read(&path).unwrap();
    source.scenario(&[]).unwrap()
}

fn trial() -> Trial {
    let scenario = scenario();
    let drive = Drive { tick_source: TickSource::Sync, telemetry_every: 1, is_simulated: false };
    Trial { configs: node_configs(&scenario, drive).unwrap(), bus: ideal_bus_between(&scenario, |_, _| true) }
}

/// Updates these nodes, which get the ids from 1, to the new program.
fn update(made: [Made; 3]) -> Outcome {
    let mut stages = Vec::new();
    let (nodes, attached): (Vec<_>, Vec<_>) =
        made.into_iter().zip(1..).map(|(made, id)| made.attach(id)).unzip();
    let program = Program::of(&new()).unwrap();
    let mut tell = |stage: &UpdateStage| stages.push(stage.clone());
    let met = Updating::new(attached, &program, (PATIENCE, SWAP), &mut tell).map_err(Failed::Before);
    let ended = met.and_then(|updating| updating.update(&program, trial()));
    Outcome { nodes, ended, stages }
}

/// Three, of which the second has this flaw.
fn second(flaw: Flaw) -> Outcome {
    update([Flaw::Nothing, flaw, Flaw::Nothing].map(Made::new))
}

/// Whether an error is the one that was to come.
type Seen = fn(&HubError) -> bool;

fn is_of_2(error: &HubError) -> bool {
    error.to_string().contains("node 2")
}

#[test]
fn all_nodes_get_the_program_complete_their_trial_and_are_restarted() {
    let outcome = second(Flaw::Nothing);
    let updated = outcome.all_new();
    // The swap, and the restart at the end.
    assert!(outcome.nodes.iter().all(|node| node.starts() == 3));
    assert!(updated.iter().all(|node| (node.before.firmware, node.after.firmware) == ([0, 1, 0], [0, 3, 0])));
    assert!(updated.iter().all(|node| !node.had_it && node.repeated == 0), "{updated:?}");
    let is_told = |stage: &UpdateStage| outcome.stages.contains(stage);
    assert!(is_told(&UpdateStage::Sent { nodes: vec![1, 2, 3], done: 3_000, all: 3_000 }));
    assert!(
        is_told(&UpdateStage::OnTrial(vec![1, 2, 3])) && is_told(&UpdateStage::Trial { left: 0, all: TICKS })
    );
    assert_eq!(outcome.stages.last(), Some(&UpdateStage::Confirmed));
}

#[test]
fn a_line_that_loses_or_spoils_blocks_is_gone_through() {
    for flaw in [Flaw::Loses, Flaw::Spoils, Flaw::Late] {
        let outcome = second(flaw);
        let updated = outcome.all_new();
        assert!(updated[1].repeated > 2 && updated[0].repeated == 0, "{flaw:?}: {updated:?}");
    }
}

#[test]
fn a_swap_that_is_not_heard_is_said_again_and_one_whose_answer_is_lost_is_not() {
    for flaw in [Flaw::DeafToSwap, Flaw::SwapUnheard] {
        let outcome = second(flaw);
        match flaw {
            Flaw::DeafToSwap => assert_eq!(outcome.all_new().len(), 3),
            // Nor is the answer to the restart at the end ever heard, which is told; all have the program.
            _ => {
                let Err(Failed::After(error, known)) = &outcome.ended else { panic!("{:?}", outcome.ended) };
                assert!(matches!(error, HubError::NoAnswer { node: 2, awaited: "restart", .. }), "{error}");
                assert_eq!((known.done.as_slice(), known.unsure.len()), (&[1, 2, 3][..], 0), "{known:?}");
                assert_eq!(outcome.runs(), [Runs::New; 3]);
                // The swap, the restart at the end, and the one after the failure, which the third gets alone.
                assert_eq!((outcome.nodes[0].starts(), outcome.nodes[2].starts()), (4, 3));
                // It heard of each of these restarts more than once.
                assert!(outcome.nodes[1].starts() > 4);
            }
        }
    }
}

#[test]
fn a_report_that_is_lost_after_the_trial_is_no_failure() {
    let outcome = second(Flaw::ReportUnheard);
    assert_eq!(outcome.all_new().len(), 3);
    assert!(outcome.nodes.iter().all(|node| node.starts() == 3));
}

#[test]
fn a_node_that_never_answers_is_named_and_nothing_is_sent() {
    let outcome = second(Flaw::SilentFrom(Moment::Met));
    assert!(matches!(outcome.all_old().0, HubError::NoAnswer { node: 2, awaited: "identity", .. }));
    assert!(outcome.nodes.iter().all(Updatable::is_untouched) && outcome.stages.is_empty());
}

#[test]
fn all_nodes_that_cannot_take_it_are_named_and_nothing_is_sent() {
    let outcome = update([Flaw::WithoutFeature, Flaw::AnotherBoard, Flaw::WithoutBootLoader].map(Made::new));
    let words = outcome.ended.as_ref().unwrap_err();
    let Failed::Before(error) = words else { panic!("{words:?}") };
    let words = error.to_string();
    for word in [
        "node 1: its image takes no updates: it was built without the feature `update`",
        "node 2: it is another board, 00000007, than the program is for",
        "node 3: it has no boot loader that could swap programs",
    ] {
        assert!(words.contains(word), "no '{word}' in: {words}");
    }
    assert!(outcome.nodes.iter().all(Updatable::is_untouched) && outcome.stages.is_empty());
}

#[test]
fn whatever_fails_before_the_swap_leaves_every_node_as_it_was() {
    let cases: [(Flaw, Seen); 5] = [
        (Flaw::SilentFrom(Moment::Begin), |error| {
            matches!(error, HubError::NoAnswer { awaited: "announcement", .. })
        }),
        (Flaw::SilentFrom(Moment::Block(5)), |error| {
            matches!(error, HubError::NoAnswer { awaited: "block", .. })
        }),
        (Flaw::CutAt(Moment::Block(7)), |error| matches!(error, HubError::Died { .. })),
        (Flaw::ResetAt(6), |error| matches!(error, HubError::NotTaken { reason: UpdateError::NotBegun, .. })),
        (Flaw::WeakCell, |error| {
            matches!(error, HubError::NotTaken { reason: UpdateError::Checksum { .. }, .. })
        }),
    ];
    for (flaw, expected) in cases {
        let outcome = second(flaw);
        let (error, unsure) = outcome.all_old();
        assert!(expected(error) && is_of_2(error), "{flaw:?}: {error}");
        assert!(unsure.is_empty() && matches!(outcome.ended, Err(Failed::Before(_))), "{flaw:?}");
        assert_eq!((outcome.nodes[0].starts(), outcome.nodes[2].starts()), (1, 1), "{flaw:?}");
    }
}

#[test]
fn whatever_fails_between_swap_and_last_tick_takes_all_of_them_back() {
    let cases: [(Flaw, &[u8], Seen); 8] = [
        (Flaw::NeverComesUp, &[], |error| matches!(error, HubError::OldProgram { .. })),
        (Flaw::SilentFrom(Moment::OnTrial), &[2], |error| matches!(error, HubError::NoAnswer { .. })),
        (Flaw::CutAt(Moment::Swap), &[2], |error| {
            matches!(error, HubError::Died { .. } | HubError::NoAnswer { .. })
        }),
        (Flaw::HangsAt(Moment::Tick(1)), &[], |error| {
            matches!(error, HubError::NoAnswer { awaited: "state", .. })
        }),
        (Flaw::HangsAt(Moment::Tick(50)), &[], |error| {
            matches!(error, HubError::NoAnswer { awaited: "state", .. })
        }),
        (Flaw::SilentFrom(Moment::Tick(98)), &[2], |error| {
            matches!(error, HubError::NoAnswer { awaited: "state", .. })
        }),
        // Seen before the others can confirm theirs.
        (Flaw::CountsNoTicks, &[], |error| matches!(error, HubError::NotConfirmed { left: TICKS, .. })),
        (Flaw::CutAt(Moment::Tick(40)), &[2], |error| matches!(error, HubError::Died { .. })),
    ];
    for (flaw, expected_unsure, expected) in cases {
        let outcome = second(flaw);
        let (error, unsure) = outcome.all_old();
        assert!(expected(error) && is_of_2(error), "{flaw:?}: {error}");
        assert_eq!(unsure, expected_unsure, "{flaw:?}");
        assert_eq!(outcome.stages.last(), Some(&UpdateStage::GoingBack), "{flaw:?}");
        // There, back, and nothing else; the third one is not told any more where the second has failed before.
        let third = if flaw == Flaw::CutAt(Moment::Swap) { 1 } else { 3 };
        assert_eq!((outcome.nodes[0].starts(), outcome.nodes[2].starts()), (3, third), "{flaw:?}");
    }
}

#[test]
fn a_node_that_hangs_in_the_last_tick_may_be_alone_with_its_program_and_that_is_told() {
    let outcome = second(Flaw::HangsAt(Moment::Tick(TICKS)));
    let Failed::After(error, known) = outcome.ended.as_ref().unwrap_err() else { panic!("it went well") };
    assert!(is_of_2(error), "{error}");
    let told: Vec<_> = outcome
        .runs()
        .iter()
        .zip(1..)
        .map(
            |(runs, id)| {
                if *runs == Runs::New { known.done.contains(&id) } else { known.unchanged.contains(&id) }
            },
        )
        .collect();
    assert_eq!(told, [true; 3], "{:?}: {known:?}", outcome.runs());
    assert_eq!(outcome.runs()[1], Runs::Old);
}

#[test]
fn ctrl_c_before_the_swap_leaves_every_node_as_it_was() {
    let moments =
        [Moment::Met, Moment::Begin, Moment::Block(0), Moment::Block(8), Moment::Block(11), Moment::Check];
    for moment in moments {
        let interrupt = Interrupt::default();
        let made = [Flaw::Nothing, Flaw::Nothing, Flaw::InterruptAt(moment)];
        let outcome = update(made.map(|flaw| Made::new(flaw).interrupting(&interrupt)));
        let (error, _) = outcome.all_old();
        assert!(matches!(error, HubError::Interrupted), "{moment:?}: {error}");
        assert!(matches!(outcome.ended, Err(Failed::Before(_))), "{moment:?}");
        assert!(outcome.nodes.iter().all(|node| node.starts() == 1), "{moment:?}");
    }
}

#[test]
fn ctrl_c_between_swap_and_last_tick_takes_all_of_them_back() {
    let moments = [Moment::Swap, Moment::OnTrial, Moment::Tick(1), Moment::Tick(70), Moment::Tick(TICKS - 3)];
    for (moment, which) in moments.into_iter().flat_map(|moment| [(moment, 0), (moment, 2)]) {
        let interrupt = Interrupt::default();
        let flaw = |id| if id == which { Flaw::InterruptAt(moment) } else { Flaw::Nothing };
        let outcome = update([0, 1, 2].map(|id| Made::new(flaw(id)).interrupting(&interrupt)));
        let (error, unsure) = outcome.all_old();
        assert!(matches!(error, HubError::Interrupted), "{moment:?}: {error}");
        assert!(unsure.is_empty(), "{moment:?}: {unsure:?}");
    }
}

#[test]
fn ctrl_c_in_the_last_ticks_is_not_heard_any_more() {
    let interrupt = Interrupt::default();
    let made = [Flaw::Nothing, Flaw::Nothing, Flaw::InterruptAt(Moment::Tick(TICKS))];
    let outcome = update(made.map(|flaw| Made::new(flaw).interrupting(&interrupt)));
    assert_eq!(outcome.all_new().len(), 3);
    assert!(interrupt.is_set());
}

#[test]
fn who_has_it_already_is_sent_nothing_and_loses_the_configuration_of_the_trial() {
    let outcome = update([Made::updated(), Made::new(Flaw::Nothing), Made::updated()]);
    let updated = outcome.all_new();
    assert_eq!(updated.iter().map(|node| node.had_it).collect::<Vec<_>>(), [true, false, true]);
    assert_eq!(outcome.nodes.iter().map(Updatable::starts).collect::<Vec<_>>(), [2, 3, 2]);
    let outcome = update([Made::updated(), Made::new(Flaw::HangsAt(Moment::Tick(50))), Made::updated()]);
    assert_eq!(outcome.runs(), [Runs::New, Runs::Old, Runs::New]);
    let Err(Failed::After(_, known)) = &outcome.ended else { panic!("{:?}", outcome.ended) };
    assert_eq!(known.unchanged, [1, 2, 3]);
    assert_eq!((outcome.nodes[0].starts(), outcome.nodes[2].starts()), (2, 2));
    // No trial, nothing to lose.
    let outcome = update([Made::updated(), Made::new(Flaw::NeverComesUp), Made::updated()]);
    assert_eq!(outcome.runs(), [Runs::New, Runs::Old, Runs::New]);
    let Err(Failed::After(error, known)) = &outcome.ended else { panic!("{:?}", outcome.ended) };
    assert!(matches!(error, HubError::OldProgram { node: 2 }), "{error}");
    // As they were.
    assert_eq!(known.unchanged, [1, 2, 3]);
    assert_eq!((outcome.nodes[0].starts(), outcome.nodes[2].starts()), (1, 1));
}

#[test]
fn an_update_that_was_broken_off_on_trial_is_gone_on_with_where_all_are_as_far() {
    let on_trial = |ticked| Made::on_trial(&new(), Flaw::Nothing).ticked(ticked);
    let outcome = update([on_trial(40), on_trial(41), Made::updated()]);
    assert_eq!(outcome.all_new().len(), 3);
    // Nothing is sent: they have it.
    assert_eq!(outcome.stages.first(), Some(&UpdateStage::OnTrial(vec![1, 2])));
    assert!(outcome.stages.contains(&UpdateStage::Trial { left: 0, all: TICKS - 40 }));
    // The first would stay, and the second may still fail.
    let uneven = [on_trial(60), Made::on_trial(&new(), Flaw::HangsAt(Moment::Tick(45))), Made::updated()];
    let outcome = update(uneven);
    assert_eq!(outcome.stages.first(), Some(&UpdateStage::WentBack(vec![1, 2])));
    assert!(
        matches!(outcome.ended, Err(Failed::After(HubError::NoAnswer { node: 2, .. }, _))),
        "{:?}",
        outcome.ended
    );
    assert_eq!(outcome.runs(), [Runs::Old, Runs::Old, Runs::New]);
    // Nor is one of them alone.
    let outcome = update([on_trial(60), Made::new(Flaw::NeverComesUp), on_trial(60)]);
    assert_eq!(outcome.stages.first(), Some(&UpdateStage::WentBack(vec![1, 3])));
    assert!(matches!(outcome.all_old().0, HubError::OldProgram { node: 2 }));
}

#[test]
fn another_program_that_is_on_trial_goes_back_first() {
    let outcome =
        update([Made::new(Flaw::Nothing), Made::on_trial(&another(), Flaw::Nothing), Made::updated()]);
    assert_eq!(outcome.all_new().len(), 3);
    assert_eq!(outcome.stages.first(), Some(&UpdateStage::WentBack(vec![2])));
    let first = Flaw::SilentFrom(Moment::Begin);
    let outcome =
        update([Made::new(first), Made::on_trial(&another(), Flaw::Nothing), Made::new(Flaw::Nothing)]);
    assert!(matches!(outcome.all_old().0, HubError::NoAnswer { node: 1, .. }));
}

/// Nobody knows whether it is back with the program that it had.
#[test]
fn a_node_that_is_lost_as_its_earlier_trial_ends_is_not_counted_as_unchanged() {
    for flaw in [Flaw::CutAt(Moment::Restart), Flaw::SilentFrom(Moment::Restart)] {
        let first = Made::on_trial(&another(), Flaw::Nothing);
        let outcome = update([first, Made::on_trial(&another(), flaw), Made::new(Flaw::Nothing)]);
        let Err(Failed::After(error, known)) = &outcome.ended else {
            panic!("{flaw:?}: {:?}", outcome.ended)
        };
        assert!(is_of_2(error), "{flaw:?}: {error}");
        assert_eq!(
            (known.unsure.as_slice(), known.unchanged.as_slice()),
            (&[2][..], &[1, 3][..]),
            "{flaw:?}"
        );
        assert_eq!(outcome.stages, [UpdateStage::WentBack(vec![1])]);
    }
}

#[test]
fn another_program_that_is_on_trial_over_this_one_goes_back_and_that_is_all() {
    let outcome = update([(); 3].map(|()| Made::updated().trying(&another())));
    assert!(outcome.all_new().iter().all(|node| node.had_it));
    assert_eq!(outcome.stages, [UpdateStage::WentBack(vec![1, 2, 3])]);
    assert_eq!(outcome.nodes.iter().map(Updatable::starts).collect::<Vec<_>>(), [2; 3]);
    let outcome =
        update([Made::updated().trying(&another()), Made::new(Flaw::Nothing), Made::new(Flaw::Nothing)]);
    assert_eq!(outcome.all_new().iter().map(|node| node.had_it).collect::<Vec<_>>(), [true, false, false]);
}

#[test]
fn a_node_that_is_reset_on_trial_and_goes_back_does_not_pass_for_updated() {
    // Before the first tick, and before the last ones.
    for asked in [1, 2] {
        let outcome = second(Flaw::ResetWhenAsked(asked));
        let (error, unsure) = outcome.all_old();
        assert!(matches!(error, HubError::OldProgram { node: 2 }) && unsure.is_empty(), "{asked}: {error}");
    }
    // Among them the others may stay.
    let outcome = second(Flaw::ResetWhenAsked(3));
    let Err(Failed::After(error, known)) = &outcome.ended else { panic!("{:?}", outcome.ended) };
    assert!(is_of_2(error) && known.unchanged.contains(&2), "{error}: {known:?}");
    assert_eq!(outcome.runs()[1], Runs::Old);
}

// --- the command

/// Played nodes behind terminals, and a bench of them with the new program in a file.
fn bench(made: [Made; 3]) -> (Vec<Updatable>, Bench) {
    let (mut nodes, mut entries) = (Vec::new(), Vec::new());
    for (made, uid) in made.into_iter().zip(1..) {
        let (port, path) = terminal();
        entries.push(entry(&path));
        nodes.push(made.at(port, uid));
    }
    let bench = Bench::new(SCENARIO, &entries);
    std::fs::write(bench.path("new.bin"), new()).unwrap();
    (nodes, bench)
}

fn command(bench: &Bench, image: &Path, arguments: &[&str]) -> Ended {
    end(bench.spawn_update(image, arguments))
}

#[test]
fn the_command_updates_all_nodes_and_then_has_nothing_to_do() {
    let (nodes, bench) = bench([Flaw::Nothing, Flaw::Loses, Flaw::Nothing].map(Made::new));
    let ended = command(&bench, &bench.path("new.bin"), &[]);
    assert_eq!(ended.code, Some(0), "{}", ended.err);
    let lines: Vec<_> = ended.out.lines().collect();
    assert_eq!(lines.len(), 4, "{}", ended.out);
    assert!(lines[0].starts_with("node 1: the serial port /dev/pts/"), "{}", lines[0]);
    assert!(lines[0].ends_with("has the new program, firmware 0.3.0 (before: 0.1.0)"), "{}", lines[0]);
    assert!(lines[1].contains("; blocks that were sent again: "), "{}", lines[1]);
    assert!(
        lines[3].starts_with("3 nodes run program ") && lines[3].ends_with(" (3000 bytes)"),
        "{}",
        lines[3]
    );
    for word in
        ["update: sending 3000 bytes to nodes: 1, 2, 3", "sent: 100 %", "on trial: 1, 2, 3", "all stay"]
    {
        assert!(ended.err.contains(word), "no '{word}' in: {}", ended.err);
    }
    assert!(nodes.iter().all(|node| node.runs_after_power_off() == Runs::New));
    let starts = || nodes.iter().map(Updatable::starts).collect::<Vec<_>>();
    let before = starts();
    let again = command(&bench, &bench.path("new.bin"), &[]);
    assert_eq!((again.code, again.err.as_str()), (Some(0), ""));
    assert!(again.out.trim_end().ends_with("(3000 bytes) already; nothing was sent"), "{}", again.out);
    let quiet = command(&bench, &bench.path("new.bin"), &["--quiet"]);
    assert_eq!((quiet.code, quiet.out.as_str(), quiet.err.as_str()), (Some(0), "", ""));
    assert_eq!((starts(), before[0], before[2]), (before, 3, 3));
}

#[test]
fn on_a_terminal_there_is_a_bar_in_place_of_lines() {
    let (_nodes, bench) = bench([Flaw::Nothing, Flaw::Slow, Flaw::Nothing].map(Made::new));
    let (mut screen, path) = terminal();
    let mut child = bench.spawn_update_on(&path, &bench.path("new.bin"));
    let mut shown = Vec::new();
    boards::wait("the end", || {
        let mut bytes = [0; 4096];
        let length = screen.read(&mut bytes).unwrap_or(0);
        shown.extend_from_slice(&bytes[..length]);
        child.try_wait().unwrap().is_some()
    });
    assert_eq!(child.wait().unwrap().code(), Some(0));
    let shown = String::from_utf8_lossy(&shown);
    for word in ["update [", "sent: ", "ticks of the trial: "] {
        assert!(shown.contains(word), "no '{word}' in: {shown}");
    }
    assert!(!shown.contains("update: "), "{shown}");
}

#[test]
fn the_command_says_which_node_failed_and_that_the_others_went_back() {
    let (nodes, bench) = bench([Flaw::Nothing, Flaw::Nothing, Flaw::NeverComesUp].map(Made::new));
    let ended = command(&bench, &bench.path("new.bin"), &["--quiet"]);
    assert!(!ended.err.contains("update:"), "{}", ended.err);
    ended.failed(
        1,
        &[
            "node 3 came back with the program that it had: the new one did not come up there",
            "no node has changed: each has the program that it had",
        ],
    );
    assert!(nodes.iter().all(|node| node.runs_after_power_off() == Runs::Old));
}

#[test]
fn the_command_names_nodes_that_went_back_from_an_earlier_trial() {
    let on_trial = || Made::on_trial(&another(), Flaw::Nothing);
    let (_nodes, bench) = bench([on_trial(), on_trial(), Made::new(Flaw::WeakCell)]);
    let ended = command(&bench, &bench.path("new.bin"), &[]);
    assert!(!ended.err.contains("no node has changed"), "{}", ended.err);
    ended.failed(
        1,
        &["each has the program that it had, but for those that went back from an earlier trial: 1, 2"],
    );
}

#[test]
fn the_command_does_not_count_a_node_as_unchanged_that_dies_as_its_earlier_trial_ends() {
    let dies = Made::on_trial(&another(), Flaw::CutAt(Moment::Restart));
    let (_nodes, bench) = bench([Made::on_trial(&another(), Flaw::Nothing), dies, Made::new(Flaw::Nothing)]);
    let ended = command(&bench, &bench.path("new.bin"), &[]);
    ended.failed(
        1,
        &[
            "not known: 2; have the program that they had: 1, 3",
            "went back from an earlier trial: 1",
            "switch off and on: 2",
        ],
    );
}

#[test]
fn the_command_says_where_a_scenario_runs_that_is_not_for_nodes() {
    let bench = Bench::new(SCENARIO, &["/dev/a", "/dev/b", "/dev/c"].map(entry));
    std::fs::write(bench.path("new.bin"), new()).unwrap();
    for setting in ["bus.model=can", "bus.model=uart", "coupling.kind=weakly-centralised"] {
        let ended = command(&bench, &bench.path("new.bin"), &["--set", setting]);
        ended.failed(2, &["run it with sim-host run --on loopback"]);
    }
}

#[test]
fn the_command_names_nodes_that_cannot_take_it_before_anything_is_sent() {
    let (nodes, bench) = bench([Flaw::WithoutFeature, Flaw::Nothing, Flaw::WithoutFeature].map(Made::new));
    let ended = command(&bench, &bench.path("new.bin"), &[]);
    ended.failed(
        3,
        &[
            "node 1: its image takes no updates",
            "node 3: its image",
            "nothing was sent: every node has the program",
        ],
    );
    assert!(nodes.iter().all(Updatable::is_untouched));
}

#[test]
fn a_file_that_is_no_program_is_refused_before_any_node_is_touched() {
    // Nobody is there: it is not even looked.
    let bench = Bench::new(SCENARIO, &["/dev/a", "/dev/b", "/dev/c"].map(entry));
    let other = |name: &str, bytes: &[u8]| {
        std::fs::write(bench.path(name), bytes).unwrap();
        bench.path(name)
    };
    let cases = [
        (other("text", b"a letter to a friend"), "is no program of a Raspberry Pi Pico: its first word"),
        (other("empty", b""), "has 0 bytes"),
        (other("uf2", b"UF2\nWQ]\x9e"), "is a UF2 file; give the ELF file"),
        (other("long", &updates::program((256 << 10) + 1, 3)), "has 262145 bytes"),
        (Path::new(env!("CARGO_BIN_EXE_sim-host")).to_owned(), "is an ELF file, but not for an ARM"),
        (bench.path("missing"), "cannot read "),
    ];
    for (image, words) in cases {
        command(&bench, &image, &[]).failed(2, &["--update ", words]);
    }
    let image = other("new.bin", &new());
    command(&bench, &image, &[])
        .failed(3, &["/dev/a does not exist", "nothing was sent: every node has the program that it had"]);
}

#[test]
fn a_signal_to_the_command_takes_all_nodes_back() {
    // Of its steps 12 are blocks.
    for (step, starts, words) in [
        (5, 1, ["interrupted", "no node has changed: each has the program that it had"]),
        (12 + 30, 3, ["update: going back", "no node has changed: each has the program that it had"]),
    ] {
        let (nodes, bench) = bench([Flaw::Nothing, Flaw::Slow, Flaw::Nothing].map(Made::new));
        let child = bench.spawn_update(&bench.path("new.bin"), &[]);
        boards::wait("far enough", || nodes[1].steps() >= step);
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        end(child).failed(130, &words);
        assert_eq!(nodes.iter().map(Updatable::starts).collect::<Vec<_>>(), [starts; 3]);
        assert!(nodes.iter().all(|node| node.runs_after_power_off() == Runs::Old));
    }
}
