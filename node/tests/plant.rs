//! Nodes with a plant: sampled heaters that differ from their models, actuators with limits, sensors that
//! fail.
#![allow(clippy::unwrap_used, clippy::panic)]

mod heaters;

use funnelnet_law::gain::Reciprocal;
use funnelnet_law::law::node_wise::{Memory, NodeWise};
use funnelnet_node::watchdog::Policy;
use funnelnet_node::{Event, InputRange, Output, Params, Phase, PlantSetup, Session};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{Breach, ConfigError, ConfigField, Coupling, Field, TickSource};
use funnelnet_protocol::message::{Command, Component, FaultCode, Message, TickStamp};
use heaters::{Heater, Heaters, Known, TICK_S, command, config, id, session, state, sync, tell};

const UNCHANGED: fn(NodeConfig) -> NodeConfig = |config| config;

/// Five heaters that would end far apart.
fn five() -> Vec<Heater> {
    let heater =
        |(index, loss): (u8, f64)| Heater { loss, power: 0.2 + 0.15 * f64::from(index), x: 15.0, u: 0.0 };
    (0..).zip([0.02, 0.012, 0.03, 0.008, 0.02]).map(heater).collect()
}

fn alone(heaters: &[Heater]) -> (f64, f64) {
    let alone = heaters.iter().map(Heater::alone);
    (alone.clone().fold(f64::MAX, f64::min), alone.fold(f64::MIN, f64::max))
}

/// Two equal heaters without losses; the second one is talked for by the test.
fn pair() -> Session<Known> {
    session(Known::badly(Heater { x: 20.0, ..Heater::default() }), config(1, &[2]))
}

/// The first node of a pair, started, with a sample of 20 at its start.
fn started() -> Session<Known> {
    let mut node = pair();
    tell(&mut node, command(Command::Start));
    answer(&mut node, Some(20.0));
    node
}

/// Drains the session; a sample is answered with `x`, or fails.
fn answer(node: &mut Session<Known>, x: Option<f32>) -> Vec<Output> {
    let mut outputs = Vec::new();
    while let Some(output) = node.poll(0) {
        match (&output, x) {
            (Output::Sample, Some(x)) => node.measured(&[x]),
            (Output::Sample, None) => node.sample_failed(),
            _ => {}
        }
        outputs.push(output);
    }
    outputs
}

#[test]
fn heaters_that_differ_from_their_models_agree_within_the_funnel() {
    let mut heaters = Heaters::path(five(), UNCHANGED);
    let (low, high) = alone(&heaters.plants);
    assert!(high - low > 60.0, "a task that needs the law: {low} to {high}");
    heaters.run(3000);
    for (index, session) in heaters.sessions.iter().enumerate() {
        let report = session.node().unwrap().report();
        assert!(report.max_ratio < 1.0, "node {} left its funnel: {}", index + 1, report.max_ratio);
        let counters = report.counters;
        assert_eq!((counters.ticks, counters.coasted, counters.saturated), (3000, 0, 0));
    }
    // |nu| < 0.5 at every node: the differences of neighbours along the path grow by at most that.
    assert!(heaters.spread() < 0.5 + 1.0 + 1.0 + 0.5, "{}", heaters.spread());
    assert!(heaters.plants.iter().all(|plant| plant.x > low && plant.x < high), "{:?}", heaters.plants);
}

#[test]
fn without_a_model_the_input_alone_predicts_well_enough() {
    let mut heaters = Heaters::path(five(), UNCHANGED);
    for (session, id) in heaters.sessions.iter_mut().zip(1..) {
        let others: Vec<_> = [id - 1, id + 1].into_iter().filter(|&id| (1..=5).contains(&id)).collect();
        *session = heaters::session(Known::badly(Heater::default()), config(id, &others));
    }
    heaters.tell_all(command(Command::Start));
    heaters.run(3000);
    for session in &heaters.sessions {
        let ratio = session.node().unwrap().report().max_ratio;
        assert!(ratio < 1.0, "left its funnel: {ratio}");
    }
}

