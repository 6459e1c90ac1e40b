//! Which CAN frames a node wants, as filters that any controller has: identifier and mask. Its processor is
//! left alone with the others.

use funnelnet_protocol::can::function;
use funnelnet_protocol::config::EdgeConfig;

/// What a node takes from any other one.
const BROADCASTS: [Filter; 3] = [
    // CTRL and SYNC differ in their lowest bit.
    Filter { id: of_function(function::CTRL), mask: of_function(0b1110) },
    Filter { id: of_function(function::FAULT), mask: FUNCTION },
    // Also from those that are no neighbours: an edge that only one end knows of is told so.
    Filter { id: of_function(function::EDGE), mask: FUNCTION },
];

const NODE_BITS: u32 = 7;
/// The part of an identifier that names the node.
const NODE: u16 = (1 << NODE_BITS) - 1;
/// The part that names the function.
const FUNCTION: u16 = of_function(0b1111);

const fn of_function(function: u8) -> u16 {
    (function as u16) << NODE_BITS
}

/// Data frames with an 11-bit identifier that is `id` in the bits of `mask`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Filter {
    /// Identifier.
    pub id: u16,
    /// Bits of it that count.
    pub mask: u16,
}

impl Filter {
    /// Any data frame with an 11-bit identifier.
    pub const ALL: Self = Self { id: 0, mask: 0 };

    /// Everything that a node says.
    const fn node(id: u8) -> Self {
        Self { id: id as u16, mask: NODE }
    }

    /// Whether a frame with this identifier passes.
    pub fn passes(&self, id: u16) -> bool {
        id & self.mask == self.id & self.mask
    }
}

/// The filters of a node.
#[derive(Clone, Copy, Debug)]
pub struct Filters<'a> {
    /// The node's own number, whose twin it must hear; `None` while it is blank, and takes everything.
    own: Option<u8>,
    neighbours: &'a [EdgeConfig],
}

impl<'a> Filters<'a> {
    /// Of a node that is blank: all frames.
    pub const BLANK: Filters<'static> = Filters { own: None, neighbours: &[] };

    /// Of the node `own` with these neighbours.
    pub const fn new(own: u8, neighbours: &'a [EdgeConfig]) -> Self {
        Self { own: Some(own), neighbours }
    }

    /// What a controller with `room` filters shall let in: a list of at most so many, that lets everything in
    /// where they do not fit.
    pub fn within(self, room: usize) -> impl Iterator<Item = Filter> {
        let fits = BROADCASTS.len() + 1 + self.neighbours.len() <= room;
        let own = self.own.filter(|_| fits);
        let all = own.is_none().then_some(Filter::ALL);
        let of_node = own.into_iter().chain(self.neighbours.iter().map(|edge| edge.id)).map(Filter::node);
        let some = BROADCASTS.into_iter().chain(of_node).filter(move |_| own.is_some());
        all.into_iter().chain(some)
    }
}
