//! Nodes: `[agent]` and `[coupling]` give the defaults, `[[node]]` overrides them per id.
//!
//! An override is merged over the default key by key. One that names another `kind` starts afresh, since the
//! keys of one kind mean nothing to another.

use std::collections::BTreeMap;
use std::sync::Arc;

use funnelnet_node::params;
use funnelnet_protocol::config::MAX_SINES;

use super::Sine;
use super::affine::Affine;
use super::components::Components;
use super::coupling::{Defaults, read_funnel, read_gain};
use super::diagnostic::{Diagnostic, Problem};
use super::dynamics::Dynamics;
use super::expression::{Expression, ExpressionError};
use super::inputs::{self, Files, Series};
use super::model::{InputLimits, NodeSpec};
use super::random::{self, Kept, Random};
use super::reader::{Log, Range, Section, duration_ns, integer, number, ready};
use super::tree::{Item, Place, Value};
use crate::extremes::largest;
use funnelnet_law::law::node_wise::C;
use funnelnet_law::{Coupling, Gain};

pub(super) const STATE: Range = Range::any("state units");
pub(super) const INPUT: Range = Range::any("state units per second");
/// Characters of a unit.
pub(super) const LONGEST_UNIT: usize = 16;
pub(super) const NOISE: Range = Range::non_negative("state units").up_to(params::LARGEST);

/// Slopes, frequencies and phases of an affine field.
pub(super) const SLOPE: Range = Range::any("1/s").up_to(params::LARGEST_RATE);
pub(super) const FREQUENCY: Range = Range::non_negative("rad/s").up_to(params::LARGEST_RATE);
pub(super) const PHASE: Range = Range::any("rad").up_to(params::LARGEST_PHASE);

/// What one `[agent]` or `[[node]]` table says.
#[derive(Clone, Copy, Default)]
struct Given<'a> {
    state: Option<&'a Item>,
    dynamics: Option<&'a Item>,
    gain: Option<&'a Item>,
    funnel: Option<&'a Item>,
    noise: Option<&'a Item>,
    compute: Option<&'a Item>,
    damping: Option<&'a Item>,
    inputs: Option<&'a Item>,
    limits: Option<&'a Item>,
}

/// What all nodes have in common.
struct Common<'a> {
    defaults: Given<'a>,
    coupling: Coupling<f64>,
    components: Components,
    root: &'a Place,
    outside: Outside<'a>,
    log: &'a Log,
}

/// What expressions need to know of what is not in them.
#[derive(Clone, Copy)]
struct Outside<'a> {
    files: &'a Files,
    /// The end of the run, s.
    end: f64,
}

/// The nodes and their states.
#[derive(Default)]
pub(super) struct Agents<'a> {
    pub nodes: Vec<NodeSpec>,
    /// Where each node's initial state (or else its funnel) was written.
    pub places: Vec<Place>,
    /// The unit of the states.
    pub unit: Option<String>,
    /// What is written of the damping of each node, to be understood once the graph is known.
    pub damping: Vec<Option<&'a Item>>,
}

/// What both kinds of scenario begin with.
struct Written<'a> {
    common: Common<'a>,
    overrides: BTreeMap<u64, Given<'a>>,
    unit: Option<String>,
    random: Random,
    /// Where it stands.
    drawn: Option<&'a Item>,
}

/// What `[agent]` and `[[node]]` say.
pub(super) fn read<'a>(
    root: &mut Section<'a>,
    coupling: &Defaults<'a>,
    count: u64,
    files: &'a Files,
    end: f64,
    seed: u64,
) -> Agents<'a> {
    let Written { common, overrides, unit, random, drawn } = open(root, coupling, count, files, end);
    let node = |id: u16| {
        let given = overrides.get(&u64::from(id));
        let (mut node, place) = read_node(id, &common, given)?;
        random.apply(seed, usize::from(id) - 1, kept(given), &mut node);
        Some((node, place))
    };
    let (nodes, places): (Vec<_>, _) =
        (1..=u16::try_from(count).unwrap_or(u16::MAX)).filter_map(node).unzip();
    random::has_a_place(&random, drawn, nodes.iter(), common.log);
    let written = |id| overrides.get(&id).and_then(|given: &Given<'a>| given.damping).or(coupling.damping);
    let damping = (1..=count).map(written).collect();
    Agents { nodes, places, unit, damping }
}

