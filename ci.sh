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
readonly TOOLS=$ROOT/firmware/target/tools
readonly DEFMT_PRINT_VERSION=1.2.0
readonly FLASH_BUDGET=$((48 * 1024)) RAM_BUDGET=$((16 * 1024)) # bytes

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
    apt_install rustc-web cargo-web rust-web-src lld
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

# cargo for the firmware: in its folder, because cargo looks there for the target, flags and environment.
firmware_cargo() (
    cd firmware
    chosen=$(toolchain) || fail "no toolchain for $TARGET: ./ci.sh setup"
    if [[ $chosen == debian ]]; then
        # Unstable options of a released compiler: without rustup there is no other way to core for the
        # target.
        export PATH=/usr/bin:$PATH RUSTC_BOOTSTRAP=1 CARGO_UNSTABLE_BUILD_STD=core,alloc
        export CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER=ld.lld
    fi
    exec cargo "$@"
)

defmt_print() {
    [[ -x $TOOLS/bin/defmt-print ]] && return
    say "installing defmt-print $DEFMT_PRINT_VERSION into ${TOOLS#"$ROOT"/}"
    cargo install --quiet --locked --root "$TOOLS" --version "$DEFMT_PRINT_VERSION" defmt-print
}

# --- sub-commands
# ------------------------------------------------------------------------------------------------

cmd_setup() { #: find or install what the other commands need
    local missing=()
    have qemu-system-arm || missing+=(qemu-system-arm)
    have arm-none-eabi-gcc || missing+=(gcc-arm-none-eabi)
    have python3 || missing+=(python3)
    { have arm-none-eabi-gcc && [[ -f $(arm-none-eabi-gcc -print-file-name=libm.a) ]]; } \
        || missing+=(libnewlib-arm-none-eabi)
    (( ${#missing[@]} == 0 )) || apt_install "${missing[@]}"
    setup_toolchain
    say "firmware toolchain: $(toolchain); $(qemu-system-arm --version | head -n 1)"
}

cmd_firmware() { #: build the firmware images
    firmware_cargo build --release
    say "image: ${IMAGES#"$ROOT"/}/mps2_an386"
}

cmd_selftest() { #: run the platform's own tests in the emulator: echo, clock, panic, sleep
    firmware_cargo build --release --bin selftest
    defmt_print
    python3 firmware/selftest.py qemu-system-arm "$TOOLS/bin/defmt-print" "$IMAGES/selftest"
}

cmd_cost() { #: count instructions on the emulated Cortex-M4F: name, instructions, what it is
    firmware_cargo build --release --quiet --features cost --bin cost
    timeout 120 qemu-system-arm -M mps2-an386 -display none -serial none -monitor none -icount shift=0 \
        -semihosting-config enable=on,target=native -kernel "$IMAGES/cost"
}

cmd_size() { #: check the image against its budget of flash and static RAM
    firmware_cargo build --release --quiet --bin mps2_an386
    local text data bss flash ram
    read -r text data bss _ < <(arm-none-eabi-size "$IMAGES/mps2_an386" | tail -n 1)
    flash=$((text + data)) ram=$((data + bss))
    say "mps2_an386: $flash of $FLASH_BUDGET bytes flash, $ram of $RAM_BUDGET bytes static RAM"
    (( flash <= FLASH_BUDGET && ram <= RAM_BUDGET )) || fail "the image is over its budget"
}

cmd_help() { #: list the sub-commands
    echo "usage: ./ci.sh SUB-COMMAND..."
    sed -nE 's/^cmd_([a-z_]+)\(\) [{(] *#: (.*)/  \1\t\2/p' ci.sh | expand -t 14
}

(( $# > 0 )) || { cmd_help >&2; exit 2; }
for name in "$@"; do
    [[ $(type -t "cmd_$name") == function ]] || { cmd_help >&2; fail "no sub-command is called '$name'"; }
done
for name in "$@"; do
    "cmd_$name"
done
