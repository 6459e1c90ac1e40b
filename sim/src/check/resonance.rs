//! The slowest mode of the network under the law, which a field may excite (law.md 6).

use serde_json::json;

use super::forecast::Forecast;
use super::subject::Subject;
use super::{Finding, Status, about, figure};
use crate::extremes::{beyond, smallest};
use crate::scenario::Sine;

/// `c / 2`, by which the mode is slower than the graph alone has it.
const SLOWER: f64 = 1.1;
/// How near a frequency has to be, as a ratio.
const NEAR: f64 = 1.25;
/// What a funnel makes of a sine: its third harmonic.
const HARMONICS: [f64; 2] = [1.0, 3.0];

/// What there is to say; nothing where no sine is near.
pub(super) fn finding(subject: &Subject<'_>, forecast: &Forecast) -> Option<Finding> {
    let scenario = subject.scenario;
    let mode = (scenario.graph.normalised_lambda2() / SLOWER).sqrt() / scenario.time.tick_s();
    let driving = scenario.nodes.iter().zip(1..).flat_map(|(node, id)| {
        let sines = node.dynamics.sines().iter().filter(|sine| sine.amplitude != 0.0);
        sines.flat_map(move |sine: &Sine| HARMONICS.map(|times| (id, sine.frequency.abs(), times)))
    });
    let off = |(_, frequency, times): &(u32, f64, f64)| {
        let ratio = frequency * times / mode;
        if ratio > 1.0 { ratio } else { 1.0 / ratio }
    };
    let nearest = driving.min_by(|one, other| off(one).total_cmp(&off(other)))?;
    let near = off(&nearest) < NEAR;
    if !near {
        return None;
    }
    let (node, frequency, times) = nearest;
    // What is small beside the excess of one exchange per tick.
    let narrow = forecast.nodes.iter().any(|seen| beyond(seen.excess, 1.0));
    let turns = if times == 1.0 { "turns" } else { "turns, with its third harmonic," };
    let text = format!(
        "the slowest mode of the network answers at {} rad/s; a sine of {} rad/s at node {node} {turns} near it",
        about(mode),
        figure(frequency)
    );
    let widest = smallest(f64::INFINITY, forecast.nodes.iter().map(|seen| seen.excess.recip()));
    let values = json!({
        "mode_rad_s": mode, "frequency": frequency, "harmonic": times, "node": node, "funnel_over_excess": widest,
    });
    let found = Finding::new("resonance", "Resonance", text, values);
    if narrow && !subject.keeps() {
        let advice = "the funnel is narrower than what one exchange per tick leaves, so that the mode is not damped; use another tick";
        return Some(found.advise(Status::Warn, advice.to_owned()));
    }
    let advice = "the ratio may be larger than the formula says; the law that is followed has it in it";
    Some(found.advise(Status::Note, advice.to_owned()))
}