#[test]
fn nothing_is_announced_that_was_not_measured() {
    let mut node = pair();
    tell(&mut node, command(Command::Start));
    assert_eq!(node.poll_at(), Some(0));
    assert_eq!(node.poll(0), Some(Output::Sample));
    assert_eq!(node.poll(0), Some(Output::Report(Event::Started)));
    assert_eq!((node.poll(0), node.poll_at()), (None, None), "it asks once, and waits");
    node.measured(&[21.5]);
    let Some(Output::Send(Message::State { x, tick, .. })) = node.poll(0) else { panic!() };
    assert_eq!((x, tick.value()), (21.5, 0));
    node.measured(&[99.0]);
    assert_eq!(node.node().unwrap().state().next(), Some(21.5), "nobody has asked for this one");
}

#[test]
fn a_tick_waits_for_its_sample_and_its_input_goes_first() {
    let mut node = started();
    tell(&mut node, state(2, 0, 24.0));
    tell(&mut node, sync(0));
    let outputs = answer(&mut node, Some(20.0));
    let place = |wanted: &dyn Fn(&Output) -> bool| outputs.iter().position(wanted).unwrap();
    let sample = place(&|output| *output == Output::Sample);
    let actuate = place(&|output| *output == Output::Actuate);
    let send = place(&|output| matches!(output, Output::Send(Message::State { .. })));
    assert!(sample < actuate && actuate < send, "{outputs:?}");
    let u = node.inputs()[0];
    assert!(u > 0.0);
    // What is sent is where the model sees the plant at the next tick.
    let Output::Send(Message::State { x, tick, .. }) = outputs[send] else { panic!() };
    assert_eq!((x, tick.value()), (20.0 + TICK_S as f32 * u, 1));
}

#[test]
fn the_law_sees_the_measurement_and_its_change_and_not_the_prediction() {
    let mut node = started();
    for (k, x) in [(0, 20.0), (1, 18.0)] {
        tell(&mut node, state(2, k, 24.0));
        tell(&mut node, sync(k));
        answer(&mut node, Some(x));
    }
    let seen = node.node().unwrap().observations()[0];
    assert_eq!((seen.tick, seen.x, seen.nu), (1, 18.0, 6.0));
    // (*) by hand: nu = 6, dnu = 24 - 24 - (18 - 20), the input of tick 0 from nu = 4 without memory.
    let law = NodeWise::new(Reciprocal { scale: 0.3 }, TICK_S, 1.0);
    let params = Params::<f32>::new(&config(1, &[2])).unwrap();
    let mut memory = Memory::default();
    law.step(&mut memory, 4.0, 0.0, params.funnel.widths(0));
    let u = law.step(&mut memory, 6.0, 2.0, params.funnel.widths(1)).u;
    assert!((seen.u - u).abs() < 1e-6 * u, "{} instead of {u}", seen.u);
}

/// A node that can do 2 K/s follows a neighbour that jumps up by 20 K and, when it is there, stays. By how
/// much does it overshoot, K?
fn overshoot_of_node(coupling: Coupling<f32>) -> f64 {
    let mut known = Known::badly(Heater::default());
    known.plant.inputs = [InputRange::new(-2.0, 2.0).unwrap()].into_iter().collect();
    let config = NodeConfig { coupling, funnel: heaters::constant(1.0), ..config(1, &[2]) };
    let mut node = session(known, config);
    let mut plant = Heater::default();
    tell(&mut node, command(Command::Start));
    answer(&mut node, Some(0.0));
    let mut most = f64::MIN;
    for k in 0..1000 {
        tell(&mut node, state(2, k, 20.0));
        tell(&mut node, sync(k));
        answer(&mut node, Some(plant.x as f32));
        plant.u = f64::from(node.inputs()[0]);
        assert!(plant.u.abs() <= 2.0);
        plant.advance();
        most = most.max(plant.x - 20.0);
    }
    assert!(node.node().unwrap().counters().saturated > 90, "10 s at the limit");
    most
}

/// The same with the law by itself, with or without feedback of what the actuator did.
fn overshoot_of_law(feedback: bool) -> f64 {
    let law = NodeWise::new(Reciprocal { scale: 0.3 }, TICK_S, 1.0);
    let params =
        Params::<f64>::new(&NodeConfig { funnel: heaters::constant(1.0), ..config(1, &[2]) }).unwrap();
    let (mut plant, mut memory) = (Heater::default(), Memory::default());
    let (mut before, mut most) = (0.0, f64::MIN);
    for k in 0..1000 {
        let (nu, dnu) = (20.0 - plant.x, before - plant.x);
        before = plant.x;
        plant.u = law.step(&mut memory, nu, dnu, params.funnel.widths(k)).u.clamp(-2.0, 2.0);
        if feedback {
            memory.feed_back(plant.u);
        }
        plant.advance();
        most = most.max(plant.x - 20.0);
    }
    most
}