/// Nodes of which most are alike: what they have in common, and those that `[[node]]` changes.
#[derive(Default)]
pub(super) struct Population<'a> {
    /// All others; none where each node is changed. Ids of these specifications mean nothing.
    pub common: Option<NodeSpec>,
    /// By index, ascending, each with what it does not let be drawn.
    pub own: Vec<(usize, Kept, NodeSpec)>,
    /// The unit of the states.
    pub unit: Option<String>,
    pub random: Random,
    /// What is written of the damping of the common node, and then of the others.
    pub damping: Vec<Option<&'a Item>>,
}

/// The same as [`read`] without a specification for each node: there may be a million.
pub(super) fn read_population<'a>(
    root: &mut Section<'a>,
    coupling: &Defaults<'a>,
    count: u64,
    files: &'a Files,
    end: f64,
) -> Population<'a> {
    let Written { common, overrides, unit, random, drawn } = open(root, coupling, count, files, end);
    let all_are_changed = overrides.len() as u64 == count;
    let shared = if all_are_changed { None } else { read_node(0, &common, None).map(|(node, _)| node) };
    let own = |(&id, given): (&u64, &Given<'a>)| {
        let (node, _) = read_node(0, &common, Some(given))?;
        Some((usize::try_from(id - 1).ok()?, kept(Some(given)), node))
    };
    let own: Vec<_> = overrides.iter().filter_map(own).collect();
    random::has_a_place(&random, drawn, shared.iter().chain(own.iter().map(|(.., node)| node)), common.log);
    let of_own = overrides.values().map(|given| given.damping.or(coupling.damping));
    let damping = shared.iter().map(|_| coupling.damping).chain(of_own).collect();
    Population { common: shared, own, unit, random, damping }
}

fn open<'a>(
    root: &mut Section<'a>,
    coupling: &Defaults<'a>,
    count: u64,
    files: &'a Files,
    end: f64,
) -> Written<'a> {
    let log = root.log();
    let components = Components::of(root.take("agent").into_iter().chain(root.array("node")));
    let (defaults, unit, drawn) = read_agent(root, coupling, &components, files);
    let overrides = read_overrides(root, coupling.kind, count);
    let lacks = |id: &u64| overrides.get(id).is_none_or(|given| given.dynamics.is_none());
    let without = (1..=count).find(|id| defaults.dynamics.is_none() && lacks(id));
    if let Some(id) = without {
        let allowed = format!("node {id} has none of its own; as {{ kind = \"affine\", slope = -1.0 }}");
        let problem = Problem::MissingKey { section: "[agent]".to_owned() };
        log.report(root.place().diagnostic(problem, "agent.dynamics", allowed));
    }
    let outside = Outside { files, end };
    let common = Common { defaults, coupling: coupling.kind, components, root: root.place(), outside, log };
    let random = drawn.map_or(Random::default(), |item| random::read(item, log));
    Written { common, overrides, unit, random, drawn }
}

/// What a `[[node]]` says itself.
fn kept(given: Option<&Given<'_>>) -> Kept {
    let Some(given) = given else { return Kept::default() };
    let says = |key: &str| given.dynamics.is_some_and(|dynamics| dynamics.get(key).is_some());
    Kept { state: given.state.is_some(), slope: says("slope"), offset: says("offset"), sines: says("sines") }
}

