#!/usr/bin/env bash
# Every check of this repository as a named sub-command: ./ci.sh help
#
# A sub-command is a function cmd_NAME whose first line ends in "#: what it does"; `help` lists those lines.
# Called with several names, they run in that order; the first failure ends the run with its exit code.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
readonly ROOT=$PWD
readonly TARGET=thumbv7em-none-eabihf
readonly IMAGES=$ROOT/firmware/target/$TARGET/release
readonly FLASH_BUDGET=$((48 * 1024)) RAM_BUDGET=$((16 * 1024)) # bytes
readonly HOST_LIMIT=1500 # instructions per node-tick in loopback
# The paths above and below are those of cargo's default target folders.
unset CARGO_TARGET_DIR CARGO_BUILD_TARGET_DIR CARGO_BUILD_TARGET

say() { printf 'ci.sh: %s\n' "$*"; }
fail() { printf 'ci.sh: error: %s\n' "$*" >&2; exit 1; }
have() { command -v "$1" >/dev/null 2>&1; }

# --- toolchain
# ---------------------------------------------------------------------------------------------------
#
# Two ways to a compiler for the target. rustup's, where it can reach its servers; else Debian's, which brings
# no core for the target but its source. FUNNEL_TOOLCHAIN=rustup or =debian forces one of them.

rustup_has_target() {
    have rustup && rustup target list --installed 2>/dev/null | grep -qx "$TARGET"
}

# Debian's toolchain: the compiler, the source of core, and the linker; clippy is a package of its own.
debian_has_source() {
    [[ -x /usr/bin/rustc && -x /usr/bin/cargo ]] && have ld.lld \
        && [[ -f $(/usr/bin/rustc --print sysroot)/lib/rustlib/src/rust/library/core/Cargo.toml ]]
}

# Prints rustup or debian: the toolchain that is complete. Fails if none is.
toolchain() {
    case ${FUNNEL_TOOLCHAIN:-} in
        rustup) rustup_has_target && echo rustup ;;
        debian) debian_has_source && echo debian ;;
        "") { rustup_has_target && echo rustup; } || { debian_has_source && echo debian; } ;;
        *) fail "FUNNEL_TOOLCHAIN is '$FUNNEL_TOOLCHAIN', not rustup or debian" ;;
    esac
}

setup_toolchain() {
    toolchain >/dev/null && return
    if [[ ${FUNNEL_TOOLCHAIN:-rustup} == rustup ]] && have rustup; then
        say "adding the target $TARGET by rustup"
        timeout 300 rustup target add "$TARGET" >/dev/null 2>&1 && return
        say "rustup can't fetch it"
    fi
    [[ ${FUNNEL_TOOLCHAIN:-debian} == debian ]] || fail "no target $TARGET from rustup"
    say "using Debian's rustc, which builds core from source"
    apt_install rustc-web cargo-web rust-web-src rust-web-clippy lld
    debian_has_source || fail "Debian's rustc, cargo, ld.lld and the source of core are still not all there"
}

# Installs Debian packages; says which. Without root or apt-get it says what to do instead.
apt_install() {
    have apt-get || fail "no apt-get here; install the equivalents of: $*"
    [[ $(id -u) == 0 ]] || fail "not root; run: sudo apt-get install --no-install-recommends $*"
    say "installing $*"
    export DEBIAN_FRONTEND=noninteractive
    local log; log=$(mktemp)
    if ! { apt-get install -y --no-install-recommends "$@" \
        || { apt-get update && apt-get install -y --no-install-recommends "$@"; }; } >"$log" 2>&1; then
        tail -n 20 "$log" >&2
        fail "apt-get install $* failed (the whole output: $log)"
    fi
    rm -f "$log"
}

# cargo for the microcontroller. DIR is firmware/, where cargo looks for target, flags and environment, or the root.
# LIBRARIES are those that Debian's compiler builds from source; rustup's has them.
target_cargo() ( # DIR LIBRARIES CARGO-ARGUMENTS...
    cd "$1"
    chosen=$(toolchain) || fail "no toolchain for $TARGET: ./ci.sh setup"
    if [[ $chosen == debian ]]; then
        # Unstable options of a released compiler: without rustup there is no other way to core for the
        # target.
        export PATH=/usr/bin:$PATH RUSTC_BOOTSTRAP=1 CARGO_UNSTABLE_BUILD_STD=$2
        export CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER=ld.lld
    fi
    exec cargo "${@:3}"
)

firmware_cargo() { target_cargo firmware core,alloc "$@"; }

target_has_clippy() {
    case $(toolchain) in
        debian) [[ -x /usr/bin/cargo-clippy && -x /usr/bin/clippy-driver ]] ;;
        *) cargo clippy --version >/dev/null 2>&1 ;;
    esac
}

