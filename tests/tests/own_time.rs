//! Benches whose nodes tick by clocks of their own, and keep one time by SYNC, in virtual time: the real conductor, and
//! the firmware's sessions with clocks that drift.
#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests, which clippy does not know as such")]

use funnelnet_node::time::Role;
use funnelnet_node::{Event, Phase};
use funnelnet_protocol::NodeId;
use funnelnet_protocol::config::{TickSource, TimeRules};
use funnelnet_protocol::message::{FaultCode, Message, Severity};
use funnelnet_protocol::serial::{self, Frame};
use sim_host::conductor::{Conductor, HubError, Patience, SyncCounts};
use sim_host::configure::{Drive, node_configs};
use sim_host::presence::Presence;
use sim_host::scenario::Scenario;
use std::path::Path;
use std::time::Duration;
use system_tests::world::{Blow, Fate, Peace, Way, World, conductor_of, staged};

const OWN_CLOCK: Drive = Drive { tick_source: TickSource::Timer, telemetry_every: 1, is_simulated: false };
const PATIENCE: Patience = Patience { boot: Duration::from_secs(5), answer: Duration::from_millis(500) };
/// Time that a frame takes either way, ns.
const TRAVEL: u64 = 500_000;
const NODES: usize = 4;
/// 300 ppm from the slowest to the fastest: a tick of 10 ms in 33 s.
const DRIFTS: [i64; NODES] = [0, 150_000, -150_000, 90_000];

const RING: &str = "version = 1\ntime = { tick = '10ms', duration = '10min' }\ngraph = { kind = 'ring', nodes = 4 }\n\
                    agent = { dynamics = { kind = 'affine', slope = -1.0, offset = 1.0 } }\n\
                    coupling = { kind = 'node-wise', gain = { kind = 'reciprocal', scale = 1.0 }, funnel = { kind = 'constant', width = 20.0 } }";

fn ring(events: &str, masters: &[u8]) -> Scenario {
    of_text(RING, events, masters)
}

/// The scenario of this text with these events and masters.
fn of_text(text: &str, events: &str, masters: &[u8]) -> Scenario {
    let sync =
        if masters.is_empty() { String::new() } else { format!("sync = {{ masters = {masters:?} }}\n") };
    let text = format!("event = [{events}]\n{sync}{text}");
    Scenario::parse(&text, Path::new("ring.toml"), &[]).unwrap_or_else(|errors| panic!("{errors}"))
}

/// How a bench of these nodes is run.
struct Bench<F: Fate = Peace> {
    conductor: Conductor,
    world: World<F>,
    ticks: u32,
    /// Unrecorded node-ticks.
    unrecorded: u64,
}

impl Bench {
    /// With these masters, or none. The host has the power of the nodes.
    fn new(events: &str, masters: &[u8]) -> Self {
        let mut world = World::new(NODES, TRAVEL, Peace).with_drifts(&DRIFTS);
        world.has_power = true;
        Self::of(world, (events, masters), |conductor| conductor)
    }

    fn of(world: World, chosen: (&str, &[u8]), with: impl FnOnce(Conductor) -> Conductor) -> Self {
        Self::all_of(world, &ring(chosen.0, chosen.1), chosen.1, with)
    }
}

impl<F: Fate> Bench<F> {
    fn all_of(
        world: World<F>,
        scenario: &Scenario,
        masters: &[u8],
        with: impl FnOnce(Conductor) -> Conductor,
    ) -> Self {
        let mut configs = node_configs(scenario, OWN_CLOCK).unwrap();
        if !masters.is_empty() {
            let rules = TimeRules { period_us: 100_000, jitter_us: 2_000, ..TimeRules::NONE };
            let ids = masters.iter().filter_map(|&id| NodeId::new(id));
            let rules = ids.fold(rules, TimeRules::with_master);
            configs.iter_mut().for_each(|config| config.time = rules);
        }
        let mut staged = staged(scenario, OWN_CLOCK);
        staged.iter_mut().flatten().for_each(|staged| {
            staged.config.time = configs.first().map_or(TimeRules::NONE, |config| config.time)
        });
        let conductor = conductor_of(scenario, &configs, PATIENCE).with_staged(staged);
        let conductor = with(conductor).with_own_clock();
        let silences = (0..NODES).map(|index| sim_host::engine::silences(scenario, index)).collect();
        let conductor = if masters.is_empty() { conductor } else { conductor.with_sync(silences) };
        let mut bench = Self { conductor, world, ticks: 0, unrecorded: 0 };
        bench.world.run(bench.conductor.meet()).unwrap();
        bench.world.run(bench.conductor.stage()).unwrap();
        bench.world.run(bench.conductor.start()).unwrap();
        bench
    }

