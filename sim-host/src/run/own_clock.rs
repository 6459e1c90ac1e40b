//! A bench whose nodes tick by their own clock: what they are told beside the scenario, what there is to warn
//! of, and what is summed up.

use super::error::RunError;
use crate::bench::{BenchFile, Skew, Where, ticks_until_apart};
use crate::conductor::Conductor;
use crate::configure::Drive;
use crate::engine;
use crate::record::{BenchSyncSummary, OwnClockNodeSummary, OwnClockSummary};
use crate::scenario::{Scenario, SyncSpec, format_duration};
use funnelnet_node::time::shortest_period;
use funnelnet_protocol::config::{TickSource, TimeRules};
use funnelnet_protocol::report::Counters;
use funnelnet_protocol::{NodeConfig, NodeId};

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

/// How late a frame may be read that came over a line and through this program, us: what a computer takes that does
/// other things, too.
const LINE_JITTER_US: u32 = 2_000;
/// The same on CAN, where a SYNC may wait for a frame that is on the bus, and its sender does not know it.
const CAN_JITTER_US: u32 = 500;

/// Has nodes keep time by SYNC of these masters.
///
/// Its error: SYNC that come so soon after each other that their jitter hides which one is missing.
pub(super) fn keep_time(
    configs: &mut [NodeConfig],
    sync: &SyncSpec,
    file: &BenchFile,
) -> Result<(), RunError> {
    let ids = sync.masters.iter().filter_map(|&id| NodeId::new(u8::try_from(id).ok()?));
    let jitter_us = if are_on_one_bus(configs, file) { CAN_JITTER_US } else { LINE_JITTER_US };
    let tick_ns = configs.first().map_or(1, NodeConfig::period_ns);
    let least = shortest_period(u64::from(jitter_us) * 1_000, tick_ns);
    if sync.period_ns < least {
        return Err(RunError::bad_input(format!(
            "sync.period = {}: stamps of SYNC on this bench may be {jitter_us} us late, and with this tick the period must be at least {}",
            format_duration(sync.period_ns),
            format_duration(least)
        )));
    }
    // A period of less than a microsecond more.
    let period_us = u32::try_from(sync.period_ns.div_ceil(1_000)).unwrap_or(u32::MAX);
    let rules = TimeRules { period_us, jitter_us, ..TimeRules::NONE };
    let rules = ids.fold(rules, TimeRules::with_master);
    configs.iter_mut().for_each(|config| config.time = rules);
    Ok(())
}

/// Whether all are boards on one bus, which hear each other without this program. A process has no controller that stamps
/// frames, and what goes to another bus is relayed.
fn are_on_one_bus(configs: &[NodeConfig], file: &BenchFile) -> bool {
    let interface = |config: &NodeConfig| {
        let node = file.node(config.id)?;
        node.can.as_ref().filter(|_| node.at != Where::Host)
    };
    let first = configs.first().and_then(interface);
    first.is_some() && configs.iter().all(|config| interface(config) == first)
}

/// From and to when this program does not carry the SYNC of a node, by index, ns since the start.
pub(super) fn silences(scenario: &Scenario) -> Vec<Vec<(u64, u64)>> {
    (0..scenario.nodes.len()).map(|index| engine::silences(scenario, index)).collect()
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
pub(super) fn summary(conductor: &Conductor, skew: &Skew, counters: &[Counters]) -> OwnClockSummary {
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
        end_skew_s: skew.at_the_end().map(|skew| skew.as_secs_f64()),
        sync: conductor.syncs().map(|counts| BenchSyncSummary {
            frames: counts.frames,
            kept: counts.kept,
            masters: counts.masters,
        }),
        missed: nodes.iter().map(|node| node.missed).sum(),
        nodes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::configure::node_configs;
    use std::path::Path;

    /// The jitter that two nodes are told, whose entries of the bench file have this, and a SYNC each so many ms.
    fn jitter(entries: [&str; 2], period_ms: u64) -> Result<u32, String> {
        let text = format!(
            "version = 1\ntime = {{ tick = '1ms', duration = '1s' }}\ngraph = {{ kind = 'path', nodes = 2 }}\n\
             agent = {{ dynamics = {{ kind = 'affine', slope = -1.0 }} }}\nsync = {{ masters = [1], period = '{period_ms}ms' }}\n\
             coupling = {{ kind = 'node-wise', gain = {{ kind = 'reciprocal', scale = 1.0 }}, funnel = {{ kind = 'constant', width = 2.0 }} }}"
        );
        let scenario = Scenario::parse(&text, Path::new("two.toml"), &[]).unwrap();
        let [one, two] = entries;
        let file = format!(
            "version = 1\nclock = 'own'\ncan = ['can0', 'can1']\n[[node]]\nid = 1\n{one}\n[[node]]\nid = 2\n{two}\n"
        );
        let file = BenchFile::parse(&file, Path::new("bench.toml")).unwrap();
        let mut configs = node_configs(&scenario, DRIVE).unwrap();
        let kept = keep_time(&mut configs, scenario.sync.as_ref().unwrap(), &file);
        kept.map(|()| configs[0].time.jitter_us).map_err(|error| error.to_string())
    }

    #[test]
    fn stamps_are_those_of_controllers_where_all_are_boards_on_one_bus() {
        let [one, two] = ["serial = '/dev/ttyA'\ncan = 'can0'", "serial = '/dev/ttyB'\ncan = 'can0'"];
        assert_eq!(jitter([one, two], 100), Ok(CAN_JITTER_US));
        for other in
            ["serial = '/dev/ttyB'\ncan = 'can1'", "host = true\ncan = 'can0'", "serial = '/dev/ttyB'"]
        {
            assert_eq!(jitter([one, other], 100), Ok(LINE_JITTER_US), "{other}");
        }
    }

    #[test]
    fn a_period_that_is_too_short_for_the_jitter_is_refused_with_the_shortest_one() {
        let lines = ["host = true"; 2];
        assert_eq!(jitter(lines, 64), Ok(LINE_JITTER_US));
        let error = jitter(lines, 63).unwrap_err();
        assert!(error.contains("sync.period = 63ms") && error.contains("at least 64ms"), "{error}");
        let boards = ["serial = '/dev/ttyA'\ncan = 'can0'", "serial = '/dev/ttyB'\ncan = 'can0'"];
        assert_eq!(jitter(boards, 16), Ok(CAN_JITTER_US));
        assert!(jitter(boards, 15).unwrap_err().contains("at least 16ms"));
    }
}
