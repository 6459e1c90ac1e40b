//! The runs of a sweep, by number: the point, the repetition, the seed and the scenario of each.

use super::design::{Design, Setting};
use super::identity::hash_of;
use super::values::canonical;
use crate::random::mix;
use crate::scenario::{AnyScenario, Diagnostics, Override, Source};
use std::path::Path;

/// All that is to be run.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The scenario as it was read.
    pub source: Source,
    /// The file as the user named it.
    pub named: std::path::PathBuf,
    /// What `--set` puts into it at every point.
    pub settings: Vec<Override>,
    /// The points.
    pub design: Design,
    /// Seed of the first repetition.
    pub seed: u64,
    /// Repetitions of each point.
    pub seeds: u64,
    /// Whether the seed depends on the point.
    pub is_independent: bool,
}

/// One run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// From 1.
    pub number: u64,
    /// Its values of what is swept.
    pub point: Vec<Setting>,
    /// From 1.
    pub repetition: u64,
    /// The root of its random streams.
    pub seed: u64,
}

/// The most runs of a sweep.
const MOST_RUNS: u64 = 10_000_000;

impl Plan {
    /// Refuses more runs or seeds than there can be.
    ///
    /// # Errors
    /// In what there are too many.
    pub fn check(&self) -> Result<(), String> {
        let set: Vec<_> = self.settings.iter().map(Override::key).collect();
        if set.iter().any(|key| key == "seed") {
            return Err("--set seed: use --seed, from which repetitions count".to_owned());
        }
        self.design.check(&set)?;
        let points = self.design.points();
        if points.checked_mul(self.seeds).is_none_or(|runs| runs > MOST_RUNS) {
            let seeds = self.seeds;
            return Err(format!("{points} points times {seeds} seeds: a sweep has {MOST_RUNS} runs at most"));
        }
        if !self.is_independent && self.seed.checked_add(self.seeds - 1).is_none() {
            return Err(format!("--seeds {}: counts beyond the largest seed, {}", self.seeds, u64::MAX));
        }
        Ok(())
    }

    /// How many runs there are.
    #[must_use]
    pub fn runs(&self) -> u64 {
        self.design.points() * self.seeds
    }

    /// The run with this number, from 1.
    #[must_use]
    pub fn run(&self, number: u64) -> Run {
        let (point, repetition) = ((number - 1) / self.seeds, (number - 1) % self.seeds + 1);
        let point = self.design.point(point);
        let root = if self.is_independent { mixed(self.seed, &point) } else { self.seed };
        Run { number, point, repetition, seed: root + (repetition - 1) }
    }

    /// The scenario of a run.
    ///
    /// # Errors
    /// Everything that was found to be wrong with it.
    pub fn scenario(&self, run: &Run) -> Result<AnyScenario, Diagnostics> {
        let of_point = |setting: &Setting| {
            Override::from_option(&setting.option, &format!("{}={}", setting.key, setting.value))
                .map_err(Diagnostics::from)
        };
        let mut overrides = self.settings.clone();
        for setting in &run.point {
            overrides.push(of_point(setting)?);
        }
        overrides.push(Override::seed(run.seed));
        self.source.any_scenario(&overrides)
    }

    /// The scenario of the first point that has one.
    #[must_use]
    pub fn first_readable(&self) -> Option<AnyScenario> {
        (0..self.design.points()).find_map(|point| self.scenario(&self.run(point * self.seeds + 1)).ok())
    }

    /// The scenario with what `--set` puts into it; where it is none without its points, that of the first one.
    #[must_use]
    pub fn base(&self) -> Option<AnyScenario> {
        let mut overrides = self.settings.clone();
        if self.seed != self.source.seed() {
            overrides.push(Override::seed(self.seed));
        }
        self.source.any_scenario(&overrides).ok().or_else(|| self.first_readable())
    }

    /// The words of the command that repeats a run; `scenario` takes the place of standard input.
    #[must_use]
    pub fn command(&self, program: &str, run: &Run, scenario: &Path) -> Vec<String> {
        let words = |list: &[&str]| list.iter().map(|&word| word.to_owned()).collect::<Vec<_>>();
        if crate::scenario::is_standard_input(&self.named) {
            return words(&[program, "run", &scenario.display().to_string()]);
        }
        let mut command = words(&[program, "run", &self.named.display().to_string()]);
        let settings = self.settings.iter().map(Override::setting);
        let points = run.point.iter().map(|setting| format!("{}={}", setting.key, setting.value));
        command.extend(settings.chain(points).flat_map(|setting| ["--set".to_owned(), setting]));
        command.extend(["--seed".to_owned(), run.seed.to_string()]);
        command
    }
}

