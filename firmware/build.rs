//! Puts the board's memory map on the linker's search path, and compiles the C baseline of the cost table.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, error::Error, fs};

/// Board features and their memory maps.
const BOARDS: [(&str, &str); 5] = [
    ("CARGO_FEATURE_MPS2_AN386", "boards/mps2-an386.x"),
    ("CARGO_FEATURE_NUCLEO_G474RE", "boards/nucleo-g474re.x"),
    ("CARGO_FEATURE_NUCLEO_F446RE", "boards/nucleo-f446re.x"),
    ("CARGO_FEATURE_NRF52840_DK", "boards/nrf52840-dk.x"),
    ("CARGO_FEATURE_RP2040_PICO", "boards/rp2040-pico.x"),
];

type Outcome = Result<(), Box<dyn Error>>;

fn main() -> Outcome {
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?);
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed=build.rs");
    memory_map(&out)?;
    if env::var_os("CARGO_FEATURE_COST").is_some() {
        c_baseline(&out)?;
    }
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
    if env::var_os("CARGO_FEATURE_MPS2_AN386").is_some() {
        // Its interrupt table names the handlers itself (src/mps2/interrupt.rs), so there are no weak aliases; the
        // peripheral crates of the other chips bring their own device.x.
        fs::write(out.join("device.x"), "")?;
    }
    if env::var_os("CARGO_FEATURE_RP2040_PICO").is_some() {
        // The section of the second-stage boot loader, which cortex-m-rt does not know.
        println!("cargo:rustc-link-arg-bins=-Tlink-rp.x");
    }
    Ok(())
}

/// One relocatable object that holds the C law and newlib's `expf`, with only our own two functions visible:
/// otherwise the linker would resolve `expf` to the one in Rust's compiler_builtins, and the table would
/// compare Rust with Rust.
fn c_baseline(out: &Path) -> Outcome {
    let (object, linked) = (out.join("law.o"), out.join("law-linked.o"));
    println!("cargo:rerun-if-changed=cost/law.c");
    let target = ["-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16"];
    run(Command::new("arm-none-eabi-gcc")
        .args(target)
        .args([
            "-O3",
            "-std=c11",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-ffunction-sections",
            "-c",
            "cost/law.c",
            "-o",
        ])
        .arg(&object))?;
    run(Command::new("arm-none-eabi-gcc")
        .args(target)
        .args(["-nostdlib", "-r", "-o"])
        .arg(&linked)
        .arg(&object)
        .args(["-Wl,--start-group", "-lm", "-lc", "-lgcc", "-Wl,--end-group"]))?;
    run(Command::new("arm-none-eabi-objcopy")
        .args(["--keep-global-symbol=law_in_c", "--keep-global-symbol=expf_in_c"])
        .arg(&linked))?;
    println!("cargo:rustc-link-arg-bin=cost={}", linked.display());
    Ok(())
}

fn copy(from: &Path, to: &Path) -> Outcome {
    println!("cargo:rerun-if-changed={}", from.display());
    fs::copy(from, to).map_err(|e| format!("{}: {e}", from.display()))?;
    Ok(())
}

fn run(command: &mut Command) -> Outcome {
    let status = command
        .status()
        .map_err(|e| format!("{:?}: {e} (./ci.sh setup installs it)", command.get_program()))?;
    if status.success() { Ok(()) } else { Err(format!("{command:?}: {status}").into()) }
}
