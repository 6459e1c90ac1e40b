//! The JSON Schema of the scenario file, for editors: every key with its type, range, default and meaning.
//!
//! Ranges and names of kinds are the reader's, as far as it has them as constants; the lists of keys are written here.
//! What depends on other keys (whole ticks, ids of the graph, a start inside the funnel) only the reader judges.

use super::bus;
use super::clock;
use super::coupling;
use super::duration;
use super::event;
use super::faults;
use super::network::{self, MAX_NODES};
use super::reader::Range;
use super::safety::{LONGEST_HOLDOVER_NS, MOST_DOUBTS};
use super::staged;
use super::{agents, duration::format_duration};
use funnelnet_law::Gain;
use funnelnet_law::range::{
    DAMPING, INPUT, LARGEST_RATE, LONGEST_ROUND, LONGEST_SLOW_START, POWERS, SCHEDULE_EPS, STATE,
    WIDEST_GUARD,
};
use funnelnet_node::params;
use funnelnet_protocol::config::{MAX_COMPONENTS, MAX_NEIGHBOURS, MAX_SINES};
use serde_json::{Map, Value, json};

/// A key of a section.
struct Key {
    name: &'static str,
    schema: Value,
    required: bool,
}

impl Key {
    /// With a value for those who have not seen one.
    fn like(mut self, example: Value) -> Self {
        self.schema["examples"] = json!([example]);
        self
    }

    /// With what stands for it where it is left out.
    fn or(mut self, default: Value) -> Self {
        self.schema["default"] = default;
        self
    }

    fn required(self) -> Self {
        Self { required: true, ..self }
    }
}

/// A key that may be left out.
fn key(name: &'static str, mut schema: Value, what: impl Into<String>) -> Key {
    schema["description"] = Value::String(what.into());
    Key { name, schema, required: false }
}

/// A section with these keys and no other.
fn object(keys: Vec<Key>) -> Value {
    let required: Vec<_> = keys.iter().filter(|key| key.required).map(|key| key.name).collect();
    let properties: Map<_, _> = keys.into_iter().map(|key| (key.name.to_owned(), key.schema)).collect();
    let mut schema = json!({ "type": "object", "properties": properties, "additionalProperties": false });
    if !required.is_empty() {
        schema["required"] = json!(required);
    }
    schema
}

/// A section of several kinds.
fn kinds(branches: Vec<Value>) -> Value {
    json!({ "oneOf": branches })
}

/// The key that says of which kind a section is.
fn kind(name: &'static str, names: &[&str]) -> Key {
    let schema = match names {
        [one] => json!({ "type": "string", "const": one }),
        names => json!({ "type": "string", "enum": names }),
    };
    key(name, schema, format!("the kind: {}", names.join(", "))).like(json!(names[0])).required()
}

/// Any of several types.
fn any(of: &[Value]) -> Value {
    json!({ "anyOf": of })
}

fn number(range: Range) -> Value {
    let bounds = range.bounds();
    let mut schema = json!({ "type": "number" });
    let low = if bounds.low_open { "exclusiveMinimum" } else { "minimum" };
    if bounds.low.is_finite() {
        schema[low] = plain(bounds.low);
    }
    if bounds.high.is_finite() {
        schema["maximum"] = plain(bounds.high);
    }
    schema
}

/// Whole numbers without a point.
fn plain(value: f64) -> Value {
    if value.fract() == 0.0 && value.abs() < 1e15 { json!(value as i64) } else { json!(value) }
}

fn integer((low, high): (u64, u64)) -> Value {
    // An editor's integers are TOML's, which end at 2^63 - 1.
    if high > i64::MAX as u64 {
        return json!({ "type": "integer", "minimum": low });
    }
    json!({ "type": "integer", "minimum": low, "maximum": high })
}

fn text() -> Value {
    json!({ "type": "string" })
}

fn array(of: Value, least: usize, most: Option<usize>) -> Value {
    let mut schema = json!({ "type": "array", "items": of });
    if least > 0 {
        schema["minItems"] = json!(least);
    }
    if let Some(most) = most {
        schema["maxItems"] = json!(most);
    }
    schema
}

fn id() -> Value {
    integer((1, MAX_NODES))
}

fn ids(least: usize) -> Value {
    let mut schema = array(id(), least, None);
    schema["uniqueItems"] = json!(true);
    schema
}

/// A duration that may be zero.
fn duration() -> Value {
    json!({ "type": "string", "pattern": format!("^\\s*[0-9]+(\\.[0-9]*)?\\s*{}\\s*$", units()) })
}

/// A duration longer than zero.
fn span() -> Value {
    let digits = "(0*[1-9][0-9]*(\\.[0-9]*)?|0+\\.0*[1-9][0-9]*)";
    json!({ "type": "string", "pattern": format!("^\\s*{digits}\\s*{}\\s*$", units()) })
}

/// A duration that may be negative.
fn signed_duration() -> Value {
    json!({ "type": "string", "pattern": format!("^\\s*-?\\s*[0-9]+(\\.[0-9]*)?\\s*{}\\s*$", units()) })
}

