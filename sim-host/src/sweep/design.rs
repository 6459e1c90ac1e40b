//! The points of a sweep: rows of a list or of a drawing, each with every combination of the grid.

use super::draw::{Cube, Method};
use super::identity::{Draw, Listed, RangeText};
use super::list::List;
use super::range::Range;
use super::values::Axis;
use std::collections::BTreeSet;

/// One value of a point.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setting {
    /// The full key.
    pub key: String,
    /// The value: TOML, or a bare string.
    pub value: String,
    /// The option that it comes from, as messages name it.
    pub option: String,
}

/// All points, made when they are asked for.
#[derive(Clone, Debug)]
pub struct Design {
    rows: Rows,
    grid: Vec<Axis>,
}

#[derive(Clone, Debug)]
enum Rows {
    /// Nothing but the grid.
    One,
    List {
        file: String,
        list: List,
    },
    Drawn {
        draw: Draw,
        ranges: Vec<Range>,
        cube: Cube,
    },
}

/// Names of columns that are no keys, and what to say to who wants them as keys.
const RESERVED: [(&str, &str); 8] = [
    ("seed", "repetitions have seeds: use --seeds K, and --seed N for the first one"),
    ("version", "is the version of the format"),
    ("run", "is no key of a scenario"),
    ("repetition", "is no key of a scenario"),
    ("verdict", "is no key of a scenario"),
    ("why", "is no key of a scenario"),
    ("wall_s", "is no key of a scenario"),
    ("cpu_s", "is no key of a scenario"),
];

impl Design {
    /// A grid alone; without axes it is one point.
    #[must_use]
    pub fn of_grid(grid: Vec<Axis>) -> Self {
        Self { rows: Rows::One, grid }
    }

    /// Each row of a list with each combination of the grid.
    #[must_use]
    pub fn of_list(file: String, list: List, grid: Vec<Axis>) -> Self {
        Self { rows: Rows::List { file, list }, grid }
    }

    /// Each point of a drawing with each combination of the grid.
    ///
    /// # Errors
    /// There are no ranges, or no such drawing.
    pub fn drawn(
        method: Method,
        points: u64,
        seed: u64,
        ranges: Vec<Range>,
        grid: Vec<Axis>,
    ) -> Result<Self, String> {
        if ranges.is_empty() {
            return Err(format!("{points}: needs a range to draw from, as in --range bus.loss=0.0..0.3"));
        }
        let cube = Cube::new(method, points, ranges.len(), seed)?;
        Ok(Self { rows: Rows::Drawn { draw: Draw { method, points, seed }, ranges, cube }, grid })
    }

    /// Refuses a key that is swept twice, or is none.
    ///
    /// # Errors
    /// The key, and why not.
    pub fn check(&self, set: &[String]) -> Result<(), String> {
        let mut seen = BTreeSet::new();
        for key in self.keys() {
            if let Some((_, why)) = RESERVED.iter().find(|(name, _)| *name == key) {
                return Err(format!("{key} cannot be swept: {why}"));
            }
            if set.contains(&key) {
                return Err(format!("{key} is swept, and set by --set, too; leave one of them out"));
            }
            if !seen.insert(key.clone()) {
                return Err(format!("{key} is swept twice; leave one of them out"));
            }
        }
        match self
            .grid
            .iter()
            .try_fold(self.rows(), |count, axis| count.checked_mul(axis.values.len() as u64))
        {
            Some(_) => Ok(()),
            None => Err("the grid has more points than can be counted".to_owned()),
        }
    }

    /// The keys, in the order of the columns.
    #[must_use]
    pub fn keys(&self) -> Vec<String> {
        let of_rows = match &self.rows {
            Rows::One => Vec::new(),
            Rows::List { list, .. } => list.keys.clone(),
            Rows::Drawn { ranges, .. } => ranges.iter().map(|range| range.key.clone()).collect(),
        };
        of_rows.into_iter().chain(self.grid.iter().map(|axis| axis.key.clone())).collect()
    }

    /// How many points there are.
    #[must_use]
    pub fn points(&self) -> u64 {
        self.rows() * self.grid.iter().map(|axis| axis.values.len() as u64).product::<u64>()
    }

    fn rows(&self) -> u64 {
        match &self.rows {
            Rows::One => 1,
            Rows::List { list, .. } => list.rows.len() as u64,
            Rows::Drawn { cube, .. } => cube.points(),
        }
    }

    /// The values of a point, counted from 0; the last axis of the grid is the fastest.
    #[must_use]
    pub fn point(&self, index: u64) -> Vec<Setting> {
        let mut rest = index;
        let mut of_grid = Vec::new();
        for axis in self.grid.iter().rev() {
            let count = axis.values.len() as u64;
            let value = axis.values.get((rest % count) as usize).cloned().unwrap_or_default();
            rest /= count;
            of_grid.push(Setting {
                option: format!("--grid {}={value}", axis.key),
                key: axis.key.clone(),
                value,
            });
        }
        let mut settings = self.row(rest);
        settings.extend(of_grid.into_iter().rev());
        settings
    }

