//! What `check` says of a scenario without a bus: what scales, and by name what is not looked at.

use serde_json::json;

use super::{Finding, Report, Status, about, figure};
use crate::extremes::{larger, largest, smaller};
use crate::scenario::{Graph, LargeScenario};
use funnelnet_law::floor::Floor;

/// The most nodes whose graph is looked at by all its eigenvalues, and by a few.
const DENSE: usize = 400;
const SPARSE: usize = 100_000;
/// The largest error of the second eigenvalue that is called none, and that is called known: relative.
const EXACT: f64 = 1e-6;
const KNOWN: f64 = 1e-4;
/// Decay within a tick that is fast for the midpoint step, and from which it grows.
const FAST: f64 = 0.5;
const UNSTABLE: f64 = 2.0;
/// What `check` looks at in networks with a bus.
const NOT_LOOKED_AT: [(&str, &str, &str); 6] = [
    ("emergent", "Emergent dynamics", "where the network will go, and how fast it contracts"),
    (
        "narrowest-funnel",
        "Narrowest funnel",
        "how narrow a funnel the tick holds: it depends on the emergent dynamics",
    ),
    ("input", "Inputs", "how large an input each node needs"),
    (
        "followed",
        "The sampled law",
        "whether it stays inside its funnels: run it, or a smaller network of the same kind",
    ),
    ("margin", "Margin", "what is left of each funnel along the emergent dynamics"),
    ("expectations", "Expectations", "whether the run keeps what is expected of it"),
];

/// What all nodes come to.
struct Extent {
    /// Largest size of an initial state, state units.
    state: f64,
    /// Largest decay of a field, 1/s, and fastest sine, rad/s.
    steepness: f64,
    fastest: f64,
    /// Narrowest and widest funnel at the end, state units.
    narrowest: f64,
    widest: f64,
}

/// Checks a scenario without a bus. It has been validated, so that the graph is connected and every node starts inside
/// its funnel.
#[must_use]
pub fn check_large(scenario: &LargeScenario) -> Report {
    let extent = extent(scenario);
    let degrees = scenario.graph.degrees();
    let mut findings = vec![graph(&scenario.graph, &degrees)];
    findings.extend(agreement(scenario, &extent));
    findings.push(start(scenario));
    findings.push(speed(scenario, &extent));
    findings.push(resolution(scenario, &extent, &degrees));
    findings.extend(NOT_LOOKED_AT.map(|(name, title, what)| {
        Finding::new(name, title, format!("{what} (bus.model = \"none\")"), json!({}))
            .stands(Status::NotChecked)
    }));
    Report {
        scenario: scenario.title.clone(),
        path: scenario.path.display().to_string(),
        seed: scenario.seed,
        nodes: scenario.nodes(),
        edges: scenario.graph.edges.len(),
        tick_s: scenario.time.tick_s(),
        ticks: scenario.time.ticks,
        pass: findings.iter().all(|finding| finding.status != Status::Fail),
        findings,
        per_node: Vec::new(),
        bus: None,
    }
}

fn extent(scenario: &LargeScenario) -> Extent {
    let end = scenario.time.end_s();
    let mut extent =
        Extent { state: 0.0, steepness: 0.0, fastest: 0.0, narrowest: f64::INFINITY, widest: 0.0 };
    scenario.for_each_node(|_, _, node| {
        extent.state = largest(extent.state, node.state.iter().map(|x| x.abs()));
        extent.steepness = larger(extent.steepness, node.dynamics.steepness());
        extent.fastest = larger(extent.fastest, node.dynamics.fastest_sine());
        let width = node.funnel.width(end);
        (extent.narrowest, extent.widest) = (smaller(extent.narrowest, width), larger(extent.widest, width));
    });
    extent
}

fn graph(graph: &Graph, degrees: &[f64]) -> Finding {
    let (low, high) = crate::extremes::extremes(degrees.iter().copied());
    let mean = degrees.iter().sum::<f64>() / degrees.len().max(1) as f64;
    let text = format!(
        "connected and undirected (Assumption 1); weighted degrees {} to {}, {} on average",
        figure(low),
        figure(high),
        figure(mean)
    );
    let values =
        json!({ "edges": graph.edges.len(), "degree_min": low, "degree_max": high, "degree_mean": mean });
    Finding::new("graph", "Graph", text, values)
}

