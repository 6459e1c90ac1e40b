//! Points that fill a cube evenly: a Sobol sequence, or a Latin hypercube.

use crate::random::{Purpose, below, mix, stream, uniform};
use serde::{Deserialize, Serialize};

/// How points are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Owen-scrambled Sobol points: even in all dimensions together, best for powers of two.
    Sobol,
    /// Latin hypercube: of n points, each n-th of each dimension has one.
    Lhs,
}

/// The most points of a Sobol sequence.
const MOST_POINTS: u64 = 1 << 16;
/// The most points of a Latin hypercube: each dimension keeps a number for each.
const MOST_ROWS: u64 = 1 << 24;

/// Points in the unit cube.
#[derive(Clone, Debug)]
pub struct Cube {
    method: Method,
    points: u64,
    seed: u64,
    /// Of a Latin hypercube, by dimension: the part of each point.
    parts: Vec<Vec<u32>>,
}

impl Cube {
    /// `points` in so many dimensions.
    ///
    /// # Errors
    /// There are none, or too many of either, in a few words.
    pub fn new(method: Method, points: u64, dimensions: usize, seed: u64) -> Result<Self, String> {
        let most = match method {
            Method::Sobol => MOST_POINTS,
            Method::Lhs => MOST_ROWS,
        };
        if !(1..=most).contains(&points) {
            return Err(format!("{points}: must be from 1 to {most} (points)"));
        }
        let largest = sobol_burley::NUM_DIMENSIONS as usize;
        if dimensions > largest {
            return Err(format!("{points}: takes {largest} ranges at most, and there are {dimensions}"));
        }
        let parts = match method {
            Method::Sobol => Vec::new(),
            Method::Lhs => (0..dimensions).map(|dimension| shuffled(points, dimension, seed)).collect(),
        };
        Ok(Self { method, points, seed, parts })
    }

    /// How many points there are.
    #[must_use]
    pub fn points(&self) -> u64 {
        self.points
    }

    /// A coordinate of a point, from 0 to below 1.
    #[must_use]
    pub fn at(&self, point: u64, dimension: usize) -> f64 {
        match self.method {
            Method::Sobol => {
                // Inside of what the sequence has, by `new`.
                let (index, dimension) = (point as u32, dimension as u32);
                f64::from(sobol_burley::sample(index, dimension, (mix(self.seed) >> 32) as u32))
            }
            Method::Lhs => {
                let part = self.parts.get(dimension).and_then(|parts| parts.get(point as usize));
                let index = dimension as u64 * MOST_ROWS + point + 1;
                let inside = uniform(&mut stream(self.seed, Purpose::Design, index << 1));
                (f64::from(part.copied().unwrap_or(0)) + inside) / self.points as f64
            }
        }
    }
}

/// 0 to n - 1 in random order (Fisher and Yates).
fn shuffled(n: u64, dimension: usize, seed: u64) -> Vec<u32> {
    let mut generator = stream(seed, Purpose::Design, (dimension as u64) << 1 | 1);
    let mut parts: Vec<u32> = (0..n as u32).collect();
    for last in (1..parts.len()).rev() {
        parts.swap(last, below(&mut generator, last + 1));
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many of the points are in each of `parts` equal parts of a dimension.
    fn counts(cube: &Cube, dimension: usize, parts: usize) -> Vec<usize> {
        let mut counts = vec![0; parts];
        for point in 0..cube.points() {
            let at = cube.at(point, dimension);
            assert!((0.0..1.0).contains(&at), "{at}");
            counts[(at * parts as f64) as usize] += 1;
        }
        counts
    }

    #[test]
    fn each_part_of_each_dimension_has_one_point() {
        for method in [Method::Sobol, Method::Lhs] {
            for seed in [1, 2, u64::MAX] {
                let cube = Cube::new(method, 64, 12, seed).unwrap();
                for dimension in 0..12 {
                    assert_eq!(counts(&cube, dimension, 64), vec![1; 64], "{method:?} {seed} {dimension}");
                }
            }
        }
        // Any number of rows, too.
        let cube = Cube::new(Method::Lhs, 37, 3, 5).unwrap();
        assert!((0..3).all(|dimension| counts(&cube, dimension, 37) == vec![1; 37]));
    }

    /// Each of 8 x 8 squares has one of 64 Sobol points: what Latin hypercubes do not promise.
    #[test]
    fn sobol_points_are_even_in_two_dimensions_together() {
        let cube = Cube::new(Method::Sobol, 64, 2, 3).unwrap();
        let mut squares: Vec<_> = (0..64)
            .map(|point| ((cube.at(point, 0) * 8.0) as usize, (cube.at(point, 1) * 8.0) as usize))
            .collect();
        squares.sort_unstable();
        squares.dedup();
        assert_eq!(squares.len(), 64);
    }

    #[test]
    fn the_same_seed_gives_the_same_points_and_another_one_others() {
        for method in [Method::Sobol, Method::Lhs] {
            let points = |seed| {
                let cube = Cube::new(method, 16, 2, seed).unwrap();
                (0..16).map(|point| [cube.at(point, 0), cube.at(point, 1)]).collect::<Vec<_>>()
            };
            assert_eq!(points(1), points(1));
            assert_ne!(points(1), points(2));
            assert!(points(1).iter().all(|[x, y]| x != y));
        }
    }

    /// The numbers are part of what a recorded sweep means.
    #[test]
    fn the_points_stay_what_they_are() {
        let first = |method| {
            let cube = Cube::new(method, 8, 2, 1).unwrap();
            [cube.at(0, 0), cube.at(0, 1), cube.at(7, 1)]
        };
        assert_eq!(first(Method::Sobol), [0.1214444637298584, 0.5689133405685425, 0.03452789783477783]);
        assert_eq!(first(Method::Lhs), [0.039167467517941826, 0.24018895336426188, 0.48873153610503406]);
    }

    #[test]
    fn too_many_are_refused() {
        let refused = |method, points, dimensions| Cube::new(method, points, dimensions, 1).unwrap_err();
        assert_eq!(refused(Method::Sobol, 0, 1), "0: must be from 1 to 65536 (points)");
        assert_eq!(refused(Method::Sobol, 65537, 1), "65537: must be from 1 to 65536 (points)");
        assert!(refused(Method::Lhs, 8, 257).contains("takes 256 ranges at most"));
    }
}
