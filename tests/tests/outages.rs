//! law.md 9: what edges that go and come back do to a network, against the law before the second edition.
#![allow(clippy::unwrap_used, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_node::params::NEWCOMER_PATIENCE;
use system_tests::outage::{Case, Edition, Outage, Seen, run};

const GRAPHS: [&str; 4] = ["ring", "path", "star", "complete"];
const WIDTHS: [f64; 2] = [0.02, 0.2];
const SEEDS: u64 = 8;

/// What an input may be, over the largest one of the run that nothing disturbs.
const INPUTS: f64 = 12.0;

fn cases(seeds: u64) -> impl Iterator<Item = Case> {
    GRAPHS.into_iter().flat_map(move |graph| {
        WIDTHS.into_iter().flat_map(move |psi| (1..=seeds).map(move |seed| Case { graph, psi, seed }))
    })
}

/// A case under an outage: the law before, the one now, and the largest input of the run that nothing
/// disturbs.
struct Compared {
    case: Case,
    today: Seen,
    second: Seen,
    calm_input: f64,
}

fn compare(case: Case, outage: Outage, calm_input: f64) -> Compared {
    let (today, second) = (run(&case, outage, Edition::Today), run(&case, outage, Edition::Second));
    Compared { case, today, second, calm_input }
}

/// Prints the figures of an outage, and every case that is worse than before; gives the mean shares of
/// node-ticks outside, before and now.
fn table(outage: Outage, compared: &[Compared]) -> (f64, f64) {
    let mean = |of: &dyn Fn(&Compared) -> f64| compared.iter().map(of).sum::<f64>() / compared.len() as f64;
    let most = |of: &dyn Fn(&Compared) -> f64| compared.iter().map(of).fold(0.0, f64::max);
    let (today, second) = (mean(&|one| one.today.share()), mean(&|one| one.second.share()));
    println!(
        "{outage:?}: outside {:.4} % -> {:.4} %; largest ratio {:.1} -> {:.1}; largest input {:.0} -> {:.0}, {:.2} -> {:.2} times the calm one; \
         last outside {} -> {} ticks after, {:.4} % -> {:.4} % from then on",
        100.0 * today,
        100.0 * second,
        most(&|one| one.today.ratio),
        most(&|one| one.second.ratio),
        most(&|one| one.today.input),
        most(&|one| one.second.input),
        most(&|one| one.today.input / one.calm_input),
        most(&|one| one.second.input / one.calm_input),
        most(&|one| one.today.after as f64),
        most(&|one| one.second.after as f64),
        100.0 * mean(&|one| one.today.outside_after as f64 / one.today.node_ticks as f64),
        100.0 * mean(&|one| one.second.outside_after as f64 / one.second.node_ticks as f64),
    );
    for one in compared.iter().filter(|one| one.second.outside > one.today.outside) {
        let Compared { case, today, second, .. } = one;
        println!(
            "  worse: {} psi {} seed {}: {} -> {} of {} node-ticks, ratio {:.2} -> {:.2}",
            case.graph,
            case.psi,
            case.seed,
            today.outside,
            second.outside,
            second.node_ticks,
            today.ratio,
            second.ratio
        );
    }
    (today, second)
}

/// The largest input of the run that nothing disturbs, its start included.
fn calm(case: &Case) -> f64 {
    run(case, Outage::None, Edition::Second).input
}

fn bounded(compared: &[Compared]) -> bool {
    // The bound is that of a run in f64.
    compared.iter().all(|one| one.second.input <= 1.001 * INPUTS * one.calm_input)
}

#[test]
#[ignore = "minutes: ./ci.sh extended"]
fn outages_of_single_edges_put_nodes_outside_half_as_often_as_before() {
    let calm: Vec<_> = cases(SEEDS).map(|case| (case, calm(&case))).collect();
    for outage in [Outage::Wobble, Outage::Bursts] {
        let compared: Vec<_> = calm.iter().map(|&(case, input)| compare(case, outage, input)).collect();
        let (today, second) = table(outage, &compared);
        assert!(second <= 0.5 * today, "{outage:?}: {second} {today}");
        assert!(bounded(&compared), "{outage:?}");
    }
}

#[test]
#[ignore = "minutes: ./ci.sh extended"]
fn halves_that_part_are_no_worse_than_before_and_soon_inside_again() {
    let calm: Vec<_> = cases(SEEDS).map(|case| (case, calm(&case))).collect();
    for outage in [Outage::Halves(200), Outage::Halves(2_000)] {
        let compared: Vec<_> = calm.iter().map(|&(case, input)| compare(case, outage, input)).collect();
        let (today, second) = table(outage, &compared);
        assert!(second <= today, "{outage:?}: {second} {today}");
        assert!(bounded(&compared), "{outage:?}");
        assert!(compared.iter().all(|one| one.second.after <= 100), "{outage:?}");
    }
}