    fn run(&mut self, ticks: u32) -> Result<(), HubError> {
        while self.ticks < ticks {
            self.world.run(self.conductor.advance())?;
            self.ticks += 1;
            let lost = self.conductor.presence().iter().filter(|&&presence| presence == Presence::Unrecorded);
            self.unrecorded += lost.count() as u64;
        }
        Ok(())
    }

    fn presence(&self) -> &[Presence] {
        self.conductor.presence()
    }

    /// Time between the first and the last node that said what the last tick came to, ns.
    fn skew(&self) -> u64 {
        let times = || self.conductor.stamps().iter().filter_map(|stamps| stamps.state);
        u64::try_from((times().max().unwrap() - times().min().unwrap()).as_nanos()).unwrap()
    }

    fn role(&self, index: usize) -> Role {
        self.world.boards()[index].session().keeper().unwrap().role()
    }

    fn extrapolated(&self) -> u32 {
        let nodes = self.world.boards().iter().filter_map(|board| board.session().node());
        nodes.map(|node| node.counters().extrapolated).sum()
    }
}

fn master(number: u8) -> NodeId {
    NodeId::new(number).unwrap()
}

#[test]
fn with_a_time_master_nodes_stay_together_for_as_long_as_they_run() {
    let mut bench = Bench::new("", &[1]);
    bench.run(30_000).unwrap();
    // Five minutes: without it the clocks would be 90 ms apart. What is left is the way of a SYNC.
    assert!(bench.skew() < 1_500_000, "{} ns", bench.skew());
    assert_eq!((bench.extrapolated(), bench.unrecorded), (0, 0));
    let SyncCounts { frames, kept, masters } = bench.conductor.syncs().unwrap();
    assert!((3_000..3_030).contains(&frames), "{frames}");
    assert_eq!((kept, masters), (0, 1));
    bench.world.run(bench.conductor.finish()).unwrap();
}

#[test]
fn without_one_the_same_clocks_run_apart_and_the_run_says_so() {
    let mut bench = Bench::new("", &[]);
    let error = bench.run(30_000).unwrap_err().to_string();
    assert!(error.contains("runs apart from the others"), "{error}");
    assert!(bench.extrapolated() > 100, "{}", bench.extrapolated());
    assert!(bench.skew() > 9_000_000, "{} ns", bench.skew());
    assert_eq!(bench.conductor.syncs(), None);
}

#[test]
fn a_node_that_restarts_learns_the_tick_and_is_recorded_again() {
    let mut bench =
        Bench::new("{ at = '5s', kind = 'crash', node = 3 }, { at = '8s', kind = 'join', node = 3 }", &[1]);
    bench.run(450).unwrap();
    assert_eq!(bench.presence(), [Presence::Ran; NODES]);
    bench.run(700).unwrap();
    assert_eq!(bench.presence()[2], Presence::Off);
    bench.run(6_000).unwrap();
    assert_eq!(bench.presence(), [Presence::Ran; NODES]);
    assert!(bench.skew() < 1_500_000, "{} ns", bench.skew());
    // While it listened nobody knew its state.
    assert!(bench.unrecorded > 0 && bench.unrecorded < 600, "{}", bench.unrecorded);
    let node = bench.world.boards()[2].session().node().unwrap();
    assert_eq!((node.phase(), node.counters().skipped), (Phase::Running, 0));
    bench.world.run(bench.conductor.finish()).unwrap();
}

