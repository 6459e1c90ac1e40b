//! Gains, funnels and the kind of coupling.

use super::diagnostic::Diagnostic;
use super::diagnostic::Problem;
use super::model::{BreachSpec, CouplingKind, FloorSpec, FunnelSpec, GainSpec, NormalisedSpec};
use super::reader::{Choice, Log, Range, Section, number, ready};
use super::tree::{Item, Table, Value};
use funnelnet_node::params;

const COUPLINGS: [Choice<CouplingKind>; 8] = [
    ready("node-wise", CouplingKind::NodeWise),
    ready("edge-wise", CouplingKind::EdgeWise),
    ready("element-wise", CouplingKind::ElementWise),
    ready("max-gain", CouplingKind::MaxGain),
    ready("weakly-centralised", CouplingKind::WeaklyCentralised),
    ready("linear", CouplingKind::Linear),
    ready("lambda-tracker", CouplingKind::LambdaTracker { eta: 0.0 }),
    ready("none", CouplingKind::None),
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
    ready("linear", Gain::Linear),
];

#[derive(Clone, Copy)]
enum Funnel {
    Exponential,
    Constant,
    ReciprocalTime,
    FiniteTime,
    Schedule,
}

const FUNNELS: [Choice<Funnel>; 5] = [
    ready("exponential", Funnel::Exponential),
    ready("constant", Funnel::Constant),
    ready("reciprocal-time", Funnel::ReciprocalTime),
    ready("finite-time", Funnel::FiniteTime),
    ready("schedule", Funnel::Schedule),
];

const STATE: &str = "state units";
const INPUT: &str = "state units per second";

/// What `[coupling]` gives every node, before `[[node]]` changes it.
pub(super) struct Coupling<'a> {
    pub kind: CouplingKind,
    pub floor: FloorSpec,
    pub on_breach: BreachSpec,
    pub gain: Option<&'a Item>,
    pub funnel: Option<&'a Item>,
}

/// Reads `[coupling]`; `None`, reported, where its kind is not known.
pub(super) fn read<'a>(mut section: Section<'a>) -> Option<Coupling<'a>> {
    let mut kind = section.choice("kind", &COUPLINGS, None)?;
    if let CouplingKind::LambdaTracker { eta } = &mut kind {
        *eta = section.number("eta", None, Range::non_negative(STATE));
    }
    let gain = match kind {
        CouplingKind::None => section.take("gain"),
        _ => section.need("gain", "must be a table with a kind, as { kind = \"reciprocal\", scale = 1.0 }"),
    };
    let allowed = "must be a table with a kind, as { kind = \"constant\", width = 1.0 }";
    let funnel = section.need("funnel", allowed);
    let on_breach = section.take("on_breach");
    let floor = section.value("floor", FloorSpec::None, read_floor);
    let log = section.log();
    section.finish();
    gain.and_then(|item| read_gain(item, kind, log));
    funnel.and_then(|item| read_funnel(item, log));
    let policy = on_breach.and_then(|item| read_breach(item, log)).unwrap_or(BreachSpec::Ride);
    if let (CouplingKind::EdgeWise, BreachSpec::Reopen { .. }, Some(item)) = (kind, policy, on_breach) {
        let allowed = "must be ride or stop with edge-wise coupling, where the other end of an edge would not know of it";
        log.report(item.diagnostic(Problem::Value, allowed));
    }
    if let (CouplingKind::WeaklyCentralised, BreachSpec::Stop | BreachSpec::Reopen { .. }, Some(item)) =
        (kind, policy, on_breach)
    {
        log.report(
            item.diagnostic(
                Problem::Value,
                "must be ride with weakly-centralised coupling, which no node runs",
            ),
        );
    }
    Some(Coupling { kind, floor, on_breach: policy, gain, funnel })
}

