//! Any text as a scenario: it is read, or refused with at least one mistake that has a place; no panic.
#![no_main]

use funnelnet_sim::scenario::Scenario;
use libfuzzer_sys::fuzz_target;
use std::path::Path;

fuzz_target!(|text: &str| {
    match Scenario::parse(text, Path::new("fuzz.toml"), &[]) {
        Ok(scenario) => assert!(!scenario.nodes.is_empty()),
        Err(found) => assert!(!found.0.is_empty() && !found.to_string().is_empty()),
    }
});
