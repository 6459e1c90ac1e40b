//! What is predicted of a whole run, gathered at its recorded rows.

use super::{BlendedTrajectory, EmergentTrajectory};
use crate::scenario::Scenario;
use serde::Serialize;

/// The rate at which the emergent dynamics forget their past: `df_em/dxi` along `xi`, over the recorded rows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Contraction {
    /// The largest, 1/s: negative where they contract throughout (paper, eq. (contractive_emer)).
    pub slowest: f64,
    /// The average, 1/s.
    pub mean: f64,
}

/// The prediction at the last row, and over all rows. Empty where the scenario has no emergent dynamics.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Prediction {
    /// The emergent trajectory by component, state units; empty where it is not known.
    pub xi: Vec<f64>,
    /// The blended dynamics by component, state units.
    pub blended: Vec<f64>,
    /// How fast the emergent dynamics contract.
    pub contraction: Option<Contraction>,
    /// `mu_i^-1(f_em - f_i)` at the last row, by index: what `nu_i / psi_i` settles to under a narrow funnel.
    pub steady_ratio: Vec<f64>,
    /// The largest of their sizes over all rows, by index: one minus it is the margin of a node.
    pub steady_ratio_max: Vec<f64>,
}

/// Follows the emergent and the blended dynamics from row to row.
pub struct Predictor<'a> {
    emergent: Option<EmergentTrajectory<'a>>,
    blended: BlendedTrajectory<'a>,
    rows: u32,
    prediction: Prediction,
}

impl<'a> Predictor<'a> {
    /// Both start at the mean of the initial states.
    pub fn new(scenario: &'a Scenario) -> Self {
        Self {
            emergent: EmergentTrajectory::new(scenario),
            blended: BlendedTrajectory::new(scenario),
            rows: 0,
            prediction: Prediction::default(),
        }
    }

    /// Advances to the row at time `t` (s), which must increase from call to call, and gives the prediction so far.
    pub fn advance(&mut self, t: f64) -> &Prediction {
        let prediction = &mut self.prediction;
        self.rows += 1;
        prediction.blended = self.blended.advance(t).to_vec();
        if let Some(emergent) = &mut self.emergent {
            prediction.xi = emergent.advance(t).to_vec();
            if let Some(rate) = emergent.contraction() {
                let (slowest, mean) = prediction.contraction.map_or((rate, rate), |c| (c.slowest, c.mean));
                let mean = mean + (rate - mean) / f64::from(self.rows);
                prediction.contraction = Some(Contraction { slowest: slowest.max(rate), mean });
            }
            prediction.steady_ratio.clear();
            prediction.steady_ratio.extend(emergent.steady_ratios());
            prediction.steady_ratio_max.resize(prediction.steady_ratio.len(), 0.0);
            for (largest, ratio) in prediction.steady_ratio_max.iter_mut().zip(&prediction.steady_ratio) {
                *largest = largest.max(ratio.abs());
            }
        }
        prediction
    }

    /// The prediction up to the last row.
    pub fn finish(self) -> Prediction {
        self.prediction
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
            let exact = 1.0 - 0.5 * funnel_core::math::exp(-2.0 * t);
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

    #[test]
    fn slowest_is_the_largest_and_the_largest_ratio_is_kept() {
        let scenario = five_agents(&[]);
        let (mut predictor, mut emergent) =
            (Predictor::new(&scenario), EmergentTrajectory::new(&scenario).unwrap());
        let (mut rates, mut ratios) = (Vec::new(), Vec::new());
        for t in [0.0, 0.7, 1.1, 5.0] {
            predictor.advance(t);
            emergent.advance(t);
            rates.push(emergent.contraction().unwrap());
            ratios.push(emergent.steady_ratios().nth(2).unwrap());
        }
        let prediction = predictor.finish();
        let Contraction { slowest, mean } = prediction.contraction.unwrap();
        assert_eq!(slowest, rates.iter().copied().fold(f64::NEG_INFINITY, f64::max));
        assert!((mean - rates.iter().sum::<f64>() / 4.0).abs() < 1e-14);
        assert!(mean < slowest && slowest < -0.72 && mean > -1.24);
        assert_eq!(prediction.steady_ratio[2], ratios[3]);
        assert_eq!(prediction.steady_ratio_max[2], ratios.iter().fold(0.0f64, |m, r| m.max(r.abs())));
    }
}