#[test]
fn an_actuator_at_its_limit_does_not_wind_up() {
    let (with, without) = (overshoot_of_law(true), overshoot_of_law(false));
    assert!(without > 15.0 && with < 0.05, "the feedback matters: {without} without, {with} with");
    for coupling in [Coupling::NodeWise, Coupling::MaxGain, Coupling::EdgeWise] {
        let node = overshoot_of_node(coupling);
        assert!(node < 0.05, "{coupling:?}: {node}");
    }
}

#[test]
fn a_node_without_its_sensor_coasts_on_its_prediction() {
    let mut heaters = Heaters::path(five(), UNCHANGED);
    heaters.run(1000);
    heaters.blind = vec![2];
    heaters.run(3);
    heaters.blind.clear();
    heaters.run(1000);
    let node = heaters.sessions[2].node().unwrap();
    assert_eq!((node.phase(), node.counters().coasted), (Phase::Running, 3));
    assert!(node.report().max_ratio < 1.0, "{}", node.report().max_ratio);
    // A sample in between ends the count.
    for _ in 0..5 {
        heaters.blind = vec![2];
        heaters.run(3);
        heaters.blind.clear();
        heaters.run(1);
    }
    assert_eq!(heaters.sessions[2].node().unwrap().phase(), Phase::Running);
}

#[test]
fn while_it_coasts_its_state_is_the_prediction() {
    let mut node = started();
    tell(&mut node, state(2, 0, 24.0));
    tell(&mut node, sync(0));
    answer(&mut node, Some(20.0));
    let predicted = node.node().unwrap().state().next().unwrap();
    assert!(predicted > 20.0);
    tell(&mut node, sync(1));
    assert!(answer(&mut node, None).contains(&Output::Actuate), "the plant is still driven");
    assert_eq!(node.node().unwrap().observations()[0].x, predicted);
}

#[test]
fn after_too_long_it_stops_with_a_fault_and_a_safe_output() {
    let mut heaters = Heaters::path(five(), UNCHANGED);
    heaters.run(100);
    heaters.blind = vec![2];
    heaters.run(3);
    assert_eq!(heaters.sessions[2].node().unwrap().phase(), Phase::Running);
    heaters.asked.clear();
    heaters.run(1);
    let node = heaters.sessions[2].node().unwrap();
    assert_eq!((node.phase(), node.counters().coasted), (Phase::Faulted(FaultCode::PLANT), 4));
    let of_node: Vec<_> =
        heaters.asked.iter().filter(|(index, _)| *index == 2).map(|(_, output)| output).collect();
    assert_eq!(of_node[..2], [&Output::Sample, &Output::Safe], "no further input");
    assert_eq!(heaters.plants[2].u, 0.0);
}

#[test]
fn what_cannot_be_a_state_is_a_sample_that_failed() {
    for bad in [&[f32::NAN][..], &[f32::INFINITY], &[200.1], &[-200.1], &[], &[20.0, 20.0]] {
        let mut node = started();
        tell(&mut node, sync(0));
        assert_eq!(node.poll(0), Some(Output::Sample));
        node.measured(bad);
        let node = node.node().unwrap();
        assert_eq!((node.counters().coasted, node.tick()), (1, 1), "{bad:?}");
        assert_eq!(node.observations()[0].x, 20.0);
    }
}

