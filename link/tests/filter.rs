//! Filters of a CAN controller let in what a node would take, or count as more than a stranger's, and nothing
//! else.

use funnelnet_link::{Filter, Filters};
use funnelnet_protocol::config::EdgeConfig;
use proptest::prelude::*;

const STATE: u16 = 3;
const LAST_STATE: u16 = 11;
const EDGE: u16 = 12;

fn edges(ids: &[u8]) -> Vec<EdgeConfig> {
    ids.iter().map(|&id| EdgeConfig { id, weight: 1.0, edges: 1 }).collect()
}

fn passes(filters: &[Filter], id: u16) -> bool {
    filters.iter().any(|filter| filter.passes(id))
}

#[test]
fn a_blank_node_takes_everything() {
    let filters: Vec<_> = Filters::BLANK.within(2).collect();
    assert_eq!(filters, [Filter::ALL]);
    assert!((0..1 << 11).all(|id| passes(&filters, id)));
}

#[test]
fn too_many_neighbours_for_a_controller_let_everything_in() {
    let neighbours = edges(&(2..25).collect::<Vec<_>>());
    assert_eq!(Filters::new(1, &neighbours).within(27).count(), 27);
    assert_eq!(Filters::new(1, &neighbours).within(26).collect::<Vec<_>>(), [Filter::ALL]);
}

proptest! {
    #[test]
    fn every_identifier_is_let_in_if_and_only_if_the_node_wants_it(
        own in 1_u8..128,
        neighbours in prop::collection::vec(1_u8..128, 0..20),
        id in 0_u16..1 << 11,
    ) {
        let (function, node) = (id >> 7, (id & 0x7F) as u8);
        // Of a function that there is not yet, too, from those that it hears: it counts what it does not
        // know.
        let to_all = function < STATE || function == EDGE;
        let wanted = to_all || node == own || neighbours.contains(&node);
        let filters: Vec<_> = Filters::new(own, &edges(&neighbours)).within(28).collect();
        prop_assert_eq!(passes(&filters, id), wanted);
        prop_assert!((STATE..=LAST_STATE).contains(&function) || to_all || function > EDGE);
    }
}
