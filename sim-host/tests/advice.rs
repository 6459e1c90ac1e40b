//! What `check` advises can be done: random scenarios, most of them bad, of every coupling, gain, funnel and
//! bus that a scenario can name.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use funnelnet_law::math;
use rand_pcg::Pcg64;
use sim_host::check::{Advice, Status, check};
use sim_host::random::{Purpose, below, stream, uniform};
use sim_host::scenario::{Override, Scenario};
use std::fmt::Write as _;
use std::path::Path;

const SCENARIOS: u64 = 240;
/// The shortest tick that a node takes, ns, and the largest number.
const SHORTEST_TICK: f64 = 1e4;
const LARGEST: f64 = 1e9;

fn between(random: &mut Pcg64, low: f64, high: f64) -> f64 {
    low + (high - low) * uniform(random)
}

/// A number whose size may be any from `10^low` to `10^high`.
fn sized(random: &mut Pcg64, low: f64, high: f64) -> f64 {
    math::exp10(between(random, low, high))
}

fn one_of<'a>(random: &mut Pcg64, list: &[&'a str]) -> &'a str {
    list[below(random, list.len())]
}

fn funnel(random: &mut Pcg64) -> String {
    let (start, end) = (sized(random, -1.0, 2.0), sized(random, -9.0, 0.0));
    match below(random, 5) {
        0 => format!("kind = 'constant', width = {start}"),
        1 => format!("kind = 'exponential', start = {start}, end = 0.0, rate = {}", sized(random, -1.0, 3.0)),
        2 => {
            format!("kind = 'exponential', start = {start}, end = {end}, rate = {}", sized(random, -1.0, 3.0))
        }
        3 => format!("kind = 'finite-time', start = {start}, at = '20ms', power = 1.0"),
        _ => format!("kind = 'reciprocal-time', scale = {start}"),
    }
}

fn bus(random: &mut Pcg64, tick_ns: u64) -> String {
    match below(random, 4) {
        0 => format!("[bus]\nloss = {}\n", between(random, 0.01, 0.6)),
        1 => format!("[bus]\nlatency = '{}ns'\n", (tick_ns as f64 * sized(random, -2.0, 1.3)) as u64),
        2 => format!("[bus]\nmodel = 'can'\nbitrate = {}\n", one_of(random, &["50000", "250000", "1000000"])),
        _ => String::new(),
    }
}

fn text(random: &mut Pcg64) -> String {
    let nodes = 2 + below(random, 4);
    let tick_ns = [10_000, 100_000, 1_000_000, 7_000_000, 100_000_000][below(random, 5)];
    let coupling = one_of(
        random,
        &[
            "node-wise",
            "node-wise",
            "node-wise",
            "edge-wise",
            "element-wise",
            "linear",
            "lambda-tracker",
            "weakly-centralised",
            "max-gain",
        ],
    );
    let scale = sized(random, -6.0, 4.0);
    let gain = match coupling {
        "linear" | "lambda-tracker" => format!("kind = 'linear', slope = {scale}"),
        _ => match below(random, 4) {
            0 => format!("kind = 'locally-linear', bound = {scale}"),
            1 => format!("kind = 'median', eta = {scale}, eps = 0.05"),
            2 => format!("kind = 'logarithmic', scale = {scale}"),
            _ => format!("kind = 'reciprocal', scale = {scale}"),
        },
    };
    let eta = if coupling == "lambda-tracker" { "eta = 0.1\n" } else { "" };
    let more = match coupling {
        "weakly-centralised" => String::new(),
        _ => {
            let policy = one_of(
                random,
                &["", "", "on_breach = 'stop'\n", "floor = 'f32'\n", "floor = 1e-4\n", "u_max = 0.5\n"],
            );
            policy.to_owned()
        }
    };
    let mut text = format!(
        "version = 1\n[time]\ntick = '{tick_ns}ns'\nduration = '{}ns'\n[graph]\nkind = '{}'\nnodes = {nodes}\n[coupling]\nkind = '{coupling}'\n{eta}{more}\
         gain = {{ {gain} }}\nfunnel = {{ {} }}\n",
        60 * tick_ns,
        one_of(random, &["ring", "path", "star", "complete"]),
        funnel(random),
    );
    if coupling != "weakly-centralised" {
        text += &bus(random, tick_ns);
    }
    if below(random, 4) == 0 {
        let _ = writeln!(text, "[agent]\nnoise = {}", sized(random, -6.0, 1.0));
    }
    let amplitude = sized(random, -3.0, 6.0);
    let start = if below(random, 2) == 0 { 0.0 } else { sized(random, -3.0, 1.0) };
    for id in 1..=nodes {
        let (slope, offset) = (between(random, -4.0, 1.0), amplitude * between(random, -1.0, 1.0));
        let (swing, frequency) = (amplitude * between(random, -1.0, 1.0), sized(random, -1.0, 5.0));
        let state = start * between(random, -1.0, 1.0);
        let _ = writeln!(
            text,
            "[[node]]\nid = {id}\nstate = {state}\ndynamics = {{ kind = 'affine', slope = {slope}, offset = {offset}, sines = [{{ amplitude = {swing}, frequency = {frequency} }}] }}"
        );
    }
    text + "[expect]\nfunnel_ratio = 1.0\nfinal_spread = 1e-3\nemergent_error = 1e-3\n"
}

