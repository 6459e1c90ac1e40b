use super::*;
use crate::Simulation;
use crate::scenario::Override;
use std::path::Path;

fn gallery(file: &str, sets: &[&str]) -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios").join(file);
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).unwrap()).collect();
    Scenario::load(&path, &sets).unwrap()
}

fn of(scenario: &Scenario) -> Followed {
    follow(scenario, &scenario.graph.degrees()).unwrap()
}

#[test]
fn the_law_that_is_followed_is_that_of_the_run() {
    for (file, sets) in [
        ("narrow-ring.toml", &[][..]),
        ("narrow-ring.toml", &["time.tick=4ms"]),
        ("five-agents.toml", &[]),
        ("lossy-ring.toml", &[]),
        ("five-agents.toml", &["bus.latency=2500us", "bus.jitter=2ms"]),
        ("five-agents.toml", &["agent.noise=0.2"]),
        ("vector-oscillators.toml", &[]),
        ("narrow-ring.toml", &["time.slow_start=10ms", "coupling.guard=0.1"]),
        ("lossy-ring.toml", &["time.slow_start=20ms"]),
        ("infinite-start.toml", &[]),
        ("vector-max-gain.toml", &[]),
        ("economic-dispatch.toml", &[]),
        ("five-agents.toml", &["coupling.kind=edge-wise"]),
        ("side-by-side-high-gain.toml", &[]),
        ("side-by-side-lambda-tracker.toml", &[]),
        ("side-by-side-weakly-centralised.toml", &[]),
        ("five-agents.toml", &["coupling.kind=none"]),
        (
            "five-agents.toml",
            &["coupling.kind=weakly-centralised", "agent.limits={ low = -8.0, high = 8.0 }"],
        ),
        ("lossy-ring.toml", &["coupling.kind=linear", "coupling.gain={ kind = \"linear\", slope = 30.0 }"]),
        ("tank.toml", &["agent.limits={ low = -0.2, high = 0.2 }"]),
    ] {
        let scenario = gallery(file, &[sets, &["time.duration=3s"]].concat());
        let (followed, run) = (of(&scenario), Simulation::new(&scenario).unwrap().run().findings);
        let judged = run.max_ratio;
        assert!(followed.whole && followed.lost.is_none(), "{file} {sets:?}");
        assert!(
            (followed.worst.ratio - judged).abs() < 5e-3,
            "{file} {sets:?}: {} {judged}",
            followed.worst.ratio
        );
        for (f64, f32) in followed.last.iter().zip(&run.last) {
            assert!((f64 - f32).abs() < 2e-3, "{file} {sets:?}: {f64} {f32}");
        }
    }
}

#[test]
fn a_law_that_runs_away_is_lost() {
    let late = of(&gallery("narrow-ring.toml", &["bus.latency=1ms"]));
    assert!(late.lost.is_some(), "{late:?}");
    assert!(of(&gallery("narrow-ring.toml", &[])).lost.is_none());
}

#[test]
fn what_is_followed_is_bounded_by_its_work() {
    let scenario = gallery("five-agents.toml", &[]);
    let followed = follow_for(&scenario, &scenario.graph.degrees(), Bounds::NONE, 105_000).unwrap();
    // 5 nodes of 20 and 5 edges.
    assert_eq!((followed.until, followed.whole), (1.0, false));
}