fn units() -> String {
    format!("({})", duration::UNITS.map(|(name, _)| name).join("|"))
}

/// A number for all components, or one for each.
fn per_component(range: Range) -> Value {
    any(&[number(range), array(number(range), 1, Some(MAX_COMPONENTS))])
}

/// The schema of the scenario file (draft 2020-12, without what only that draft has).
#[must_use]
pub fn scenario() -> Value {
    let mut schema = object(vec![
        key("version", integer((1, 1)), "the version of this format").like(json!(1)).required(),
        key("title", text(), "shown in plots and summaries; default: the name of the file")
            .like(json!("Five agents")),
        key("seed", integer((0, u64::MAX)), "root of every random stream").or(json!(1)),
        key("time", time(), "the network's tick, and how long a run is").required(),
        key("graph", graph(), "who hears whom, and how much it counts").required(),
        key("coupling", coupling(), "how a node's input comes from what it hears").required(),
        key("agent", agent(), "what all nodes have in common: initial state and own dynamics"),
        key("node", array(node(), 0, None), "overrides for one node"),
        key("bus", bus_section(), "what carries the states"),
        key("link", array(link(), 0, None), "what happens between two neighbours, after what the bus does"),
        key("event", array(event(), 0, None), "something that happens to nodes or links"),
        key("faults", faults_section(), "events by chance, from the seed"),
        key("clock", clock_section(), "how far the clocks of nodes may be off; each is drawn within it"),
        key("sync", sync(), "what keeps the clocks together, on CAN"),
        key(
            "safety",
            safety(),
            "what stops a node, beside its own state and funnel, and what it takes of its neighbours",
        ),
        key("expect", expect(), "what a run must keep; limits are exclusive"),
    ]);
    schema["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    schema["title"] = json!("Funnelnet scenario");
    schema["description"] = json!(
        "A network of funnel-coupled agents. What only the whole file shows is judged by sim-host check."
    );
    schema
}

fn time() -> Value {
    let shortest = format_duration(params::SHORTEST_TICK_NS.into());
    let longest = format_duration(u32::MAX.into());
    object(vec![
        key("tick", span(), format!("network tick T, from {shortest} to {longest}")).like(json!("1ms")).required(),
        key("round", span(), format!("the law decides once in a round: a whole number of ticks, 1 to {LONGEST_ROUND}; default: a tick"))
            .like(json!("5ms")),
        key("slow_start", duration(), format!("so long, in network time, a tick is an eighth of one to fields and funnels: whole ticks, up to {LONGEST_SLOW_START}"))
            .or(json!("0s")).like(json!("10ms")),
        key("duration", span(), "length of the run, a whole number of ticks").like(json!("1s")).required(),
    ])
}

fn graph() -> Value {
    let branch = |names: &[&str], own: Vec<Key>| {
        let common = vec![
            kind("kind", names),
            key("nodes", integer((1, MAX_NODES)), "number of nodes, ids 1 to this; a run takes 127 at most, with bus.model = \"none\" a million")
                .like(json!(5))
                .required(),
            key("weight", number(network::EDGE_WEIGHT), "weight of every edge").or(json!(1.0)),
        ];
        object(common.into_iter().chain(own).collect())
    };
    let degree =
        || key("degree", integer((1, MAX_NODES - 1)), "neighbours per node").like(json!(4)).required();
    let edges = array(array(number(network::EDGE_WEIGHT), 2, Some(3)), 0, None);
    kinds(vec![
        branch(&["ring", "path", "star", "complete"], vec![]),
        branch(
            &["grid", "torus"],
            vec![
                key("columns", integer((1, MAX_NODES)), "nodes per row; default: as square as it gets")
                    .like(json!(3)),
            ],
        ),
        branch(&["ring-lattice"], vec![degree()]),
        branch(&["random-regular"], vec![degree()]),
        branch(
            &["erdos-renyi"],
            vec![
                key("probability", number(Range::positive_probability()), "of each edge")
                    .like(json!(1.0))
                    .required(),
            ],
        ),
        branch(
            &["edges"],
            vec![
                key("edges", edges, "ids of both ends and the weight, which defaults to `weight`; symmetric")
                    .like(json!([[1, 2, 1.0], [2, 3], [3, 4], [4, 5]]))
                    .required(),
            ],
        ),
        graph_file(),
    ])
}

/// The file says how many nodes there are.
fn graph_file() -> Value {
    let file = "CSV with columns from, to and weight, or GraphML (.graphml, .xml); relative to the scenario";
    let weight = "weight of each edge that has none in the file";
    object(vec![
        key("kind", json!({ "type": "string", "const": "file" }), "the kind: file; may be left out")
            .or(json!("file")),
        key("file", text(), file).like(json!("grid.csv")).required(),
        key("nodes", integer((1, MAX_NODES)), "number of nodes; default: the largest id in the file")
            .like(json!(5)),
        key("weight", number(network::EDGE_WEIGHT), weight).or(json!(1.0)),
    ])
}

fn coupling() -> Value {
    let gains = |keeps_funnels: &[bool]| gain(|kind| keeps_funnels.contains(&kind), |key| key);
    let gain_key = |keeps_funnels: &[bool], example: Value| {
        key("gain", gains(keeps_funnels), "mu: what becomes of the share of the funnel that is used")
            .like(example)
    };
    let reciprocal = || json!({ "kind": "reciprocal", "scale": 1.0 });
    let linear = || json!({ "kind": "linear", "slope": 10.0 });
    let branch = |names: &[&str], own: Vec<Key>| {
        let common = vec![
            key("funnel", funnel(|key| key), "psi, within which a node's diffusive term is kept")
                .like(json!({ "kind": "constant", "width": 1.0 })).required(),
            key("on_breach", on_breach(names), "what a node does whose term is outside its funnel").or(json!("ride")),
            key("floor", any(&[number(Range::positive(STATE).on_host()), json!({ "type": "string", "const": "f32" })]),
                "the narrowest funnel that is asked for (state units), or \"f32\" for what the f32 of a node resolves; default: none").like(json!("f32")),
            key("guard", number(Range::between(0.0, WIDEST_GUARD, "a share of the funnel")), "the law runs in (1 - guard) psi, and is judged by psi")
                .or(json!(0.0)),
            key("u_max", number(Range::positive(INPUT)), "the largest |u| that a node may ask for (state units per second), fed back into the law").like(json!(300.0)),
            damping(),
        ];
        object([kind("kind", names)].into_iter().chain(own).chain(common).collect())
    };
    let both = &[true, false];
    let in_funnels = ["edge-wise", "element-wise", "max-gain", "weakly-centralised"];
    let eta = key(
        "eta",
        number(Range::non_negative(STATE)),
        "errors below this (state units) leave the gain as it is",
    )
    .like(json!(0.1))
    .required();
    kinds(vec![
        branch(&["node-wise"], vec![gain_key(both, reciprocal()).required()]),
        branch(&in_funnels[..1], vec![gain_key(&[true], reciprocal()).required()]),
        branch(&in_funnels[1..3], vec![gain_key(&[true], reciprocal()).required()]),
        branch(&in_funnels[3..], vec![gain_key(&[true], reciprocal()).required()]),
        branch(&["linear"], vec![gain_key(&[false], linear()).required()]),
        branch(&["lambda-tracker"], vec![eta, gain_key(&[false], linear()).required()]),
        branch(&["none"], vec![gain_key(both, reciprocal())]),
    ])
}

fn damping() -> Key {
    let range = number(Range::between(DAMPING.0, DAMPING.1, "1"));
    key(
        "damping",
        any(&[range, json!({ "type": "string", "const": "graph" })]),
        "c of the law, or \"graph\": 1.1 times the largest eigenvalue of D^-1 L, at most 2.2; refused below that eigenvalue",
    )
    .like(json!(2.5))
}

/// Gains that keep funnels or do not; `of` changes each parameter.
fn gain(wanted: impl Fn(bool) -> bool, of: impl Fn(Key) -> Key) -> Value {
    let wanted = Gain::<f64>::KINDS.iter().filter(|kind| wanted(kind.keeps_funnels));
    let branch = |gain: &funnelnet_law::gain::Kind<f64>| {
        let parameters = gain.parameters.iter().map(|parameter| {
            let own = key(parameter.name, number(coupling::range(parameter)), parameter.unit);
            of(match parameter.default {
                Some(default) => own.or(json!(default)),
                None => own.like(json!(0.5)).required(),
            })
        });
        object([kind("kind", &[gain.name])].into_iter().chain(parameters).collect())
    };
    kinds(wanted.map(branch).collect())
}

/// Numbers of a funnel that narrows exponentially.
fn exponential() -> Vec<Key> {
    vec![
        key("start", number(Range::positive(STATE)), "width at t = 0 (state units)")
            .like(json!(40.0))
            .required(),
        key("end", number(Range::non_negative(STATE)), "width in the end (state units)")
            .like(json!(2.0))
            .required(),
        key("rate", number(Range::positive("1/s").up_to(LARGEST_RATE)), "1/s").like(json!(1.0)).required(),
    ]
}

fn constant() -> Vec<Key> {
    vec![key("width", number(Range::positive(STATE)), "state units").like(json!(1.0)).required()]
}

/// `of` changes each key but the kind.
fn funnel(of: impl Fn(Key) -> Key) -> Value {
    let start = || {
        key("start", number(Range::positive(STATE)), "width at t = 0 (state units)")
            .like(json!(40.0))
            .required()
    };
    let at = |what| key("at", span(), what).like(json!("5s")).required();
    let branch = |name: &'static str, own: Vec<Key>| {
        let factor = key(
            "factor",
            number(Range::positive("the paper's r_i")),
            "the paper's r_i, by which the funnel is wider",
        )
        .or(json!(1.0));
        object([kind("kind", &[name])].into_iter().chain([factor].into_iter().chain(own).map(&of)).collect())
    };
    let then = |name, keys: Vec<Key>| object([kind("kind", &[name])].into_iter().chain(keys).collect());
    let normalised = kinds(vec![then("exponential", exponential()), then("constant", constant())]);
    let scale = key(
        "scale",
        number(Range::positive("state units times seconds")),
        "state units times seconds; infinite at t = 0",
    )
    .like(json!(1.0))
    .required();
    kinds(vec![
        branch("exponential", exponential()),
        branch("constant", constant()),
        branch("reciprocal-time", vec![scale]),
        branch(
            "finite-time",
            vec![
                start(),
                at("when the funnel is closed"),
                key("power", number(Range::between(POWERS.0, POWERS.1, "1")), "exponent by which it closes")
                    .or(json!(1.0)),
            ],
        ),
        branch(
            "schedule",
            vec![
                start(),
                at("when the first part ends"),
                key(
                    "eps",
                    number(Range::between(SCHEDULE_EPS.0, SCHEDULE_EPS.1, "1")),
                    "how near the end of the first part comes",
                )
                .like(json!(0.1))
                .required(),
                key("then", normalised, "the funnel that follows")
                    .like(json!({ "kind": "constant", "width": 1.0 }))
                    .required(),
            ],
        ),
    ])
}