#[test]
fn one_that_leaves_says_goodbye_and_one_that_was_absent_comes() {
    let mut bench =
        Bench::new("{ at = '2s', kind = 'join', node = 4 }, { at = '5s', kind = 'leave', node = 2 }", &[1]);
    bench.run(150).unwrap();
    assert_eq!(bench.presence(), [Presence::Ran, Presence::Ran, Presence::Ran, Presence::Off]);
    let lost = |bench: &Bench, index: usize| {
        let counters = bench.world.boards()[index].session().node().unwrap().counters();
        (counters.neighbours_lost, counters.extrapolated)
    };
    bench.run(480).unwrap();
    let before = [lost(&bench, 0), lost(&bench, 2)];
    bench.run(600).unwrap();
    assert_eq!(bench.presence()[1], Presence::Off);
    // Its neighbours drop the edge at once, and extrapolate nothing.
    let dropped = |(lost, extrapolated)| (lost + 1, extrapolated);
    assert_eq!([lost(&bench, 0), lost(&bench, 2)], before.map(dropped));
    bench.run(3_000).unwrap();
    assert_eq!(bench.presence(), [Presence::Ran, Presence::Off, Presence::Ran, Presence::Ran]);
    assert_eq!(bench.conductor.events().len(), 1, "{:?}", bench.conductor.events());
    let reports = bench.world.run(bench.conductor.finish()).unwrap();
    assert_eq!(reports.iter().map(Option::is_some).collect::<Vec<_>>(), [true, false, true, true]);
}

#[test]
fn a_master_that_dies_is_followed_within_three_periods_and_leads_again_when_it_is_back() {
    let mut bench = Bench::new("{ at = '5s', kind = 'bounce', node = 1, for = '5s' }", &[1, 2]);
    // A tick before its 5 s and three periods are over.
    bench.run(531).unwrap();
    assert_eq!((bench.role(1), bench.role(2)), (Role::Leads, Role::Follows(master(2))));
    bench.run(6_000).unwrap();
    assert_eq!((bench.role(0), bench.role(1)), (Role::Leads, Role::Follows(master(1))));
    assert_eq!(bench.presence(), [Presence::Ran; NODES]);
    assert!(bench.skew() < 1_500_000, "{} ns", bench.skew());
    assert_eq!(bench.conductor.syncs().unwrap().masters, 3);
}

#[test]
fn the_only_master_that_restarts_can_learn_the_tick_from_nobody_and_the_run_names_it() {
    let mut bench = Bench::new("{ at = '5s', kind = 'bounce', node = 1, for = '1s' }", &[1]);
    let error = bench.run(6_000).unwrap_err().to_string();
    assert!(error.contains("node 1 goes on speaking, but said no telemetry of tick 6"), "{error}");
}

#[test]
fn where_sync_is_kept_back_nodes_hold_over_and_come_together_again() {
    let mut bench = Bench::new("{ at = '60s', kind = 'sync-loss', for = '20s' }", &[1]);
    bench.run(7_000).unwrap();
    let kept = bench.conductor.syncs().unwrap().kept;
    assert!((80..120).contains(&kept), "{kept}");
    // They know their rates by then.
    bench.run(7_900).unwrap();
    assert!(bench.skew() < 3_000_000, "{} ns", bench.skew());
    bench.run(12_000).unwrap();
    assert!(bench.skew() < 1_500_000, "{} ns", bench.skew());
    assert_eq!(bench.conductor.syncs().unwrap().masters, 1);
}

#[test]
fn the_sync_of_one_master_kept_back_makes_the_next_one_lead_until_it_is_heard_again() {
    let mut bench = Bench::new("{ at = '10s', kind = 'sync-loss', node = 1, for = '5s' }", &[1, 2]);
    bench.run(1_400).unwrap();
    assert_eq!((bench.role(1), bench.role(3)), (Role::Leads, Role::Follows(master(2))));
    bench.run(3_000).unwrap();
    assert_eq!((bench.role(0), bench.role(1)), (Role::Leads, Role::Follows(master(1))));
}

#[test]
fn a_node_that_comes_where_nobody_tells_the_tick_is_named() {
    let events = "{ at = '5s', kind = 'crash', node = 3 }, { at = '5900ms', kind = 'sync-loss', for = '60s' }, \
                  { at = '6s', kind = 'join', node = 3 }";
    let error = Bench::new(events, &[1]).run(3_000).unwrap_err().to_string();
    assert!(error.contains("node 3") && error.contains("tick by the SYNC of a time master"), "{error}");
}

