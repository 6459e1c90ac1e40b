//! A node with any configuration that is accepted, and any messages: no panic, no state or input that is not
//! finite, a bounded number of actions.
#![no_main]

use funnelnet_law::field::{Field, Sine};
use funnelnet_law::funnel::{Funnel, Normalised, Shape};
use funnelnet_law::gain::Gain;
use funnelnet_law::{Breach, Coupling};
use funnelnet_node::{Action, Node, Params, Phase};
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::can;
use funnelnet_protocol::config::{HeardLimits, Limits, MAX_CONSTANTS, MAX_OPERATIONS, Program, TickSource};
use funnelnet_protocol::message::{Command, Message, Target};
use libfuzzer_sys::fuzz_target;

/// More actions at one time than a node of 8 components and 126 neighbours can have.
const MOST_ACTIONS: usize = 2_000;

/// Kinds, numbers and neighbours of a configuration.
type Draw = ([u8; 8], [f32; 12], u32, Vec<(u8, f32)>, (f32, f32, u8));

/// The configuration that a draw stands for, or none.
fn config(
    (kinds, numbers, tick_ns, neighbours, (far, fast, drop_after)): Draw,
    (code, constants): (Vec<u8>, Vec<f32>),
) -> Option<NodeConfig> {
    let [a, b, c, d, e, f, slope, offset, x, limit, amplitude, weight] = numbers;
    let gains = Gain::<f32>::KINDS;
    let gain = (gains[usize::from(kinds[0]) % gains.len()].build)([a, b]);
    let then = Normalised::Exponential { start: c, end: d, rate: e };
    let shape = match kinds[1] % 5 {
        0 => Shape::Exponential { start: c, end: d, rate: e },
        1 => Shape::Constant { width: c },
        2 => Shape::ReciprocalTime { scale: c },
        3 => Shape::FiniteTime { start: c, at_ns: u64::from(tick_ns) * 3, power: d },
        _ => Shape::Schedule { start: c, at_ns: u64::from(tick_ns) * 2, eps: f, then },
    };
    let coupling = match kinds[2] % 5 {
        0 => Coupling::NodeWise,
        1 => Coupling::MaxGain,
        2 => Coupling::EdgeWise,
        3 => Coupling::LambdaTracker { eta: f },
        _ => Coupling::None,
    };
    let breach = match kinds[3] % 3 {
        0 => Breach::Ride,
        1 => Breach::Reopen { margin: e, rate: d },
        _ => Breach::Stop,
    };
    let components = 1 + usize::from(kinds[4] % 3);
    let sine = Sine { component: 0, amplitude, frequency: f64::from(e), phase: 0.0 };
    let field = Field {
        slope: [slope].into_iter().collect(),
        offset: (0..components).map(|_| offset).collect(),
        sines: [sine].into_iter().collect(),
    };
    let source = if kinds[5] % 2 == 0 { TickSource::Timer } else { TickSource::Sync };
    let builder = NodeConfig::builder(1, tick_ns)
        .tick_source(source)
        .state((0..components).map(|_| x))
        .state_limit(limit)
        .field(field)
        .gain(gain)
        .funnel(Funnel { factor: weight, shape })
        .coupling(coupling)
        .on_breach(breach)
        .extrapolate_ticks(kinds[6])
        .lost_neighbours(kinds[7])
        .limits(Limits { low: -f.abs(), high: f.abs() })
        .heard(HeardLimits { limit: far, rate: fast, drop_after })
        .telemetry_every(1);
    // Half of the nodes have a program, whatever is in it.
    let builder = match code.as_slice() {
        [] => builder,
        code => builder.program(
            Program {
                code: code.iter().copied().take(MAX_OPERATIONS).collect(),
                constants: constants.into_iter().take(MAX_CONSTANTS).collect(),
            },
            [sine],
        ),
    };
    neighbours.into_iter().fold(builder, |builder, (id, weight)| builder.edge(id, weight)).build().ok()
}

fuzz_target!(|input: (Draw, Vec<(u16, [u8; 8], u8, u32)>, (Vec<u8>, Vec<f32>))| {
    let (draw, script, program) = input;
    let Some(config) = config(draw, program) else { return };
    let Ok(params) = Params::<f32>::new(&config) else { return };
    let mut node = Node::new(params, &config.neighbours);
    let start = Message::Ctrl { target: Target::All, command: Command::Start, arg: 0, at_tick: 0 };
    let _ = node.on_message(&start, 0);
    let mut now = 0;
    for (id, data, length, later) in script {
        if let Ok(message) = can::decode(id, &data[..usize::from(length % 9)]) {
            let _ = node.on_message(&message, now);
        }
        let mut actions = 0;
        while let Some(action) = node.poll(now) {
            actions += 1;
            assert!(actions < MOST_ACTIONS);
            if let Action::Send(Message::State { x, .. }) = action {
                assert!(x.is_finite());
            }
        }
        if node.phase() == Phase::Running {
            assert!(node.state().all(f32::is_finite));
            assert!(node.observations().iter().all(|seen| seen.u.is_finite()));
        }
        now += u64::from(later);
    }
});
