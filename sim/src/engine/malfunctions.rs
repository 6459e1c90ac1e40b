//! How the sensors and actuators of nodes fail, by the events of a scenario.

use crate::random::{self, Purpose};
use crate::scenario::{ActuatorFault, Detail, EventSpec, Lie, Scenario, SensorFault, on_engine};
use funnelnet_law::field::State;
use rand_pcg::Pcg64;
use std::collections::VecDeque;
use std::ops::Range;

/// What fails of the plant of a node, event by event.
#[derive(Clone, Debug, Default)]
pub(super) struct Malfunctions(Vec<Malfunction>);

#[derive(Clone, Debug)]
struct Malfunction {
    /// Engine time, ns.
    during: Range<u64>,
    fails: Fails,
    /// What was measured or done when it began (state units, or state units / s); none before.
    first: Option<State<f32>>,
}

#[derive(Clone, Debug)]
enum Fails {
    Gives(Lie),
    Noise(f64, Pcg64),
    Loss(f64, Pcg64),
    /// What was so long ago (ns), and samples since with their times (ns).
    Age(u64, VecDeque<(u64, State<f32>)>),
    Actuator(ActuatorFault),
}

impl Malfunctions {
    /// Those of the node with this index.
    pub(super) fn of(scenario: &Scenario, index: usize) -> Self {
        let of_it = |(_, event): &(usize, &EventSpec)| event.targets.nodes().contains(&index);
        let malfunction = |(number, event): (usize, &EventSpec)| {
            let stream =
                |purpose| random::stream(scenario.seed, purpose, index as u64 + ((number as u64) << 14));
            let fails = match event.detail {
                Detail::Sensor(SensorFault::Gives(lie)) => Fails::Gives(lie),
                Detail::Sensor(SensorFault::Noise(deviation)) => {
                    Fails::Noise(deviation, stream(Purpose::SensorNoise))
                }
                Detail::Sensor(SensorFault::Loss(share)) => Fails::Loss(share, stream(Purpose::SensorLoss)),
                Detail::Sensor(SensorFault::Age(age)) => Fails::Age(age, VecDeque::new()),
                Detail::Actuator(fault) => Fails::Actuator(fault),
                _ => return None,
            };
            let during = on_engine(&scenario.time, event.at_ns, event.end_ns());
            Some(Malfunction { during, fails, first: None })
        };
        Self(scenario.events.iter().enumerate().filter(of_it).filter_map(malfunction).collect())
    }

    /// What the sensor gives at `now` (ns) for the state `x` (state units); none where it gives nothing.
    pub(super) fn measured(&mut self, now: u64, x: &State<f32>) -> Option<State<f32>> {
        let (mut given, mut is_lost) = (x.clone(), false);
        for Malfunction { during, fails, first } in &mut self.0 {
            if let Fails::Age(age, past) = fails {
                past.push_back((now, given.clone()));
                // A node that was away has taken no samples meanwhile; what is older than it should be is gone.
                while past.front().is_some_and(|(at, _)| at.saturating_add(*age) < now) {
                    past.pop_front();
                }
            }
            if !during.contains(&now) {
                continue;
            }
            let t = now.saturating_sub(during.start) as f64 / 1e9;
            match fails {
                Fails::Gives(lie) => {
                    let first = first.get_or_insert_with(|| given.clone());
                    given.iter_mut().zip(first.iter()).for_each(|(x, &first)| *x = lie.of(first, *x, t));
                }
                Fails::Noise(deviation, stream) => {
                    let noisy = |x: f32, draw: f64| (f64::from(x) + *deviation * draw) as f32;
                    given.iter_mut().for_each(|x| *x = noisy(*x, random::gaussian(stream)));
                }
                Fails::Loss(share, stream) => is_lost |= random::happens(stream, *share),
                Fails::Age(_, past) => given = past.front().map_or(given, |(_, x)| x.clone()),
                Fails::Actuator(_) => {}
            }
        }
        (!is_lost).then_some(given)
    }

    /// What the actuator does at `now` (ns) for the inputs `u`, where it has done `last` so far (state units / s).
    pub(super) fn done(&mut self, now: u64, u: &[f32], last: &[f32]) -> State<f32> {
        let mut done: State<f32> = u.iter().copied().collect();
        for Malfunction { during, fails, first } in &mut self.0 {
            let Fails::Actuator(fault) = fails else { continue };
            if !during.contains(&now) {
                continue;
            }
            let t = now.saturating_sub(during.start) as f64 / 1e9;
            let first = first.get_or_insert_with(|| last.iter().copied().collect());
            done.iter_mut().zip(first.iter()).for_each(|(u, &first)| *u = fault.of(first, *u, t));
        }
        done
    }
}
