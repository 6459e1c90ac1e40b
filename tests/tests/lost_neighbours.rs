//! `safety.lost_neighbours`: a network in which one node falls silent for good.

use funnelnet_node::Event;
use funnelnet_protocol::message::FaultCode;
use sim_host::run::Fidelity;
use system_tests::{run, scenario};

/// The nodes that stopped, in order of time, with why and at which tick. On the path 1-2-3-4-5 node 3 leaves
/// its state limit.
fn stopped(lost_neighbours: &str) -> Vec<(usize, FaultCode, u64)> {
    let settings =
        ["time.duration=200ms", "coupling.kind=none", "node.3.dynamics.slope=200", lost_neighbours];
    let outcome = run(&scenario("five-agents-path.toml", &settings), Fidelity::Loopback);
    let fault = |event: &sim_host::engine::NodeEvent| match event.event {
        Event::Fault(code) => Some((event.node + 1, code, event.at / 1_000_000)),
        _ => None,
    };
    outcome.events.iter().filter_map(fault).collect()
}

#[test]
fn a_node_that_stops_stops_those_that_cannot_do_without_it() {
    let (limit, lost) = (FaultCode::STATE_LIMIT, FaultCode::NEIGHBOURS_LOST);
    let none = stopped("safety.lost_neighbours=0");
    let [(3, code, at)] = none[..] else { panic!("{none:?}") };
    assert_eq!(code, limit);
    // Two of two: the inner nodes have another neighbour left.
    assert_eq!(stopped("safety.lost_neighbours=2"), none);
    // One: it spreads, node by node, each a tick after the one before, which says that it has stopped: nobody
    // extrapolates it.
    let spread = stopped("safety.lost_neighbours=1");
    let step = spread[1].2 - at;
    assert!((1..3).contains(&step), "{spread:?}");
    let expected = [
        (3, limit, at),
        (2, lost, at + step),
        (4, lost, at + step),
        (1, lost, at + 2 * step),
        (5, lost, at + 2 * step),
    ];
    assert_eq!(spread, expected);
}
