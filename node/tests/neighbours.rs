//! The table of neighbours is changed in place: what it makes of one list of edges after another.

use funnelnet_node::neighbour::{Neighbours, Own};
use funnelnet_protocol::config::EdgeConfig;
use funnelnet_protocol::message::{Component, NodeId};
use funnelnet_protocol::{Refusal, TickStamp};
use proptest::prelude::*;
use std::collections::BTreeMap;

/// Edges to different neighbours, in any order.
fn edges(most: usize) -> impl Strategy<Value = Vec<EdgeConfig>> {
    let ids = prop::sample::subsequence((1..=126).collect::<Vec<u8>>(), 0..=most).prop_shuffle();
    (ids, 1..9u8).prop_map(|(ids, scale)| {
        let edge = |&id: &u8| EdgeConfig { id, weight: f32::from(scale) + f32::from(id), edges: 1 };
        ids.iter().map(edge).collect()
    })
}

fn stamp(tick: u32) -> TickStamp {
    TickStamp::full(tick)
}

/// Rounded as the node rounds: edge by edge, in the order of the configuration.
fn sum(edges: &[EdgeConfig], heard: &BTreeMap<(u8, u8), f32>, component: u8) -> f32 {
    let term = |edge: &EdgeConfig| heard.get(&(edge.id, component)).map(|x| edge.weight * x);
    edges.iter().filter_map(term).fold(0.0, |sum, term| sum + term)
}

proptest! {
    /// Those that stay are still known, those that come are not heard yet, those that go are strangers, and
    /// the order is that of the list.
    #[test]
    fn after_any_changes_it_is_the_table_of_the_last_edges(
        (components, lists) in (1..=8u8).prop_flat_map(|n| {
            (Just(n), prop::collection::vec((edges(126 / usize::from(n)), any::<u64>()), 1..6))
        }),
    ) {
        let mut table: Neighbours<f32> = Neighbours::new(components);
        let mut heard = BTreeMap::new();
        for (tick, (edges, chosen)) in (10..).zip(&lists) {
            table.set(edges, 100, f32::MAX);
            heard.retain(|(id, _), _| edges.iter().any(|edge| edge.id == *id));
            prop_assert_eq!(table.count(), edges.len());
            for (index, edge) in edges.iter().enumerate() {
                prop_assert_eq!(table.edge(index), NodeId::new(edge.id).map(|id| (id, edge.weight)));
            }
            for component in 0..components {
                let expected = sum(edges, &heard, component);
                prop_assert_eq!(table.sums(tick, component, Own::default()).nu, expected);
            }
            for id in 1..=127u8 {
                for component in 0..components {
                    let x = f32::from(id) + 0.1 * f32::from(component) + tick as f32;
                    let says = |table: &mut Neighbours<f32>| {
                        let (id, component) = (NodeId::new(id).unwrap(), Component::new(component).unwrap());
                        table.hear(id, component, stamp(tick), tick, x)
                    };
                    if !edges.iter().any(|edge| edge.id == id) {
                        prop_assert_eq!(says(&mut table), Err(Refusal::UnknownSource));
                    } else if chosen.rotate_left(id.into()) & 1 == 1 && !heard.contains_key(&(id, component)) {
                        // Once, so that nothing is extrapolated by a slope.
                        prop_assert!(says(&mut table).is_ok());
                        heard.insert((id, component), x);
                    }
                }
            }
        }
    }
}
