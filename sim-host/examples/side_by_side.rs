//! Funnel coupling beside its baselines: the width that each keeps, the input that it uses, the noise that it
//! passes on.
//!
//! From the root of the repository; runs `scenarios/side-by-side-*.toml`, each with its noise and without,
//! and prints a table: the share of the run in which some `|nu_i|` is at or beyond the funnel, the largest
//! `|nu_i|` over the second half, the largest and the root mean square input, and the root mean square that
//! noise adds to the inputs over the second half.
#![allow(clippy::expect_used)]

use sim_host::interrupt::Interrupt;
use sim_host::number_format::significant;
use sim_host::record::Row;
use sim_host::run::{Fidelity, RunOptions, Verbosity, simulate};
use sim_host::scenario::{Override, Scenario};
use std::path::Path;

/// Scenarios of the table: name, file, and what is put in place of the file's values.
const ROWS: [(&str, &str, &[&str]); 7] = [
    ("funnel", "funnel", &[]),
    ("weakly centralised", "weakly-centralised", &[]),
    ("linear, k = 20", "high-gain", &["coupling.gain.slope=20.0"]),
    ("linear, k = 80", "high-gain", &[]),
    ("linear, k = 320", "high-gain", &["coupling.gain.slope=320.0"]),
    ("lambda-tracker, eta = 0.2", "lambda-tracker", &[]),
    ("lambda-tracker, eta = 0.05", "lambda-tracker", &["coupling.eta=0.05"]),
];

fn main() {
    println!(
        "| coupling | outside the funnel | largest \\|nu\\|, 2nd half | largest input | rms input | noise in the input |\n\
         |---|---:|---:|---:|---:|---:|"
    );
    for (name, file, sets) in ROWS {
        let noisy = rows(file, sets);
        let quiet = rows(file, &[sets, &["agent.noise=0.0"]].concat());
        let outside = noisy.iter().filter(|row| pairs(row).any(|(nu, psi)| nu.abs() >= psi)).count();
        let late = &noisy[noisy.len() / 2..];
        let width = late.iter().flat_map(pairs).fold(0.0f64, |most, (nu, _)| most.max(nu.abs()));
        let inputs = || noisy.iter().flat_map(|row| &row.u);
        let both = noisy.iter().zip(&quiet).skip(noisy.len() / 2);
        let added = both.flat_map(|(noisy, quiet)| noisy.u.iter().zip(&quiet.u).map(|(a, b)| a - b));
        println!(
            "| {name} | {} % | {} | {} | {} | {} |",
            significant(100.0 * outside as f64 / noisy.len() as f64, 2),
            significant(width, 2),
            significant(inputs().fold(0.0f64, |most, u| most.max(u.abs())), 3),
            significant(root_mean_square(inputs().copied()), 3),
            significant(root_mean_square(added), 2),
        );
    }
}

/// Every tick of a run.
fn rows(file: &str, sets: &[&str]) -> Vec<Row> {
    let path = format!("scenarios/side-by-side-{file}.toml");
    let sets: Vec<_> = sets.iter().map(|set| Override::parse(set).expect("a setting")).collect();
    let scenario = Scenario::load(Path::new(&path), &sets).expect("a valid scenario");
    let options = RunOptions {
        on: Fidelity::Loopback,
        out: None,
        every_ticks: Some(1),
        json: None,
        junit: None,
        image: "".into(),
        bench: None,
        bus_logs: Default::default(),
        mcap: false,
        verbosity: Verbosity::Quiet,
        interrupt: Interrupt::default(),
        repeat: String::new(),
    };
    simulate(&scenario, &options).expect("a run").rows
}

fn pairs(row: &Row) -> impl Iterator<Item = (f64, f64)> {
    row.nu.iter().copied().zip(row.psi.iter().copied())
}

fn root_mean_square(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0u32, 0.0), |(count, sum), value| (count + 1, sum + value * value));
    (sum / f64::from(count.max(1))).sqrt()
}
