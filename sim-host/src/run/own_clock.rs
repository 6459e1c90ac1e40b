//! A bench whose nodes tick by their own clock: what they are told beside the scenario, what there is to warn
//! of, and what is summed up.

use crate::bench::{BenchFile, Skew, Where, ticks_until_apart};
use crate::conductor::Conductor;
use crate::configure::Drive;
use crate::record::{OwnClockNodeSummary, OwnClockSummary};
use crate::scenario::Scenario;
use funnelnet_protocol::NodeConfig;
use funnelnet_protocol::config::TickSource;
use funnelnet_protocol::report::Counters;

/// Drive of nodes behind streams of bytes that tick by themselves, and tell all they see.
pub(crate) const DRIVE: Drive =
    Drive { tick_source: TickSource::Timer, telemetry_every: 1, is_simulated: false };

/// Ticks of silence after which a neighbour is lost to a node that shall stop when it is alone.
const SOON: u8 = 10;

/// This program may die, and no SYNC tells the nodes so. But with it go all its relays: a node stops once all
/// its neighbours are lost, unless the scenario says how many of them stop it.
pub(super) fn stop_when_alone(configs: &mut [NodeConfig]) {
    for config in configs.iter_mut().filter(|config| config.lost_neighbours == 0) {
        // 126 at most.
        config.lost_neighbours = u8::try_from(config.neighbours.len()).unwrap_or(u8::MAX);
        config.extrapolate_ticks = config.extrapolate_ticks.min(SOON);
    }
}

/// What the user should know before a run whose clocks nobody synchronises.
pub(super) fn warning(scenario: &Scenario, file: &BenchFile) -> Option<String> {
    let has_own_crystal = |id: u16| {
        let at = u8::try_from(id).ok().and_then(|id| file.node(id)).map(|node| &node.at);
        matches!(at, Some(Where::Serial(_) | Where::UsbSerial(_)))
    };
    let (ticks, apart) = (scenario.time.ticks, ticks_until_apart());
    let crystals = scenario.nodes.iter().any(|node| has_own_crystal(node.id));
    (ticks > apart && crystals).then(|| {
        format!(
            "nobody synchronises these clocks: crystals of 50 ppm may be two ticks apart, which ends the run, after {apart} ticks ({} s); it has {ticks}",
            apart as f64 * scenario.time.tick_s()
        )
    })
}

/// What the nodes did with their clocks; `counters` by index.
pub(super) fn summary(conductor: &Conductor, skew: Skew, counters: &[Counters]) -> OwnClockSummary {
    let node = |(index, (link, counters)): (usize, (u8, &Counters))| OwnClockNodeSummary {
        node: link,
        missed: conductor.missed(index),
        no_bus_time: conductor.without_bus_time(index),
        overruns: counters.overruns,
        extrapolated: counters.extrapolated,
        late: counters.late,
    };
    let ids = conductor.members().map(|(link, _)| link.id());
    let nodes: Vec<_> = ids.zip(counters).enumerate().map(node).collect();
    OwnClockSummary {
        start_spread_s: conductor.start_spread().as_secs_f64(),
        largest_skew_s: skew.largest.map_or(0.0, |(_, skew)| skew.as_secs_f64()),
        largest_skew_tick: skew.largest.map(|(tick, _)| tick),
        missed: nodes.iter().map(|node| node.missed).sum(),
        nodes,
    }
}