#[test]
fn every_way_to_stop_makes_the_output_safe_at_once() {
    type Stop = fn(&mut Session<Known>);
    let stops: [(&str, Stop); 4] = [
        ("stop", |node| tell(node, command(Command::Stop))),
        ("a twin", |node| tell(node, state(1, 0, 1.0))),
        ("the platform", |node| node.fail(FaultCode::BUS_OFF, 1)),
        ("the sensor", |node| {
            for k in 0..4 {
                tell(node, sync(k));
                assert_eq!(node.poll(0), Some(Output::Sample));
                node.sample_failed();
                // All but the fourth are followed by an input.
                assert!(k == 3 || node.poll(0) == Some(Output::Actuate));
                while k < 3 && node.poll(0).is_some() {}
            }
        }),
    ];
    for (name, stop) in stops {
        let mut node = started();
        stop(&mut node);
        assert_eq!(node.poll_at(), Some(0), "{name}");
        let outputs = answer(&mut node, Some(20.0));
        assert_eq!(outputs[0], Output::Safe, "{name}");
        let others = outputs[1..].iter().filter(|output| {
            matches!(
                output,
                Output::Safe | Output::Sample | Output::Actuate | Output::Send(Message::State { .. })
            )
        });
        assert_eq!(others.count(), 0, "{name}: {outputs:?}");
    }
}

#[test]
fn a_stop_while_a_tick_waits_for_its_sample_drops_the_tick() {
    let mut node = started();
    tell(&mut node, sync(0));
    assert_eq!(node.poll(0), Some(Output::Sample));
    tell(&mut node, command(Command::Stop));
    node.measured(&[25.0]);
    assert_eq!(answer(&mut node, None), [Output::Safe, Output::Report(Event::Stopped)]);
    assert_eq!(node.node().unwrap().tick(), 0);
}

#[test]
fn a_virtual_node_that_stops_says_so_too() {
    let breach = NodeConfig { on_breach: Breach::Stop, funnel: heaters::constant(1.0), ..config(1, &[2]) };
    let mut node = session(funnelnet_node::Configured, breach);
    tell(&mut node, command(Command::Start));
    while node.poll(0).is_some() {}
    tell(&mut node, state(2, 0, 24.0));
    tell(&mut node, sync(0));
    assert_eq!(node.poll(0), Some(Output::Safe));
    assert_eq!(node.node().unwrap().phase(), Phase::Faulted(FaultCode::FUNNEL_LEFT));
    // A new configuration must not swallow what the old node had to say.
    let mut node = session(funnelnet_node::Configured, config(1, &[2]));
    tell(&mut node, command(Command::Start));
    while node.poll(0).is_some() {}
    tell(&mut node, command(Command::Stop));
    *node.config_buffer() = Some(config(1, &[2]));
    node.restore().unwrap();
    assert_eq!((node.poll(0), node.poll(0)), (Some(Output::Safe), None));
}

#[test]
fn a_virtual_node_is_never_asked_for_a_sample() {
    let timer = NodeConfig { tick_source: TickSource::Timer, ..config(1, &[2]) };
    let mut node = session(funnelnet_node::Configured, timer);
    tell(&mut node, command(Command::Start));
    node.sample_failed();
    node.measured(&[3.0]);
    let outputs: Vec<_> = (0..10)
        .flat_map(|k| {
            let node = &mut node;
            std::iter::from_fn(move || node.poll(k * 100_000_000)).collect::<Vec<_>>()
        })
        .collect();
    assert!(!outputs.contains(&Output::Sample) && !outputs.contains(&Output::Actuate), "{outputs:?}");
    assert_eq!((node.node().unwrap().tick(), node.inputs()), (9, &[][..]));
    assert_eq!(node.node().unwrap().counters().coasted, 0);
}

#[test]
fn a_sync_that_comes_before_the_sample_takes_it_over() {
    let mut node = started();
    tell(&mut node, sync(0));
    assert_eq!(node.poll(0), Some(Output::Sample));
    tell(&mut node, sync(1));
    node.measured(&[20.0]);
    answer(&mut node, Some(30.0));
    let counters = node.node().unwrap().counters().clone();
    assert_eq!((counters.ticks, counters.sync_gaps, node.node().unwrap().tick()), (1, 1, 2));
    tell(&mut node, sync(2));
    answer(&mut node, Some(20.0));
    assert_eq!((node.node().unwrap().tick(), node.node().unwrap().counters().sync_gaps), (3, 1));
}

#[test]
fn a_tick_that_never_gets_its_sample_is_not_fed_over_by_the_syncs_that_follow() {
    let mut node = started();
    let mut policy = Policy::default();
    for k in 0..20 {
        tell(&mut node, sync(k));
        while node.poll(0).is_some() {}
        assert!(!policy.may_feed(node.progress(), 0), "fed at SYNC {k}, and no tick has run");
    }
    node.measured(&[20.0]);
    assert!(policy.may_feed(node.progress(), 0), "the one that has run");
    assert_eq!(node.node().unwrap().counters().ticks, 1);
}

