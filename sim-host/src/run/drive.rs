//! Drives a network through a scenario, tick by tick, and records what it does.

use super::collect::Collector;
use super::error::RunError;
use super::event_log::EventLog;
use super::network::Network;
use super::options::{Fidelity, RunOptions, Verbosity};
use super::outcome::{EarlyEnd, Outcome};
use super::reference;
use super::rows::Rows;
use crate::progress::Progress;
use crate::scenario::Scenario;

/// Record of a run.
pub(super) struct Record {
    /// All that was seen, tick by tick.
    pub outcome: Outcome,
    /// What nodes have reported.
    pub log: EventLog,
    /// Where it ended before its last tick.
    pub cut: Option<Cut>,
}

/// End of a run before its last tick.
pub(super) struct Cut {
    /// Ticks that were recorded.
    pub after: u64,
    /// Reason why there are no more.
    pub error: RunError,
}

impl Cut {
    /// The end in words.
    pub fn told(self, scenario: &Scenario) -> EarlyEnd {
        EarlyEnd::after(self.after, scenario, self.error)
    }
}

/// Runs `network` through all ticks of `scenario`; `each` sees it after every tick. However it fails once
/// there is a record, that is kept.
///
/// # Errors
/// What went wrong before there was a record, the user's interrupt among it, and what `each` says.
pub(super) fn drive<N: Network>(
    what: &'static str,
    scenario: &Scenario,
    options: &RunOptions,
    network: &mut N,
    rows: &mut dyn Rows,
    mut each: impl FnMut(u64, &mut N) -> Result<(), RunError>,
) -> Result<Record, RunError> {
    let exact = reference::where_expected(scenario, options)?;
    let stride = options.stride(&scenario.time);
    let mut collector = match options.on {
        // A board may have a plant, which goes its own way.
        Fidelity::Bench => {
            let rounds = stride.next_multiple_of(scenario.time.round.into());
            Collector::new(scenario, rounds, exact.as_ref(), rows)
        }
        _ => Collector::new(scenario, stride, exact.as_ref(), rows).between_rounds(),
    };
    let progress = Progress::new(what, scenario.time.end_s(), options.verbosity == Verbosity::Quiet);
    network.start()?;
    let (mut seen, mut presence, mut cut) = (Vec::new(), Vec::new(), None);
    let mut log = EventLog::default();
    // One tick more than the run has: it is what makes the diffusive terms at the end.
    for k in 0..=scenario.time.ticks {
        if let Err(error) = advance(network, options) {
            let Some(last) = last_of(k) else { return Err(error) };
            // What the network shows may be of the tick that has failed.
            collector.end_at(last, &seen, &presence)?;
            cut = Some(Cut { after: k, error });
            break;
        }
        seen.clear();
        seen.extend_from_slice(network.observations());
        presence = network.presence(k);
        collector.lost(network.traffic().lost);
        collector.tick(k, &seen, &presence)?;
        collector.hear(&network.take_heard())?;
        network.tell(&mut log);
        each(k, network)?;
        progress.at(scenario.time.at_s(k));
    }
    Ok(Record { outcome: collector.finish(), log, cut })
}

/// The next tick, unless the user has stopped the run.
fn advance(network: &mut impl Network, options: &RunOptions) -> Result<(), RunError> {
    if options.interrupt.is_set() { Err(RunError::interrupted()) } else { network.advance() }
}

/// The last of so many ticks, where that is enough for a record: a picture takes two.
fn last_of(ticks: u64) -> Option<u64> {
    ticks.checked_sub(1).filter(|&last| last > 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::Traffic;
    use crate::engine::Engine;
    use crate::loopback::engine as engine_of;
    use crate::presence::Presence;
    use crate::run::Fidelity;
    use crate::run::testing::options;
    use crate::scenario::Override;
    use funnelnet_node::Observation;
    use std::path::Path;

    /// Loopback that fails at a tick.
    struct Frail {
        engine: Engine,
        left: u64,
    }

    impl Network for Frail {
        fn start(&mut self) -> Result<(), RunError> {
            Network::start(&mut self.engine)
        }

        fn advance(&mut self) -> Result<(), RunError> {
            // What it shows then is of the tick that has failed.
            Network::advance(&mut self.engine)?;
            self.left = self.left.checked_sub(1).ok_or_else(|| RunError::defect("it broke"))?;
            Ok(())
        }

        fn observations(&self) -> &[Observation<f32>] {
            self.engine.observations()
        }

        fn presence(&self, k: u64) -> Vec<Presence> {
            self.engine.presence(k)
        }

        fn tell(&mut self, log: &mut EventLog) {
            self.engine.tell(log);
        }

        fn traffic(&self) -> Traffic {
            self.engine.traffic()
        }
    }

    fn scenario() -> Scenario {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios/five-agents.toml");
        let sets = ["time.duration=10ms", "time.tick=1ms"].map(|set| Override::parse(set).unwrap());
        Scenario::load(&path, &sets).unwrap()
    }

    /// A run of a network that fails after so many ticks, and at which ticks it was looked at.
    fn run(scenario: &Scenario, ticks: u64) -> (Result<Record, RunError>, Vec<u64>) {
        let mut network = Frail { engine: engine_of(scenario).unwrap(), left: ticks };
        let (options, mut looks) =
            (RunOptions { every_ticks: Some(1), ..options(Fidelity::Loopback) }, Vec::new());
        let mut rows = Vec::new();
        let record = drive("test", scenario, &options, &mut network, &mut rows, |k, _| {
            looks.push(k);
            Ok(())
        });
        let with_rows = |record: Record| Record { outcome: Outcome { rows, ..record.outcome }, ..record };
        (record.map(with_rows), looks)
    }

    #[test]
    fn a_whole_run_has_a_tick_more_than_its_scenario_and_is_not_cut() {
        let scenario = scenario();
        let (record, looks) = run(&scenario, u64::MAX);
        assert!(record.unwrap().cut.is_none());
        assert_eq!(looks, (0..=scenario.time.ticks).collect::<Vec<_>>());
    }

    #[test]
    fn of_a_network_that_fails_the_ticks_before_are_kept_as_they_were() {
        let scenario = scenario();
        let whole = run(&scenario, u64::MAX).0.unwrap().outcome;
        let (record, looks) = run(&scenario, 4);
        let Record { outcome, cut, .. } = record.unwrap();
        let cut = cut.unwrap();
        assert_eq!((cut.after, cut.error.message.as_str()), (4, "it broke"));
        assert_eq!(looks, [0, 1, 2, 3]);
        let states = |outcome: &Outcome| outcome.rows.iter().map(|row| row.x.clone()).collect::<Vec<_>>();
        assert_eq!(states(&outcome), states(&whole)[..4]);
        assert_eq!(outcome.last, outcome.rows[3].x);
        let told = cut.told(&scenario).why;
        assert_eq!(told, "after 4 of 11 ticks: it broke");
    }

    #[test]
    fn a_tick_alone_is_no_record() {
        for ticks in [0, 1] {
            assert!(run(&scenario(), ticks).0.is_err_and(|error| error.message == "it broke"), "{ticks}");
        }
    }

    #[test]
    fn a_user_who_stops_a_run_at_once_gets_no_record() {
        let (scenario, options) = (scenario(), options(Fidelity::Loopback));
        options.interrupt.set();
        let mut engine = engine_of(&scenario).unwrap();
        let record = drive("test", &scenario, &options, &mut engine, &mut Vec::new(), |_, _| Ok(()));
        assert!(record.is_err_and(|error| error == RunError::interrupted()));
    }
}
