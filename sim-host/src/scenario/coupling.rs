//! Gains, funnels and the kind of coupling.

use super::model::{CouplingKind, FunnelSpec, GainSpec};
use super::reader::{Choice, Log, Range, Section, later, ready};
use super::tree::Item;
use funnel_core::params;

const COUPLINGS: [Choice<CouplingKind>; 8] = [
    ready("node-wise", CouplingKind::NodeWise),
    later("edge-wise", CouplingKind::EdgeWise),
    later("element-wise", CouplingKind::ElementWise),
    later("max-gain", CouplingKind::MaxGain),
    later("weakly-centralised", CouplingKind::WeaklyCentralised),
    later("linear", CouplingKind::Linear),
    later("lambda-tracker", CouplingKind::LambdaTracker),
    later("none", CouplingKind::None),
];

#[derive(Clone, Copy)]
enum Gain {
    Reciprocal,
    Logarithmic,
    LocallyLinear,
    Median,
    Linear,
}

const GAINS: [Choice<Gain>; 5] = [
    ready("reciprocal", Gain::Reciprocal),
    ready("logarithmic", Gain::Logarithmic),
    ready("locally-linear", Gain::LocallyLinear),
    ready("median", Gain::Median),
    later("linear", Gain::Linear),
];

#[derive(Clone, Copy)]
enum Funnel {
    Exponential,
    Constant,
    ReciprocalTime,
    FiniteTime,
}

const FUNNELS: [Choice<Funnel>; 4] = [
    ready("exponential", Funnel::Exponential),
    ready("constant", Funnel::Constant),
    ready("reciprocal-time", Funnel::ReciprocalTime),
    ready("finite-time", Funnel::FiniteTime),
];

const STATE: &str = "state units";
const INPUT: &str = "state units per second";

/// What `[coupling]` gives every node, before `[[node]]` changes it.
pub(super) struct Coupling<'a> {
    pub kind: CouplingKind,
    pub gain: Option<&'a Item>,
    pub funnel: Option<&'a Item>,
}

/// Reads `[coupling]`; `None`, reported, where this version cannot go on with it.
pub(super) fn read<'a>(mut section: Section<'a>) -> Option<Coupling<'a>> {
    let kind = section.choice("kind", &COUPLINGS, None)?;
    let allowed = "must be a table with a kind, as { kind = \"reciprocal\", scale = 1.0 }";
    let gain = section.need("gain", allowed);
    let allowed = "must be a table with a kind, as { kind = \"constant\", width = 1.0 }";
    let funnel = section.need("funnel", allowed);
    let log = section.log();
    section.finish();
    gain.and_then(|item| read_gain(item, log));
    funnel.and_then(|item| read_funnel(item, log));
    Some(Coupling { kind, gain, funnel })
}

/// Reads one gain.
pub(super) fn read_gain(item: &Item, log: &Log) -> Option<GainSpec> {
    let mut section = Section::open(item, log)?;
    let gain = match section.choice("kind", &GAINS, None)? {
        Gain::Reciprocal => {
            GainSpec::Reciprocal { scale: section.number("scale", Some(1.0), Range::positive(INPUT)) }
        }
        Gain::Logarithmic => {
            GainSpec::Logarithmic { scale: section.number("scale", Some(1.0), Range::positive(INPUT)) }
        }
        Gain::LocallyLinear => {
            GainSpec::LocallyLinear { bound: section.number("bound", None, Range::positive(INPUT)) }
        }
        Gain::Median => GainSpec::Median {
            eta: section.number("eta", None, Range::positive(STATE)),
            eps: section.number("eps", None, Range::between(1e-9, 0.999, "1")),
        },
        Gain::Linear => GainSpec::Linear { slope: section.number("slope", None, Range::positive("1/s")) },
    };
    section.finish();
    Some(gain)
}

/// Reads one funnel.
pub(super) fn read_funnel(item: &Item, log: &Log) -> Option<FunnelSpec> {
    let mut section = Section::open(item, log)?;
    let kind = section.choice("kind", &FUNNELS, None)?;
    let factor = section.number("factor", Some(1.0), Range::positive("the paper's r_i"));
    let funnel = match kind {
        Funnel::Exponential => FunnelSpec::Exponential {
            start: section.number("start", None, Range::positive(STATE)),
            end: section.number("end", None, Range::non_negative(STATE)),
            rate: section.number("rate", None, Range::positive("1/s").up_to(params::LARGEST_RATE)),
            factor,
        },
        Funnel::Constant => {
            FunnelSpec::Constant { width: section.number("width", None, Range::positive(STATE)), factor }
        }
        Funnel::ReciprocalTime => FunnelSpec::ReciprocalTime {
            scale: section.number("scale", None, Range::positive("state units times seconds")),
            factor,
        },
        Funnel::FiniteTime => FunnelSpec::FiniteTime {
            start: section.number("start", None, Range::positive(STATE)),
            at_ns: section.duration("at", None),
            power: section.number("power", Some(1.0), Range::between(0.1, 10.0, "1")),
            factor,
        },
    };
    section.finish();
    Some(funnel)
}