/// `couplings`: which reopening a funnel suits only some of.
fn on_breach(couplings: &[&str]) -> Value {
    let (words, reopens): (&[&str], _) = match couplings {
        ["weakly-centralised"] => (&["ride"], false),
        ["edge-wise"] => (&["ride", "stop"], false),
        _ => (&["ride", "stop", "reopen"], true),
    };
    let mut tables = vec![object(vec![kind("kind", if reopens { &words[..2] } else { words })])];
    if reopens {
        tables.push(object(vec![
            kind("kind", &["reopen"]),
            key(
                "margin",
                number(Range::between(1.01, 1e6, "1")),
                "|nu| / psi is 1 / margin in the wider funnel",
            )
            .or(json!(1.5)),
            key(
                "rate",
                number(Range::positive("1/s").up_to(LARGEST_RATE)),
                "how fast the added width decays, 1/s",
            )
            .or(json!(1.0)),
        ]));
    }
    any(&[json!({ "type": "string", "enum": words }), kinds(tables)])
}

/// What `[agent]` and `[[node]]` share.
fn of_node() -> Vec<Key> {
    vec![
        key("state", per_component(agents::STATE), "initial state: a number, or an array for a vector state")
            .like(json!(0.5)),
        key(
            "noise",
            number(agents::NOISE),
            "standard deviation of Gaussian noise on each state as it is sent",
        )
        .like(json!(0.1)),
        key("inputs", inputs(), "values over time from CSV files that expressions may name").like(json!({})),
        key("limits", limits(), "what an actuator can do: bounds of the input, around zero")
            .like(json!({ "low": -5.0, "high": 5.0 })),
        key("compute", duration(), "time from a node's tick to its frames, shorter than the tick")
            .like(json!("20us")),
    ]
}

