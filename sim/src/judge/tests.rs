use super::*;
use crate::scenario::Override;
use std::path::Path;

fn scenario(text: &str, sets: &[&str]) -> Scenario {
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    Scenario::parse(text, Path::new("test.toml"), &sets).unwrap()
}

/// A path of three in a constant funnel of 2, for ten ticks of 1 ms.
const PATH: &str = r#"
version = 1
time = { tick = "1ms", duration = "10ms" }
graph = { kind = "path", nodes = 3, weight = 0.5 }
coupling = { kind = "node-wise", gain = { kind = "reciprocal", scale = 1.0 }, funnel = { kind = "constant", width = 2.0 } }
agent = { dynamics = { kind = "affine", slope = -1.0 } }
"#;

const RAN: [Presence; 3] = [Presence::Ran; 3];

fn findings(scenario: &Scenario, ticks: &[(u64, [f64; 3], [Presence; 3])]) -> Findings {
    let mut judge = Judge::new(scenario);
    for (k, x, presence) in ticks {
        judge.tick(&Moment { k: *k, part: 0, x, u: &[0.0, -7.0, 1.0], presence }, None);
    }
    judge.finish()
}

#[test]
fn terms_are_those_of_the_states_whatever_nodes_have_heard() {
    let scenario = scenario(PATH, &[]);
    let found = findings(&scenario, &[(0, [0.0, 1.0, 0.0], RAN), (10, [0.0, 3.0, 1.0], RAN)]);
    // nu_2 = 0.5 (0 - 3) + 0.5 (1 - 3).
    assert_eq!((found.max_ratio, found.breaches, found.first_breach), (1.25, 1, Some((10, 1))));
    assert_eq!((found.max_spread, found.final_spread, found.max_input), (Some(3.0), Some(3.0), Some(7.0)));
    assert_eq!((found.last, found.unknown, found.judged), (vec![0.0, 3.0, 1.0], 0, 6));
}

#[test]
fn the_largest_spread_is_not_the_final_one() {
    let scenario = scenario(PATH, &[]);
    let found = findings(&scenario, &[(4, [0.0, 1.0, 0.0], RAN), (10, [0.0, 0.25, 0.0], RAN)]);
    assert_eq!((found.max_spread, found.final_spread), (Some(1.0), Some(0.25)));
}

#[test]
fn a_value_that_is_not_a_number_is_a_breach_and_stays_the_largest() {
    let scenario = scenario(PATH, &[]);
    let found = findings(&scenario, &[(0, [0.0, f64::NAN, 0.0], RAN), (10, [0.0; 3], RAN)]);
    assert!(found.max_ratio.is_nan() && found.max_spread.is_some_and(f64::is_nan), "{found:?}");
    assert_eq!(found.breaches, 3);
}

#[test]
fn a_term_with_an_unknown_state_in_it_is_counted_and_not_judged() {
    let scenario = scenario(PATH, &[]);
    for unknown in [Presence::Absent, Presence::Unrecorded] {
        let presence = [unknown, Presence::Ran, Presence::Ran];
        let found = findings(&scenario, &[(10, [1e9, 0.0, 1.0], presence)]);
        // Node 3 hears only node 2.
        assert_eq!((found.unknown, found.judged, found.max_ratio), (2, 1, 0.25), "{unknown:?}");
        // Nobody knows how far away the third one is at the end.
        assert_eq!((found.max_spread, found.final_spread), (Some(1.0), None));
        assert!(found.last[0].is_nan() && found.last[1..] == [0.0, 1.0]);
    }
    let nobody = findings(&scenario, &[(10, [0.0; 3], [Presence::Absent; 3])]);
    assert!(nobody.judged == 0 && nobody.final_spread.is_none() && nobody.max_input.is_none(), "{nobody:?}");
}