/// A seed for a point, whatever the order of its keys: 53 bits, which every reader of the table has exactly.
fn mixed(seed: u64, point: &[Setting]) -> u64 {
    let mut values: Vec<_> =
        point.iter().map(|setting| (setting.key.as_str(), canonical(&setting.value))).collect();
    values.sort();
    let values = hash_of(values.iter().flat_map(|(key, value)| [*key, value.as_str()]));
    mix(seed ^ mix(values)) >> 11
}

#[cfg(test)]
mod tests {
    use super::super::values::Axis;
    use super::*;
    use std::path::PathBuf;

    fn plan(grid: &[&str], is_independent: bool) -> Plan {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
        let grid = grid.iter().map(|text| Axis::parse(text).unwrap()).collect();
        Plan {
            source: Source::read(&path).unwrap(),
            named: path,
            settings: vec![Override::parse("bus.loss=0.1").unwrap()],
            design: Design::of_grid(grid),
            seed: 5,
            seeds: 3,
            is_independent,
        }
    }

    fn seeds(plan: &Plan) -> Vec<u64> {
        (1..=plan.runs()).map(|number| plan.run(number).seed).collect()
    }

    #[test]
    fn repetition_r_has_the_seed_plus_r_minus_1_at_every_point() {
        let plan = plan(&["graph.kind=ring,star"], false);
        assert_eq!(seeds(&plan), [5, 6, 7, 5, 6, 7]);
        let run = plan.run(5);
        assert_eq!((run.repetition, run.point[0].value.as_str()), (2, "star"));
        assert!(matches!(plan.scenario(&run).unwrap(), AnyScenario::Wired(scenario) if scenario.seed == 6));
    }

    #[test]
    fn independent_seeds_depend_on_the_point_and_on_no_order() {
        let of = |grid: &[&str]| {
            let plan = plan(grid, true);
            let mut of: Vec<_> = (1..=plan.runs())
                .map(|number| plan.run(number))
                .map(|run| {
                    let mut values: Vec<_> = run.point.iter().map(|it| canonical(&it.value)).collect();
                    values.sort();
                    (values, run.repetition, run.seed)
                })
                .collect();
            of.sort();
            of
        };
        let first = of(&["a=1,2", "b=ring,star"]);
        assert_eq!(first, of(&["b=star,ring", "a=2.0,1e0"]));
        let mut all: Vec<_> = first.iter().map(|(_, _, seed)| *seed).collect();
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), 12);
        assert!(all.iter().all(|seed| *seed < 1 << 54));
        // Another value is another seed, also where it stands for the same key.
        assert_ne!(of(&["a=1"])[0].2, of(&["a=3"])[0].2);
        assert_ne!(of(&["a=1"])[0].2, of(&["b=1"])[0].2);
    }

    #[test]
    fn the_command_of_a_run_names_all_that_was_set() {
        let plan = plan(&["graph.kind=ring,star"], false);
        let command = plan.command("sim-host", &plan.run(4), Path::new("x.toml"));
        assert_eq!(command[3..].join(" "), "--set bus.loss=0.1 --set graph.kind=star --seed 5");
        let plan = Plan { named: "-".into(), ..plan };
        assert_eq!(
            plan.command("sim-host", &plan.run(4), Path::new("x.toml")).join(" "),
            "sim-host run x.toml"
        );
    }

    #[test]
    fn more_than_can_be_run_is_refused() {
        let of = |seed, seeds| Plan { seed, seeds, ..plan(&["bus.jitter=1,2"], false) }.check();
        assert!(of(1, 5_000_000).is_ok());
        assert!(of(1, 5_000_001).unwrap_err().contains("10000000 runs at most"));
        assert!(of(u64::MAX, 2).unwrap_err().contains("beyond the largest seed"));
        assert!(of(u64::MAX, 1).is_ok());
    }
}