/// Words that no advice has.
fn is_sane(word: &str) -> bool {
    let word = word.trim_matches(|c: char| ",;:()".contains(c));
    let as_ns = [("ns", 1.0), ("us", 1e3), ("ms", 1e6)].into_iter().find_map(|(unit, times)| {
        let number: f64 = word.strip_suffix(unit)?.parse().ok()?;
        Some(number * times)
    });
    let is_number = word.parse::<f64>().is_ok_and(f64::is_finite) || word.parse::<f64>().is_err();
    is_number && as_ns.is_none_or(|ns| ns >= SHORTEST_TICK)
}

fn assert_sane(name: &str, advice: &Advice, text: &str) {
    assert!(advice.text.split_whitespace().all(is_sane), "{name}: {}\n{text}", advice.text);
    let settings: Vec<_> = advice.settings().collect();
    let sets = settings.iter().map(|set| Override::parse(&format!("{}={}", set.key, set.value)).unwrap());
    let sets: Vec<_> = sets.collect();
    for set in &settings {
        // Times and words are judged by who reads them.
        let value: Option<f64> = set.value.parse().ok();
        assert!(value.is_none_or(|value| value > 0.0 && value <= LARGEST), "{name}: {set:?}\n{text}");
        assert!(is_sane(&set.value), "{name}: {set:?}\n{text}");
    }
    if let Err(error) = Scenario::parse(text, Path::new("advised.toml"), &sets) {
        panic!("{name} advises {settings:?}, which no scenario takes: {error}\n{text}");
    }
}

#[test]
fn what_is_advised_can_be_done() {
    let (mut read, mut open, mut advised) = (0, 0, 0);
    for index in 0..SCENARIOS {
        let text = text(&mut stream(19, Purpose::Graph, index));
        let Ok(scenario) = Scenario::parse(&text, Path::new("wild.toml"), &[]) else { continue };
        read += 1;
        let report = check(&scenario);
        open += u32::from(
            report.findings.iter().any(|found| matches!(found.status, Status::Warn | Status::Fail)),
        );
        for found in &report.findings {
            if found.name == "narrowest-funnel" {
                assert!(
                    found.text.split_whitespace().all(|word| word != "inf" && word != "NaN"),
                    "{}\n{text}",
                    found.text
                );
            }
            let Some(advice) = &found.advice else { continue };
            advised += u32::from(advice.setting.is_some());
            assert_sane(found.name, advice, &text);
        }
    }
    println!("{read} of {SCENARIOS} read, {open} warned of, {advised} settings advised");
    assert!(read > SCENARIOS / 2 && open > 20 && advised > 20, "{read} {open} {advised} show nothing");
}