#[test]
fn a_stopped_node_keeps_its_state_and_its_edges() {
    let scenario = scenario(PATH, &[]);
    let presence = [Presence::Stopped, Presence::Ran, Presence::Ran];
    let found = findings(&scenario, &[(10, [9.0, 0.0, 0.0], presence)]);
    assert_eq!((found.max_ratio, found.breaches), (2.25, 2));
    // What it was told last drives nothing any more.
    assert_eq!(found.max_input, Some(7.0));
}

#[test]
fn each_edge_is_judged_by_itself_where_each_has_a_funnel() {
    let scenario = scenario(PATH, &["coupling.kind=edge-wise"]);
    let found = findings(&scenario, &[(10, [-3.0, 0.0, 3.0], RAN)]);
    // Node-wise the two terms of node 2 would cancel.
    assert_eq!((found.max_ratio, found.breaches), (0.75, 0));
}

#[test]
fn the_funnel_is_the_scenarios_down_to_the_accepted_floor() {
    let closed = "coupling.funnel={kind='finite-time',start=2.0,at='5ms'}";
    let at_the_end = [(10, [0.0, 0.01, 0.0], RAN)];
    let ratio = |sets: &[&str]| findings(&scenario(PATH, sets), &at_the_end).max_ratio;
    assert_eq!(ratio(&[closed]), f64::INFINITY);
    assert!((ratio(&[closed, "coupling.floor=0.02"]) - 0.5).abs() < 1e-12);
    // Wider than rounding needs by far.
    assert!(ratio(&[closed, "coupling.floor='f32'"]) > 100.0);
    // Even in step a funnel that has closed is not kept.
    let still = findings(&scenario(PATH, &[closed]), &[(10, [0.0; 3], RAN)]);
    assert_eq!((still.max_ratio, still.breaches), (1.0, 3));
}

#[test]
fn a_funnel_that_opens_from_next_to_nothing_has_a_width_at_the_start() {
    let opening = "coupling.funnel={kind='exponential',start=1e-9,end=1e9,rate=1.0}";
    let scenario = scenario(PATH, &[opening]);
    let mut judge = Judge::new(&scenario);
    judge.tick(&Moment { k: 0, part: 0, x: &[0.0, 0.0, 0.0], u: &[0.0; 3], presence: &RAN }, None);
    assert_eq!((judge.psi(), judge.terms()), (&[1e-9; 3][..], &[0.0; 3][..]));
    assert_eq!(judge.finish().breaches, 0);
}

#[test]
fn windows_see_their_ticks_only_both_ends_included() {
    let window = "expect={window=[{from='2ms',to='4ms',funnel_ratio=1.0,spread=1.0,emergent_error=1.0,max_input=9.0}]}";
    let scenario = scenario(PATH, &[window]);
    let apart = |x: f64| [0.0, x, 0.0];
    let ticks = [(1, apart(9.0), RAN), (2, apart(0.5), RAN), (4, apart(1.0), RAN), (5, apart(9.0), RAN)];
    let found = findings(&scenario, &ticks).windows;
    let [window] = found.as_slice() else { panic!("{found:?}") };
    assert_eq!((window.funnel_ratio, window.spread, window.max_input), (Some(0.5), Some(1.0), Some(7.0)));
    // All fields are -x from zero on.
    assert_eq!((window.emergent_error, window.reference_error), (Some(1.0), None));
    let never = findings(&scenario, &[(1, apart(0.0), RAN)]).windows;
    assert_eq!(never[0], WindowFigures::default());
}

#[test]
fn every_node_has_figures_of_its_own() {
    let scenario = scenario(PATH, &[]);
    let away = [Presence::Absent, Presence::Ran, Presence::Ran];
    let found = findings(
        &scenario,
        &[(0, [0.0, 5.0, 0.0], RAN), (1, [0.0, 1.0, 0.0], RAN), (10, [0.0, 3.0, 1.0], away)],
    );
    let worst =
        |max_ratio, breaches, unknown, judged| Worst { max_ratio, breaches, unknown, judged, uncoupled: 0 };
    // nu_1 = 2.5 and 0.5, nu_2 = -5 and -1, nu_3 = 2.5, 0.5 and 1, in a funnel of 2.
    assert_eq!(found.worst, [worst(1.25, 1, 1, 2), worst(2.5, 1, 1, 2), worst(1.25, 1, 0, 3)]);
    assert_eq!(found.breaches, 3);
}