#[test]
fn every_component_has_limits_of_its_own() {
    let mut known = Known::badly(Heater::default());
    known.plant = PlantSetup::new(
        [(-1.0, 0.5), (-0.25, 1.0)].map(|(low, high)| InputRange::new(low, high).unwrap()),
        3,
    );
    let field = Field { offset: [0.0, 0.0].into_iter().collect(), ..config(1, &[2]).field };
    let initial_state = [0.0, 0.0].into_iter().collect();
    let mut node = session(known, NodeConfig { initial_state, field, ..config(1, &[2]) });
    tell(&mut node, command(Command::Start));
    assert_eq!(node.poll(0), Some(Output::Sample));
    node.measured(&[20.0, 40.0]);
    while node.poll(0).is_some() {}
    for (component, x) in [(0, 59.0), (1, 1.0)] {
        let component = Component::new(component).unwrap();
        tell(&mut node, Message::State { source: id(2), component, tick: TickStamp::full(0), x });
    }
    tell(&mut node, sync(0));
    assert_eq!(node.poll(0), Some(Output::Sample));
    node.measured(&[20.0, 40.0]);
    assert_eq!(node.inputs(), [0.5, -0.25]);
    let counters = node.node().unwrap().counters();
    assert_eq!((counters.coasted, counters.saturated), (0, 1));
}

#[test]
fn a_plant_that_its_model_sees_beyond_its_limit_is_not_driven_further() {
    let mut node = session(Known::badly(Heater { power: 10.0, ..Heater::default() }), config(1, &[2]));
    tell(&mut node, command(Command::Start));
    answer(&mut node, Some(199.9));
    tell(&mut node, sync(0));
    let outputs = answer(&mut node, Some(199.9));
    let node = node.node().unwrap();
    assert_eq!(node.phase(), Phase::Faulted(FaultCode::STATE_LIMIT), "{:?}", node.observations());
    assert_eq!(outputs[..2], [Output::Sample, Output::Safe]);
}

#[test]
fn a_plant_with_another_number_of_components_is_refused_by_name() {
    let mut known = Known::badly(Heater::default());
    known.plant.inputs = [InputRange::new(-1.0, 1.0).unwrap(); 2].into_iter().collect();
    let identity = funnelnet_protocol::service::Identity { wire_version: 1, ..Default::default() };
    let mut session = Session::with_model(identity, known);
    *session.config_buffer() = Some(config(1, &[2]));
    let refused = session.restore();
    let expected =
        ConfigError::OutOfRange { field: ConfigField::Components, index: 0, found: 1.0, low: 2.0, high: 2.0 };
    assert_eq!(refused, Err(expected));
}

#[test]
fn a_range_without_the_zero_input_is_refused_with_its_limits() {
    for (low, high) in [(0.1, 1.0), (-1.0, -0.1), (0.0, 0.0), (f32::NAN, 1.0), (-1.0, f32::INFINITY)] {
        let refused = InputRange::new(low, high).unwrap_err().to_string();
        assert!(refused.contains(&low.to_string()) && refused.contains(&high.to_string()), "{refused}");
    }
    assert_eq!(InputRange::new(0.0, 2.0).unwrap().clamp(-1.0), 0.0);
}

/// Drains a session whose samples and replies each take `cost` ns. Gives the states sent, and whether the
/// drain has come to its end.
fn drain_slowly<M: funnelnet_node::Model>(node: &mut Session<M>, cost: u64) -> (usize, bool) {
    let (mut now, mut states) = (node.poll_at().unwrap(), 0);
    for _ in 0..10_000 {
        match node.poll(now) {
            None => return (states, true),
            Some(Output::Sample) => {
                now += cost;
                node.measured(&[20.0]);
            }
            Some(Output::Reply(_)) => now += cost,
            Some(Output::Send(Message::State { .. })) => states += 1,
            Some(_) => {}
        }
    }
    (states, false)
}

