//! What `check` says of a scenario without a bus: what scales, and by name what is not looked at.
#![allow(clippy::neg_cmp_op_on_partial_ord, reason = "what is not a number is not known")]

use serde_json::json;

use super::limits::{ALIASED, FAST, UNSTABLE, stiffness};
use super::{Finding, Report, Status, about, figure};
use crate::extremes::{larger, largest, smaller};
use crate::scenario::{Estimate, FloorSpec, Graph, LargeScenario};
use funnelnet_law::floor::Floor;

/// The most nodes whose graph is looked at by all its eigenvalues, and by a few.
const DENSE: usize = 400;
const SPARSE: usize = 100_000;
/// The largest error of the second eigenvalue that is called none, and that is called known: relative.
const EXACT: f64 = 1e-6;
const KNOWN: f64 = 1e-4;
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
    /// Steepest field, what of a field makes the node's step grow, both 1/s, and fastest sine, rad/s.
    steepness: f64,
    stiffness: f64,
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
    let mut extent = Extent {
        state: 0.0,
        steepness: 0.0,
        stiffness: 0.0,
        fastest: 0.0,
        narrowest: f64::INFINITY,
        widest: 0.0,
    };
    scenario.for_each_node(|_, _, node| {
        extent.state = largest(extent.state, node.state.iter().map(|x| x.abs()));
        extent.steepness = larger(extent.steepness, node.dynamics.steepness());
        extent.stiffness = larger(extent.stiffness, stiffness(&node.dynamics));
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
    let found = match graph.nodes {
        0 | 1 => None,
        nodes if nodes <= DENSE => Some(Estimate { value: graph.lambda2(), error: 0.0 }),
        nodes if nodes <= SPARSE => graph.sparse_lambda2(),
        _ => None,
    };
    let known = found.filter(|found| found.value > 0.0 && found.relative() <= KNOWN);
    let values = match found {
        Some(found) => json!({ "lambda2": found.value, "relative_error": found.relative() }),
        None => json!({}),
    };
    let status = if known.is_some() { Status::Ok } else { Status::NotChecked };
    let connectivity =
        Finding::new("connectivity", "Connectivity", connectivity(graph.nodes, found), values).stands(status);
    [connectivity, spread(scenario, extent, known)]
}

/// What is said of the second eigenvalue.
fn connectivity(nodes: usize, found: Option<Estimate>) -> String {
    let Some(found) = found else {
        return match nodes {
            0 | 1 => "lambda_2 of a single node".to_owned(),
            nodes if nodes > SPARSE => format!("lambda_2 of more than {SPARSE} nodes"),
            _ => "lambda_2 is not found: eigenvalues are close together".to_owned(),
        };
    };
    let (value, relative) = (figure(found.value), found.relative());
    if nodes <= DENSE {
        return format!("lambda_2 = {value}, to a millionth");
    }
    // Written so that NaN is not known.
    if !(found.value > 0.0 && relative <= KNOWN) {
        return format!(
            "lambda_2 is at most {value}, and not found more closely: eigenvalues are close together"
        );
    }
    let error =
        if relative <= EXACT { "a millionth".to_owned() } else { format!("{} of it", about(relative)) };
    format!("lambda_2 = {value}, to {error}, as far as two searches from random vectors can tell")
}

/// The bound on the spread at the end.
fn spread(scenario: &LargeScenario, extent: &Extent, known: Option<Estimate>) -> Finding {
    let unknown = |why: &str| {
        Finding::new("agreement", "Agreement", why.to_owned(), json!({})).stands(Status::NotChecked)
    };
    let Some(lambda2) = known.filter(|_| scenario.coupling.keeps_funnels()) else {
        return unknown("the bound on the spread needs lambda_2 and funnels that are kept");
    };
    if scenario.floor == FloorSpec::F32 {
        return unknown(
            "the bound on the spread needs funnels without the floor of f32, which coupling.floor accepts",
        );
    }
    let nodes = scenario.nodes() as f64;
    let bound = 2.0 * nodes.sqrt() / (lambda2.value - lambda2.error) * extent.widest;
    let text = format!("states end within {} of each other while every term is in its funnel", figure(bound));
    Finding::new("agreement", "Agreement", text, json!({ "bound": bound }))
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
    if larger(decay, angle) <= FAST {
        return finding;
    }
    if extent.stiffness * tick >= UNSTABLE {
        return finding
            .advise(Status::Fail, "use a shorter tick: the node's own step grows from 2 on".to_owned());
    }
    let advice = match angle > ALIASED {
        true => "use a shorter tick: a node sees such a sine once per tick, as a slower one or as a constant",
        false => "fast for the node's midpoint step; use a shorter tick",
    };
    finding.advise(Status::Note, advice.to_owned())
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
    match floor < extent.narrowest || scenario.floor == FloorSpec::F32 {
        true => finding.stands(Status::Note),
        false => finding.advise(
            Status::Warn,
            "accept it by coupling.floor = \"f32\", or let the funnel end wider".to_owned(),
        ),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on has failed")]

    use super::*;
    use crate::scenario::{AnyScenario, Override, Source};

    fn checked(graph: &str, list: &[&str]) -> Report {
        let text = format!(
            r#"
            version = 1
            time = {{ tick = "1ms", duration = "100ms" }}
            graph = {{ {graph} }}
            coupling = {{ kind = "node-wise", gain = {{ kind = "reciprocal" }}, funnel = {{ kind = "constant", width = 60 }} }}
            agent.dynamics = {{ kind = "affine", slope = -1.0, offset = 0.5 }}
            bus.model = "none"
            "#
        );
        let overrides: Vec<_> = list.iter().map(|text| Override::parse(text).unwrap()).collect();
        match (Source { text, path: "large.toml".into() }).any_scenario(&overrides) {
            Ok(AnyScenario::Large(scenario)) => check_large(&scenario),
            other => panic!("{other:?}"),
        }
    }

    fn of<'r>(report: &'r Report, name: &str) -> &'r Finding {
        report.findings.iter().find(|finding| finding.name == name).unwrap()
    }

    #[test]
    fn what_is_not_found_has_no_value() {
        let report = checked("kind = \"path\", nodes = 1900", &[]);
        let found = of(&report, "connectivity");
        assert_eq!(found.status, Status::NotChecked, "{}", found.text);
        assert!(found.text.contains("not found: eigenvalues are close together"), "{}", found.text);
        assert!(!report.to_string().contains("NaN"), "{report}");
        assert_eq!(of(&report, "agreement").status, Status::NotChecked);
    }

    /// With the floor of f32 accepted, no bound is known, and nothing is left to accept.
    #[test]
    fn a_floor_that_is_accepted_is_no_bound_and_no_advice() {
        let closing = "coupling.funnel={ kind = \"finite-time\", start = 40, at = \"50ms\", power = 2 }";
        let before = checked("kind = \"ring\", nodes = 20", &[closing]);
        assert!(of(&before, "resolution").advice.as_ref().unwrap().text.contains("coupling.floor"));
        assert_eq!(of(&before, "agreement").status, Status::Ok);
        let report = checked("kind = \"ring\", nodes = 20", &[closing, "coupling.floor=f32"]);
        assert_eq!(of(&report, "agreement").status, Status::NotChecked, "{report}");
        let resolution = of(&report, "resolution");
        assert_eq!((resolution.status, &resolution.advice), (Status::Note, &None), "{report}");
    }

    #[test]
    fn fast_fields_stand_as_they_do_with_a_bus() {
        let status = |field: &str| {
            let set = format!("agent.dynamics={{ kind = \"affine\", {field} }}");
            of(&checked("kind = \"ring\", nodes = 20", &[&set]), "fields").status
        };
        assert_eq!(status("slope = -1"), Status::Ok);
        assert_eq!(status("slope = -600"), Status::Note);
        assert_eq!(status("slope = -2000"), Status::Fail);
        // It grows by itself, and the step with it.
        assert_eq!(status("slope = 2000"), Status::Note);
        assert_eq!(status("slope = -1, sines = [{ amplitude = 1, frequency = 600 }]"), Status::Note);
        assert_eq!(status("slope = -1, sines = [{ amplitude = 1, frequency = 4000 }]"), Status::Note);
    }

    #[test]
    fn a_report_without_rows_has_no_table() {
        let text = checked("kind = \"ring\", nodes = 20", &[]).to_string();
        assert!(!text.contains("start |nu|/psi"), "{text}");
    }
}
