//! `check` against the run on random designs: a small version of
//! `cargo run --release -p sim-host --example designs`.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

#[path = "../examples/designs.rs"]
#[allow(dead_code)]
mod designs;

use designs::{Cured, tried};

const DESIGNS: u64 = 24;

#[test]
fn what_is_called_clean_stays_inside_and_what_is_warned_of_is_cured() {
    let designs: Vec<_> = (0..DESIGNS).map(|index| tried(7, index).unwrap()).collect();
    let count =
        |test: &dyn Fn(&designs::Design) -> bool| designs.iter().filter(|design| test(design)).count();
    let (good, bad) = (count(&|design| !design.left), count(&|design| design.left));
    assert!(good >= 6 && bad >= 6, "{good} good and {bad} bad designs show nothing");
    assert_eq!(count(&|design| design.clean && design.left), 0, "called clean and left");
    let warned = count(&|design| !design.clean && !design.left);
    assert!(4 * warned <= good, "{warned} of {good} good designs are warned of");
    let cured = count(&|design| matches!(design.cure, Some(Cured::After(_))));
    let told = count(&|design| matches!(design.cure, Some(Cured::Not { start_is_named: true })));
    assert!(10 * (cured + told) >= 9 * bad, "{cured} of {bad} are cured, and of {told} the start is named");
}