/// Reads `floor`: a width, or "f32".
fn read_floor(item: &Item) -> Result<FloorSpec, Box<Diagnostic>> {
    let range = Range::positive(STATE).on_host();
    match &item.value {
        Value::Text(text) if text == "f32" => Ok(FloorSpec::F32),
        Value::Integer(_) | Value::Float(_) => number(item, range).map(FloorSpec::Width),
        _ => Err(range.mismatch(item, ", or \"f32\"")),
    }
}

/// Reads `on_breach`: a kind alone, or a table of one.
fn read_breach(item: &Item, log: &Log) -> Option<BreachSpec> {
    if let Value::Text(_) = item.value {
        let table = Table::from([("kind".to_owned(), item.clone())]);
        return read_breach(&Item { value: Value::Table(table), ..item.clone() }, log);
    }
    let kinds = [
        ready("ride", BreachSpec::Ride),
        ready("stop", BreachSpec::Stop),
        ready("reopen", BreachSpec::Reopen { margin: 1.5, rate: 1.0 }),
    ];
    let mut section = Section::open(item, log)?;
    let mut policy = section.choice("kind", &kinds, None)?;
    if let BreachSpec::Reopen { margin, rate } = &mut policy {
        *margin = section.number("margin", Some(*margin), Range::between(1.01, 1e6, "1"));
        *rate = section.number("rate", Some(*rate), Range::positive("1/s").up_to(params::LARGEST_RATE));
    }
    section.finish();
    Some(policy)
}

/// A gain that suits the coupling, or what is wrong with it.
fn suits(gain: GainSpec, coupling: CouplingKind) -> Result<GainSpec, String> {
    let linear = matches!(gain, GainSpec::Linear { .. });
    match coupling {
        CouplingKind::Linear | CouplingKind::LambdaTracker { .. } if !linear => {
            Err(format!("must be {{ kind = \"linear\", slope }} with {} coupling", coupling.name()))
        }
        CouplingKind::Linear
        | CouplingKind::LambdaTracker { .. }
        | CouplingKind::NodeWise
        | CouplingKind::None => Ok(gain),
        _ if linear => Err(format!(
            "must be a funnel's gain (reciprocal, logarithmic, locally-linear, median) with {} coupling; a linear one suits \
             linear, lambda-tracker and node-wise",
            coupling.name()
        )),
        _ => Ok(gain),
    }
}

/// Reads one gain.
pub(super) fn read_gain(item: &Item, coupling: CouplingKind, log: &Log) -> Option<GainSpec> {
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
    let refuse = |allowed| log.report(item.diagnostic(Problem::Value, allowed));
    suits(gain, coupling).map_err(refuse).ok()
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
        Funnel::Schedule => FunnelSpec::Schedule {
            start: section.number("start", None, Range::positive(STATE)),
            at_ns: section.duration("at", None),
            eps: section.number("eps", None, Range::between(1e-9, 1.0, "1")),
            then: read_normalised(&mut section)?,
            factor,
        },
    };
    section.finish();
    Some(funnel)
}

/// Reads what a schedule goes on with.
fn read_normalised(funnel: &mut Section<'_>) -> Option<NormalisedSpec> {
    let allowed = "must be a table with a kind, as { kind = \"constant\", width = 1.0 }";
    funnel.need("then", allowed)?;
    let mut section = funnel.section("then")?;
    let kinds = [ready("exponential", Funnel::Exponential), ready("constant", Funnel::Constant)];
    let then = match section.choice("kind", &kinds, None)? {
        Funnel::Exponential => NormalisedSpec::Exponential {
            start: section.number("start", None, Range::positive(STATE)),
            end: section.number("end", None, Range::non_negative(STATE)),
            rate: section.number("rate", None, Range::positive("1/s").up_to(params::LARGEST_RATE)),
        },
        _ => NormalisedSpec::Constant { width: section.number("width", None, Range::positive(STATE)) },
    };
    section.finish();
    Some(then)
}
