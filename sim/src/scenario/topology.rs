//! The named graphs of the contract, as lists of links.

use std::collections::BTreeSet;

use rand_pcg::Pcg64;

use super::graph::{Edge, Graph};
use funnelnet_law::math;

use crate::number_format::significant;
use crate::random::{Purpose, below, stream, uniform};

/// The most nodes of which each pair is drawn by itself: graphs of seeds that are in use stay.
const LARGEST_BY_PAIRS: usize = 2_000;
/// Draws before a random graph is given up.
const ATTEMPTS: u64 = 1_000;
/// Nodes and links of all draws, about: a refusal comes within a minute.
const WORK: f64 = 1e8;

/// A link between two 0-based indices, the lower first.
pub(super) type Link = (usize, usize);

/// A graph by its shape.
#[derive(Clone, Copy, Debug)]
pub(super) enum Topology {
    Ring,
    Path,
    /// The first node is the centre.
    Star,
    Complete,
    /// Row by row; the last row may be shorter.
    Grid {
        columns: usize,
    },
    /// Row by row, whole rows, each closed to a ring, and each column too.
    Torus {
        columns: usize,
    },
    /// Every node linked to the `degree / 2` next ones on either side of a ring.
    RingLattice {
        degree: usize,
    },
    RandomRegular {
        degree: usize,
    },
    ErdosRenyi {
        probability: f64,
    },
}

impl Topology {
    /// How many links there will be, about.
    pub fn expected_links(self, nodes: usize) -> f64 {
        let n = nodes as f64;
        match self {
            Self::Ring | Self::Path | Self::Star => n,
            Self::Complete => n * n / 2.0,
            Self::Grid { .. } | Self::Torus { .. } => 2.0 * n,
            Self::RingLattice { degree } | Self::RandomRegular { degree } => n * degree as f64 / 2.0,
            Self::ErdosRenyi { probability } => probability * n * n / 2.0,
        }
    }

    /// The links, sorted, each once.
    ///
    /// # Errors
    /// What is wrong with the parameters, or that no connected graph was drawn.
    pub fn links(self, nodes: usize, seed: u64) -> Result<Vec<Link>, String> {
        let links = match self {
            Self::Ring => lattice(nodes, 2),
            Self::Path => (1..nodes).map(|i| (i - 1, i)).collect(),
            Self::Star => (1..nodes).map(|i| (0, i)).collect(),
            Self::Complete => pairs(nodes).collect(),
            Self::Grid { columns } => grid(nodes, columns),
            Self::Torus { columns } => torus(nodes, columns)?,
            Self::RingLattice { degree } => {
                if degree % 2 == 1 || degree >= nodes.max(1) {
                    return Err(format!("must be even and below nodes = {nodes} for a ring lattice"));
                }
                lattice(nodes, degree)
            }
            Self::RandomRegular { degree } => random_regular(nodes, degree, seed)?,
            Self::ErdosRenyi { probability } => erdos_renyi(nodes, probability, seed)?,
        };
        Ok(links.into_iter().collect())
    }
}

fn pairs(nodes: usize) -> impl Iterator<Item = Link> {
    (0..nodes).flat_map(move |a| (a + 1..nodes).map(move |b| (a, b)))
}

fn lattice(nodes: usize, degree: usize) -> BTreeSet<Link> {
    let ahead = |a: usize| (1..=degree / 2).map(move |k| (a, (a + k) % nodes));
    let links = (0..nodes).flat_map(ahead).filter(|(a, b)| a != b);
    links.map(|(a, b)| (a.min(b), a.max(b))).collect()
}

fn grid(nodes: usize, columns: usize) -> BTreeSet<Link> {
    let right = (1..nodes).filter(|i| i % columns != 0).map(|i| (i - 1, i));
    let down = (columns..nodes).map(|i| (i - columns, i));
    right.chain(down).collect()
}

fn torus(nodes: usize, columns: usize) -> Result<BTreeSet<Link>, String> {
    let rows = nodes / columns;
    if !nodes.is_multiple_of(columns) || columns < 3 || rows < 3 {
        return Err(format!("must divide nodes = {nodes} into three rows or more of three nodes or more"));
    }
    let around = |i: usize| {
        let (row, column) = (i / columns, i % columns);
        [(i, row * columns + (column + 1) % columns), (i, (row + 1) % rows * columns + column)]
    };
    Ok((0..nodes).flat_map(around).map(|(a, b)| (a.min(b), a.max(b))).collect())
}

