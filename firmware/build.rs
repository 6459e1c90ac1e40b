//! Writes the board's memory map where the linker finds it, and compiles the C baseline of the cost table.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, error::Error, fs};

use toml::{Table, Value};

/// What it knows of boards is their metadata in here.
const MANIFEST: &str = "Cargo.toml";

type Outcome<T = ()> = Result<T, Box<dyn Error>>;

fn main() -> Outcome {
    let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?);
    println!("cargo:rustc-link-search={}", out.display());
    println!("cargo:rerun-if-changed=build.rs");
    link(&out)?;
    if env::var_os("CARGO_FEATURE_COST").is_some() {
        c_baseline(&out)?;
    }
    Ok(())
}

/// `link.x` includes `memory.x`, which only includes `board-memory.x`: see the comment in the root file.
fn link(out: &Path) -> Outcome {
    let metadata = metadata()?;
    let board = chosen(&metadata)?;
    let family = family(&metadata, board)?;
    copy(Path::new("../memory.x"), &out.join("memory.x"))?;
    fs::write(out.join("board-memory.x"), memory_map(board, family)?)?;
    if text(board, "family")? == "mps2" {
        // Its interrupt table names the handlers itself (src/mps2/interrupt.rs), so there are no weak aliases; the
        // peripheral crates of the other chips bring their own device.x.
        fs::write(out.join("device.x"), "")?;
    }
    if is_on("update") {
        // Its program begins at no multiple of 64 KiB: else the linker puts the headers of the ELF file in front of it, where the boot loader is.
        println!("cargo:rustc-link-arg-bins=--nmagic");
        println!("cargo:rustc-env=FUNNELNET_BOARD={}", text(board, "name")?);
    }
    if family.contains_key("boot2") && !is_on("update") {
        // The section of the second-stage boot loader, which cortex-m-rt does not know.
        println!("cargo:rustc-link-arg-bins=-Tlink-rp.x");
    }
    Ok(())
}

fn metadata() -> Outcome<Table> {
    println!("cargo:rerun-if-changed={MANIFEST}");
    let manifest: Table = fs::read_to_string(MANIFEST)?.parse()?;
    let metadata =
        manifest.get("package").and_then(|package| package.get("metadata")).and_then(Value::as_table);
    Ok(metadata.ok_or("Cargo.toml has no [package.metadata]")?.clone())
}

/// The board whose feature is on.
fn chosen(metadata: &Table) -> Outcome<&Table> {
    let boards = metadata.get("boards").and_then(Value::as_array).ok_or("no boards in the metadata")?;
    let boards = boards.iter().filter_map(Value::as_table);
    let is_chosen = |board: &&Table| text(board, "name").is_ok_and(is_on);
    match boards.filter(is_chosen).collect::<Vec<_>>()[..] {
        [board] => Ok(board),
        ref several => Err(format!(
            "choose exactly one board feature, not {}; other boards than the default: --no-default-features",
            several.len()
        )
        .into()),
    }
}

/// The family of a board, whose feature the board's has to turn on.
fn family<'a>(metadata: &'a Table, board: &Table) -> Outcome<&'a Table> {
    let (name, board) = (text(board, "family")?, text(board, "name")?);
    if !is_on(&format!("_{name}")) {
        return Err(format!("feature {board} does not turn on _{name}, its family in the metadata").into());
    }
    let family = metadata.get("families").and_then(|families| families.get(name)).and_then(Value::as_table);
    family.ok_or_else(|| format!("no family {name} in the metadata").into())
}

