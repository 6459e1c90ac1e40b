//! An hour of virtual time in a broken world: frames are lost, doubled and spoilt, nodes fall silent, restart
//! and are unplugged. Every tick of every node is recorded as it was, or named as what is not known of it.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_node::{Event, Observation};
use funnelnet_protocol::config::TickSource;
use rand_pcg::Pcg64;
use sim_host::conductor::{Absence, Conductor, HubError, OnLoss, Patience};
use sim_host::configure::Drive;
use sim_host::engine::NodeEvent;
use sim_host::presence::Presence;
use sim_host::random::{Purpose, below, stream, uniform};
use sim_host::record::TraceHash;
use sim_host::scenario::Scenario;
use std::time::Duration;
use system_tests::scenario;
use system_tests::world::{Blow, Fate, Way, World, conductor};

const NODES: usize = 12;
const LOCKSTEP: Drive = Drive { tick_source: TickSource::Sync, telemetry_every: 1, is_simulated: false };
const OWN_CLOCK: Drive = Drive { tick_source: TickSource::Timer, telemetry_every: 1, is_simulated: false };
const PATIENCE: Patience = Patience { boot: Duration::from_secs(5), answer: Duration::from_millis(500) };
/// Time that a frame takes, ns: a tick takes twice as long.
const TRAVEL: u64 = 25_000_000;
/// The same where nodes have clocks of their own, and a state must come within a tick.
const SOON: u64 = 2_000_000;
const SECOND: u64 = 1_000_000_000;
const HOUR: u64 = 3600 * SECOND;
/// How long after it a blow may be felt: an answer is waited for, or a look has just been in vain.
const FELT: u64 = 2 * SECOND;

/// How often what happens.
#[derive(Clone, Copy, Default)]
struct Rates {
    /// Of the frames on every line; the same share is spoilt.
    lost: f64,
    doubled: f64,
    /// Of the moments at which a board hears or speaks: it falls silent, restarts, or is unplugged.
    boards: f64,
}

const BROKEN: Rates = Rates { lost: 1e-4, doubled: 1e-4, boards: 1e-5 };

/// How often what has happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Counts {
    lost: u64,
    doubled: u64,
    spoilt: u64,
    silences: u64,
    restarts: u64,
    replugs: u64,
}

/// What happens, from a seed.
struct Trouble {
    rates: Rates,
    /// By node.
    draws: Vec<Pcg64>,
    silent_until: Vec<u64>,
    struck: Vec<Option<u64>>,
    counts: Counts,
}

impl Trouble {
    fn new(seed: u64, rates: Rates) -> Self {
        let draws = (0..).take(NODES).map(|node| stream(seed, Purpose::Loss, node)).collect();
        let (silent_until, struck) = (vec![0; NODES], vec![None; NODES]);
        Self { rates, draws, silent_until, struck, counts: Counts::default() }
    }

    /// Whether something has struck a node so shortly before `now` that it may be felt.
    fn is_felt(&self, node: usize, now: u64) -> bool {
        self.struck[node].is_some_and(|at| now < at + FELT)
    }
}

impl Fate for Trouble {
    fn carry(&mut self, node: usize, _: Way, now: u64, mut frame: Vec<u8>) -> Vec<Vec<u8>> {
        if now < self.silent_until[node] {
            self.struck[node] = Some(now);
            return Vec::new();
        }
        let Rates { lost, doubled, .. } = self.rates;
        let draw = uniform(&mut self.draws[node]);
        if draw >= 2.0 * lost + doubled {
            return vec![frame];
        }
        self.struck[node] = Some(now);
        if draw < lost {
            self.counts.lost += 1;
            Vec::new()
        } else if draw < 2.0 * lost {
            self.counts.spoilt += 1;
            let at = below(&mut self.draws[node], frame.len());
            frame[at] ^= 1 << below(&mut self.draws[node], 8);
            vec![frame]
        } else {
            self.counts.doubled += 1;
            vec![frame.clone(), frame]
        }
    }