#[test]
fn a_node_that_is_off_has_no_state_and_no_edge() {
    let scenario = scenario(PATH, &["coupling.floor='f32'"]);
    let presence = [Presence::Off, Presence::Ran, Presence::Ran];
    let mut judge = Judge::new(&scenario);
    let u = [f64::NAN, 0.5, 1.0];
    judge.tick(&Moment { k: 10, part: 0, x: &[f64::NAN, 3.0, 1.0], u: &u, presence: &presence }, None);
    // 0.5 (1 - 3), and nothing of node 1; its funnel is the scenario's all the same.
    assert_eq!((judge.terms()[1], judge.terms()[2], judge.psi()), (-1.0, 1.0, &[2.0; 3][..]));
    assert!(judge.terms()[0].is_nan());
    let found = judge.finish();
    assert_eq!((found.unknown, found.judged, found.breaches, found.max_ratio), (0, 2, 0, 0.5));
    assert_eq!(
        (found.final_spread, found.max_input, found.off),
        (Some(2.0), Some(1.0), vec![true, false, false])
    );
}

#[test]
fn only_disturbed_ticks_are_excused() {
    let events = ["event=[{at='4ms',kind='crash',node=1}]", "expect.recovered_within=2ms"];
    let scenario = scenario(PATH, &events);
    let gone = [Presence::Off, Presence::Ran, Presence::Ran];
    let outside = |from: u64, to: u64| {
        let ticks: Vec<_> = (0..=10)
            .map(|k| {
                (
                    k,
                    [0.0, if (from..to).contains(&k) { 9.0 } else { 0.0 }, 0.0],
                    if k < 4 { RAN } else { gone },
                )
            })
            .collect();
        let found = findings(&scenario, &ticks);
        let during = found.during_events.unwrap();
        (found.breaches, during.breaches, during.judged, found.recovered_s)
    };
    // Ticks 4 and 5, of two nodes each.
    assert_eq!(outside(4, 6), (0, 4, 4, Some(0.001)));
    assert_eq!(outside(4, 7), (2, 4, 4, Some(0.002)));
    assert_eq!(outside(3, 5), (3, 2, 4, Some(0.0)));
    assert_eq!(outside(9, 11), (4, 0, 4, None));
}

#[test]
fn who_has_no_neighbour_left_has_no_term_that_could_pass() {
    let window = "expect={window=[{from='6ms',to='10ms',funnel_ratio=1.0,spread=9.0,emergent_error=9.0,max_input=9.0}]}";
    let scenario = scenario(PATH, &[window]);
    let hub_gone = [Presence::Ran, Presence::Off, Presence::Ran];
    let found = findings(&scenario, &[(0, [0.0, 1.0, 0.0], RAN), (8, [0.0, f64::NAN, 3.0], hub_gone)]);
    assert_eq!((found.judged, found.unknown, found.uncoupled), (3, 0, 2));
    assert_eq!((found.worst[0].judged, found.worst[0].uncoupled), (1, 1));
    let [figures] = found.windows.as_slice() else { panic!("{found:?}") };
    // How far they are apart is known all the same.
    assert_eq!((figures.funnel_ratio, figures.spread, figures.max_input), (None, Some(3.0), Some(1.0)));
    let nobody = findings(&scenario, &[(8, [f64::NAN; 3], [Presence::Off; 3])]);
    assert_eq!(nobody.windows, [WindowFigures::default()]);
    // One alone agrees with nobody.
    let alone = [Presence::Ran, Presence::Off, Presence::Off];
    let found = findings(&scenario, &[(10, [1.0, f64::NAN, f64::NAN], alone)]);
    assert_eq!((found.final_spread, found.windows[0].spread, found.judged), (None, None, 0));
}