fn agent() -> Value {
    let unit = json!({ "type": "string", "minLength": 1, "maxLength": agents::LONGEST_UNIT });
    let own = vec![
        key("dynamics", dynamics(|key| key), "the node's own field: needed here or in each node")
            .like(json!({ "kind": "affine", "slope": -1.0 })),
        key("unit", unit, "the unit of the states, shown on the axes of pictures").like(json!("degC")),
        key("random", random(), "what is drawn for each node, from the seed")
            .like(json!({ "state": { "uniform": [-1.0, 1.0] } })),
    ];
    let with_default = |key: Key| match key.name {
        "state" | "noise" => key.or(json!(0.0)),
        "compute" => key.or(json!("0s")),
        "inputs" => key.or(json!({})),
        _ => key,
    };
    object(own.into_iter().chain(of_node().into_iter().map(with_default)).collect())
}

/// Draws, by key.
fn random() -> Value {
    let of = |name, range: Range, what: &str| {
        let low_high = array(number(range), 2, Some(2));
        let uniform = object(vec![key("uniform", low_high.clone(), "lowest and highest value").required()]);
        let normal = object(vec![key("normal", low_high, "mean and standard deviation").required()]);
        let example = if name == "slope" { [-2.0, -0.5] } else { [0.0, 1.0] };
        key(name, kinds(vec![uniform, normal]), what).like(json!({ "uniform": example }))
    };
    object(vec![
        of("state", agents::STATE, "initial state (state units)"),
        of("slope", agents::SLOPE, "slope of an affine field, 1/s"),
        of("offset", agents::INPUT, "offset of an affine field (state units per second)"),
        of("amplitude", agents::INPUT, "amplitude of each sine (state units per second)"),
        of("phase", agents::PHASE, "phase of each sine, rad"),
    ])
}