    fn befall(&mut self, node: usize, now: u64) -> Blow {
        let draw = uniform(&mut self.draws[node]) / self.rates.boards;
        if draw < 3.0 {
            self.struck[node] = Some(now);
        }
        match draw {
            ..1.0 => {
                self.counts.silences += 1;
                let length = 3.0 * uniform(&mut self.draws[node]);
                self.silent_until[node] = now + (length * SECOND as f64) as u64;
                Blow::None
            }
            1.0..2.0 => {
                self.counts.restarts += 1;
                Blow::Restart
            }
            2.0..3.0 => {
                self.counts.replugs += 1;
                Blow::Replug
            }
            _ => Blow::None,
        }
    }
}

/// Twelve nodes that differ, on a ring.
fn twelve() -> Scenario {
    let ring = "graph={kind='ring',nodes=12}";
    scenario("average.toml", &[ring, "time.tick=50ms", "time.duration=2h", "coupling.funnel.end=20"])
}

/// What a run names.
#[derive(Clone, Copy)]
struct Named<'a> {
    absences: &'a [Absence],
    events: &'a [NodeEvent],
    contradictions: &'a [String],
}

impl<'a> Named<'a> {
    fn of(conductor: &'a Conductor, contradictions: &'a [String]) -> Self {
        Self { absences: conductor.absences(), events: conductor.events(), contradictions }
    }

    /// Whether it is said that a node was away at a tick.
    fn is_away(&self, node: usize, k: u32) -> bool {
        let covers = |absence: &Absence| absence.from <= k && absence.to.is_none_or(|to| k < to);
        self.absences.iter().any(|absence| usize::from(absence.node) == node + 1 && covers(absence))
    }

    fn has_stopped(&self, node: usize) -> bool {
        self.events.iter().any(|event| event.node == node && matches!(event.event, Event::Fault(_)))
    }

    fn is_contradicted(&self, node: usize) -> bool {
        let name = format!("node {} ", node + 1);
        self.contradictions.iter().any(|sentence| sentence.starts_with(&name))
    }
}

/// What a node saw at a tick.
fn truth(world: &World<Trouble>, node: usize, k: u32) -> Option<Observation<f32>> {
    world.boards()[node].seen_at(k)?.first().copied()
}

/// What is wrong with what a run says of a node at tick `k`; `truth` is what the node saw there.
fn complaint(
    (k, node): (u32, usize),
    presence: Presence,
    seen: Observation<f32>,
    truth: Option<Observation<f32>>,
    named: Named<'_>,
) -> Option<String> {
    let bits = |seen: Observation<f32>| {
        (seen.tick, [seen.x, seen.nu, seen.psi, seen.ratio, seen.u].map(f32::to_bits))
    };
    let good = match presence {
        Presence::Ran => seen.tick == k && truth.map(bits) == Some(bits(seen)),
        Presence::Absent => named.is_away(node, k),
        Presence::Stopped => named.has_stopped(node),
        Presence::Unrecorded => named.is_contradicted(node),
        // Nothing but an event keeps a node off.
        Presence::Off => false,
    };
    (!good).then(|| format!("node {} at tick {k}: {presence:?}, {seen:?}, in truth {truth:?}", node + 1))
}

/// What a run has come to.
#[derive(Debug, PartialEq)]
struct Record {
    ticks: u32,
    /// Node-ticks by what is known of them: run, absent, all others.
    known: [u64; 3],
    absences: usize,
    counts: Counts,
    hash: TraceHash,
    complaints: Vec<String>,
}