/// What `[agent]` gives to all nodes, the unit of the states, and what is drawn.
fn read_agent<'a>(
    root: &mut Section<'a>,
    coupling: &Defaults<'a>,
    components: &Components,
    files: &Files,
) -> (Given<'a>, Option<String>, Option<&'a Item>) {
    // What a default expression may name is not known here where a node has inputs of its own.
    let inputs_differ = root.array("node").iter().any(|node| node.get("inputs").is_some());
    let mut given = Given { gain: coupling.gain, funnel: coupling.funnel, ..Given::default() };
    let (mut unit, mut drawn) = (None, None);
    if let Some(mut agent) = root.section("agent") {
        let log = agent.log();
        given.state = agent.take("state");
        given.dynamics = agent.take("dynamics");
        given.noise = agent.take("noise");
        given.inputs = agent.take("inputs");
        given.limits = agent.take("limits");
        given.compute = agent.take("compute");
        drawn = agent.take("random");
        unit = agent.value("unit", None, |item| read_unit(item).map(Some));
        agent.finish();
        given.state.and_then(|item| read_state(item, components, log));
        let inputs = given.inputs.map_or(Some([].into()), |item| inputs::read(item, files, log));
        let dynamics = given.dynamics.filter(|item| !inputs_differ || item.get("f").is_none());
        dynamics.zip(inputs).and_then(|(item, inputs)| read_dynamics(item, components, &inputs, log));
        given.noise.and_then(|item| read_noise(item, log));
        given.compute.and_then(|item| read_compute(item, log));
    }
    (given, unit, drawn)
}

/// A unit stands on axes: short, and all of it to be seen.
fn read_unit(item: &Item) -> Result<String, Box<Diagnostic>> {
    let fits =
        |text: &&str| (1..=LONGEST_UNIT).contains(&text.chars().count()) && !text.contains(char::is_control);
    let allowed = || {
        format!("must be a string of 1 to {LONGEST_UNIT} characters without control characters, as \"degC\"")
    };
    item.text().filter(fits).map(str::to_owned).ok_or_else(|| item.diagnostic(Problem::Value, allowed()))
}

fn read_overrides<'a>(
    root: &mut Section<'a>,
    coupling: Coupling<f64>,
    count: u64,
) -> BTreeMap<u64, Given<'a>> {
    let log = root.log();
    let mut all = BTreeMap::new();
    for item in root.array("node") {
        let Some(mut section) = Section::open(item, log) else { continue };
        let id = section.need("id", "must be the id of the node that it changes");
        let given = Given {
            state: section.take("state"),
            dynamics: section.take("dynamics"),
            gain: section.take("gain"),
            funnel: section.take("funnel"),
            noise: section.take("noise"),
            compute: section.take("compute"),
            damping: section.take("damping"),
            inputs: section.take("inputs"),
            limits: section.take("limits"),
        };
        // Read with [clock].
        section.take("clock");
        section.finish();
        if coupling == Coupling::EdgeWise {
            let of_edges = given.gain.into_iter().chain(given.funnel).chain(given.damping);
            of_edges.for_each(|item| log.report(one_sided(item)));
        }
        let Some(id) = id else { continue };
        match integer(id, (1, count), "[graph] nodes") {
            Ok(number) if all.insert(number, given).is_some() => {
                log.report(id.diagnostic(Problem::Value, "must be unique: an earlier [[node]] has this id"));
            }
            Ok(_) => {}
            Err(diagnostic) => log.report(diagnostic),
        }
    }
    all
}

/// With edge-wise coupling both ends of an edge must find the same input.
fn one_sided(item: &Item) -> Box<Diagnostic> {
    let allowed = "must not be there with edge-wise coupling, where both ends of an edge need the same gain, funnel and damping";
    let mut diagnostic = item.diagnostic(Problem::Value, allowed);
    diagnostic.hint = Some("set it in [coupling]".to_owned());
    diagnostic
}