#[test]
fn boards_that_keep_their_power_are_told_to_stop_and_come_back_by_another_configuration() {
    let events = "{ at = '5s', kind = 'crash', node = 3 }, { at = '8s', kind = 'join', node = 3 }";
    let world = World::new(NODES, TRAVEL, Peace).with_drifts(&DRIFTS);
    let mut bench = Bench::of(world, (events, &[1]), |conductor| conductor);
    bench.run(700).unwrap();
    assert_eq!(bench.presence()[2], Presence::Off);
    assert_eq!(bench.world.boards()[2].session().node().unwrap().phase(), Phase::Stopped);
    bench.run(6_000).unwrap();
    assert_eq!(bench.presence(), [Presence::Ran; NODES]);
    assert_eq!(bench.conductor.contradictions(), [""; 0]);
}

#[test]
fn on_a_bus_nodes_hear_the_master_themselves_and_the_host_carries_its_sync_to_lines() {
    let events = "{ at = '5s', kind = 'bounce', node = 3, for = '1s' }";
    let mut world = World::new(NODES, TRAVEL, Peace).with_drifts(&DRIFTS).with_bus(&[0, 1, 2], false);
    world.has_power = true;
    let on_can = |conductor: Conductor| {
        conductor.with_can(vec![("can0".to_owned(), false)], |index| (index < 3).then_some(0))
    };
    let mut bench = Bench::of(world, (events, &[1, 4]), on_can);
    bench.run(580).unwrap();
    assert_eq!(bench.presence()[2], Presence::Off);
    bench.run(6_000).unwrap();
    assert_eq!(bench.presence(), [Presence::Ran; NODES]);
    assert_eq!([1, 3].map(|index| bench.role(index)), [Role::Follows(master(1)); 2]);
    assert_eq!(bench.conductor.can().map(|(_, counts)| counts.strangers).sum::<u64>(), 0);
    let ticks: Vec<_> =
        bench.world.boards().iter().map(|board| board.session().node().unwrap().tick()).collect();
    assert!(ticks.iter().all(|&tick| tick.abs_diff(ticks[0]) <= 1), "{ticks:?}");
    let reports = bench.world.run(bench.conductor.finish()).unwrap();
    assert_eq!(bench.conductor.unheard(&reports), [0; 0]);
}

/// What a node accepts of SYNC says nothing of what it hears of states.
#[test]
fn a_node_on_a_bus_that_takes_sync_and_no_state_has_heard_nobody() {
    let mut world = World::new(NODES, TRAVEL, Peace).with_drifts(&DRIFTS).with_bus(&[0, 1, 2, 3], false);
    [0, 2].iter().for_each(|&index| world.board_mut(index).is_deaf = true);
    let on_can = |conductor: Conductor| conductor.with_can(vec![("can0".to_owned(), false)], |_| Some(0));
    // What an event keeps back is not carried, and heard on the bus all the same.
    let mut bench = Bench::of(world, ("{ at = '2s', kind = 'sync-loss', for = '1s' }", &[2]), on_can);
    bench.run(1_000).unwrap();
    assert_eq!(bench.role(2), Role::Follows(master(2)));
    let reports = bench.world.run(bench.conductor.finish()).unwrap();
    assert_eq!(bench.conductor.unheard(&reports), [2, 4]);
}

#[test]
fn on_a_bus_where_all_have_left_nobody_says_sync() {
    let events = "{ at = '5s', kind = 'leave', node = 3 }, { at = '5s', kind = 'leave', node = 4 }";
    let world = World::new(NODES, TRAVEL, Peace).with_drifts(&DRIFTS).with_bus(&[0, 1], false);
    let on_can = |conductor: Conductor| {
        let buses = ["can0", "can1"].map(|name| (name.to_owned(), false));
        conductor.with_can(buses.to_vec(), |index| Some(index / 2))
    };
    let mut bench = Bench::of(world.with_bus(&[2, 3], false), (events, &[1]), on_can);
    let frames =
        |bench: &Bench| bench.conductor.can().map(|(_, counts)| counts.frames).collect::<Vec<_>>()[1];
    bench.run(400).unwrap();
    assert_eq!(bench.role(2), Role::Follows(master(1)));
    bench.run(600).unwrap();
    let before = frames(&bench);
    bench.run(1_500).unwrap();
    assert_eq!((frames(&bench), bench.presence()[3]), (before, Presence::Off));
}