/// Runs the twelve for so long, and looks at every tick of every node.
fn run(seed: u64, length: u64, rates: Rates) -> Record {
    let scenario = twelve();
    let mut conductor = conductor(&scenario, LOCKSTEP, PATIENCE).with_loss(OnLoss::GoOn);
    let mut world = World::new(NODES, TRAVEL, Trouble::new(seed, Rates::default()));
    world.run(conductor.meet()).unwrap();
    world.run(conductor.start()).unwrap();
    world.fate.rates = rates;
    let (mut known, mut hash, mut complaints, mut k, mut told) = ([0; 3], TraceHash::new(), Vec::new(), 0, 0);
    while world.now() < length {
        world.run(conductor.advance()).unwrap();
        let contradictions = conductor.contradictions();
        let named = Named::of(&conductor, &contradictions);
        for absence in &named.absences[told..] {
            let node = usize::from(absence.node) - 1;
            if !world.fate.is_felt(node, world.now()) {
                complaints.push(format!("nothing has happened to it: {absence}"));
            }
        }
        told = named.absences.len();
        let seen = conductor.presence().iter().zip(conductor.observations());
        for (node, (&presence, &seen)) in seen.enumerate() {
            known[match presence {
                Presence::Ran => 0,
                Presence::Absent => 1,
                Presence::Stopped | Presence::Unrecorded | Presence::Off => 2,
            }] += 1;
            hash.extend([if presence.is_known() { seen.x } else { f32::NAN }]);
            let truth = truth(&world, node, k);
            complaints.extend(complaint((k, node), presence, seen, truth, named));
        }
        k += 1;
    }
    let reports = world.run(conductor.finish()).unwrap();
    assert_eq!(reports.len(), NODES);
    Record { ticks: k, known, absences: told, counts: world.fate.counts, hash, complaints }
}

#[test]
fn every_node_tick_of_an_hour_of_twelve_nodes_is_recorded_or_named() {
    let Record { ticks, known: [ran, absent, other], absences, counts, complaints, .. } =
        run(1, HOUR, BROKEN);
    println!(
        "{ticks} ticks: {ran} node-ticks recorded, {absent} absent in {absences} absences, {other} others; {counts:?}"
    );
    assert!(complaints.is_empty(), "{} complaints: {:#?}", complaints.len(), complaints.first());
    assert_eq!(ran + absent + other, u64::from(ticks) * NODES as u64);
    let Counts { lost, doubled, spoilt, silences, restarts, replugs } = counts;
    assert!([lost, doubled, spoilt].iter().all(|&count| count > 100), "{counts:?}");
    assert!([silences, restarts, replugs].iter().all(|&count| count > 5), "{counts:?}");
    assert!(absences > 100 && ran > 20 * absent, "{absences} absences: {ran} and {absent}");
}

#[test]
fn the_seed_makes_the_faults() {
    let minutes = 5 * 60 * SECOND;
    let first = run(2, minutes, BROKEN);
    assert_eq!(first, run(2, minutes, BROKEN));
    assert_ne!(first.hash, run(3, minutes, BROKEN).hash);
    let peace = run(2, minutes, Rates::default());
    assert_eq!((peace.known[1], peace.known[2], peace.absences), (0, 0, 0));
}

#[test]
fn without_leave_to_go_on_the_first_fault_that_is_felt_ends_the_run_and_names_its_node() {
    let scenario = twelve();
    for seed in 0..40 {
        let mut conductor = conductor(&scenario, LOCKSTEP, PATIENCE);
        let mut world = World::new(NODES, TRAVEL, Trouble::new(seed, Rates::default()));
        world.run(conductor.meet()).unwrap();
        world.run(conductor.start()).unwrap();
        world.fate.rates = Rates { lost: 1e-3, doubled: 1e-3, boards: 1e-4 };
        let error: HubError = loop {
            if let Err(error) = world.run(conductor.advance()) {
                break error;
            }
        };
        let text = error.to_string();
        let names = |&node: &usize| text.contains(&format!("node {} ", node + 1));
        let named: Vec<_> = (0..NODES).filter(names).collect();
        let [node] = named[..] else { panic!("{text} names {named:?}") };
        assert!(world.fate.is_felt(node, world.now()), "seed {seed}: {text}");
        // All that can hear it stop, and the others are named.
        let halted = world.run(conductor.halt());
        let mut all: Vec<_> = halted.confirmed.iter().chain(&halted.silent).copied().collect();
        all.sort_unstable();
        assert_eq!(all, (1..=12).collect::<Vec<_>>(), "{halted}");
        for id in halted.silent {
            assert!(world.fate.struck[usize::from(id) - 1].is_some(), "seed {seed}: node {id} is silent");
        }
    }
}