#[test]
fn telemetry_slower_than_the_ticks_does_not_keep_the_app_from_its_link() {
    let timer = NodeConfig { tick_source: TickSource::Timer, telemetry_every: 1, ..config(1, &[2]) };
    let mut node = session(funnelnet_node::Configured, timer);
    tell(&mut node, command(Command::Start));
    while node.poll(0).is_some() {}
    assert!(drain_slowly(&mut node, 350_000_000).1, "10,000 outputs, and a stop could not have been heard");
}

#[test]
fn a_plant_slower_than_its_ticks_still_tells_its_neighbours() {
    let timer = NodeConfig { tick_source: TickSource::Timer, ..config(1, &[2]) };
    let mut node = session(Known::badly(Heater::default()), timer);
    tell(&mut node, command(Command::Start));
    answer(&mut node, Some(20.0));
    assert!(drain_slowly(&mut node, 110_000_000).0 > 0, "thousands of inputs, and not one state");
}

#[test]
fn a_plant_is_not_measured_for_ticks_whose_time_is_over() {
    let timer = NodeConfig { tick_source: TickSource::Timer, ..config(1, &[2]) };
    let tick = u64::from(timer.tick_ns);
    let mut node = session(Known::badly(Heater::default()), timer);
    tell(&mut node, command(Command::Start));
    answer(&mut node, Some(20.0));
    // Tick 0 is due after one period, and this is in the middle of tick 3.
    let now = tick + 3 * tick + tick / 2;
    let (mut samples, mut stamps) = (0, Vec::new());
    while let Some(output) = node.poll(now) {
        match output {
            Output::Sample => {
                samples += 1;
                node.measured(&[20.0]);
            }
            Output::Send(Message::State { tick, .. }) => stamps.push(tick.value()),
            _ => {}
        }
    }
    assert_eq!((samples, stamps), (1, vec![4]));
    assert_eq!(node.poll_at(), Some(5 * tick), "tick 4 is on time again");
    let counters = node.node().unwrap().report().counters;
    assert_eq!((counters.ticks, counters.overruns, counters.skipped), (1, 1, 3));
    assert_eq!(node.progress().completed, 1, "what was skipped feeds no watchdog");
}

/// A model that gives no number where the state is beyond 25.
#[derive(Clone, Copy, Debug)]
struct Lost;

impl funnelnet_law::VectorField<f32> for Lost {
    fn at(&self, _: u64, x: f32) -> f32 {
        if x <= 25.0 { 0.0 } else { f32::NAN }
    }
}

impl funnelnet_node::Model for Lost {
    type Field = Self;

    fn field(&self, _: &NodeConfig, _: f64) -> Result<Self, ConfigError> {
        Ok(*self)
    }

    fn plant(&self) -> Option<PlantSetup> {
        Some(PlantSetup::new([InputRange::new(-100.0, 100.0).unwrap()], 3))
    }
}

#[test]
fn a_field_that_gives_no_number_stops_the_node_safe_and_its_inputs_are_numbers() {
    let mut node = session(Lost, config(1, &[2]));
    tell(&mut node, command(Command::Start));
    let drain = |node: &mut Session<Lost>, x: f32| {
        let mut said = Vec::new();
        while let Some(output) = node.poll(0) {
            if output == Output::Sample {
                node.measured(&[x]);
            }
            assert!(node.inputs().iter().all(|u| u.is_finite()), "{said:?}");
            said.push(output);
        }
        said
    };
    drain(&mut node, 20.0);
    for (tick, x) in [(0, 20.0), (1, 26.0)] {
        tell(&mut node, state(2, tick, 21.0));
        tell(&mut node, sync(tick));
        let said = drain(&mut node, x);
        let driven = said.contains(&Output::Actuate);
        assert_eq!((driven, said.contains(&Output::Safe)), (tick == 0, tick == 1), "{said:?}");
    }
    assert_eq!(node.node().unwrap().phase(), Phase::Faulted(FaultCode::FIELD));
    assert_eq!(node.node().unwrap().state().next(), Some(26.0));
}

#[test]
fn an_actuator_is_given_no_input_for_what_is_not_a_number() {
    let range = InputRange::new(-2.0, 3.0).unwrap();
    for (u, done) in
        [(f32::NAN, 0.0), (-9.0, -2.0), (9.0, 3.0), (-1.0, -1.0), (1.0, 1.0), (f32::INFINITY, 3.0)]
    {
        assert_eq!(range.clamp(u), done, "{u}");
    }
}
