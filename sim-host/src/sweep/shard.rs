//! `--shard i/n`: the part of a sweep that one process runs.

use std::fmt;
use std::str::FromStr;

/// Every n-th run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which, from 1 to `of`.
    pub index: u64,
    /// How many there are.
    pub of: u64,
}

/// The most shards of a sweep.
const MOST: u64 = 100_000;

impl Shard {
    /// Whether a run, by its number from 1, is of this shard.
    #[must_use]
    pub fn has(self, run: u64) -> bool {
        (run - 1) % self.of == self.index - 1
    }

    /// How many of so many runs are of this shard.
    #[must_use]
    pub fn share(self, runs: u64) -> u64 {
        runs / self.of + u64::from(self.index <= runs % self.of)
    }

    /// The name of its table.
    #[must_use]
    pub fn file(self) -> String {
        format!("runs-{}-of-{}.csv", self.index, self.of)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers =
            text.split_once('/').and_then(|(index, of)| Some((index.parse().ok()?, of.parse().ok()?)));
        match numbers {
            Some((index, of)) if (1..=MOST).contains(&of) && (1..=of).contains(&index) => {
                Ok(Self { index, of })
            }
            _ => Err(format!("must be i/n with i from 1 to n and n up to {MOST}, as in 2/8")),
        }
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_part_the_runs() {
        for (runs, of) in [(10, 3), (2, 5), (12, 4), (1, 1)] {
            let shards: Vec<_> = (1..=of).map(|index| Shard { index, of }).collect();
            for run in 1..=runs {
                assert_eq!(shards.iter().filter(|shard| shard.has(run)).count(), 1, "{run} of {runs}");
            }
            for shard in shards {
                let count = (1..=runs).filter(|run| shard.has(*run)).count() as u64;
                assert_eq!(shard.share(runs), count, "{shard} of {runs}");
            }
        }
    }

    #[test]
    fn what_is_no_shard_is_refused() {
        assert_eq!("2/8".parse(), Ok(Shard { index: 2, of: 8 }));
        for text in ["0/8", "9/8", "1", "1/0", "a/b", "1/100001", "-1/3"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }
}