/// The same twelve with clocks of their own: nothing is asked for twice there, so what was lost is counted.
#[test]
fn every_node_tick_of_an_hour_of_twelve_clocks_is_recorded_or_counted_as_missed() {
    let scenario = twelve();
    let mut conductor = conductor(&scenario, OWN_CLOCK, PATIENCE).with_own_clock();
    let mut world = World::new(NODES, SOON, Trouble::new(1, Rates::default()));
    world.run(conductor.meet()).unwrap();
    world.run(conductor.start()).unwrap();
    let begin = world.now();
    world.fate.rates = Rates { lost: 1e-4, doubled: 1e-4, ..Rates::default() };
    let (mut unrecorded, mut ran, mut k) = ([0; NODES], 0_u64, 0);
    while world.now() < begin + HOUR {
        world.run(conductor.advance()).unwrap();
        let seen = conductor.presence().iter().zip(conductor.observations());
        for (node, (&presence, &seen)) in seen.enumerate() {
            if presence == Presence::Unrecorded {
                unrecorded[node] += 1;
                assert!(world.fate.is_felt(node, world.now()), "node {} at tick {k}", node + 1);
                continue;
            }
            ran += 1;
            let nothing = Named { absences: &[], events: &[], contradictions: &[] };
            let complaint = complaint((k, node), presence, seen, truth(&world, node, k), nothing);
            assert_eq!(complaint, None);
        }
        k += 1;
    }
    println!("{k} ticks: {ran} node-ticks recorded, {unrecorded:?} missed; {:?}", world.fate.counts);
    assert!(u64::from(k).abs_diff(HOUR / 50_000_000) < 10, "{k} ticks");
    assert_eq!(unrecorded, std::array::from_fn(|node| conductor.missed(node)));
    assert!(unrecorded.iter().all(|&count| count > 3), "{unrecorded:?}");
    world.run(conductor.finish()).unwrap();
}

#[test]
fn a_record_that_leaves_something_out_is_complained_of() {
    let nothing = Named { absences: &[], events: &[], contradictions: &[] };
    let truth = Observation { tick: 7, x: 1.0, nu: 0.5, psi: 2.0, ratio: 0.25, u: 0.1 };
    let complained =
        |presence, seen, truth, named: Named<'_>| complaint((7, 2), presence, seen, truth, named).is_some();
    assert!(!complained(Presence::Ran, truth, Some(truth), nothing));
    assert!(complained(Presence::Ran, Observation { x: -1.0, ..truth }, Some(truth), nothing));
    assert!(complained(Presence::Ran, Observation { tick: 6, ..truth }, Some(truth), nothing));
    assert!(complained(Presence::Ran, truth, None, nothing));
    for presence in [Presence::Absent, Presence::Stopped, Presence::Unrecorded] {
        assert!(complained(presence, truth, Some(truth), nothing), "{presence:?}");
    }
    let absence = |node, from, to| Absence { node, from, to, why: String::new() };
    for (absence, covers) in [
        (absence(3, 7, None), true),
        (absence(3, 2, Some(8)), true),
        (absence(3, 2, Some(7)), false),
        (absence(3, 8, None), false),
        (absence(4, 7, None), false),
    ] {
        let named = Named { absences: std::slice::from_ref(&absence), ..nothing };
        assert_eq!(!complained(Presence::Absent, truth, Some(truth), named), covers, "{absence:?}");
    }
    let of_another = ["node 31 lies".to_owned()];
    let named = Named { contradictions: &of_another, ..nothing };
    assert!(complained(Presence::Unrecorded, truth, Some(truth), named));
}
