//! Gains, funnels and the kind of coupling.

use super::diagnostic::Diagnostic;
use super::diagnostic::Problem;
use super::model::FloorSpec;
use super::reader::{Choice, Log, Range, Section, number, ready};
use super::tree::{Item, Table, Value};
use funnelnet_law::funnel::{Normalised, Shape};
use funnelnet_law::gain::{Gain, Kind, MAX_PARAMETERS};
use funnelnet_law::range::{
    Allowed, INPUT, LARGEST_RATE, POWERS, Parameter, SCHEDULE_EPS, STATE, WIDEST_GUARD,
};
use funnelnet_law::{Breach, Coupling, Funnel};

const COUPLINGS: [Coupling<f64>; 8] = [
    Coupling::NodeWise,
    Coupling::EdgeWise,
    Coupling::ElementWise,
    Coupling::MaxGain,
    Coupling::WeaklyCentralised,
    Coupling::Linear,
    Coupling::LambdaTracker { eta: 0.0 },
    Coupling::None,
];

/// What `[coupling]` gives every node, before `[[node]]` changes it.
pub(super) struct Defaults<'a> {
    pub kind: Coupling<f64>,
    pub floor: FloorSpec,
    pub on_breach: Breach<f64>,
    pub guard: f64,
    pub u_max: Option<f64>,
    pub damping: Option<&'a Item>,
    pub gain: Option<&'a Item>,
    pub funnel: Option<&'a Item>,
}

/// Reads `[coupling]`; `None`, reported, where its kind is not known.
pub(super) fn read<'a>(mut section: Section<'a>) -> Option<Defaults<'a>> {
    let mut kind =
        section.choice("kind", &COUPLINGS.map(|coupling| ready(coupling.kind(), coupling)), None)?;
    if let Coupling::LambdaTracker { eta } = &mut kind {
        *eta = section.number("eta", None, Range::non_negative(STATE));
    }
    let gain = match kind {
        Coupling::None => section.take("gain"),
        _ => section.need("gain", "must be a table with a kind, as { kind = \"reciprocal\", scale = 1.0 }"),
    };
    let allowed = "must be a table with a kind, as { kind = \"constant\", width = 1.0 }";
    let funnel = section.need("funnel", allowed);
    let on_breach = section.take("on_breach");
    let floor = section.value("floor", FloorSpec::None, read_floor);
    let guard =
        section.number("guard", Some(0.0), Range::between(0.0, WIDEST_GUARD, "a share of the funnel"));
    let u_max = section.optional_number("u_max", Range::positive(INPUT));
    let damping = section.take("damping");
    let log = section.log();
    section.finish();
    gain.and_then(|item| read_gain(item, kind, log));
    funnel.and_then(|item| read_funnel(item, log));
    let policy = on_breach.and_then(|item| read_breach(item, log)).unwrap_or(Breach::Ride);
    if let (Coupling::EdgeWise, Breach::Reopen { .. }, Some(item)) = (kind, policy, on_breach) {
        let allowed = "must be ride or stop with edge-wise coupling, where the other end of an edge would not know of it";
        log.report(item.diagnostic(Problem::Value, allowed));
    }
    if let (Coupling::WeaklyCentralised, Breach::Stop | Breach::Reopen { .. }, Some(item)) =
        (kind, policy, on_breach)
    {
        log.report(
            item.diagnostic(
                Problem::Value,
                "must be ride with weakly-centralised coupling, which no node runs",
            ),
        );
    }
    Some(Defaults { kind, floor, on_breach: policy, guard, u_max, damping, gain, funnel })
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
fn read_breach(item: &Item, log: &Log) -> Option<Breach<f64>> {
    if let Value::Text(_) = item.value {
        let table = Table::from([("kind".to_owned(), item.clone())]);
        return read_breach(&Item { value: Value::Table(table), ..item.clone() }, log);
    }
    let kinds = [
        ready("ride", Breach::Ride),
        ready("stop", Breach::Stop),
        ready("reopen", Breach::Reopen { margin: 1.5, rate: 1.0 }),
    ];
    let mut section = Section::open(item, log)?;
    let mut policy = section.choice("kind", &kinds, None)?;
    if let Breach::Reopen { margin, rate } = &mut policy {
        *margin = section.number("margin", Some(*margin), Range::between(1.01, 1e6, "1"));
        *rate = section.number("rate", Some(*rate), Range::positive("1/s").up_to(LARGEST_RATE));
    }
    section.finish();
    Some(policy)
}