fn read_node(id: u16, common: &Common<'_>, given: Option<&Given<'_>>) -> Option<(NodeSpec, Place)> {
    let Common { defaults, coupling, components, root, outside, log } = common;
    let given = given.copied().unwrap_or_default();
    let state = given.state.or(defaults.state);
    let dynamics = merged(defaults.dynamics, given.dynamics);
    let gain = merged(defaults.gain, given.gain);
    let funnel = merged(defaults.funnel, given.funnel);
    let place = state.map(|item| &item.place).or(funnel.as_ref().map(|item| &item.place));
    let place = place.unwrap_or(root).clone();
    let inputs = merged(defaults.inputs, given.inputs);
    let inputs = inputs.map_or(Some([].into()), |item| read_inputs(&item, *outside, log));
    let state = state.map_or(Some(vec![0.0; components.count]), |item| read_state(item, components, log))?;
    let (dynamics, limits) = (dynamics?, given.limits.or(defaults.limits));
    let node = NodeSpec {
        id,
        dynamics: begun(
            &dynamics,
            read_dynamics(&dynamics, components, &inputs?, log)?,
            &state,
            *outside,
            log,
        )?,
        limits: limits.map_or(Some(None), |item| read_limits(item, log).map(Some))?,
        state,
        gain: match gain {
            // Nothing uses it.
            None if *coupling == Coupling::None => Gain::default(),
            gain => read_gain(&gain?, *coupling, log)?,
        },
        funnel: read_funnel(&funnel?, log)?,
        damping: C,
        noise: given.noise.or(defaults.noise).map_or(Some(0.0), |item| read_noise(item, log))?,
        compute_ns: given.compute.or(defaults.compute).map_or(Some(0), |item| read_compute(item, log))?,
    };
    Some((node, place))
}

/// `over` merged over `base`, key by key; `over` alone where it names another kind.
fn merged(base: Option<&Item>, over: Option<&Item>) -> Option<Item> {
    let (Some(base), Some(over)) = (base, over) else { return over.or(base).cloned() };
    let (Value::Table(low), Value::Table(high)) = (&base.value, &over.value) else {
        return Some(over.clone());
    };
    let kind = |item: &Item| item.get("kind").map(|kind| kind.raw.clone());
    if kind(over).is_some() && kind(over) != kind(base) {
        return Some(over.clone());
    }
    let mut table = low.clone();
    table.extend(high.iter().map(|(key, item)| (key.clone(), item.clone())));
    Some(Item { value: Value::Table(table), ..over.clone() })
}

fn read_state(item: &Item, components: &Components, log: &Log) -> Option<Vec<f64>> {
    components.numbers(item, STATE).map_err(|diagnostic| log.report(diagnostic)).ok()
}

fn read_noise(item: &Item, log: &Log) -> Option<f64> {
    number(item, NOISE).map_err(|diagnostic| log.report(diagnostic)).ok()
}

fn read_inputs(item: &Item, outside: Outside<'_>, log: &Log) -> Option<Arc<[Series]>> {
    let inputs = inputs::read(item, outside.files, log)?;
    match inputs::cover(&inputs, outside.end) {
        Ok(()) => Some(inputs),
        Err(why) => {
            log.report(item.diagnostic(Problem::Value, why));
            None
        }
    }
}

fn read_compute(item: &Item, log: &Log) -> Option<u64> {
    duration_ns(item, true).map_err(|diagnostic| log.report(diagnostic)).ok()
}

/// What an actuator can do. No input at all must be possible: that is what the law gives where all agree.
fn read_limits(item: &Item, log: &Log) -> Option<InputLimits> {
    let mut section = Section::open(item, log)?;
    let low = section.number("low", None, INPUT);
    let high = section.number("high", None, INPUT);
    section.finish();
    if low <= 0.0 && high >= 0.0 && low < high {
        return Some(InputLimits { low, high });
    }
    if low.is_finite() && high.is_finite() {
        log.report(item.diagnostic(Problem::Value, "must have low <= 0 <= high and low < high"));
    }
    None
}

fn read_dynamics(
    item: &Item,
    components: &Components,
    inputs: &Arc<[Series]>,
    log: &Log,
) -> Option<Dynamics> {
    let mut section = Section::open(item, log)?;
    let is_expression = section.choice("kind", &[ready("affine", false), ready("expression", true)], None)?;
    if is_expression {
        return read_expression(section, components, inputs, log).map(Dynamics::Expression);
    }
    let affine = Affine {
        slope: section.value("slope", vec![0.0], |item| components.matrix(item, SLOPE)),
        offset: section.value("offset", vec![0.0; components.count], |item| components.numbers(item, INPUT)),
        sines: read_sines(&mut section, components),
    };
    section.finish();
    Some(Dynamics::Affine(affine))
}

