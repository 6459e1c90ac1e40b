//! What is predicted of a whole run: at its recorded rows, and over all steps of the integration, which do
//! not depend on the rows.

use super::{BlendedTrajectory, EmergentTrajectory};
use crate::extremes::{larger, largest};
use crate::number_format::significant;
use crate::scenario::Scenario;
use serde::Serialize;

/// The rate at which the emergent dynamics forget their past: `df_em/dxi` along `xi`, over all steps of the
/// integration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Contraction {
    /// The largest, 1/s: negative where they contract throughout (paper, (22), contractive_emer).
    pub slowest: f64,
    /// The average, 1/s.
    pub mean: f64,
}

/// The prediction at the last row, and over all steps up to it. Empty where the scenario has no emergent
/// dynamics.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Prediction {
    /// The emergent trajectory by component, state units; empty where it is not known.
    pub xi: Vec<f64>,
    /// The blended dynamics by component, state units.
    pub blended: Vec<f64>,
    /// Why the steps of the integration do not resolve the fields, where they do not: then nothing here is a
    /// prediction.
    pub unresolved: Option<String>,
    /// How fast the emergent dynamics contract.
    pub contraction: Option<Contraction>,
    /// `mu_i^-1(f_em - f_i)` at the last row, by index: what `nu_i / psi_i` settles to under a narrow funnel.
    pub steady_ratio: Vec<f64>,
    /// The largest of their sizes over all steps, by index: one minus it is the margin of a node.
    pub steady_ratio_max: Vec<f64>,
}

/// Follows the emergent and the blended dynamics from row to row.
pub struct Predictor<'a> {
    emergent: Option<EmergentTrajectory<'a>>,
    blended: BlendedTrajectory<'a>,
    /// Steps that were looked at.
    seen: u64,
    growth: Growth,
    /// Time from which on nothing is predicted, s: an event sets there what the network moves by.
    ends_at: Option<f64>,
    prediction: Prediction,
}

impl<'a> Predictor<'a> {
    /// The emergent dynamics start at what the coupling conserves, the blended dynamics at the mean of the
    /// initial states.
    pub fn new(scenario: &'a Scenario) -> Self {
        let (emergent, blended) = (EmergentTrajectory::new(scenario), BlendedTrajectory::new(scenario));
        let unresolved = blended.unresolved().map(str::to_owned);
        let prediction = Prediction { unresolved, ..Prediction::default() };
        let ends_at = scenario.predicted_to().map(|tick| scenario.time.at_s(tick));
        Self { emergent, blended, seen: 0, growth: Growth::default(), ends_at, prediction }
    }

    /// Advances to the row at time `t` (s), which must increase from call to call, and gives the prediction
    /// so far.
    pub fn advance(&mut self, t: f64) -> &Prediction {
        let prediction = &mut self.prediction;
        if let Some(end) = self.ends_at.filter(|&end| t >= end) {
            prediction.end(end);
            return prediction;
        }
        prediction.blended = self.blended.advance(t).to_vec();
        if let Some(emergent) = &mut self.emergent {
            if self.seen == 0 {
                prediction.note(emergent, &mut self.seen);
            }
            while emergent.step(t) {
                prediction.note(emergent, &mut self.seen);
                self.growth.note(emergent);
            }
            if prediction.unresolved.is_none() {
                prediction.unresolved = self.growth.outgrown();
            }
            prediction.xi = emergent.advance(t).to_vec();
            prediction.steady_ratio.clear();
            prediction.steady_ratio.extend(emergent.steady_ratios());
        }
        prediction
    }

    /// The prediction up to the last row.
    pub fn finish(self) -> Prediction {
        self.prediction
    }
}

/// How much the error of a step has grown at most: the emergent dynamics multiply it by `e` to the integral
/// of `df_em/dxi`.
#[derive(Default)]
struct Growth {
    /// The exponent, from the step from which it is largest.
    now: f64,
    /// The largest `|xi|` (state units).
    size: f64,
    /// The exponent when it was too large, and the time, s.
    beyond: Option<(f64, f64)>,
}

impl Growth {
    fn note(&mut self, emergent: &mut EmergentTrajectory<'_>) {
        let Some(rate) = emergent.contraction() else { return };
        let walk = &emergent.walk;
        self.now = larger(0.0, self.now + rate * walk.grid.step);
        self.size = largest(self.size, walk.x.iter().map(|x| x.abs()));
        if self.beyond.is_none() && super::outgrown(self.now, self.size) {
            self.beyond = Some((self.now, walk.t));
        }
    }