/// Seeds of the table of times of extrapolation, which has many columns.
const FEW_SEEDS: u64 = 2;

/// What a longer extrapolation of silent neighbours gives and takes: outages of links on one side, crashes on
/// the other.
#[test]
#[ignore = "minutes: ./ci.sh extended"]
fn no_time_of_extrapolation_serves_both_silent_links_and_crashed_nodes() {
    let share = |outage: Outage, edition: Edition| {
        let shares = cases(FEW_SEEDS).map(|case| run(&case, outage, edition).share());
        100.0 * shares.sum::<f64>() / cases(FEW_SEEDS).count() as f64
    };
    let [silent, crashed] = [Outage::Wobble, Outage::Restart(100)];
    let before = [share(silent, Edition::Today), share(crashed, Edition::Today)];
    println!("before: {:.4} % outside with silent links, {:.4} % with a crash", before[0], before[1]);
    let mut serves_both = false;
    for ticks in [10, 15, 20, 30, 60, 120] {
        let now = [silent, crashed].map(|outage| share(outage, Edition::Extrapolating(ticks)));
        let times = [now[0] / before[0], now[1] / before[1]];
        println!(
            "{ticks} ticks: {:.4} %, {:.2} times; {:.4} %, {:.2} times",
            now[0], times[0], now[1], times[1]
        );
        serves_both |= times[0] <= 0.5 && times[1] <= 1.0;
    }
    assert!(!serves_both, "then that is the time to take");
}

/// A node that says goodbye is dropped at once, and comes back when that is no jump.
#[test]
#[ignore = "minutes: ./ci.sh extended"]
fn a_restart_with_a_goodbye_is_no_worse_than_before_and_soon_inside_again() {
    let calm: Vec<_> = cases(SEEDS).map(|case| (case, calm(&case))).collect();
    for (outage, compared, today, second) in restarts(&calm, Outage::Leave) {
        assert!(second <= today, "{outage:?}: {second} {today}");
        assert!(bounded(&compared), "{outage:?}");
        assert!(compared.iter().all(|one| one.second.after <= WAITS), "{outage:?}");
    }
}

/// Here nodes are outside for longer than before: those that stay follow one that is gone for as long as the
/// funnel allows, and not for ten ticks. They are not further outside, their inputs are smaller, and they are
/// inside again as soon.
#[test]
#[ignore = "minutes: ./ci.sh extended"]
fn a_restart_takes_nobody_further_outside_than_before() {
    let calm: Vec<_> = cases(SEEDS).map(|case| (case, calm(&case))).collect();
    for (outage, compared, today, second) in restarts(&calm, Outage::Restart) {
        assert!(second <= 2.5 * today, "{outage:?}: {second} {today}");
        let most = |of: fn(&Compared) -> f64| compared.iter().map(of).fold(0.0, f64::max);
        assert!(most(|one| one.second.ratio) <= most(|one| one.today.ratio), "{outage:?}");
        assert!(bounded(&compared), "{outage:?}");
        assert!(compared.iter().all(|one| one.second.after <= WAITS), "{outage:?}");
    }
}

/// Ticks after which a node that was away has spoken, and everybody is inside: it waits for a time at which
/// its coming throws nobody out.
const WAITS: u64 = NEWCOMER_PATIENCE as u64 + 10;

/// A restart after 0.1 s and after 2 s: the cases, and the share of node-ticks outside today and by the
/// second edition.
fn restarts(calm: &[(Case, f64)], kind: fn(u64) -> Outage) -> Vec<(Outage, Vec<Compared>, f64, f64)> {
    let tabled = |ms| {
        let outage = kind(ms);
        let compared: Vec<_> = calm.iter().map(|&(case, input)| compare(case, outage, input)).collect();
        let (today, second) = table(outage, &compared);
        (outage, compared, today, second)
    };
    [100, 2_000].map(tabled).into()
}

/// A small part of the tables.
#[test]
fn a_wobbling_cable_and_a_cut_do_less_than_before() {
    let case = Case { graph: "ring", psi: 0.2, seed: 1 };
    let input = calm(&case);
    for outage in [Outage::Wobble, Outage::Halves(200)] {
        let one = compare(case, outage, input);
        assert!(one.today.outside > 0, "{outage:?}: nothing happened");
        assert!(one.second.outside < one.today.outside, "{outage:?}: {:?} {:?}", one.today, one.second);
        assert!(bounded(&[one]), "{outage:?}");
    }
}
