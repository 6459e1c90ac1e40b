//! Configurations to store.
#![allow(dead_code)] // each test uses a part

use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::{
    Breach, Coupling, EdgeConfig, Field, Funnel, Gain, HeardLimits, Limits, MAX_COMPONENTS, MAX_CONSTANTS,
    MAX_MATRIX, MAX_NEIGHBOURS, MAX_OPERATIONS, MAX_SINES, Normalised, Program, Shape, Sine, TickSource,
    TimeRules, Tuning,
};

/// The configuration of node `id`, with a few numbers that depend on it.
pub fn small(id: u8) -> NodeConfig {
    NodeConfig::builder(id, 1_000_000)
        .state([f32::from(id)])
        .state_limit(1e6)
        .field(Field::scalar(-1.0, 0.5, []))
        .funnel(Shape::Constant { width: 10.0 })
        .edges((1..=2).map(|i| EdgeConfig { id: id + i, weight: 1.0, edges: 2 }))
        .extrapolate_ticks(3)
        .telemetry_every(2)
        .build()
        .unwrap()
}

/// The longest with a program, which leaves no matrix.
pub fn longest_program(id: u8) -> NodeConfig {
    let mut config = longest(id);
    config.field.slope = [0.0].into_iter().collect();
    config.program = Program {
        code: [0x20; MAX_OPERATIONS].into_iter().collect(),
        constants: [0.5; MAX_CONSTANTS].into_iter().collect(),
    };
    config
}

/// The longest that a CONFIGURE can carry.
pub fn longest(id: u8) -> NodeConfig {
    let sine = Sine { component: 7, amplitude: 1.0, frequency: 2.0, phase: 0.5 };
    let edge = EdgeConfig { id: 127, weight: 1.0, edges: 126 };
    NodeConfig {
        id,
        tick_ns: u32::MAX,
        tick_source: TickSource::Sync,
        initial_state: [1.0; MAX_COMPONENTS].into_iter().collect(),
        state_limit: 1e6,
        field: Field {
            slope: [-1.0; MAX_MATRIX].into_iter().collect(),
            offset: [0.25; MAX_COMPONENTS].into_iter().collect(),
            sines: [sine; MAX_SINES].into_iter().collect(),
        },
        coupling: Coupling::LambdaTracker { eta: 1.0 },
        gain: Gain::Median { eta: 1.0, eps: 0.5 },
        funnel: Funnel {
            factor: 1.0,
            shape: Shape::Schedule {
                start: 1.0,
                at_ns: u64::MAX,
                eps: 1.0,
                then: Normalised::Exponential { start: 2.0, end: 1.0, rate: 1.0 },
            },
        },
        on_breach: Breach::Reopen { margin: 2.0, rate: 1.0 },
        neighbours: [edge; MAX_NEIGHBOURS].into_iter().collect(),
        extrapolate_ticks: 255,
        telemetry_every: u32::MAX,
        lost_neighbours: u8::MAX,
        holdover_ns: u64::MAX,
        tuning: Tuning {
            damping: 8.0,
            guard: 0.5,
            round: 100,
            input_limit: 1e9,
            slope_limit: 1e9,
            slow_start: 1_000,
        },
        program: Program::none(),
        limits: Limits { low: -1.0, high: 1.0 },
        heard: HeardLimits { limit: 2.0, rate: 3.0, drop_after: u8::MAX },
        time: TimeRules { masters: [255; 16], period_us: u32::MAX, jitter_us: u32::MAX },
    }
}
