//! What every finding looks at, computed once.

use std::cell::OnceCell;

use super::cures::{self, Cure};
use super::forecast::Forecast;
use super::widths::Widths;
use crate::emergent::{Prediction, Predictor};
use crate::extremes::{larger, largest};
use crate::sampled::{self, Followed};
use crate::scenario::{Coupling, NodeSpec, Scenario, initial_ratios};

/// A scenario with what follows from it.
pub(super) struct Subject<'s> {
    pub scenario: &'s Scenario,
    /// Second eigenvalue of the Laplacian; 0 for a single node.
    pub lambda2: f64,
    /// Largest eigenvalue of the Laplacian.
    pub lambda_max: f64,
    /// Weighted degrees, by index.
    pub degrees: Vec<f64>,
    /// `|nu_i| / psi_i` at the start, by index.
    pub ratios: Vec<f64>,
    pub widths: Widths,
    /// None where the motion is not that of the paper's law for scalar states.
    pub forecast: Option<Forecast>,
    /// None where the sampled law of the coupling is not followed here.
    pub followed: Option<Followed>,
    cure: OnceCell<Option<Cure>>,
    aims: OnceCell<Option<Prediction>>,
}

/// Ratio in the first tenth of a second from which on it is warned about, where the law settles lower than
/// that.
const TIGHT_START: f64 = 0.95;
/// How far a start is above what the law settles at, at least, to count as tight.
const ABOVE_STEADY: f64 = 0.02;

impl<'s> Subject<'s> {
    pub fn of(scenario: &'s Scenario) -> Self {
        let subject = Self::by_formula(scenario);
        Self { followed: sampled::follow(scenario, &subject.degrees), ..subject }
    }

    /// With what formulas say, and without following the law, which takes by far the longest.
    pub fn by_formula(scenario: &'s Scenario) -> Self {
        let spectrum = scenario.graph.spectrum();
        let widths = Widths::of(scenario);
        let degrees = scenario.graph.degrees();
        Self {
            lambda2: spectrum.get(1).copied().unwrap_or(0.0),
            lambda_max: spectrum.last().copied().unwrap_or(0.0),
            ratios: initial_ratios(scenario),
            forecast: follows_the_paper(scenario).then(|| Forecast::of(scenario, &widths, &degrees)),
            followed: None,
            cure: OnceCell::new(),
            aims: OnceCell::new(),
            degrees,
            widths,
            scenario,
        }
    }

    /// The paper's bound on `|x_i - x_j|` per width of the widest funnel: `2 sqrt(N) / lambda2`; 0 for a
    /// single node.
    pub fn bound_per_width(&self) -> f64 {
        match self.scenario.nodes.len() {
            0 | 1 => 0.0,
            nodes => 2.0 * (nodes as f64).sqrt() / self.lambda2,
        }
    }

    /// The widest funnel that a node keeps at time `t` (s): its own, or its floor (state units).
    pub fn widest_kept(&self, t: f64) -> f64 {
        let kept = self.widths.at(t).enumerate().map(|(index, psi)| larger(psi, self.resolution(index)));
        largest(0.0, kept)
    }

    /// The narrowest funnel that a node keeps (state units).
    pub fn narrowest(&self, index: usize) -> f64 {
        larger(self.widths.narrowest[index], self.resolution(index))
    }

    /// The law, where it was followed to the end of the run and the states did not run away.
    pub fn run(&self) -> Option<&Followed> {
        self.followed.as_ref().filter(|followed| followed.whole && followed.lost.is_none())
    }

    /// Whether the law keeps every node inside its funnel over the whole run; not where it was not followed
    /// so far.
    pub fn keeps(&self) -> bool {
        self.run().is_some_and(|followed| followed.worst.ratio < 1.0)
    }

    /// Whether the law promises that diffusive terms stay in their funnels.
    pub fn is_promised(&self) -> bool {
        sampled::promises(self.scenario)
    }

    /// Emergent and blended dynamics at the end of the run, by component, where they are not those of the
    /// forecast; none where steps do not resolve the fields.
    pub fn aims(&self) -> Option<&Prediction> {
        let found = self.aims.get_or_init(|| {
            let calm = self.scenario.without_events();
            let prediction = Predictor::new(&calm).advance(calm.time.end_s()).clone();
            prediction.unresolved.is_none().then_some(prediction)
        });
        found.as_ref()
    }

    /// What keeps every node inside its funnel where the scenario does not, as far as anything was found that
    /// does.
    pub fn cure(&self) -> Option<&Cure> {
        self.cure.get_or_init(|| cures::search(self)).as_ref()
    }

    /// The ratio in the first tenth of a second from which on a start counts as close to the funnel's edge.
    pub fn calm_start(&self) -> f64 {
        let steady = self.forecast.as_ref().map_or(0.0, |forecast| {
            let ratios = forecast.nodes.iter().map(|node| 1.0 - node.margin);
            largest(0.0, ratios)
        });
        larger(TIGHT_START, steady + ABOVE_STEADY)
    }

    /// The narrowest funnel that f32 resolves at a node; 0 where nothing is known of the states to come
    /// (state units).
    fn resolution(&self, index: usize) -> f64 {
        self.forecast.as_ref().map_or(0.0, |forecast| forecast.resolution[index])
    }
}

/// Whether states are scalar and coupled by the paper's law with gains that keep a funnel.
fn follows_the_paper(scenario: &Scenario) -> bool {
    let law = matches!(scenario.coupling, Coupling::NodeWise | Coupling::ElementWise | Coupling::MaxGain);
    let keeps = |node: &NodeSpec| node.gain.keeps_funnels();
    scenario.components() == 1 && law && scenario.nodes.iter().all(keeps)
}