/// The second eigenvalue with the bound of its error, and the bound on the spread that follows.
fn agreement(scenario: &LargeScenario, extent: &Extent) -> [Finding; 2] {
    let graph = &scenario.graph;
    let (value, relative) = match graph.nodes {
        0 | 1 => (0.0, f64::NAN),
        nodes if nodes <= DENSE => (graph.lambda2(), 0.0),
        nodes if nodes <= SPARSE => graph
            .sparse_lambda2()
            .map_or((f64::NAN, f64::NAN), |estimate| (estimate.value, estimate.relative())),
        _ => (f64::NAN, f64::NAN),
    };
    let is_known = relative <= KNOWN;
    let text = match is_known {
        true if relative <= EXACT => format!("lambda_2 = {}, to a millionth", figure(value)),
        true => format!("lambda_2 = {}, to {} of it", figure(value), about(relative)),
        false if graph.nodes > SPARSE => format!("lambda_2 of more than {SPARSE} nodes"),
        false if graph.nodes < 2 => "lambda_2 of a single node".to_owned(),
        false => format!(
            "lambda_2: at most {}, and its error may be {} of it: eigenvalues are close together",
            figure(value),
            about(relative)
        ),
    };
    let values = json!({ "lambda2": value, "relative_error": relative });
    let status = if is_known { Status::Ok } else { Status::NotChecked };
    let connectivity = Finding::new("connectivity", "Connectivity", text, values).stands(status);
    let bound = 2.0 * (graph.nodes as f64).sqrt() / value * extent.widest;
    let (text, values) = match is_known && scenario.coupling.keeps_funnels() {
        true => (
            format!("states end within {} of each other while every term is in its funnel", figure(bound)),
            json!({ "bound": bound }),
        ),
        false => ("the bound on the spread needs lambda_2 and funnels that are kept".to_owned(), json!({})),
    };
    let status = if is_known && scenario.coupling.keeps_funnels() { Status::Ok } else { Status::NotChecked };
    [connectivity, Finding::new("agreement", "Agreement", text, values).stands(status)]
}

fn start(scenario: &LargeScenario) -> Finding {
    let (outside, (index, nu, psi)) = crate::scenario::large_starts(scenario);
    let ratio = nu / psi;
    let text = format!("|nu| / psi is {} at most at t = 0, at node {}", figure(ratio), index + 1);
    let values = json!({ "ratio": ratio, "node": index + 1, "outside": outside });
    let finding = Finding::new("start", "Start", text, values);
    match (outside, scenario.coupling.keeps_funnels()) {
        (0, _) => finding,
        _ => finding.stands(Status::Note),
    }
}

fn speed(scenario: &LargeScenario, extent: &Extent) -> Finding {
    let tick = scenario.time.tick_s();
    let (decay, angle) = (extent.steepness * tick, extent.fastest * tick);
    let text =
        format!("fields change by {} and sines by {} rad per tick at most", about(decay), about(angle));
    let values = json!({ "decay": decay, "angle": angle });
    let finding = Finding::new("fields", "Fields", text, values);
    let worst = larger(decay, angle);
    if decay >= UNSTABLE || angle >= std::f64::consts::PI {
        return finding
            .advise(Status::Fail, "use a shorter tick: the node's midpoint step does not follow".to_owned());
    }
    if worst > FAST {
        return finding
            .advise(Status::Note, "fast for the node's midpoint step; use a shorter tick".to_owned());
    }
    finding
}

fn resolution(scenario: &LargeScenario, extent: &Extent, degrees: &[f64]) -> Finding {
    let degree = largest(0.0, degrees.iter().copied());
    let floor = Floor::<f64>::of_f32(degree, scenario.time.tick_s()).width(extent.state, 0.0);
    let text = format!(
        "f32 resolves funnels down to {} at states of the size of the start; the narrowest ends at {}",
        about(floor),
        figure(extent.narrowest)
    );
    let values = json!({ "floor": floor, "narrowest": extent.narrowest });
    let finding = Finding::new("resolution", "Resolution of f32", text, values);
    match floor < extent.narrowest {
        true => finding.stands(Status::Note),
        false => finding.advise(
            Status::Warn,
            "accept it by coupling.floor = \"f32\", or let the funnel end wider".to_owned(),
        ),
    }
}