fn connected(nodes: usize, links: &BTreeSet<Link>) -> bool {
    let edges = links.iter().map(|&(a, b)| Edge { a, b, weight: 1.0 }).collect();
    Graph { nodes, edges }.components().len() == 1
}

/// Draws before a random graph of so many nodes and links is given up.
fn attempts(nodes: usize, links: f64) -> u64 {
    ((WORK / (nodes as f64 + links)) as u64).clamp(1, ATTEMPTS)
}

/// Draws until the graph is connected.
fn draw(
    nodes: usize,
    attempts: u64,
    seed: u64,
    mut once: impl FnMut(&mut Pcg64) -> Option<BTreeSet<Link>>,
) -> Option<BTreeSet<Link>> {
    let attempt = |n| once(&mut stream(seed, Purpose::Graph, n));
    (0..attempts).filter_map(attempt).find(|links| connected(nodes, links))
}

fn erdos_renyi(nodes: usize, probability: f64, seed: u64) -> Result<BTreeSet<Link>, String> {
    let once = |generator: &mut Pcg64| {
        if nodes > LARGEST_BY_PAIRS {
            return Some(skipping(nodes, probability, generator));
        }
        Some(pairs(nodes).filter(|_| uniform(generator) < probability).collect())
    };
    let enough = significant((math::ln(nodes as f64) / nodes as f64).min(1.0), 4);
    let attempts = attempts(nodes, Topology::ErdosRenyi { probability }.expected_links(nodes));
    draw(nodes, attempts, seed, once).ok_or_else(|| {
        format!(
            "gave no connected graph in {attempts} draws; above ln N / N = {enough} most draws are connected"
        )
    })
}

/// Batagelj and Brandes (2005): the number of pairs up to the next link is geometric, so that only links cost time.
fn skipping(nodes: usize, probability: f64, generator: &mut Pcg64) -> BTreeSet<Link> {
    if probability >= 1.0 {
        return pairs(nodes).collect();
    }
    let scale = 1.0 / math::ln_1p(-probability);
    let mut links = BTreeSet::new();
    let (mut row, mut column) = (0, 0usize);
    while row < nodes {
        let skip = math::floor(math::ln(1.0 - uniform(generator)) * scale);
        column = column.saturating_add(skip as usize);
        // Row a has the pairs with a + 1 and beyond.
        while row < nodes && column >= nodes - 1 - row {
            column -= nodes - 1 - row;
            row += 1;
        }
        if row < nodes {
            links.insert((row, row + 1 + column));
            column += 1;
        }
    }
    links
}

fn random_regular(nodes: usize, degree: usize, seed: u64) -> Result<BTreeSet<Link>, String> {
    if degree >= nodes.max(1) || (degree * nodes) % 2 == 1 {
        return Err(format!("must be below nodes = {nodes}, and degree * nodes must be even"));
    }
    // A dense regular graph is the complement of a sparse one, which is far easier to draw.
    let sparse = degree.min(nodes - 1 - degree);
    let once = |generator: &mut Pcg64| {
        let links = match_stubs(nodes, sparse, generator)?;
        Some(if sparse == degree {
            links
        } else {
            pairs(nodes).filter(|link| !links.contains(link)).collect()
        })
    };
    let attempts = attempts(nodes, (nodes * sparse / 2) as f64);
    draw(nodes, attempts, seed, once)
        .ok_or_else(|| format!("gave no connected graph in {attempts} draws; use degree >= 3"))
}