# --- sub-commands
# ------------------------------------------------------------------------------------------------

cmd_setup() { #: find or install what the other commands need
    local missing=()
    have cargo || fail "no cargo: install Rust 1.95 or later, for example from https://rustup.rs"
    have qemu-system-arm || missing+=(qemu-system-arm)
    have arm-none-eabi-gcc || missing+=(gcc-arm-none-eabi)
    have python3 || missing+=(python3)
    # Debian's valgrind doesn't start without the debug symbols of the C library.
    have valgrind || missing+=(valgrind libc6-dbg)
    { have arm-none-eabi-gcc && [[ -f $(arm-none-eabi-gcc -print-file-name=libm.a) ]]; } \
        || missing+=(libnewlib-arm-none-eabi)
    (( ${#missing[@]} == 0 )) || apt_install "${missing[@]}"
    setup_toolchain
    # Not fatal: clippy says where it is skipped.
    target_has_clippy || [[ $(toolchain) != debian ]] || (apt_install rust-web-clippy) || true
    say "host: $(rustc --version); $(valgrind --version)"
    say "firmware: toolchain of $(toolchain); $(qemu-system-arm --version | head -n 1)"
}

cmd_fmt() { #: check the format of every Rust file
    cargo fmt --all --check || fail "not formatted: cargo fmt --all"
    (cd firmware && cargo fmt --check) || fail "not formatted: (cd firmware && cargo fmt)"
}

cmd_clippy() { #: clippy with warnings denied: workspace, and firmware for its target
    cargo clippy --quiet --locked --workspace --all-targets -- -D warnings
    if target_has_clippy; then
        firmware_cargo clippy --quiet --locked --features cost --bins -- -D warnings
    else
        say "SKIPPED clippy of the firmware: the toolchain for $TARGET has none"
    fi
}

cmd_unit() { #: unit, property and golden tests on the host
    cargo test --locked --workspace
}

cmd_sweep() { #: every f32 through every gain, against f64; 7 minutes of processor time, on all cores, not part of `test`
    cargo test --locked --release --package funnel-core --test sweep -- --include-ignored --nocapture
}

cmd_thumb() { #: core and protocol alone for the target: no std, and with Debian's toolchain no alloc either
    local package
    for package in funnel-core funnel-protocol; do
        target_cargo . core build --quiet --locked --target "$TARGET" --no-default-features --package "$package"
        say "$package builds for $TARGET without std"
    done
}

cmd_firmware() { #: build the firmware images
    firmware_cargo build --release --locked
    say "image: ${IMAGES#"$ROOT"/}/mps2_an386"
}

cmd_selftest() { #: run the platform's own tests in the emulator: echo, clock, panic, sleep
    firmware_cargo build --release --locked --quiet --bin selftest
    cargo build --locked --quiet --package sim-host --example defmt_log
    python3 firmware/selftest.py qemu-system-arm target/debug/examples/defmt_log "$IMAGES/selftest"
}

# The tests that the host's `cargo test` leaves out, by name; they fail where they cannot run.
cmd_parity() { #: the simulator against emulated nodes, bit for bit, and what can go wrong with emulators
    firmware_cargo build --release --locked --quiet --bin mps2_an386 --bin selftest
    cargo test --locked --workspace --test parity --test emulator_faults -- --include-ignored
}

cmd_cost() { #: count instructions on the emulated Cortex-M4F and on the host; Markdown, fails above a limit
    local over=0
    firmware_cargo build --release --locked --quiet --features cost --bin cost
    cargo build --release --locked --quiet --package sim-host --example loopback_ticks
    emulator_cost || over=1
    host_cost || over=1
    (( over == 0 )) || fail "too many instructions"
}

# The table that the image prints; 1 where a row is over its limit.
emulator_cost() {
    local status=0
    timeout 120 qemu-system-arm -M mps2-an386 -display none -serial none -monitor none -icount shift=0 \
        -semihosting-config enable=on,target=native -kernel "$IMAGES/cost" </dev/null || status=$?
    (( status <= 1 )) || fail "counting on the emulator ended with exit code $status (124: it took too long)"
    return "$status"
}

# A row for the host; 1 where it is over its limit. Between two lengths of run everything but the ticks cancels.
host_cost() {
    local nodes=100 short=200 long=1200 few many ticks each
    few=$(loopback_instructions $short) || exit 1
    many=$(loopback_instructions $long) || exit 1
    ticks=$((nodes * (long - short)))
    each=$(((many - few + ticks / 2) / ticks))
    printf '\n| on the host (x86-64) | instructions | limit | what is counted |\n|---|---:|---:|---|\n'
    printf '| loopback, per node-tick | %d | %d | callgrind: 100 nodes of degree 4, bytes, bus and all |\n' \
        "$each" "$HOST_LIMIT"
    (( each <= HOST_LIMIT ))
}

# Instructions of a whole run of the load behind the loopback figures.
loopback_instructions() { # TICKS
    local log; log=$(mktemp)
    valgrind --tool=callgrind --callgrind-out-file=/dev/null target/release/examples/loopback_ticks "$1" \
        >"$log" 2>&1 </dev/null || { cat "$log" >&2; fail "valgrind failed"; }
    sed -nE 's/.*Collected *: *([0-9]+).*/\1/p' "$log"
    rm -f "$log"
}

cmd_bench() { #: node-ticks per second in loopback; depends on the machine, so nothing fails
    cargo build --release --locked --quiet --package sim-host --example loopback_ticks
    target/release/examples/loopback_ticks 20000
}

cmd_size() { #: check the image against its budget of flash and static RAM
    firmware_cargo build --release --locked --quiet --bin mps2_an386
    local text data bss flash ram
    read -r text data bss _ < <(arm-none-eabi-size "$IMAGES/mps2_an386" | tail -n 1)
    flash=$((text + data)) ram=$((data + bss))
    say "mps2_an386: $flash of $FLASH_BUDGET bytes flash, $ram of $RAM_BUDGET bytes static RAM"
    (( flash <= FLASH_BUDGET && ram <= RAM_BUDGET )) || fail "the image is over its budget"
}

# First address of a section and the one after its end, in decimal.
section_span() { # IMAGE SECTION
    local size start
    read -r size start < <(arm-none-eabi-objdump -h "$1" | awk -v name="$2" '$2 == name { print $3, $4 }')
    [[ -n ${size:-} ]] || fail "${1##*/} has no section $2"
    echo $((16#$start)) $((16#$start + 16#$size))
}

expect_within() { # IMAGE SECTION LOW HIGH
    local start end
    read -r start end < <(section_span "$1" "$2")
    (( start >= $3 && end <= $4 )) \
        || fail "$(printf '%s of %s is at %#x..%#x, not within %#x..%#x' "$2" "${1##*/}" "$start" "$end" "$3" "$4")"
}

cmd_addresses() { #: check where the image is linked to: a root memory.x would silently win over the board's
    [[ $(sed -E 's|/\*.*\*/||; /^\/\*/,/\*\//d; /^[[:space:]]*$/d' memory.x) == "INCLUDE board-memory.x" ]] \
        || fail "memory.x in the root must hold nothing but INCLUDE board-memory.x"
    firmware_cargo build --release --locked --quiet --bin mps2_an386
    local image=$IMAGES/mps2_an386 flash_end=$((4 << 20)) ram=$((0x20000000)) section
    expect_within "$image" .vector_table 0 $((0x400))
    for section in .text .rodata; do expect_within "$image" "$section" 0 "$flash_end"; done
    for section in .data .bss; do expect_within "$image" "$section" "$ram" $((ram + flash_end)); done
    say "mps2_an386: vectors at 0, code in flash, .data and .bss in RAM"
}

cmd_scenarios() { #: run every scenario in scenarios/ and judge its expectations
    cargo build --release --quiet --package sim-host
    local scenario
    for scenario in scenarios/*.toml; do
        target/release/sim-host check "$scenario" >/dev/null || fail "check $scenario"
        target/release/sim-host run --quiet "$scenario" || fail "run $scenario"
        say "$scenario holds"
    done
}

cmd_gallery() { #: draw the book's figures and compute the README's table of scenarios anew
    cargo run --release --locked --quiet --package sim-host --example gallery
}

cmd_gallery-check() { #: check that the README's table of scenarios is what they give now
    cargo run --release --locked --quiet --package sim-host --example gallery -- --check
}

cmd_book() { #: build the book as HTML in target/book, where mdBook is installed
    have mdbook || { say "SKIPPED the book: no mdbook here; cargo install mdbook"; return; }
    mdbook build docs/book
    say "the book: target/book/index.html"
}

cmd_test() { #: set up, then every check, cheap ones first
    local name
    for name in setup fmt clippy unit thumb firmware size addresses selftest parity scenarios gallery-check \
        cost book; do
        say "--- $name"
        "cmd_$name"
    done
    say "all checks passed"
}

cmd_help() { #: list the sub-commands
    echo "usage: ./ci.sh SUB-COMMAND..."
    sed -nE 's/^cmd_([a-z_-]+)\(\) [{(] *#: (.*)/  \1\t\2/p' ci.sh | expand -t 18
}

(( $# > 0 )) || { cmd_help >&2; exit 2; }
for name in "$@"; do
    [[ $(type -t "cmd_$name") == function ]] || { cmd_help >&2; fail "no sub-command is called '$name'"; }
done
for name in "$@"; do
    "cmd_$name"
done