/// An override is merged over the default, so that nothing of it is required.
fn node() -> Value {
    // What an override leaves out is the node's default, not the section's.
    let loose = |mut key: Key| {
        if let Some(default) = key.schema.as_object_mut().and_then(|schema| schema.remove("default")) {
            key = key.like(default);
        }
        Key { required: false, ..key }
    };
    let own = vec![
        key("id", id(), "the node that it changes").like(json!(1)).required(),
        key(
            "dynamics",
            merged(dynamics(loose)),
            "merged over the default of the same kind; another kind starts afresh",
        )
        .like(json!({ "offset": 1.0 })),
        key(
            "gain",
            merged(gain(|_| true, loose)),
            "merged over the default of the same kind; another kind starts afresh",
        )
        .like(json!({ "scale": 2.0 })),
        key(
            "funnel",
            merged(funnel(loose)),
            "merged over the default of the same kind; another kind starts afresh",
        )
        .like(json!({ "factor": 2.0 })),
        damping(),
        key("clock", own_clock(), "the clock of this node").like(json!({ "drift_ppm": -50.0 })),
    ];
    object(own.into_iter().chain(of_node()).collect())
}

/// The kinds, and what may be said without naming one.
fn merged(mut kinds: Value) -> Value {
    let Some(branches) = kinds["oneOf"].as_array_mut() else { return kinds };
    let mut all = Map::new();
    for branch in branches.iter() {
        for (name, schema) in branch["properties"].as_object().into_iter().flatten() {
            if name != "kind" {
                all.insert(name.clone(), schema.clone());
            }
        }
    }
    branches.push(json!({ "type": "object", "properties": all, "additionalProperties": false }));
    kinds
}

/// `of` changes each key but the kind.
fn dynamics(of: impl Fn(Key) -> Key) -> Value {
    let slope = agents::SLOPE;
    let matrix = array(array(number(slope), 1, Some(MAX_COMPONENTS)), 1, Some(MAX_COMPONENTS));
    let affine = [
        key("slope", any(&[number(slope), matrix]), "1/s; a matrix, row by row, for vector states")
            .or(json!(0.0)),
        key("offset", per_component(agents::INPUT), "state units per second").or(json!(0.0)),
        key("sines", array(sine(), 0, Some(MAX_SINES)), "sum of amplitude sin(frequency t + phase)")
            .or(json!([])),
    ];
    let f = key(
        "f",
        any(&[text(), array(text(), 1, Some(MAX_COMPONENTS))]),
        "the field in state units per second; an array for vector states",
    )
    .like(json!("-x + sin(t)"))
    .required();
    kinds(vec![
        object([kind("kind", &["affine"])].into_iter().chain(affine.into_iter().map(&of)).collect()),
        object(vec![kind("kind", &["expression"]), of(f)]),
    ])
}

fn sine() -> Value {
    object(vec![
        key("amplitude", per_component(agents::INPUT), "state units per second").like(json!(10.0)).required(),
        key("frequency", number(agents::FREQUENCY), "rad/s").like(json!(1.0)).required(),
        key("phase", per_component(agents::PHASE), "rad").or(json!(0.0)),
    ])
}

fn inputs() -> Value {
    let input = object(vec![
        key("file", text(), "a CSV file beside the scenario").like(json!("load.csv")).required(),
        key("time", text(), "column of times, s").or(json!("t")),
        key("column", text(), "column of values").like(json!("p_kw")).required(),
    ]);
    let most = funnelnet_law::program::MAX_INPUTS;
    json!({ "type": "object", "additionalProperties": input, "maxProperties": most })
}

fn limits() -> Value {
    let input = |range| number(range);
    let low = Range::between(-params::LARGEST, 0.0, INPUT);
    object(vec![
        key("low", input(low), "state units per second, zero at most").like(json!(-5.0)).required(),
        key("high", input(Range::non_negative(INPUT)), "state units per second, zero at least")
            .like(json!(5.0))
            .required(),
    ])
}

/// A probability, or bursts.
fn loss() -> Key {
    let probability = || number(Range::probability());
    let changes = || number(Range::positive_probability());
    let bursts = object(vec![
        key("good", probability(), "probability of a loss in the good state").or(json!(0.0)),
        key("bad", probability(), "probability of a loss in the bad state").or(json!(1.0)),
        key("to_bad", changes(), "probability that the bad state follows the good one")
            .like(json!(0.01))
            .required(),
        key("to_good", changes(), "probability that the good state follows the bad one")
            .like(json!(0.1))
            .required(),
    ]);
    key("loss", any(&[probability(), bursts]), "probability that a receiver loses a frame; or bursts")
        .or(json!(0.0))
}

fn delay() -> [Key; 2] {
    [
        key("latency", duration(), "delay of every frame").or(json!("0s")),
        key("jitter", duration(), "largest extra delay, uniform, per frame").or(json!("0s")),
    ]
}

