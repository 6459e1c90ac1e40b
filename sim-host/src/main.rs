//! Command line of sim-host.

fn main() -> std::process::ExitCode {
    sim_host::cli::main()
}