/// The stack is at the beginning of RAM, and grows towards addresses that nothing is behind: overflowing it is a fault (docs/book/src/boards.md, Stack), and
/// overwrites nothing.
fn memory_map(board: &Table, family: &Table) -> Outcome<String> {
    let (flash, flash_size) = program(board)?;
    let (ram, ram_size) = region(board, "ram")?;
    let stack = number(board.get("stack"), "stack")?;
    let below = ram_size.checked_sub(stack).ok_or("stack is larger than ram")?;
    // What a program keeps over a reset is behind its stack and its data: the boot loader stays away from it.
    let (data, below) = if is_on("boot-loader") {
        let own = number(update(board)?.get("boot-ram"), "boot-ram")?;
        (ram + ram_size - own, own)
    } else {
        (ram + stack, below)
    };
    let mut map = String::from("MEMORY\n{\n");
    let mut line = |name: &str, start: u64, size: u64| {
        writeln!(map, "  {name} : ORIGIN = {start:#010x}, LENGTH = {size:#x}")
    };
    if let Some(size) = family.get("boot2").filter(|_| !is_on("update")) {
        let size = number(Some(size), "boot2")?;
        line("BOOT2", flash - size, size)?;
    }
    line("FLASH", flash, flash_size)?;
    line("STACK", ram, stack)?;
    line("RAM", data, below)?;
    let storage = if board.contains_key("storage") { Some(region(board, "storage")?) } else { None };
    if let Some((start, size)) = storage {
        line("STORAGE (r)", start, size)?;
    }
    map += "}\n_stack_start = ORIGIN(STACK) + LENGTH(STACK);\n_stack_end = ORIGIN(STACK);\n";
    if let Some((start, _)) = storage {
        map += "__storage_start = ORIGIN(STORAGE);\n__storage_end = ORIGIN(STORAGE) + LENGTH(STORAGE);\n";
        if (flash..flash + flash_size).contains(&start) {
            // In the middle of flash: the vectors are in front of it, the program goes on behind.
            map += "_stext = __storage_end;\n";
        }
    }
    if is_on("update") || is_on("boot-loader") {
        for part in ["state", "active", "spare"] {
            let (start, size) = region(update(board)?, part)?;
            writeln!(
                map,
                "__update_{part}_start = {start:#010x};\n__update_{part}_end = {:#010x};",
                start + size
            )?;
        }
    }
    Ok(map)
}

/// Where the program is: all of flash, or the part that a boot loader starts, or that boot loader's own.
fn program(board: &Table) -> Outcome<(u64, u64)> {
    match (is_on("update"), is_on("boot-loader")) {
        (false, false) => region(board, "flash"),
        (true, false) => region(update(board)?, "active"),
        (false, true) => region(update(board)?, "boot"),
        (true, true) => Err("features update and boot-loader are for two images, not for one".into()),
    }
}

/// The memory map of a board whose program is swapped.
fn update(board: &Table) -> Outcome<&Table> {
    let found = board.get("update").and_then(Value::as_table);
    let name = text(board, "name")?;
    found.ok_or_else(|| format!("board {name} has no memory map for updates in the metadata").into())
}

/// Start and bytes.
fn region(board: &Table, key: &str) -> Outcome<(u64, u64)> {
    match board.get(key).and_then(Value::as_array).map(Vec::as_slice) {
        Some([start, size]) => Ok((number(Some(start), key)?, number(Some(size), key)?)),
        _ => {
            Err(format!("{key} of {} is not [start, bytes]", text(board, "name").unwrap_or("the map")).into())
        }
    }
}

fn number(value: Option<&Value>, key: &str) -> Outcome<u64> {
    let number = value.and_then(Value::as_integer).ok_or_else(|| format!("{key} is no integer"))?;
    u64::try_from(number).map_err(|_| format!("{key} is {number}, not 0 or more").into())
}

fn text<'a>(table: &'a Table, key: &str) -> Outcome<&'a str> {
    table.get(key).and_then(Value::as_str).ok_or_else(|| format!("{key} is no text").into())
}

/// Whether a feature is.
fn is_on(feature: &str) -> bool {
    env::var_os(format!("CARGO_FEATURE_{}", feature.replace('-', "_").to_uppercase())).is_some()
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