fn bus_section() -> Value {
    let bitrate = |limits| key("bitrate", integer(limits), "bit/s").or(json!(bus::DEFAULT_BITRATE));
    let errors = || {
        let range = Range::between(0.0, bus::MOST_BIT_ERRORS, "of the bits");
        key("bit_errors", number(range), "share of bits that are wrong").or(json!(0.0))
    };
    let point = |name, per_mille: u32| {
        key(
            name,
            number(bus::SAMPLE_POINT),
            "where in a bit its level is read, a whole number of thousandths",
        )
        .or(json!(f64::from(per_mille) / 1e3))
    };
    let can = |name: &'static str| {
        let limits = (bus::SLOWEST_BITRATE.into(), bus::DEFAULT_BITRATE.into());
        vec![
            kind("model", &[name]),
            bitrate(limits),
            point("sample_point", bus::SAMPLE_PER_MILLE),
            errors(),
            loss(),
        ]
    };
    let data = (bus::SLOWEST_BITRATE.into(), bus::FASTEST_DATA_BITRATE.into());
    let of_data = [
        key("data_bitrate", integer(data), "rate of the data, bit/s, no slower than bitrate")
            .or(json!(bus::DEFAULT_DATA_BITRATE)),
        point("data_sample_point", bus::DATA_SAMPLE_PER_MILLE),
    ];
    let wiring = json!({ "type": "string", "enum": ["lines", "hub"] });
    // Without a model the bus is ideal.
    let ideal = Key { required: false, ..kind("model", &["ideal"]) }.or(json!("ideal"));
    kinds(vec![
        object([ideal, loss()].into_iter().chain(delay()).collect()),
        object(vec![kind("model", &["none"])]),
        object(can("can")),
        object(can("can-fd").into_iter().chain(of_data).collect()),
        object(vec![
            kind("model", &["uart"]),
            bitrate(bus::BAUDS),
            key("wiring", wiring, "a line for each edge, or for each node to a hub").or(json!("lines")),
            key(
                "receive_buffer",
                integer((1, bus::LARGEST_RECEIVE_BUFFER)),
                "bytes that a driver holds for a node that computes",
            )
            .or(json!(bus::DEFAULT_RECEIVE_BUFFER)),
            errors(),
            loss(),
        ]),
    ])
}

fn link() -> Value {
    let share = |name, what| key(name, number(Range::probability()), what).or(json!(0.0));
    let of_frames = [
        loss(),
        share("reorder", "probability that a frame comes after the next one"),
        share("duplicate", "probability that a frame comes twice"),
        share("corrupt", "probability that the receiver reads a bit of a frame wrong"),
    ];
    let branch = |ends: Vec<Key>, of_frames: Vec<Key>| {
        object(ends.into_iter().chain(of_frames).chain(delay()).collect())
    };
    branch(
        vec![
            key(
                "between",
                {
                    let mut pair = ids(2);
                    pair["maxItems"] = json!(2);
                    pair
                },
                "both directions between two neighbours",
            )
            .like(json!([1, 2])),
            key("from", id(), "the sender, with `to`: one direction").like(json!(1)),
            key("to", id(), "the receiver").like(json!(2)),
        ],
        of_frames.into_iter().collect(),
    )
}

