//! `[[expect.window]]`: figures of a part of the run only.

use super::{Moment, raise};
use crate::emergent::EmergentTrajectory;
use crate::extremes::larger;
use crate::scenario::{Scenario, Window};

/// Figures of a window; `None` where nothing could be measured in it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WindowFigures {
    /// The largest true `|nu| / psi`.
    pub funnel_ratio: Option<f64>,
    /// The largest `max x - min x`, state units.
    pub spread: Option<f64>,
    /// The largest distance of a state to `xi`, state units.
    pub emergent_error: Option<f64>,
    /// The largest distance of a state to the reference, state units.
    pub reference_error: Option<f64>,
    /// The largest `|u|`, state units / s.
    pub max_input: Option<f64>,
}

/// All windows of a scenario.
pub(super) struct Windows<'a> {
    windows: &'a [Window],
    figures: Vec<WindowFigures>,
    scenario: &'a Scenario,
    /// Where a window asks for it.
    emergent: Option<EmergentTrajectory<'a>>,
    /// The first tick for which there is none.
    predicted_to: Option<u64>,
}

impl<'a> Windows<'a> {
    pub(super) fn of(scenario: &'a Scenario) -> Self {
        let windows = scenario.expect.windows.as_slice();
        let asked = windows.iter().any(|window| window.emergent_error.is_some());
        Self {
            windows,
            figures: vec![WindowFigures::default(); windows.len()],
            scenario,
            predicted_to: scenario.predicted_to(),
            // The distance to what is not resolved is no measurement.
            emergent: asked
                .then(|| EmergentTrajectory::new(scenario))
                .flatten()
                .filter(|emergent| emergent.unresolved().is_none()),
        }
    }

    pub(super) fn tick(
        &mut self,
        moment: &Moment<'_>,
        ratio: Option<f64>,
        spread: Option<f64>,
        input: Option<f64>,
        reference: Option<&[f64]>,
    ) {
        let inside = |window: &Window| (window.from_tick..=window.to_tick).contains(&moment.k);
        if !self.windows.iter().any(inside) {
            return;
        }
        let components = self.scenario.components();
        let t = self.scenario.time.part_at_s(moment.k, moment.part);
        let emergent =
            match self.emergent.as_mut().filter(|_| self.predicted_to.is_none_or(|tick| moment.k < tick)) {
                Some(emergent) => distance(moment, components, emergent.advance(t)),
                None => None,
            };
        let reference = reference.and_then(|exact| distance(moment, components, exact));
        for (window, figures) in self.windows.iter().zip(&mut self.figures) {
            if !inside(window) {
                continue;
            }
            raise(&mut figures.funnel_ratio, ratio);
            raise(&mut figures.spread, spread);
            raise(&mut figures.emergent_error, emergent);
            raise(&mut figures.reference_error, reference);
            raise(&mut figures.max_input, input);
        }
    }

    pub(super) fn finish(self) -> Vec<WindowFigures> {
        self.figures
    }
}

/// The largest distance of a known state to a point, or to the states of a reference, state units; `None`
/// where none is known.
fn distance(moment: &Moment<'_>, components: usize, point: &[f64]) -> Option<f64> {
    let known = |&(at, _): &(usize, (&f64, &f64))| super::is_known(moment, at / components);
    let apart = moment.x.iter().zip(point.iter().cycle()).enumerate().filter(known);
    apart.map(|(_, (x, point))| (x - point).abs()).reduce(larger)
}
