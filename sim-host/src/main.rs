//! Command line of sim-host.
fn main() {}