fn event() -> Value {
    let at = || key("at", duration(), "time from the start").like(json!("500ms")).required();
    let of_nodes = || {
        [
            key("node", id(), "the node that it happens to").like(json!(2)),
            key("nodes", ids(1), "the nodes that it happens to").like(json!([2, 3])),
        ]
    };
    let pair = || {
        let mut pair = ids(2);
        pair["maxItems"] = json!(2);
        pair
    };
    let of_links = || {
        [
            key("link", pair(), "ids of two neighbours").like(json!([1, 2])),
            key(
                "groups",
                array(ids(1), 2, None),
                "two or more groups of nodes, between which links are cut or repaired",
            )
            .like(json!([[1, 2], [3, 4, 5]])),
        ]
    };
    let lasts = key("for", span(), "how long a bounced node is off").or(json!("100ms"));
    let by = key("by", signed_duration(), "how far the clock jumps: a second at most").like(json!("-300us"));
    let drift =
        key("drift_ppm", number(clock::DRIFT), "how much too fast it is from then on, parts in a million")
            .like(json!(-50.0));
    let silent = key("for", span(), "how long no SYNC goes out").like(json!("100ms")).required();
    let goes_on = || key("for", span(), "how long that goes on").like(json!("100ms"));
    let frames = |name: &'static str, keys: Vec<Key>| {
        object(
            [at(), kind("kind", &[name])]
                .into_iter()
                .chain(keys)
                .chain(of_nodes())
                .chain(of_links())
                .collect(),
        )
    };
    let said = || {
        [
            key("constant", number(event::SAID), "what is said for a state").like(json!(3.0)),
            key("ramp", number(event::SLOPE), "its slope per s, from the state at the begin")
                .like(json!(1.0)),
            key("offset", number(event::SAID), "how far it is from the state").like(json!(0.5)),
        ]
    };
    let tale = |name: &'static str, keys: Vec<Key>| {
        object([at(), kind("kind", &[name]), goes_on()].into_iter().chain(keys).chain(of_nodes()).collect())
    };
    let share = key(
        "probability",
        number(Range::positive_probability()),
        "that a receiver reads a bit of a frame wrong",
    );
    let noise = Range::between(1e-9, bus::MOST_BIT_ERRORS, "of the bits");
    let name = key("as", id(), "the node in whose name it speaks").like(json!(3)).required();
    let babbled =
        key("id", integer((0, event::LARGEST_ID)), "the 11-bit identifier of what it sends").or(json!(0));
    let age = || key("age", span(), "how old the states are that are said once more").like(json!("100ms"));
    let of_sensor = vec![
        key("constant", number(event::SAID), "what is measured for a state").like(json!(3.0)),
        key(
            "ramp",
            number(event::SLOPE),
            "its slope per s, from the state at the begin; 0.0 for a sensor that is stuck",
        )
        .like(json!(0.0)),
        key("offset", number(event::SAID), "how far it is from the state").like(json!(0.5)),
        key("noise", number(event::DEVIATION), "standard deviation of what is measured").like(json!(0.05)),
        key("loss", number(Range::positive_probability()), "probability that a sample fails")
            .like(json!(0.5)),
        key("age", span(), "how old what is measured is").like(json!("10ms")),
    ];
    let of_actuator = vec![
        key(
            "effectiveness",
            number(event::PART),
            "part of the input that is done; 0.0 for an actuator that is dead",
        )
        .like(json!(0.5)),
        key("limit", number(event::LIMIT), "what is done at most, in both directions").like(json!(2.0)),
        key("constant", number(event::INPUT), "what is done whatever the input is").like(json!(3.0)),
        key(
            "ramp",
            number(event::INPUT_SLOPE),
            "its slope per s, from what was done at the begin; 0.0 for an actuator that is stuck",
        )
        .like(json!(0.0)),
    ];
    let new_value = [
        key("key", settable(), "what changes while nodes run").like(json!("coupling.funnel.end")).required(),
        key("value", json!({}), "what the key gets").like(json!(0.5)).required(),
    ];
    kinds(vec![
        frames("burst", vec![goes_on().required(), loss().required()]),
        frames("corrupt", vec![goes_on().required(), share.like(json!(0.01)).required()]),
        frames("hold", vec![goes_on()]),
        frames("release", vec![]),
        object(vec![
            at(),
            kind("kind", &["noise"]),
            goes_on().required(),
            key("bit_errors", number(noise), "share of bits that are wrong").like(json!(1e-4)).required(),
        ]),
        object(vec![at(), kind("kind", &["short"]), goes_on().required()]),
        tale("cut", vec![]),
        tale("babble", vec![babbled]),
        tale("liar", said().into_iter().collect()),
        tale("impostor", said().into_iter().chain([name]).collect()),
        tale("replayer", vec![age().required()]),
        tale("sensor", of_sensor),
        tale("actuator", of_actuator),
        object([at(), kind("kind", &["crash", "leave", "join"])].into_iter().chain(of_nodes()).collect()),
        object([at(), kind("kind", &["bounce"]), lasts].into_iter().chain(of_nodes()).collect()),
        object([at(), kind("kind", &["partition", "repair"])].into_iter().chain(of_links()).collect()),
        object([at(), kind("kind", &["set"])].into_iter().chain(new_value).chain(of_nodes()).collect()),
        object([at(), kind("kind", &["clock"]), by, drift].into_iter().chain(of_nodes()).collect()),
        object([at(), kind("kind", &["sync-loss"]), silent].into_iter().chain(of_nodes()).collect()),
    ])
}

/// The keys that nodes adopt while they run.
fn settable() -> Value {
    let names = staged::SETTABLE.map(|(name, _)| name.replace('.', "\\."));
    json!({ "type": "string", "pattern": format!("^({})(\\.[^.]+)*$", names.join("|")) })
}

fn faults_section() -> Value {
    let names = faults::KINDS.map(|kind| kind.name());
    let one = json!({ "type": "string", "enum": names });
    let chance = || number(Range::positive_probability());
    object(vec![
        key("rate", number(faults::RATE), "events per second, on average").like(json!(0.5)).required(),
        key("kinds", array(one, 1, None), "what may happen, each as likely")
            .like(json!(["burst"]))
            .required(),
        key("from", duration(), "the earliest begin").or(json!("0s")),
        key("to", span(), "the latest end: the end of the run, or expect.recovered_within before it"),
        key("shortest", span(), "how long an event lasts at least").or(json!("10ms")),
        key("longest", span(), "how long it lasts at most").or(json!("200ms")),
        key("loss", chance(), "of a burst: probability that a frame is lost").or(json!(1.0)),
        key("probability", chance(), "of corrupt: that a receiver reads a bit of a frame wrong")
            .or(json!(0.1)),
        key("bit_errors", number(faults::BIT_ERRORS), "of noise: share of bits that are wrong")
            .or(json!(1e-3)),
        key("offset", number(faults::OFFSET), "of a liar and of a sensor: how far it is from the state")
            .or(json!(1.0)),
        key("effectiveness", number(faults::EFFECTIVENESS), "of an actuator: part of the input that it does")
            .or(json!(0.0)),
        key("age", span(), "of a replayer: how old its states are").or(json!("100ms")),
        key("jump", signed_duration(), "of a clock: how far it jumps").or(json!("300us")),
    ])
}

