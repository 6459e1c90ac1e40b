//! `[agent] random`: values drawn for each node from the seed (docs/notes/2026-11-29-large.md).

use super::agents::{INPUT, PHASE, SLOPE, STATE};
use super::diagnostic::{Diagnostic, Problem};
use super::dynamics::Dynamics;
use super::model::NodeSpec;
use super::reader::{Log, Range, Section, number};
use super::tree::{Item, Value};
use crate::random::{Purpose, gaussian, stream, uniform};
use rand_pcg::Pcg64;

/// Deviations from the mean that a normal draw never leaves: 53 bits end at 8.6.
const FARTHEST: f64 = 10.0;

/// What a value is drawn from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distribution {
    /// From the first, included, to the second.
    Uniform(f64, f64),
    /// Mean and standard deviation.
    Normal(f64, f64),
}

impl Distribution {
    fn draw(self, generator: &mut Pcg64) -> f64 {
        match self {
            Self::Uniform(low, high) => low + (high - low) * uniform(generator),
            Self::Normal(mean, deviation) => mean + deviation * gaussian(generator),
        }
    }
}

/// What is drawn for each node, by key.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Random {
    /// Initial state, state units.
    pub state: Option<Distribution>,
    /// Slope of an affine field, 1/s.
    pub slope: Option<Distribution>,
    /// Offset of an affine field, state units / s.
    pub offset: Option<Distribution>,
    /// Amplitude of each sine, state units / s.
    pub amplitude: Option<Distribution>,
    /// Phase of each sine, rad.
    pub phase: Option<Distribution>,
}

/// What a `[[node]]` says itself, so that it is not drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kept {
    /// Its initial state.
    pub state: bool,
    /// Its slope.
    pub slope: bool,
    /// Its offset.
    pub offset: bool,
    /// Its sines.
    pub sines: bool,
}

impl Random {
    /// Draws for the node with this index.
    pub fn apply(&self, seed: u64, index: usize, kept: Kept, node: &mut NodeSpec) {
        let fill =
            |from: Option<Distribution>, purpose: Purpose, slots: &mut dyn Iterator<Item = &mut f64>| {
                let Some(from) = from else { return };
                let mut generator = stream(seed, purpose, index as u64);
                slots.for_each(|slot| *slot = from.draw(&mut generator));
            };
        fill(self.state.filter(|_| !kept.state), Purpose::AgentState, &mut node.state.iter_mut());
        let Dynamics::Affine(affine) = &mut node.dynamics else { return };
        fill(self.slope.filter(|_| !kept.slope), Purpose::AgentSlope, &mut affine.slope.iter_mut());
        fill(self.offset.filter(|_| !kept.offset), Purpose::AgentOffset, &mut affine.offset.iter_mut());
        let sines = &mut affine.sines;
        let [amplitude, phase] = [self.amplitude, self.phase].map(|from| from.filter(|_| !kept.sines));
        fill(amplitude, Purpose::AgentAmplitude, &mut sines.iter_mut().map(|sine| &mut sine.amplitude));
        fill(phase, Purpose::AgentPhase, &mut sines.iter_mut().map(|sine| &mut sine.phase));
    }

    /// Whether anything of the dynamics is drawn.
    fn draws_dynamics(&self) -> bool {
        [self.slope, self.offset, self.amplitude, self.phase].iter().any(Option::is_some)
    }
}

/// Reads the table.
pub(super) fn read(item: &Item, log: &Log) -> Random {
    let Some(mut section) = Section::open(item, log) else { return Random::default() };
    let mut of = |key, range| section.value(key, None, |item| distribution(item, range).map(Some));
    let random = Random {
        state: of("state", STATE),
        slope: of("slope", SLOPE),
        offset: of("offset", INPUT),
        amplitude: of("amplitude", INPUT),
        phase: of("phase", PHASE),
    };
    section.finish();
    random
}

const ALLOWED: &str = "must be { uniform = [low, high] } or { normal = [mean, deviation] }";

fn distribution(item: &Item, range: Range) -> Result<Distribution, Box<Diagnostic>> {
    let refuse = |allowed: &str| item.diagnostic(Problem::Value, allowed);
    let Value::Table(table) = &item.value else { return Err(refuse(ALLOWED)) };
    let mut entries = table.iter();
    let (Some((kind, pair)), None) = (entries.next(), entries.next()) else { return Err(refuse(ALLOWED)) };
    let Value::Array(pair) = &pair.value else { return Err(refuse(ALLOWED)) };
    let [first, second] = pair.as_slice() else { return Err(refuse(ALLOWED)) };
    match kind.as_str() {
        "uniform" => {
            let (low, high) = (number(first, range)?, number(second, range)?);
            match low <= high {
                true => Ok(Distribution::Uniform(low, high)),
                false => Err(refuse("must have low <= high")),
            }
        }
        "normal" => {
            let mean = number(first, range)?;
            let deviation = number(second, Range::non_negative("a standard deviation"))?;
            for end in [mean - FARTHEST * deviation, mean + FARTHEST * deviation] {
                // Its ends have to be values that the key takes.
                number(&Item { value: Value::Float(end), ..item.clone() }, range)?;
            }
            Ok(Distribution::Normal(mean, deviation))
        }
        _ => Err(refuse(ALLOWED)),
    }
}

/// Reports what is drawn and has no place in any of `nodes`.
pub(super) fn has_a_place<'n>(
    random: &Random,
    item: Option<&Item>,
    nodes: impl Iterator<Item = &'n NodeSpec>,
    log: &Log,
) {
    let Some(item) = item.filter(|_| random.draws_dynamics()) else { return };
    let affine: Vec<_> = nodes.filter_map(|node| node.dynamics.affine()).collect();
    let report = |key: &str, allowed: &str| {
        log.report(item.get(key).unwrap_or(item).diagnostic(Problem::Value, allowed));
    };
    if affine.is_empty() {
        report("", "must not draw slope, offset, amplitude or phase where no node has an affine field");
        return;
    }
    if random.slope.is_some() && affine.iter().any(|field| field.slope.len() > 1) {
        report("slope", "must not be drawn where a slope is a matrix");
    }
    for (key, from) in [("amplitude", random.amplitude), ("phase", random.phase)] {
        if from.is_some() && affine.iter().all(|field| field.sines.is_empty()) {
            report(key, "must not be drawn where no node has sines: write them into agent.dynamics");
        }
    }
}
