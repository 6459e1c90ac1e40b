//! Plots of real runs. With `GALLERY=folder` in the environment they are left there to be looked at.

use super::*;
use crate::record::Row;
use crate::reference::examples::{five_agents, narrow_path, ring};
use crate::reference::{ReferenceProblem, solve};
use funnelnet_law::funnel::{Funnel, Shape};
use funnelnet_law::{Gain, GainFunction};
use plotters::style::RGBColor;

/// The emergent vector field: the root `h` of `sum_i psi_i mu_i^-1(h - f_i(t, xi)) = 0`.
fn emergent(problem: &ReferenceProblem, t: f64, xi: f64) -> f64 {
    let fields: Vec<f64> = problem.fields.iter().map(|f| f.value(t, xi)).collect();
    let sum = |h: f64| -> f64 {
        let term = |i: usize| problem.funnels[i].width(t) * problem.gains[i].inverse(h - fields[i]);
        (0..fields.len()).map(term).sum()
    };
    let (mut low, mut high) = (-1e4, 1e4);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if sum(middle) < 0.0 { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

fn trace(title: &str, problem: &ReferenceProblem, end: f64, rows: usize) -> Trace {
    let times: Vec<f64> = (0..=rows).map(|k| end * k as f64 / rows as f64).collect();
    let solution = solve(problem, &times, &Default::default()).unwrap();
    let mut xi = problem.x0.iter().sum::<f64>() / problem.x0.len() as f64;
    let mut trace = Trace::new(title);
    let step = end / rows as f64;
    for (k, &t) in times.iter().enumerate() {
        let row = |table| solution.row(table, k).to_vec();
        let (x, nu, psi) = (row(&solution.x), row(&solution.nu), row(&solution.psi));
        trace.push(&Row {
            t,
            x,
            nu,
            psi,
            u: row(&solution.u),
            xi: vec![xi],
            blended: vec![0.5 * xi],
            ..Row::default()
        });
        let half = xi + 0.5 * step * emergent(problem, t, xi);
        xi += step * emergent(problem, t + 0.5 * step, half);
    }
    trace
}

fn keep(name: &str, svg: &str) {
    if let Some(folder) = std::env::var_os("GALLERY") {
        std::fs::write(std::path::Path::new(&folder).join(name), svg).unwrap();
    }
}

/// Both plots of a run.
fn draw(name: &str, trace: &Trace) -> (String, String) {
    let (states, funnels) = (states_svg(trace).unwrap(), funnels_svg(trace).unwrap());
    keep(&format!("{name}-states.svg"), &states);
    keep(&format!("{name}-funnels.svg"), &funnels);
    keep(&format!("{name}-inputs.svg"), &inputs_svg(trace).unwrap());
    (states, funnels)
}

/// Points of all polylines of a drawing, the longest first.
fn lengths(svg: &str) -> Vec<usize> {
    let points = svg.split("points=\"").skip(1).filter_map(|rest| rest.split('"').next());
    let mut lengths: Vec<usize> = points.map(|p| p.split_whitespace().count()).collect();
    lengths.sort_by(|a, b| b.cmp(a));
    lengths
}

#[test]
fn five_agents_are_drawn_whole_and_thin() {
    let problem = five_agents(ring(5), 2.0);
    let (states, funnels) = draw("five", &trace("Five heterogeneous agents on a ring", &problem, 20.0, 8000));
    for label in ["node 1", "node 5", "emergent", "blended", "time t in s", "state x in state units"] {
        assert!(states.contains(label), "{label}");
    }
    assert_eq!(funnels.matches("largest |").count(), 5);
    assert!(lengths(&states)[4] > 1000 && lengths(&states)[0] <= thin::POINTS + 2, "{:?}", lengths(&states));
    assert!(!states.contains("NaN") && !funnels.contains("NaN"));
}

#[test]
fn narrow_funnels_get_a_logarithmic_axis() {
    let (_, wide) = draw("five-narrow", &trace("0.02 + 38 exp(-t)", &five_agents(ring(5), 0.02), 20.0, 2000));
    assert!(wide.contains("0.01"));
    let (_, path) = draw("path", &trace("Path of 11, 1200 exp(-t)", &narrow_path(), 30.0, 2000));
    assert!(path.contains("1e\u{2212}11"), "decades down to the end of the funnel");
    assert_eq!(path.matches("largest |").count(), 11);
}

#[test]
fn a_crowd_is_drawn_alike_and_the_twelve_nearest_to_the_boundary_have_panels() {
    let mut problem = five_agents(ring(5), 2.0);
    problem.x0 = (0..30).map(|i| f64::from(i % 7)).collect();
    problem.edges = ring(30);
    problem.fields = (0..30).map(|i| problem.fields[i % 5].clone()).collect();
    problem.gains = vec![Gain::Reciprocal { scale: 1.0 }; 30];
    problem.funnels = vec![Funnel { factor: 1.0, shape: Shape::Constant { width: 20.0 } }; 30];
    let (states, funnels) = draw("crowd", &trace("Thirty agents", &problem, 5.0, 500));
    assert!(states.contains("30 nodes") && !states.contains("node 1"));
    assert!(funnels.contains("the 12 of 30 nodes nearest to the boundary"));
    assert_eq!(funnels.matches("largest |").count(), 12);
}

#[test]
fn nothing_to_show_is_an_error() {
    assert!(states_svg(&Trace::new("empty")).is_err());
    let mut single = Trace::new("one row");
    single.push(&Row { x: vec![1.0], nu: vec![0.0], psi: vec![1.0], ..Row::default() });
    assert!(funnels_svg(&single).is_err());
}

/// Time, states, true terms and believed terms.
type Told = (f64, Vec<f64>, Vec<f64>, Vec<f64>);

/// A network of nodes in funnels of 2.
fn told(rows: &[Told]) -> Trace {
    let mut trace = Trace::new("told");
    for (t, x, true_nu, nu) in rows.iter().cloned() {
        let (asked_psi, psi) = (vec![2.0; x.len()], vec![2.0; x.len()]);
        trace.push(&Row { t, x, nu, psi, true_nu, asked_psi, ..Row::default() });
    }
    trace
}

/// Numbers of points of the polylines and dots that have this colour and width in pixels.
fn drawn(svg: &str, colour: RGBColor, width: u32) -> Vec<usize> {
    let RGBColor(r, g, b) = colour;
    let stroke = format!("stroke=\"#{r:02X}{g:02X}{b:02X}\" stroke-width=\"{}\" points=\"", style::px(width));
    let points = svg.split(&stroke).skip(1).filter_map(|rest| rest.split('"').next());
    points.map(|points| points.split_whitespace().count()).collect()
}

/// Dots of this colour.
fn dots(svg: &str, colour: RGBColor) -> usize {
    let RGBColor(r, g, b) = colour;
    svg.lines()
        .filter(|l| l.starts_with("<circle") && l.contains(&format!("fill=\"#{r:02X}{g:02X}{b:02X}\"")))
        .count()
}

#[test]
fn a_node_that_hears_nobody_is_shown_outside_however_it_believes_to_be_inside() {
    let rows: Vec<_> =
        (0..100).map(|k| (f64::from(k), vec![0.0, 3.0], vec![3.0, -3.0], vec![0.0, 0.0])).collect();
    let (_, funnels) = draw("deaf", &told(&rows));
    for words in [
        "largest |\u{3BD}|/\u{3C8} = 1.500 at the rows",
        "outside at 100 rows",
        "\u{3BD} as the node believes",
    ] {
        assert!(funnels.contains(words), "{words}");
    }
    assert!(!funnels.contains("\u{3C8} as the node has it"), "the funnels are the same");
    // Terms and ratios of two nodes, and a line of the legend.
    assert_eq!(drawn(&funnels, style::BREACH, 3).len(), 5);
}

#[test]
fn what_a_node_believes_is_not_drawn_where_it_is_true() {
    let rows: Vec<_> =
        (0..100).map(|k| (f64::from(k), vec![0.0, 1.0], vec![1.0, -1.0], vec![1.0001, -1.0])).collect();
    let (_, funnels) = draw("honest", &told(&rows));
    assert!(!funnels.contains("believes") && !funnels.contains("outside"));
}

#[test]
fn the_largest_ratio_is_that_of_all_ticks_where_the_judge_has_it() {
    let rows: Vec<_> =
        (0..3).map(|k| (f64::from(k), vec![0.0, 1.0], vec![1.0, -1.0], vec![1.0, -1.0])).collect();
    let mut trace = told(&rows);
    let worst = |max_ratio, breaches| crate::judge::Worst {
        max_ratio,
        breaches,
        unknown: 0,
        uncoupled: 0,
        judged: 2001,
    };
    trace.judged(&[worst(1.25, 1), worst(f64::NAN, 7)]);
    let (_, funnels) = draw("judged", &trace);
    assert!(funnels.contains("= 1.250\n") && !funnels.contains("at the rows"), "the rows show 0.5");
    assert!(funnels.contains("outside at 1 tick, between the rows"));
    assert!(funnels.contains("largest |\u{3BD}|/\u{3C8}: not a number"));
}

#[test]
fn a_node_of_which_nothing_is_known_does_not_look_good() {
    let rows: Vec<_> =
        (0..3).map(|k| (f64::from(k), vec![0.0, f64::NAN], vec![f64::NAN; 2], vec![f64::NAN; 2])).collect();
    let (_, funnels) = draw("unknown", &told(&rows));
    assert_eq!(funnels.matches("largest |\u{3BD}|/\u{3C8}: not known").count(), 2);
    assert!(funnels.contains("not known at 3 rows"));
}

#[test]
fn an_absence_is_a_gap_with_a_name_and_a_single_known_point_in_it_is_a_dot() {
    let x = |k: i32| if (30..60).contains(&k) && k != 45 { f64::NAN } else { 1.0 };
    let rows: Vec<_> = (0..100)
        .map(|k| {
            let x = x(k);
            (f64::from(k), vec![x, 0.0], vec![-x, x], vec![-x, x])
        })
        .collect();
    let mut trace = told(&rows);
    let (states, funnels) = draw("gap", &trace);
    assert_eq!(drawn(&states, style::colour(0), 2), [30, 40, 2], "two pieces, and the legend");
    assert_eq!(dots(&states, style::colour(0)), 1);
    assert_eq!(dots(&funnels, style::colour(0)), 2, "term and ratio");
    trace.mark(1, 30.0, Some(60.0), MarkKind::Away);
    let (states, funnels) = draw("away", &trace);
    assert!(states.contains("node 1 away") && funnels.contains("away from 30 s to 60 s"));
    assert_eq!((drawn(&states, style::colour(0), 2), dots(&states, style::colour(0))), (vec![30, 40, 2], 0));
}

#[test]
fn a_curve_ends_in_a_cross_where_its_node_stops() {
    let x = |k: i32| f64::from(k.min(50)) / 50.0;
    let rows: Vec<_> =
        (0..100).map(|k| (f64::from(k), vec![x(k), 0.0], vec![-x(k), x(k)], vec![-x(k), x(k)])).collect();
    let mut trace = told(&rows);
    trace.mark(1, 50.0, None, MarkKind::Stopped);
    let (states, funnels) = draw("stopped", &trace);
    assert!(states.contains("node 1 stopped") && funnels.contains("stopped at 50 s; judged on"));
    // Its points; two strokes of a cross at the end are lines of two points; and the legend.
    let curve = drawn(&states, style::colour(0), 2);
    assert_eq!(curve.iter().max(), Some(&51), "{curve:?}");
    assert_eq!(drawn(&states, style::colour(1), 2).iter().max(), Some(&100));
}

#[test]
fn a_node_that_diverges_leaves_room_for_the_others_and_what_is_cut_is_said() {
    let far = |k: i32| if k < 50 { 0.5 } else { 1e9 };
    let rows: Vec<_> = (0..100)
        .map(|k| (f64::from(k), vec![far(k), 0.0], vec![-far(k), far(k)], vec![-far(k), far(k)]))
        .collect();
    let (states, funnels) = draw("diverged", &told(&rows));
    assert!(states.contains("clipped: values up to 1e9"));
    assert_eq!(funnels.matches("clipped: values up to 1e9").count(), 2);
    assert_eq!(funnels.matches("clipped: values up to 5e8").count(), 2, "the ratios");
    assert!(states.contains("\n1\n</text>") && funnels.contains("\n2\n</text>"), "axes of this scale");
    assert_eq!(drawn(&funnels, style::BREACH, 5), [50, 50], "where they are outside");
}

#[test]
fn a_funnel_that_begins_infinite_is_drawn_from_where_it_can_be_seen() {
    let mut trace = Trace::new("reciprocal time");
    for k in 0..200 {
        let t = 0.05 * f64::from(k);
        let nu = vec![0.2, -0.2];
        let psi = vec![1.0 / t; 2];
        trace.push(&Row {
            t,
            x: vec![0.0, 0.2],
            nu: nu.clone(),
            psi: psi.clone(),
            true_nu: nu,
            asked_psi: psi,
            ..Row::default()
        });
    }
    let (_, funnels) = draw("infinite", &trace);
    assert!(funnels.contains("\u{3C8} begins infinite") && !funnels.contains("clipped"));
    assert!(!funnels.contains("inf,") && !funnels.contains("NaN"));
}

#[test]
fn the_unit_of_the_states_stands_on_the_axes() {
    let rows: Vec<_> =
        (0..3).map(|k| (f64::from(k), vec![0.0, 1.0], vec![1.0, -1.0], vec![1.0, -1.0])).collect();
    let (states, funnels) = draw("unit", &told(&rows).with_unit(Some("\u{b0}C")));
    assert!(states.contains("state (\u{b0}C)") && funnels.contains("\u{3BD} (\u{b0}C)"));
    assert!(!states.contains("state units") && !funnels.contains("state units"));
}

/// Whether `svg` is well-formed XML of what plotters writes (elements, attributes, text), without control
/// characters.
fn well_formed(svg: &str) -> Result<(), String> {
    let fit = |c: char| c == '\n' || !(c.is_control() || u32::from(c) & 0xFFFE == 0xFFFE);
    let text =
        |text: &str| match text.split('&').skip(1).find(|rest| {
            !["lt;", "gt;", "amp;", "quot;", "apos;"].iter().any(|entity| rest.starts_with(entity))
        }) {
            Some(rest) => Err(format!("a lone & before {rest:?}")),
            None => Ok(()),
        };
    if let Some(c) = svg.chars().find(|&c| !fit(c)) {
        return Err(format!("the character {c:?}"));
    }
    let mut open: Vec<&str> = Vec::new();
    for (k, part) in svg.split('<').enumerate().skip(1) {
        let (tag, after) = part.split_once('>').ok_or(format!("no end of tag {k}"))?;
        text(after)?;
        if after.contains('>') || (open.is_empty() && k > 1) {
            return Err(format!("text that is none: {after:?}"));
        }
        if let Some(name) = tag.strip_prefix('/') {
            let opened = open.pop();
            if opened != Some(name) {
                return Err(format!("{name} closes {opened:?}"));
            }
            continue;
        }
        let (whole, inner) = (tag.ends_with('/'), tag.trim_end_matches('/'));
        let (name, attributes) = inner.split_once(' ').unwrap_or((inner, ""));
        let quoted: Vec<&str> = attributes.split('"').collect();
        if !name.chars().all(|c| c.is_ascii_alphabetic()) || quoted.len().is_multiple_of(2) {
            return Err(format!("the tag {tag:?}"));
        }
        quoted.iter().try_for_each(|value| text(value))?;
        if !whole {
            open.push(name);
        }
    }
    if open.is_empty() { Ok(()) } else { Err(format!("never closed: {open:?}")) }
}

#[test]
fn a_title_cannot_break_out_of_the_picture() {
    let title =
        "</text></svg><script>alert(1)</script><!-- \u{1b}[2J\u{7} & \" ' ]]> \u{FFFE}\u{202E}\0 --> &amp;";
    let mut trace = Trace::new(title).with_unit(Some("<&\"'>\u{1b}"));
    for t in [0.0, 1.0] {
        trace.push(&Row { t, x: vec![t, 0.0], nu: vec![0.0, 1.0], psi: vec![2.0; 2], ..Row::default() });
    }
    let (states, funnels) = draw("title", &trace);
    for svg in [&states, &funnels] {
        well_formed(svg).unwrap();
        assert!(!svg.contains("<script") && svg.contains("&lt;script&gt;alert"));
    }
    assert!(well_formed("<svg>\n<text>\n\u{1b}\n</text>\n</svg>\n").is_err());
    assert!(well_formed("<svg>\n<text>\na & b\n</text>\n</svg>\n").is_err());
    assert!(well_formed("<svg>\n<text>\n</svg>\n").is_err());
}

/// The picture of the agreement of a network of two, whose states are `x` at the ticks and whose funnels are
/// `psi`.
fn agreement(name: &str, x: impl Fn(i32) -> [f64; 2], psi: impl Fn(i32) -> f64) -> String {
    let mut trace = Trace::new("agreement").with_bound(2.0);
    for k in 0..200 {
        let (x, psi) = (x(k), vec![psi(k); 2]);
        let nu = vec![x[1] - x[0], x[0] - x[1]];
        let row = Row {
            t: 0.1 * f64::from(k),
            true_nu: nu.clone(),
            asked_psi: psi.clone(),
            nu,
            psi,
            ..Row::default()
        };
        trace.push(&Row { x: x.to_vec(), xi: vec![0.0], ..row });
    }
    trace.spread(4.5, 0.25);
    trace.mark(1, 10.0, None, MarkKind::Stopped);
    let svg = agreement_svg(&trace).unwrap();
    keep(&format!("{name}-agreement.svg"), &svg);
    well_formed(&svg).unwrap();
    assert!(!svg.contains("NaN") && !svg.contains("inf,"));
    svg
}

#[test]
fn spread_and_error_stand_beside_their_bound_on_decades() {
    let decays = |k: i32| 4.0 * funnelnet_law::math::exp(-0.05 * f64::from(k));
    let svg = agreement("decays", |k| [0.0, decays(k)], |k| 2.0 * decays(k));
    for words in [
        "bound",
        "spread",
        "to \u{3BE}",
        "0.001",
        "largest spread of all ticks 4.5, at the end 0.25",
        "node 1 stopped",
    ] {
        assert!(svg.contains(words), "{words}");
    }
    assert!(!svg.contains("lower edge") && !svg.contains("clipped"));
    // The bound above the spread: further up in the picture, at all times.
    let first = |colour| drawn(&svg, colour, 2);
    assert_eq!((first(style::BOUNDARY)[0], first(style::colour(0))[0]), (200, 200));
}

#[test]
fn a_distance_of_zero_lies_on_the_edge_and_the_picture_says_so() {
    let svg = agreement("zero", |k| [0.0, if k < 100 { 1.0 } else { 0.0 }], |_| 1.0);
    assert!(svg.contains("0 and what is below the axis lies on its lower edge"));
    assert_eq!(drawn(&svg, style::colour(0), 2)[0], 200, "it goes on to the end");
    // Nothing but zero, too.
    let svg = agreement("nothing", |_| [0.0; 2], |_| 0.0);
    assert!(svg.contains("lies on its lower edge"));
}

#[test]
fn a_bound_that_begins_infinite_and_a_network_that_diverges_leave_an_axis() {
    let svg = agreement("infinite-start", |k| [0.0, 1.0 / f64::from(k + 1)], |k| 1.0 / f64::from(k));
    assert!(svg.contains("the bound begins infinite") && !svg.contains("clipped"));
    let svg = agreement("away", |k| [0.0, if k > 100 { f64::INFINITY } else { 1.0 }], |_| 1.0);
    assert!(svg.contains("clipped: values up to infinity"));
    let svg = agreement("unknown", |k| [0.0, if k > 100 { f64::NAN } else { 1.0 }], |_| 1.0);
    assert!(!svg.contains("clipped"));
}

/// Two nodes with two components each; the second component is ten times the first.
fn vectors() -> Trace {
    let mut trace = Trace::new("vectors").with_components(2).with_unit(Some("m"));
    for k in 0..100 {
        let wave = funnelnet_law::math::sin(0.1 * f64::from(k));
        let x = vec![wave, 10.0 * wave, 0.5 * wave, 5.0 * wave];
        let u = x.iter().map(|x| -x).collect();
        let row = Row { t: 0.1 * f64::from(k), nu: vec![0.1; 4], psi: vec![2.0; 4], u, ..Row::default() };
        trace.push(&Row { x, xi: vec![0.75 * wave, 7.5 * wave], ..row });
    }
    trace
}

#[test]
fn vectors_have_an_axis_for_each_component_and_a_colour_for_each_node() {
    let trace = vectors();
    let (states, _) = draw("vectors", &trace);
    let inputs = inputs_svg(&trace).unwrap();
    for (svg, axes) in
        [(&states, ["state x0 (m)", "state x1 (m)"]), (&inputs, ["input u0 (m/s)", "input u1 (m/s)"])]
    {
        well_formed(svg).unwrap();
        assert!(axes.iter().all(|axis| svg.contains(axis)), "{axes:?}");
        // In the legend once each, and in no other colour.
        assert_eq!((svg.matches("node 1").count(), svg.matches("node 2").count()), (1, 1));
        for node in 0..2 {
            assert_eq!(drawn(svg, style::colour(node), 2), [100, 100, 2], "both components, and the legend");
        }
        assert!(drawn(svg, style::colour(2), 2).is_empty());
    }
    assert!(states.contains("emergent") && !inputs.contains("emergent"));
}

#[test]
fn inputs_end_where_a_node_stops_or_is_away() {
    let mut trace = vectors();
    trace.mark(1, 5.0, None, MarkKind::Stopped);
    trace.mark(2, 2.0, Some(4.0), MarkKind::Away);
    let inputs = inputs_svg(&trace).unwrap();
    assert!(inputs.contains("node 1 stopped") && inputs.contains("node 2 away"));
    assert_eq!(drawn(&inputs, style::colour(0), 2).iter().filter(|&&points| points == 51).count(), 2);
    // A cross of two strokes in each component.
    let RGBColor(r, g, b) = style::colour(0);
    let stroke = format!("stroke=\"#{r:02X}{g:02X}{b:02X}\"");
    let strokes = inputs.lines().filter(|line| line.starts_with("<line ") && line.contains(&stroke));
    let width = format!("stroke-width=\"{}\"", style::px(2));
    assert_eq!(strokes.filter(|line| line.contains(&width)).count(), 4);
    assert_eq!(
        drawn(&inputs, style::colour(1), 2).iter().filter(|&&points| [20, 60].contains(&points)).count(),
        4
    );
}

#[test]
fn an_input_is_held_until_a_stop_between_two_rows() {
    let mut trace = vectors();
    trace.mark(1, 5.05, None, MarkKind::Stopped);
    let inputs = inputs_svg(&trace).unwrap();
    assert_eq!(drawn(&inputs, style::colour(0), 2).iter().filter(|&&points| points == 52).count(), 2);
}

#[test]
fn lost_frames_are_marked_where_they_were_lost_and_nowhere_else() {
    let picture = |lost: fn(i32) -> u64| {
        let mut trace = Trace::new("losses");
        for k in 0..5000 {
            let row = Row { t: f64::from(k), x: vec![0.0, 1.0], nu: vec![1.0, -1.0], ..Row::default() };
            trace.push(&Row { psi: vec![2.0; 2], u: vec![0.0; 2], lost: lost(k), ..row });
        }
        [states_svg(&trace).unwrap(), inputs_svg(&trace).unwrap(), agreement_svg(&trace).unwrap()]
    };
    let marks = |svg: &String| drawn(svg, style::INK, 1).len();
    let none = picture(|_| 0);
    for (svg, without) in picture(|k| u64::from(k % 1000 == 7)).iter().zip(&none) {
        well_formed(svg).unwrap();
        assert!(svg.contains("frames lost") && !without.contains("frames lost"));
        // And five in the legend.
        assert_eq!(marks(svg) - marks(without), 10);
    }
    for (svg, without) in picture(|_| 1).iter().zip(&none) {
        assert!(marks(svg) - marks(without) <= 1029, "{}", marks(svg) - marks(without));
    }
}