fn read_expression(
    mut section: Section<'_>,
    components: &Components,
    inputs: &Arc<[Series]>,
    log: &Log,
) -> Option<Expression> {
    let item = section
        .need("f", "must be an expression, as \"-x + sin(t)\", or an array of them, one per component");
    section.finish();
    let texts = components.texts(item?).map_err(|diagnostic| log.report(diagnostic)).ok()?;
    let words: Vec<_> = texts.iter().map(|(_, text)| *text).collect();
    let mistake = |(index, error): (usize, ExpressionError)| log.report(misread(texts[index].0, &error));
    Expression::new(&words, inputs.clone()).map_err(mistake).ok()
}

/// A mistake in an expression, where in the file its text is written as it is, else where that begins.
fn misread(item: &Item, error: &ExpressionError) -> Box<Diagnostic> {
    let mut diagnostic =
        item.diagnostic(Problem::Value, format!("in column {} of it, {}", error.column, error.message));
    let is_plain =
        !item.raw.contains('\\') && !item.raw.starts_with("\"\"\"") && !item.raw.starts_with("'''");
    if item.place.line > 0 && is_plain {
        diagnostic.column += error.column;
    }
    diagnostic
}

/// The field, once it is known to be finite where its node starts: a node would refuse it. Its steepest slope
/// is looked for where nodes may come to.
fn begun(
    item: &Item,
    dynamics: Dynamics,
    state: &[f64],
    outside: Outside<'_>,
    log: &Log,
) -> Option<Dynamics> {
    /// Sizes of the start.
    const AROUND: f64 = 4.0;
    let Dynamics::Expression(expression) = dynamics else { return Some(dynamics) };
    let at_start = |index: &usize| expression.component(*index, 0.0, state);
    if let Some(index) = (0..state.len()).find(|index| !(at_start(index) as f32).is_finite()) {
        let allowed = format!(
            "must be finite at the start: component {} is {} at t = 0, x = {state:?}",
            index + 1,
            at_start(&index)
        );
        log.report(item.get("f").unwrap_or(item).diagnostic(Problem::Value, allowed));
        return None;
    }
    let size = AROUND * largest(1.0, state.iter().map(|x| x.abs()));
    Some(Dynamics::Expression(expression.explored(size, outside.end)))
}

fn read_sines(dynamics: &mut Section<'_>, components: &Components) -> Vec<Sine> {
    let log = dynamics.log();
    let mut sines = Vec::new();
    let mut surplus = None;
    for item in dynamics.array("sines") {
        sines.extend(read_sine(item, components, log).into_iter().flatten());
        if sines.len() > MAX_SINES {
            surplus = surplus.or(Some(item));
        }
    }
    if let Some(surplus) = surplus {
        let over = if components.count > 1 { " over all components, zero amplitudes apart" } else { "" };
        let allowed = format!("must not be there: a node takes at most {MAX_SINES} sines{over}");
        log.report(surplus.diagnostic(Problem::Value, allowed));
    }
    sines
}

/// One sine per component that has an amplitude.
fn read_sine(item: &Item, components: &Components, log: &Log) -> Option<Vec<Sine>> {
    let mut section = Section::open(item, log)?;
    let nothing = vec![0.0; components.count];
    section.need(
        "amplitude",
        "must be a number or an array of numbers, one per component (state units per second)",
    );
    let amplitudes = section.value("amplitude", nothing.clone(), |item| components.numbers(item, INPUT));
    let frequency = section.number("frequency", None, FREQUENCY);
    let phases = section.value("phase", nothing, |item| components.numbers(item, PHASE));
    section.finish();
    let sines = amplitudes.into_iter().zip(phases).enumerate();
    let sines = sines.map(|(component, (amplitude, phase))| Sine {
        // A state has eight components at most.
        component: component as u8,
        amplitude,
        frequency,
        phase,
    });
    Some(sines.filter(|sine| components.count == 1 || sine.amplitude != 0.0).collect())
}