    fn outgrown(&self) -> Option<String> {
        let (exponent, t) = self.beyond?;
        Some(format!(
            "the emergent dynamics expand: an error has grown by {} up to {} s",
            significant(funnelnet_law::math::exp(exponent), 2),
            significant(t, 4)
        ))
    }
}

impl Prediction {
    /// From the time `end` (s) on there is none.
    fn end(&mut self, end: f64) {
        self.xi.clear();
        self.blended.clear();
        self.steady_ratio.clear();
        self.unresolved.get_or_insert_with(|| {
            format!("an event sets at {} s what the network moves by", significant(end, 6))
        });
    }

    /// Takes the figures at a step, of which `seen` were looked at before.
    fn note(&mut self, emergent: &mut EmergentTrajectory<'_>, seen: &mut u64) {
        *seen += 1;
        if let Some(rate) = emergent.contraction() {
            let (slowest, mean) = self.contraction.map_or((rate, rate), |c| (c.slowest, c.mean));
            let mean = mean + (rate - mean) / *seen as f64;
            self.contraction = Some(Contraction { slowest: larger(slowest, rate), mean });
        }
        let ratios = emergent.steady_ratios();
        for (index, ratio) in ratios.enumerate() {
            match self.steady_ratio_max.get_mut(index) {
                Some(most) => *most = larger(*most, ratio.abs()),
                None => self.steady_ratio_max.push(ratio.abs()),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::five_agents;
    use super::*;

    #[test]
    fn equal_linear_fields_are_known_in_closed_form() {
        // f_i = -2 x + o_i with o = -1, 0, 1, 2, 8 and the reciprocal gain: h = -2 xi + c with the root c of
        // sum_i (c - o_i) / (1 + |c - o_i|), the average is 2, and the steady ratios are constant.
        let offsets = [-1.0, 0.0, 1.0, 2.0, 8.0];
        let field = |k: usize| {
            let (id, offset) = (k + 1, offsets[k]);
            format!("node.{id}.dynamics={{kind='affine',slope=-2.0,offset={offset:?},sines=[]}}")
        };
        let sets: Vec<_> = (0..5).map(field).collect();
        let scenario = five_agents(&sets.iter().map(String::as_str).collect::<Vec<_>>());
        let mut predictor = Predictor::new(&scenario);
        for k in 0..=200 {
            let t = 0.1 * f64::from(k);
            // From the mean 0.5 of the initial states.
            let exact = 1.0 - 0.5 * funnelnet_law::math::exp(-2.0 * t);
            assert!((predictor.advance(t).blended[0] - exact).abs() < 1e-9);
        }
        let prediction = predictor.finish();
        let inverse = |u: f64| u / (1.0 + u.abs());
        let xi = prediction.xi[0];
        let ratios: Vec<f64> = offsets.iter().map(|offset| inverse(2.0 * xi - offset)).collect();
        assert!(ratios.iter().sum::<f64>().abs() < 1e-9, "{xi}");
        let Contraction { slowest, mean } = prediction.contraction.unwrap();
        assert!((slowest + 2.0).abs() < 1e-12 && (mean + 2.0).abs() < 1e-12);
        for (k, ratio) in ratios.iter().enumerate() {
            assert!((prediction.steady_ratio[k] - ratio).abs() < 1e-9);
            assert!((prediction.steady_ratio_max[k] - ratio.abs()).abs() < 1e-9);
        }
    }

    /// What is predicted of a run with a row every so many ticks of 1 ms.
    fn with_rows(scenario: &Scenario, every: u64) -> Prediction {
        let mut predictor = Predictor::new(scenario);
        let ticks = scenario.time.ticks;
        for k in (0..=ticks).filter(|k| k.is_multiple_of(every) || *k == ticks) {
            predictor.advance(k as f64 * scenario.time.tick_s());
        }
        predictor.finish()
    }

    #[test]
    fn slowest_is_the_largest_and_the_largest_ratio_is_kept() {
        let scenario = five_agents(&["time.duration=5s"]);
        let mut emergent = EmergentTrajectory::new(&scenario).unwrap();
        let (mut rates, mut ratios) = (Vec::new(), Vec::new());
        for k in 0..=2500 {
            emergent.advance(0.002 * f64::from(k));
            rates.push(emergent.contraction().unwrap());
            ratios.push(emergent.steady_ratios().nth(2).unwrap());
        }
        let prediction = with_rows(&scenario, 700);
        let Contraction { slowest, mean } = prediction.contraction.unwrap();
        assert_eq!(slowest, rates.iter().copied().fold(f64::NEG_INFINITY, f64::max));
        assert!((mean - rates.iter().sum::<f64>() / 2501.0).abs() < 1e-12);
        assert!(mean < slowest && slowest < -0.72 && mean > -1.24);
        assert_eq!(prediction.steady_ratio[2], ratios[2500]);
        assert_eq!(prediction.steady_ratio_max[2], ratios.iter().fold(0.0f64, |m, r| m.max(r.abs())));
    }

    #[test]
    fn the_rows_that_are_recorded_change_no_figure() {
        // 3 ms do not go into 5 s: the last row is on its own.
        for sets in
            [&["time.duration=5s"][..], &["time.duration=5s", "time.tick=5ms", "node.2.funnel={rate=0.5}"]]
        {
            let scenario = five_agents(sets);
            let every_tick = with_rows(&scenario, 1);
            for every in [2, 3, 7, 50, 100_000] {
                assert_eq!(with_rows(&scenario, every), every_tick, "{every}");
            }
        }
    }

    #[test]
    fn a_ripple_of_whole_turns_per_tick_averages_out() {
        // -x + 1 + 10 sin(100 pi t): beside the ripple, which is 0.03 high, xi goes to 1.
        let ripple = "{kind='affine',slope=-1.0,offset=1.0,sines=[{amplitude=10.0,frequency=314.159265358979,phase=1.2}]}";
        let fields = (1..=5).map(|id| format!("node.{id}.dynamics={ripple}"));
        let sets: Vec<_> = fields.chain(["time.tick=20ms".to_owned()]).collect();
        let scenario = five_agents(&sets.iter().map(String::as_str).collect::<Vec<_>>());
        let prediction = with_rows(&scenario, 1);
        assert!((prediction.xi[0] - 1.0).abs() < 0.04, "{:?}", prediction.xi);
        assert!((prediction.blended[0] - 1.0).abs() < 0.04, "{:?}", prediction.blended);
        assert_eq!(prediction.unresolved, None);
        let mut by_chi = super::super::ChiTrajectory::new(&scenario, 0.0).unwrap();
        assert!((by_chi.advance(20.0).0 - prediction.xi[0]).abs() < 1e-5);
    }

    #[test]
    fn what_the_steps_do_not_resolve_is_said() {
        let fast = "node.1.dynamics={kind='affine',slope=-1.0,sines=[{amplitude=1.0,frequency=1e6}]}";
        let scenario = five_agents(&[fast]);
        assert!(
            Predictor::new(&scenario)
                .finish()
                .unresolved
                .is_some_and(|why| why.contains("steps would resolve"))
        );
    }

    #[test]
    #[ignore = "a measurement"]
    fn cost_at_the_bound() {
        let fast = "node.1.dynamics={kind='affine',slope=-1.0,sines=[{amplitude=1.0,frequency=24000.0}]}";
        let scenario = five_agents(&[fast]);
        let begin = std::time::Instant::now();
        let prediction = with_rows(&scenario, 10);
        println!("{:?} {:?}", begin.elapsed(), prediction);
    }

    #[test]
    fn a_motion_that_errors_outgrow_is_not_resolved() {
        let alike = |field: &str| -> Vec<String> {
            (1..=5).map(|id| format!("node.{id}.dynamics={field}")).collect()
        };
        let of = |field: &str| {
            let sets = alike(field);
            with_rows(&five_agents(&sets.iter().map(String::as_str).collect::<Vec<_>>()), 100).unresolved
        };
        // From 0.5, which is where the first of them rests, an error grows by e^20 in 20 s; by e^6 it does no
        // harm.
        let why = of("{kind='affine',slope=1.0,offset=-0.5,sines=[]}").unwrap();
        assert!(why.contains("an error has grown by"), "{why}");
        assert_eq!(of("{kind='affine',slope=0.3,offset=-0.15,sines=[]}"), None);
        // What the states share in growth is known to as many digits as before.
        assert_eq!(of("{kind='affine',slope=1.0,offset=1.0,sines=[]}"), None);
    }

    #[test]
    fn a_ratio_that_is_not_a_number_is_kept() {
        let mut prediction = Prediction::default();
        let (mut seen, scenario) = (0, five_agents(&[]));
        let mut emergent = EmergentTrajectory::new(&scenario).unwrap();
        emergent.walk.x[0] = f64::NAN;
        prediction.note(&mut emergent, &mut seen);
        emergent.walk.x[0] = 0.0;
        prediction.note(&mut emergent, &mut seen);
        assert!(prediction.contraction.unwrap().slowest.is_nan());
        assert!(prediction.steady_ratio_max.iter().all(|most| most.is_nan()), "{prediction:?}");
    }
}