/// A gain that suits the coupling, or what is wrong with it.
fn suits(gain: Gain<f64>, coupling: Coupling<f64>) -> Result<Gain<f64>, String> {
    let linear = !gain.keeps_funnels();
    match coupling {
        Coupling::Linear | Coupling::LambdaTracker { .. } if !linear => {
            Err(format!("must be {{ kind = \"linear\", slope }} with {} coupling", coupling.kind()))
        }
        Coupling::Linear | Coupling::LambdaTracker { .. } | Coupling::NodeWise | Coupling::None => Ok(gain),
        _ if linear => {
            let kinds = Gain::<f64>::KINDS.iter().filter(|kind| kind.keeps_funnels).map(|kind| kind.name);
            Err(format!(
                "must be a funnel's gain ({}) with {} coupling; a linear one suits linear, lambda-tracker and node-wise",
                kinds.collect::<Vec<_>>().join(", "),
                coupling.kind()
            ))
        }
        _ => Ok(gain),
    }
}

/// Reads one gain.
pub(super) fn read_gain(item: &Item, coupling: Coupling<f64>, log: &Log) -> Option<Gain<f64>> {
    let mut section = Section::open(item, log)?;
    let kinds: Vec<Choice<&Kind<f64>>> = Gain::KINDS.iter().map(|kind| ready(kind.name, kind)).collect();
    let kind = section.choice("kind", &kinds, None)?;
    let mut values = [0.0; MAX_PARAMETERS];
    for (value, parameter) in values.iter_mut().zip(kind.parameters) {
        *value = section.number(parameter.name, parameter.default, range(parameter));
    }
    let gain = (kind.build)(values);
    section.finish();
    let refuse = |allowed| log.report(item.diagnostic(Problem::Value, allowed));
    suits(gain, coupling).map_err(refuse).ok()
}

pub(super) fn range(parameter: &Parameter) -> Range {
    match parameter.allowed {
        Allowed::Between(low, high) => Range::between(low, high, parameter.unit),
        _ => Range::positive(parameter.unit),
    }
}

/// Reads one funnel.
pub(super) fn read_funnel(item: &Item, log: &Log) -> Option<Funnel<f64>> {
    let mut section = Section::open(item, log)?;
    let kind = section.choice("kind", &Shape::<f64>::KINDS.map(|name| ready(name, name)), None)?;
    let factor = section.number("factor", Some(1.0), Range::positive("the paper's r_i"));
    let shape = match kind {
        "exponential" => Shape::Exponential {
            start: section.number("start", None, Range::positive(STATE)),
            end: section.number("end", None, Range::non_negative(STATE)),
            rate: section.number("rate", None, Range::positive("1/s").up_to(LARGEST_RATE)),
        },
        "constant" => Shape::Constant { width: section.number("width", None, Range::positive(STATE)) },
        "reciprocal-time" => Shape::ReciprocalTime {
            scale: section.number("scale", None, Range::positive("state units times seconds")),
        },
        "finite-time" => Shape::FiniteTime {
            start: section.number("start", None, Range::positive(STATE)),
            at_ns: section.duration("at", None),
            power: section.number("power", Some(1.0), Range::between(POWERS.0, POWERS.1, "1")),
        },
        _ => Shape::Schedule {
            start: section.number("start", None, Range::positive(STATE)),
            at_ns: section.duration("at", None),
            eps: section.number("eps", None, Range::between(SCHEDULE_EPS.0, SCHEDULE_EPS.1, "1")),
            then: read_normalised(&mut section)?,
        },
    };
    section.finish();
    Some(Funnel { factor, shape })
}

/// Reads what a schedule goes on with.
fn read_normalised(funnel: &mut Section<'_>) -> Option<Normalised<f64>> {
    let allowed = "must be a table with a kind, as { kind = \"constant\", width = 1.0 }";
    funnel.need("then", allowed)?;
    let mut section = funnel.section("then")?;
    let kinds = ["exponential", "constant"].map(|name| ready(name, name));
    let then = match section.choice("kind", &kinds, None)? {
        "exponential" => Normalised::Exponential {
            start: section.number("start", None, Range::positive(STATE)),
            end: section.number("end", None, Range::non_negative(STATE)),
            rate: section.number("rate", None, Range::positive("1/s").up_to(LARGEST_RATE)),
        },
        _ => Normalised::Constant { width: section.number("width", None, Range::positive(STATE)) },
    };
    section.finish();
    Some(then)
}