fn clock_section() -> Value {
    object(vec![
        key("offset", duration(), "how far clocks may be ahead or behind at the start, less than a tick")
            .or(json!("0s")),
        key("drift_ppm", number(clock::WIDTH), "how much too fast or slow, parts in a million")
            .or(json!(0.0)),
        key("wander", number(clock::WANDER), "how the drift changes, ppm in a second").or(json!(0.0)),
    ])
}

fn own_clock() -> Value {
    let jump = object(vec![
        key("at", duration(), "time from the start").like(json!("500ms")).required(),
        key("by", signed_duration(), "how far the clock jumps: a second at most")
            .like(json!("-300us"))
            .required(),
    ]);
    object(vec![
        key("offset", signed_duration(), "how far it is ahead at the start, less than a tick")
            .like(json!("-100us")),
        key("drift_ppm", number(clock::DRIFT), "how much it is too fast, parts in a million")
            .like(json!(-50.0)),
        key("wander", number(clock::WANDER), "how the drift changes, ppm in a second").like(json!(0.1)),
        key("jumps", array(jump, 0, None), "when the clock jumps").or(json!([])),
    ])
}

fn sync() -> Value {
    let period = format!(
        "time from one SYNC to the next, from a tick to {}",
        format_duration(clock::LONGEST_PERIOD_NS)
    );
    object(vec![
        key("period", span(), period).or(json!(format_duration(clock::PERIOD_NS))),
        key("masters", ids(1), "ids of the nodes that may be time master").or(json!([1])),
        key("off", json!({ "type": "boolean" }), "no SYNC at all").or(json!(false)),
    ])
}

fn safety() -> Value {
    let holdover = format!(
        "a node that ticks by SYNC stops when it has heard none for so long, a tick to {}",
        format_duration(LONGEST_HOLDOVER_NS)
    );
    object(vec![
        key(
            "lost_neighbours",
            integer((0, MAX_NEIGHBOURS as u64)),
            "so many neighbours lost at once stop a node; 0 never does",
        )
        .or(json!(0)),
        key("holdover", span(), holdover).like(json!("200ms")),
        key("heard_limit", number(Range::positive(STATE)), "the largest |x| that a node takes of a neighbour (state units)")
            .like(json!(50.0)),
        key(
            "heard_rate",
            number(Range::positive(INPUT)),
            "the largest change of a neighbour's state that a node takes (state units per second)",
        )
        .like(json!(100.0)),
        key(
            "drop_after",
            integer((0, MOST_DOUBTS)),
            "so many states in a row that were not taken drop the edge, until the neighbour starts anew; 0 never does; 10 with heard_limit or heard_rate",
        )
        .like(json!(10)),
    ])
}

/// Limits of a run or a part of it.
fn limit(name: &'static str, unit: &'static str, what: &str) -> Key {
    key(name, number(Range::positive(unit).on_host()), format!("{what} ({unit})")).like(json!(10.0))
}

fn expect() -> Value {
    let final_value = object(vec![
        key("is", number(Range::any(STATE).on_host()), "state units").like(json!(1.0)).required(),
        key("within", number(Range::positive(STATE).on_host()), "state units").like(json!(0.1)).required(),
    ]);
    let window = object(vec![
        key("from", duration(), "where it begins").or(json!("0s")),
        key("to", span(), "where it ends, included").like(json!("500ms")).required(),
        limit("funnel_ratio", "|nu| / psi", "largest ratio"),
        limit("spread", STATE, "largest max x - min x"),
        limit("emergent_error", STATE, "largest distance of a node to the emergent dynamics"),
        limit("reference_error", STATE, "largest distance to the continuous-time reference"),
        limit("max_input", INPUT, "largest |u|"),
    ]);
    let stopped = any(&[array(id(), 0, None), json!({ "type": "string", "const": "any" })]);
    object(vec![
        limit("funnel_ratio", "|nu| / psi", "largest true ratio over all nodes and ticks"),
        limit("final_spread", STATE, "max x - min x at the end"),
        limit("emergent_error", STATE, "largest distance of a node to the emergent dynamics at the end"),
        limit("blended_error", STATE, "largest distance of a node to the blended dynamics at the end"),
        limit("reference_error", STATE, "largest distance to the continuous-time reference"),
        key("final_value", final_value, "every component of every node ends nearer than `within` to `is`")
            .like(json!({ "is": 1.0, "within": 0.1 })),
        limit("max_input", INPUT, "largest |u| over all nodes and ticks"),
        key(
            "recovered_within",
            span(),
            "longest time from the end of an event to the last tick outside a funnel",
        )
        .like(json!("500ms")),
        key("stopped", stopped, "ids of nodes that may stop by themselves, or \"any\"").or(json!([])),
        key("window", array(window, 0, None), "limits for a part of the run"),
    ])
}