/// Steger and Wormald (1999): match free stubs at random, skipping loops and repeats; `None` when stuck.
fn match_stubs(nodes: usize, degree: usize, generator: &mut Pcg64) -> Option<BTreeSet<Link>> {
    let mut stubs: Vec<usize> = (0..nodes).flat_map(|i| std::iter::repeat_n(i, degree)).collect();
    let mut links = BTreeSet::new();
    let mut misses = 0;
    while !stubs.is_empty() {
        let (p, q) = (below(generator, stubs.len()), below(generator, stubs.len()));
        let link = (stubs[p].min(stubs[q]), stubs[p].max(stubs[q]));
        if link.0 != link.1 && links.insert(link) {
            misses = 0;
            stubs.swap_remove(p.max(q));
            stubs.swap_remove(p.min(q));
        } else {
            misses += 1;
            if misses > 200 + stubs.len() * stubs.len() {
                return None;
            }
        }
    }
    Some(links)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_have_the_links_they_should() {
        let links = |topology: Topology, nodes| topology.links(nodes, 1).unwrap();
        assert_eq!(links(Topology::Ring, 5), [(0, 1), (0, 4), (1, 2), (2, 3), (3, 4)]);
        assert_eq!(links(Topology::Ring, 2), [(0, 1)]);
        assert_eq!(links(Topology::Ring, 1), []);
        assert_eq!(links(Topology::Path, 3), [(0, 1), (1, 2)]);
        assert_eq!(links(Topology::Star, 4), [(0, 1), (0, 2), (0, 3)]);
        assert_eq!(links(Topology::Complete, 127).len(), 127 * 126 / 2);
        assert_eq!(
            links(Topology::Grid { columns: 3 }, 7),
            [(0, 1), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 6), (4, 5)]
        );
        assert_eq!(links(Topology::RingLattice { degree: 4 }, 9).len(), 18);
        assert!(Topology::RingLattice { degree: 3 }.links(9, 1).is_err());
    }

    #[test]
    fn regular_graphs_are_regular_connected_and_fixed_by_the_seed() {
        for (nodes, degree) in [(10, 3), (127, 4), (20, 9), (20, 15), (6, 5), (12, 6), (2, 1)] {
            let topology = Topology::RandomRegular { degree };
            let links = topology.links(nodes, 3).unwrap();
            let count = |i| links.iter().filter(|(a, b)| *a == i || *b == i).count();
            assert!((0..nodes).all(|i| count(i) == degree), "{nodes} {degree}");
            assert_eq!(links, topology.links(nodes, 3).unwrap());
        }
        let other = Topology::RandomRegular { degree: 4 };
        assert_ne!(other.links(50, 1), other.links(50, 2));
        assert!(Topology::RandomRegular { degree: 3 }.links(5, 1).is_err());
        assert!(Topology::RandomRegular { degree: 1 }.links(6, 1).unwrap_err().contains("1000 draws"));
    }

    #[test]
    fn a_torus_has_four_neighbours_everywhere() {
        let links = Topology::Torus { columns: 5 }.links(15, 1).unwrap();
        let count = |i| links.iter().filter(|(a, b)| *a == i || *b == i).count();
        assert!(links.len() == 30 && (0..15).all(|i| count(i) == 4), "{links:?}");
        assert!(Topology::Torus { columns: 4 }.links(15, 1).unwrap_err().contains("three rows"));
        assert!(Topology::Torus { columns: 3 }.links(6, 1).is_err());
    }

    #[test]
    fn skipping_gives_as_many_links_as_drawing_each_pair() {
        let (nodes, probability) = (400, 0.02);
        let expected = probability * (nodes * (nodes - 1) / 2) as f64;
        let count = |n| skipping(nodes, probability, &mut stream(n, Purpose::Graph, 0)).len() as f64;
        let mean = (0..50).map(count).sum::<f64>() / 50.0;
        // Five standard deviations of the mean.
        assert!((mean - expected).abs() < 5.0 * (expected / 50.0).sqrt(), "{mean} {expected}");
        let links = skipping(nodes, probability, &mut stream(1, Purpose::Graph, 0));
        assert!(links.iter().all(|&(a, b)| a < b && b < nodes));
        let last = (0..50).flat_map(|n| skipping(nodes, probability, &mut stream(n, Purpose::Graph, 0)));
        let (low, high) = last.fold(
            (0, 0),
            |(low, high), (a, _)| {
                if a < nodes / 2 { (low + 1, high) } else { (low, high + 1) }
            },
        );
        // Three quarters of all pairs begin in the first half.
        let share = f64::from(low) / f64::from(low + high);
        assert!((share - 0.75).abs() < 0.01, "{share}");
    }

    #[test]
    fn sparse_random_graphs_are_given_up() {
        assert!(Topology::ErdosRenyi { probability: 0.1 }.links(40, 1).is_ok());
        let error = Topology::ErdosRenyi { probability: 0.001 }.links(40, 1).unwrap_err();
        assert!(error.contains("ln N / N = 0.092"), "{error}");
    }

    #[test]
    fn draws_of_large_graphs_are_few_and_the_bound_has_digits() {
        let hopeless = Topology::ErdosRenyi { probability: 1e-6 };
        let error = hopeless.links(100_000, 1).unwrap_err();
        assert!(error.contains("ln N / N = 1.15e-4"), "{error}");
        let draws: usize = error.split(" draws").next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
        assert!(draws < 1_000, "{error}");
        assert_eq!(
            (attempts(40, 100.0), attempts(1_000_000, 4e6), attempts(1_000_000, 1e12)),
            (1_000, 20, 1)
        );
    }
}
