//! A node whose own field is a program.
#![allow(clippy::unwrap_used, clippy::panic)]

use funnelnet_law::program::Operation::{self, *};
use funnelnet_node::{Action, Event, Node, Params, Phase};
use funnelnet_protocol::config::{
    ConfigError, ConfigField, Field, Limits, MAX_CONSTANTS, MAX_OPERATIONS, Program, Shape, Sine,
};
use funnelnet_protocol::message::{Command, FaultCode, Message, Severity, Target};
use funnelnet_protocol::{NodeBuilder, NodeConfig};
use proptest::prelude::*;

const MS: u64 = 1_000_000;

fn builder(x: f32) -> NodeBuilder {
    NodeConfig::builder(1, MS as u32).state([x]).funnel(Shape::Constant { width: 10.0 }).edge(2, 1.0)
}

fn wave() -> Sine<f32> {
    Sine { component: 0, amplitude: 1.0, frequency: 0.5, phase: 0.0 }
}

fn config(operations: &[Operation], constants: &[f32], x: f32) -> NodeConfig {
    let program = Program::new(operations.iter().copied(), constants.iter().copied());
    builder(x).program(program, [wave()]).build().unwrap()
}

fn started(config: &NodeConfig) -> Node {
    let mut node = Node::new(Params::new(config).unwrap(), &config.neighbours);
    let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
    node.on_message(&start, 0).unwrap();
    node
}

/// What the node does up to and with this many ticks.
fn run(node: &mut Node, ticks: u64) -> Vec<Action> {
    let mut said = Vec::new();
    for now in 0..=ticks {
        said.extend(std::iter::from_fn(|| node.poll(now * MS)));
    }
    said
}

fn refused(config: &NodeConfig) -> (ConfigField, u8, f64, f64, f64) {
    match Params::<f32>::new(config) {
        Err(ConfigError::OutOfRange { field, index, found, low, high }) => (field, index, found, low, high),
        other => panic!("{:?}", other.map(|_| ())),
    }
}

#[test]
fn it_follows_its_program() {
    // x' = -x + 3 from 1, alone: 3 - 2 exp(-t).
    let mut config = config(&[State(0), Negate, Constant(0), Add], &[3.0], 1.0);
    config.neighbours.clear();
    let mut node = started(&config);
    run(&mut node, 2_000);
    let x = node.state().next().unwrap();
    assert!((x - (3.0 - 2.0 * funnelnet_law::math::exp(-2.0) as f32)).abs() < 1e-5, "{x}");
}

#[test]
fn a_program_is_refused_by_what_is_wrong_with_it() {
    let with = |operations: &[Operation]| refused(&config(operations, &[1.0], 0.0));
    assert_eq!(with(&[State(1)]), (ConfigField::ProgramState, 0, 1.0, 0.0, 0.0));
    assert_eq!(with(&[State(0), Wave(1), Add]), (ConfigField::ProgramWave, 1, 1.0, 0.0, 0.0));
    assert_eq!(with(&[State(0), Constant(1), Add]), (ConfigField::ProgramConstant, 1, 1.0, 0.0, 0.0));
    assert_eq!(with(&[Input(0)]), (ConfigField::ProgramInput, 0, 0.0, 0.0, -1.0), "a real node has none");
    assert_eq!(with(&[Add]), (ConfigField::ProgramStack, 0, 0.0, 2.0, 16.0));
    assert_eq!(with(&[State(0), Next, Time]), (ConfigField::ProgramComponents, 3, 2.0, 1.0, 1.0));
    let mut unknown = config(&[State(0)], &[], 0.0);
    unknown.program.code.push(0xFF).unwrap();
    assert_eq!(refused(&unknown), (ConfigField::Operation, 1, 255.0, 0.0, 95.0));
    let mut both = config(&[State(0)], &[], 0.0);
    both.field = Field::scalar(-1.0, 0.0, []);
    assert_eq!(refused(&both), (ConfigField::Slope, 0, -1.0, 0.0, 0.0));
    both.field = Field::scalar(0.0, 2.0, []);
    assert_eq!(refused(&both), (ConfigField::Offset, 0, 2.0, 0.0, 0.0));
}

#[test]
fn a_field_that_is_not_finite_at_the_start_is_refused() {
    let (field, index, found, ..) = refused(&config(&[State(0), Logarithm], &[], 0.0));
    assert_eq!((field, index, found), (ConfigField::FieldAtStart, 0, f64::NEG_INFINITY));
    let (field, _, found, ..) = refused(&config(&[State(0), SquareRoot], &[], -1.0));
    assert!(field == ConfigField::FieldAtStart && found.is_nan());
    assert!(Params::<f32>::new(&config(&[State(0), SquareRoot], &[], 1.0)).is_ok());
}

