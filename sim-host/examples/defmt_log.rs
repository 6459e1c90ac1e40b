//! Decodes a node's defmt log: `defmt_log IMAGE < LOG`. Used by firmware/checks/selftest.py, so that no other
//! decoder has to be installed.
use sim_host::emulator::log;
use std::error::Error;
use std::io::Read;

fn main() -> Result<(), Box<dyn Error>> {
    let image = std::env::args_os().nth(1).ok_or("usage: defmt_log IMAGE < LOG")?;
    let mut bytes = Vec::new();
    std::io::stdin().read_to_end(&mut bytes)?;
    print!("{}", log::decode(&std::fs::read(image)?, &bytes));
    Ok(())
}