    fn row(&self, index: u64) -> Vec<Setting> {
        match &self.rows {
            Rows::One => Vec::new(),
            Rows::List { file, list } => {
                let Some((line, values)) = list.rows.get(index as usize) else { return Vec::new() };
                let setting = |(key, value): (&String, &String)| Setting {
                    key: key.clone(),
                    value: value.clone(),
                    option: format!("--list {file}, line {line}"),
                };
                list.keys.iter().zip(values).map(setting).collect()
            }
            Rows::Drawn { ranges, cube, .. } => {
                let setting = |(dimension, range): (usize, &Range)| {
                    let value = range.at(cube.at(index, dimension));
                    Setting {
                        option: format!("--range {}={value}", range.key),
                        key: range.key.clone(),
                        value,
                    }
                };
                ranges.iter().enumerate().map(setting).collect()
            }
        }
    }

    /// The axes of the grid.
    #[must_use]
    pub fn grid(&self) -> &[Axis] {
        &self.grid
    }

    /// The list, as far as it tells one sweep from another.
    #[must_use]
    pub fn listed(&self) -> Option<Listed> {
        match &self.rows {
            Rows::List { list, .. } => Some(Listed::of(list)),
            _ => None,
        }
    }

    /// The drawing, and its ranges.
    #[must_use]
    pub fn drawing(&self) -> (Option<Draw>, Vec<RangeText>) {
        match &self.rows {
            Rows::Drawn { draw, ranges, .. } => {
                let text = |range: &Range| RangeText { key: range.key.clone(), range: range.text.clone() };
                (Some(*draw), ranges.iter().map(text).collect())
            }
            _ => (None, Vec::new()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(text: &str) -> Axis {
        Axis::parse(text).unwrap()
    }

    fn values(design: &Design, index: u64) -> Vec<String> {
        design.point(index).into_iter().map(|setting| setting.value).collect()
    }

    #[test]
    fn a_grid_has_every_combination_and_its_last_axis_is_the_fastest() {
        let design = Design::of_grid(vec![axis("a.x=1,2"), axis("b=p,q,r")]);
        let all: Vec<_> = (0..design.points()).map(|index| values(&design, index).concat()).collect();
        assert_eq!(all, ["1p", "1q", "1r", "2p", "2q", "2r"]);
        assert_eq!(design.point(4)[1].option, "--grid b=q");
        assert_eq!(Design::of_grid(Vec::new()).points(), 1);
    }

    #[test]
    fn rows_come_with_every_combination_of_the_grid() {
        let list = List { keys: vec!["c".into()], rows: vec![(2, vec!["u".into()]), (5, vec!["v".into()])] };
        let design = Design::of_list("points.csv".into(), list, vec![axis("b=p,q")]);
        assert_eq!(design.keys(), ["c", "b"]);
        let all: Vec<_> = (0..design.points()).map(|index| values(&design, index).concat()).collect();
        assert_eq!(all, ["up", "uq", "vp", "vq"]);
        assert_eq!(design.point(2)[0].option, "--list points.csv, line 5");
        let ranges = vec![Range::parse("a=0.0..1.0").unwrap(), Range::parse("n=1..3").unwrap()];
        let design = Design::drawn(Method::Lhs, 5, 1, ranges, vec![axis("b=p,q")]).unwrap();
        assert_eq!((design.points(), design.keys()), (10, vec!["a".into(), "n".into(), "b".into()]));
        assert_eq!(values(&design, 6)[..2], values(&design, 7)[..2]);
        assert_ne!(values(&design, 6)[..2], values(&design, 8)[..2]);
    }

    #[test]
    fn a_key_is_swept_once_and_is_no_seed() {
        let refused = |grid: &[&str], set: &[&str]| {
            let design = Design::of_grid(grid.iter().map(|text| axis(text)).collect());
            design.check(&set.iter().map(|&key| key.to_owned()).collect::<Vec<_>>()).unwrap_err()
        };
        assert!(refused(&["a=1", "a=2"], &[]).contains("a is swept twice"));
        assert!(refused(&["a=1"], &["a"]).contains("set by --set, too"));
        assert!(refused(&["seed=1,2"], &[]).contains("use --seeds K"));
        assert!(Design::of_grid(vec![axis("a=1")]).check(&["b".to_owned()]).is_ok());
    }

    #[test]
    fn a_drawing_needs_a_range() {
        assert!(Design::drawn(Method::Sobol, 8, 1, Vec::new(), Vec::new()).unwrap_err().contains("--range"));
    }
}