#[test]
fn a_field_that_is_no_number_later_stops_the_node_with_its_last_state() {
    // sqrt(x) - 1 from 0.25: down to zero within a second.
    let mut node = started(&config(&[State(0), SquareRoot, Constant(0), Subtract], &[1.0], 0.25));
    let said = run(&mut node, 2_000);
    assert_eq!(node.phase(), Phase::Faulted(FaultCode::FIELD));
    assert!(said.contains(&Action::Safe) && said.contains(&Action::Report(Event::Fault(FaultCode::FIELD))));
    let faults = said.iter().filter(|action| {
        matches!(
            action,
            Action::Send(Message::Fault { code: FaultCode::FIELD, severity: Severity::Stopped, arg: 0, .. })
        )
    });
    assert_eq!(faults.count(), 1);
    let x = node.state().next().unwrap();
    assert!(x.is_finite() && (0.0..2e-3).contains(&x), "{x}");
}

#[test]
fn limits_bound_the_input_of_a_node_without_a_plant_and_are_counted() {
    let with = |low, high| builder(0.0).limits(Limits { low, high }).build().unwrap();
    let mut node = started(&with(-0.5, 0.25));
    let said = |x| Message::State {
        source: funnelnet_protocol::NodeId::new(2).unwrap(),
        component: funnelnet_protocol::Component::FIRST,
        tick: funnelnet_protocol::TickStamp::full(0),
        x,
    };
    node.on_message(&said(9.0), 0).unwrap();
    run(&mut node, 2);
    let seen = node.observations()[0];
    assert_eq!((seen.u, node.counters().saturated > 0), (0.25, true), "{seen:?}");
    for (low, high, field, found) in [
        (0.5, 1.0, ConfigField::LimitLow, 0.5),
        (-1.0, -0.5, ConfigField::LimitHigh, -0.5),
        (f32::NEG_INFINITY, 1.0, ConfigField::LimitLow, f64::NEG_INFINITY),
    ] {
        let (named, _, value, ..) = refused(&with(low, high));
        assert_eq!((named, value), (field, found));
    }
}

proptest! {
    #[test]
    fn whatever_a_program_is_it_is_refused_or_runs_without_a_state_that_is_no_number(
        code in proptest::collection::vec(any::<u8>(), 1..=MAX_OPERATIONS),
        constants in proptest::collection::vec(any::<f32>(), 0..=MAX_CONSTANTS),
        x in any::<f32>(),
    ) {
        tried(&code, &constants, x)?;
    }

    #[test]
    fn so_does_what_is_nearly_a_program(
        choice in proptest::collection::vec(0_usize..34, 1..=MAX_OPERATIONS),
        constants in proptest::collection::vec(-1e3_f32..1e3, 3),
        x in -1e3_f32..1e3,
    ) {
        // Only what the stack has room and values for, and the sum of what is left.
        let mut depth = 0;
        let mut code = Vec::new();
        for choice in choice {
            let pushes = [State(0), Time, Wave(0), Constant(0), Constant(1), Constant(2)];
            let plain = u8::try_from(choice).unwrap();
            let operation = Operation::of_byte(plain).filter(|_| depth > 0 && plain != 2 && plain < 21).unwrap_or(pushes[choice % 6]);
            let (takes, leaves) = operation.arity();
            if depth >= takes && depth - takes + leaves <= 8 {
                depth = depth - takes + leaves;
                code.push(operation.to_byte());
            }
        }
        code.truncate(MAX_OPERATIONS - 8);
        let mut depth = 0;
        for &byte in &code {
            let (takes, leaves) = Operation::of_byte(byte).unwrap().arity();
            depth = depth - takes + leaves;
        }
        code.extend(std::iter::repeat_n(Add.to_byte(), depth.saturating_sub(1)));
        prop_assert!(tried(&code, &constants, x)?);
    }
}

/// Whether it is a program; the node that runs it keeps a state that is finite.
fn tried(code: &[u8], constants: &[f32], x: f32) -> Result<bool, TestCaseError> {
    let program =
        Program { code: code.iter().copied().collect(), constants: constants.iter().copied().collect() };
    let is_program = program.check(1, 1, 0).is_ok();
    let config = builder(x).program(program, [wave()]).build().unwrap();
    if Params::<f32>::new(&config).is_ok() {
        let mut node = started(&config);
        run(&mut node, 30);
        prop_assert!(node.state().all(f32::is_finite));
        prop_assert!(node.observations().iter().all(|seen| seen.u.is_finite()));
    }
    Ok(is_program)
}
