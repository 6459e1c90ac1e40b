//! Puts the board's memory map on the linker's search path.

use std::path::{Path, PathBuf};
use std::{env, error::Error, fs};

/// Board features and their memory maps.
const BOARDS: [(&str, &str); 1] = [("CARGO_FEATURE_MPS2_AN386", "boards/mps2-an386.x")];

type Outcome = Result<(), Box<dyn Error>>;

fn main() -> Outcome {
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?);
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed=build.rs");
    memory_map(&out)?;
    Ok(())
}

/// `link.x` includes `memory.x`, which only includes `board-memory.x`: see the comment in the root file.
fn memory_map(out: &Path) -> Outcome {
    let chosen: Vec<_> = BOARDS.iter().filter(|(feature, _)| env::var_os(feature).is_some()).collect();
    let [(_, board)] = chosen[..] else {
        return Err(format!("choose exactly one board feature, not {}", chosen.len()).into());
    };
    copy(Path::new("../memory.x"), &out.join("memory.x"))?;
    copy(Path::new(board), &out.join("board-memory.x"))?;
    // The interrupt table names its handlers itself (src/mps2/interrupt.rs), so there are no weak aliases.
    fs::write(out.join("device.x"), "")?;
    Ok(())
}

fn copy(from: &Path, to: &Path) -> Outcome {
    println!("cargo:rerun-if-changed={}", from.display());
    fs::copy(from, to).map_err(|e| format!("{}: {e}", from.display()))?;
    Ok(())
}