/// What is set names a tick of the network's time, and leaves the rules of time as they are.
#[test]
fn what_is_set_is_adopted_at_one_tick_also_by_clocks_that_drift() {
    let set = "{ at = '40s', kind = 'set', key = 'coupling.funnel.width', value = 5.0 }";
    let mut bench = Bench::new(set, &[1]);
    bench.run(3_999).unwrap();
    let widths =
        |bench: &Bench| -> Vec<f32> { bench.conductor.observations().iter().map(|seen| seen.psi).collect() };
    assert_eq!(widths(&bench), [20.0; NODES]);
    bench.run(4_010).unwrap();
    assert_eq!(widths(&bench), [5.0; NODES]);
    bench.run(6_000).unwrap();
    bench.world.run(bench.conductor.finish()).unwrap();
    let adopted =
        bench.conductor.events().iter().filter(|event| event.event == Event::Adopted { tick: 4_000 });
    assert_eq!(adopted.count(), NODES);
    assert_eq!(bench.conductor.contradictions(), [""; 0]);
    assert!(bench.skew() < 1_500_000, "{} ns", bench.skew());
}

/// With and without its power in the host's hands: a board's storage still has what was staged.
#[test]
fn a_node_that_was_off_before_what_is_set_has_missed_it() {
    let events = "{ at = '10s', kind = 'bounce', node = 3, for = '1s' }, \
                  { at = '40s', kind = 'set', key = 'coupling.funnel.width', value = 5.0 }";
    for has_power in [true, false] {
        let mut world = World::new(NODES, TRAVEL, Peace).with_drifts(&DRIFTS);
        world.has_power = has_power;
        let mut bench = Bench::of(world, (events, &[1]), |conductor| conductor);
        bench.run(6_000).unwrap();
        assert_eq!(bench.presence(), [Presence::Ran; NODES]);
        let widths: Vec<_> = bench.conductor.observations().iter().map(|seen| seen.psi).collect();
        assert_eq!(widths, [5.0, 5.0, 20.0, 5.0], "{has_power}");
        bench.world.run(bench.conductor.finish()).unwrap();
        assert_eq!(bench.conductor.missed_commits(), [2], "{has_power}");
    }
}

/// A node that comes says that it starts anew, which is not its end. Fields change states by at most 1 unit/s here.
#[test]
fn where_what_is_heard_has_limits_a_node_that_comes_goes_on_after_it_has_said_so() {
    // Honest nodes move by 0.1 a second, and by 0.2 where a newcomer is behind.
    let text = RING.replace("slope = -1.0, offset = 1.0", "slope = -0.1, offset = 0.1")
        + "\nsafety = { heard_rate = 0.3, drop_after = 3 }";
    let scenario = of_text(&text, "{ at = '40s', kind = 'bounce', node = 3, for = '1s' }", &[1]);
    let mut world = World::new(NODES, TRAVEL, Peace).with_drifts(&DRIFTS);
    world.has_power = true;
    let mut bench = Bench::all_of(world, &scenario, &[1], |conductor| conductor);
    bench.run(6_000).unwrap();
    assert_eq!(bench.presence(), [Presence::Ran; NODES]);
    let nodes = bench.world.boards().iter().filter_map(|board| board.session().node());
    assert_eq!(nodes.map(|node| node.counters().kept.barred).sum::<u32>(), 0);
    assert_eq!(bench.conductor.contradictions(), [""; 0]);
}

#[test]
fn one_that_leaves_while_it_waits_for_its_tick_goes_without_a_word_and_may_come_again() {
    let events = "{ at = '5s', kind = 'crash', node = 3 }, { at = '8s', kind = 'join', node = 3 }, \
                  { at = '8050ms', kind = 'leave', node = 3 }, { at = '12s', kind = 'join', node = 3 }";
    for has_power in [true, false] {
        let mut world = World::new(NODES, TRAVEL, Peace).with_drifts(&DRIFTS);
        world.has_power = has_power;
        let mut bench = Bench::of(world, (events, &[1]), |conductor| conductor);
        bench.run(1_100).unwrap();
        assert_eq!(bench.presence()[2], Presence::Off);
        bench.run(3_000).unwrap();
        assert_eq!(bench.presence(), [Presence::Ran; NODES]);
    }
}

/// Says a warning before each goodbye.
struct Warns;

impl Fate for Warns {
    fn carry(&mut self, _: usize, way: Way, _: u64, frame: Vec<u8>) -> Vec<Vec<u8>> {
        let mut bytes = frame.clone();
        bytes.pop();
        let Ok(Frame::RealTime(Message::Fault { source, code: FaultCode::LEAVES, arg, tick, .. })) =
            serial::decode(&mut bytes)
        else {
            return vec![frame];
        };
        if way == Way::ToNode {
            return vec![frame];
        }
        let (code, severity) = (FaultCode::COMMIT, Severity::Warning);
        vec![serial::encode(&Message::Fault { source, code, severity, arg, tick }).to_vec(), frame]
    }

    fn befall(&mut self, _: usize, _: u64) -> Blow {
        Blow::None
    }
}

#[test]
fn a_warning_is_no_goodbye() {
    let world = World::new(NODES, TRAVEL, Warns).with_drifts(&DRIFTS);
    let scenario = ring("{ at = '5s', kind = 'leave', node = 2 }", &[1]);
    let mut bench = Bench::all_of(world, &scenario, &[1], |conductor| conductor);
    bench.run(600).unwrap();
    let events: Vec<_> = bench.conductor.events().iter().map(|event| event.event).collect();
    assert_eq!(events, [Event::Warned(FaultCode::COMMIT), Event::Stopped]);
    assert_eq!(bench.presence()[1], Presence::Off);
}

/// Nobody to join: it says its state at once, before it has told of a tick.
#[test]
fn the_first_state_of_a_node_without_coupling_that_was_long_away_is_taken_for_what_it_is() {
    let text = RING.replace("'node-wise'", "'none'");
    let scenario = of_text(&text, "{ at = '5s', kind = 'bounce', node = 3, for = '5s' }", &[1]);
    let mut world = World::new(NODES, TRAVEL, Peace).with_drifts(&DRIFTS);
    world.has_power = true;
    let mut bench = Bench::all_of(world, &scenario, &[1], |conductor| conductor);
    bench.run(2_000).unwrap();
    assert_eq!(bench.presence(), [Presence::Ran; NODES]);
    assert_eq!(bench.conductor.contradictions(), [""; 0]);
}

/// With and without its power in the host's hands, it is configured anew when it comes.
#[test]
fn a_node_that_has_adopted_what_is_set_comes_back_with_it() {
    let events = "{ at = '20s', kind = 'set', key = 'coupling.funnel.width', value = 5.0 }, \
                  { at = '30s', kind = 'bounce', node = 3, for = '1s' }";
    for has_power in [true, false] {
        let mut world = World::new(NODES, TRAVEL, Peace).with_drifts(&DRIFTS);
        world.has_power = has_power;
        let mut bench = Bench::of(world, (events, &[1]), |conductor| conductor);
        bench.run(6_000).unwrap();
        let widths: Vec<_> = bench.conductor.observations().iter().map(|seen| seen.psi).collect();
        assert_eq!(widths, [5.0; NODES], "{has_power}");
        bench.world.run(bench.conductor.finish()).unwrap();
        assert_eq!(bench.conductor.missed_commits(), [0; 0], "{has_power}");
        let is_adopted = |event: Event| event == Event::Adopted { tick: 2_000 };
        let adopted = bench.conductor.events().iter().filter(|event| is_adopted(event.event));
        assert_eq!(adopted.count(), NODES);
        assert_eq!(bench.conductor.contradictions(), [""; 0]);
    }
}

#[test]
fn a_clock_that_no_sync_can_make_up_for_runs_apart_and_the_run_says_so() {
    let world = World::new(NODES, TRAVEL, Peace).with_drifts(&[0, 500_000, 0, 0]);
    let mut bench = Bench::of(world, ("", &[1]), |conductor| conductor);
    let error = bench.run(30_000).unwrap_err().to_string();
    assert!(error.contains("node 2 runs apart"), "{error}");
    assert!(error.contains("more than the SYNC of a time master make up for"), "{error}");
}
