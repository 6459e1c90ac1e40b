#!/usr/bin/env bash
# Every check of this repository as a named sub-command: ./ci.sh help
#
# A sub-command is a function cmd_NAME whose first line ends in "#: what it does"; `help` lists those lines.
# Called with several names, they run in that order; the first failure ends the run with its exit code.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
readonly ROOT=$PWD
readonly TARGET=thumbv7em-none-eabihf
readonly SMALL_TARGET=thumbv6m-none-eabi # Cortex-M0+
readonly IMAGES=$ROOT/firmware/target/$TARGET/release
# Boards and images, from the metadata of firmware/Cargo.toml by firmware/boards.py. Boards as their binaries are called; targets; where flash and RAM begin and
# how large they are; bytes of a boot loader in front; where the storage begins and how large it is, if there is one. Images: boards, binaries, features; budgets of
# flash, static RAM and stack; "emulated" if firmware/emulated runs it; where the program is and how long it may be, and bytes of the chip's boot loader in front of it.
BOARDS="" IMAGES_OF_NODES=""
# Where the emulators of boards are installed, beside firmware/emulated/pico/node_modules.
readonly EMULATED=$ROOT/target/emulated
# Where the readers of tests/readers are installed; sim-host/tests/exports.rs looks there.
readonly READERS=$ROOT/target/readers
# Where the Python package is installed, with what its tests and notebooks need.
readonly PACKAGE=$ROOT/target/python
# Instructions per node-tick in loopback. 1650.4 were counted, 33 more than before nodes had limits of what they hear and events could set something: 1650 would hang on rounding.
readonly HOST_LIMIT=1660
# The same on CAN, in tenths of those in loopback. It is to be 25; 27.7 were counted.
readonly CAN_TIMES_TEN=29
# The paths above and below are those of cargo's default target folders.
unset CARGO_TARGET_DIR CARGO_BUILD_TARGET_DIR CARGO_BUILD_TARGET
# A clean clone is compiled once: what would make the next build faster only fills the disk.
[[ ${CI:-} != true ]] || export CARGO_INCREMENTAL=0

say() { printf 'ci.sh: %s\n' "$*"; }
fail() { printf 'ci.sh: error: %s\n' "$*" >&2; exit 1; }
have() { command -v "$1" >/dev/null 2>&1; }

# --- toolchain
# ---------------------------------------------------------------------------------------------------
#
# Two ways to a compiler for the target. rustup's, where it can reach its servers; else Debian's, which brings
# no core for the target but its source. FUNNEL_TOOLCHAIN=rustup or =debian forces one of them.

rustup_has_targets() {
    have rustup && [[ $(rustup target list --installed 2>/dev/null | grep -cx -e "$TARGET" -e "$SMALL_TARGET") == 2 ]]
}

# Debian's toolchain: the compiler, the source of core, and the linker; clippy is a package of its own.
debian_has_source() {
    [[ -x /usr/bin/rustc && -x /usr/bin/cargo ]] && have ld.lld \
        && [[ -f $(/usr/bin/rustc --print sysroot)/lib/rustlib/src/rust/library/core/Cargo.toml ]]
}

# Prints rustup or debian: the toolchain that is complete. Fails if none is.
toolchain() {
    case ${FUNNEL_TOOLCHAIN:-} in
        rustup) rustup_has_targets && echo rustup ;;
        debian) debian_has_source && echo debian ;;
        "") { rustup_has_targets && echo rustup; } || { debian_has_source && echo debian; } ;;
        *) fail "FUNNEL_TOOLCHAIN is '$FUNNEL_TOOLCHAIN', not rustup or debian" ;;
    esac
}

setup_toolchain() {
    toolchain >/dev/null && return
    if [[ ${FUNNEL_TOOLCHAIN:-rustup} == rustup ]] && have rustup; then
        say "adding the targets $TARGET and $SMALL_TARGET by rustup"
        timeout 300 rustup target add "$TARGET" "$SMALL_TARGET" >/dev/null 2>&1 && return
        say "rustup can't fetch it"
    fi
    [[ ${FUNNEL_TOOLCHAIN:-debian} == debian ]] || fail "no targets $TARGET and $SMALL_TARGET from rustup"
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
    chosen=$(toolchain) || fail "no toolchain for the targets: ./ci.sh setup"
    if [[ $chosen == debian ]]; then
        # Unstable options of a released compiler: without rustup there is no other way to core for the
        # target.
        export PATH=/usr/bin:$PATH RUSTC_BOOTSTRAP=1 CARGO_UNSTABLE_BUILD_STD=$2
        export CARGO_TARGET_THUMBV7EM_NONE_EABIHF_LINKER=ld.lld CARGO_TARGET_THUMBV6M_NONE_EABI_LINKER=ld.lld
    fi
    exec cargo "${@:3}"
)

firmware_cargo() { target_cargo firmware core,alloc "$@"; }

# cargo COMMAND for one image.
image_cargo() { # COMMAND IMAGE CARGO-ARGUMENTS...
    local board features
    board=$(image_field "$2" 2) features=$(image_field "$2" 4)
    firmware_cargo "$1" --quiet --locked --target "$(board_field "$board" 2)" --no-default-features \
        --features "${board//_/-},${features#-}" --bin "$(image_field "$2" 3)" "${@:3}"
}

# What has been built since this script began; nothing changes a source meanwhile.
declare -A BUILT=()

# Builds an image once, and gives it its name where its binary has another one.
image_build() { # IMAGE
    [[ -z ${BUILT[$1]:-} ]] || return 0
    BUILT[$1]=yes
    local binary
    binary=$(image_field "$1" 3)
    image_cargo build "$1" --release
    [[ $1 != "$binary" ]] || return 0
    cp "$(dirname "$(image_path "$1")")/$binary" "$(image_path "$1")"
    # An image that has the binary's own name has to be built again.
    unset "BUILT[$binary]"
}

read_boards() { BOARDS=$(python3 firmware/boards.py boards) && IMAGES_OF_NODES=$(python3 firmware/boards.py images); }

images() { awk 'NF { print $1 }' <<<"$IMAGES_OF_NODES"; }
emulated_images() { awk '$8 == "emulated" { print $1 }' <<<"$IMAGES_OF_NODES"; }

# A column of the table of images, or of boards.
image_field() { field "$IMAGES_OF_NODES" "$@"; } # IMAGE COLUMN
board_field() { field "$BOARDS" "$@"; } # BOARD COLUMN
field() { awk -v row="$2" -v column="$3" '$1 == row { print $column }' <<<"$1"; } # TABLE ROW COLUMN

image_path() { # IMAGE
    echo "$ROOT/firmware/target/$(board_field "$(image_field "$1" 2)" 2)/release/$1"
}

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
    # libFuzzer is C++.
    have g++ || missing+=(g++)
    # Debian's valgrind doesn't start without the debug symbols of the C library.
    have valgrind || missing+=(valgrind libc6-dbg)
    { have arm-none-eabi-gcc && [[ -f $(arm-none-eabi-gcc -print-file-name=libm.a) ]]; } \
        || missing+=(libnewlib-arm-none-eabi)
    (( ${#missing[@]} == 0 )) || apt_install "${missing[@]}"
    setup_toolchain
    setup_socketcan
    setup_emulated
    setup_readers
    setup_package_tools
    setup_browser
    # Not fatal: clippy says where it is skipped.
    target_has_clippy || [[ $(toolchain) != debian ]] || (apt_install rust-web-clippy) || true
    read_boards
    say "host: $(rustc --version); $(valgrind --version)"
    say "firmware: toolchain of $(toolchain); $(qemu-system-arm --version | head -n 1)"
}

# A kernel with CAN, in a process; only Debian and its like package it. `socketcan` says what follows where it is missing.
has_socketcan() { have linux.uml && have candump && have insmod && have ip && have patchelf; }

has_package() { apt-cache show "$1" >/dev/null 2>&1; }

setup_socketcan() {
    has_socketcan || (apt_install user-mode-linux can-utils kmod iproute2 patchelf) || say "no user-mode Linux, so no test of SocketCAN"
}

# Emulators of boards, from npm and PyPI, in the versions of the lock files: development tools alone.
has_emulated() { have node && [[ -x $EMULATED/venv/bin/python && -x $EMULATED/venv/bin/ruff && -s $EMULATED/bootrom.bin && -d firmware/emulated/pico/node_modules/rp2040js ]]; }

setup_emulated() {
    has_emulated || (install_emulated) || say "no emulators of boards, so none of their images is run"
}

install_emulated() {
    local missing=() wheels=$EMULATED/wheels log=$EMULATED/install.log
    have node || missing+=(nodejs)
    have npm || missing+=(npm)
    python3 -c 'import ensurepip' 2>/dev/null || missing+=(python3-venv)
    (( ${#missing[@]} == 0 )) || apt_install "${missing[@]}"
    mkdir -p "$EMULATED"
    say "installing emulators of boards from npm and PyPI"
    {
        (cd firmware/emulated/pico && timeout 300 npm ci --no-audit --no-fund) \
            && python3 -m venv "$EMULATED/venv" \
            && timeout 300 "$EMULATED/venv/bin/pip" download --no-deps --require-hashes -d "$wheels" -r firmware/emulated/requirements.txt \
            && "$EMULATED/venv/bin/pip" install --no-deps --no-index --find-links "$wheels" unicorn pyelftools ruff \
            && python3 firmware/emulated/bootrom.py "$wheels" "$EMULATED/bootrom.bin"
    } >"$log" 2>&1 || { tail -n 5 "$log" >&2; fail "the emulators of boards cannot be installed (the whole output: $log)"; }
}

# Python packages that read what `export` writes, from PyPI, in the versions of a lock file.
has_readers() { [[ -x $READERS/bin/python ]] && "$READERS/bin/python" -c 'import cantools, mcap, networkx' 2>/dev/null; }

setup_readers() {
    has_readers || (install_readers) || say "no readers of other makers, so none of them reads what export writes"
}

install_readers() {
    local log=$READERS.log
    python3 -c 'import ensurepip' 2>/dev/null || apt_install python3-venv
    say "installing cantools, mcap and networkx from PyPI"
    mkdir -p "$(dirname "$READERS")"
    {
        python3 -m venv "$READERS" \
            && timeout 300 "$READERS/bin/pip" install --no-deps --only-binary :all: --require-hashes -r tests/readers/requirements.txt
    } >"$log" 2>&1 || { tail -n 5 "$log" >&2; fail "cantools, mcap and networkx cannot be installed (the whole output: $log)"; }
}

# The tools of the Python package, from PyPI, in the versions of a lock file.
has_package_tools() { [[ -x $PACKAGE/bin/maturin ]] && "$PACKAGE/bin/python" -c 'import ipykernel, matplotlib, nbclient, pandas, polars, pytest' 2>/dev/null; }

setup_package_tools() {
    has_package_tools || (install_package_tools) || say "no tools of the Python package, so it is not built"
}

install_package_tools() {
    local log=$PACKAGE.log
    python3 -c 'import ensurepip' 2>/dev/null || apt_install python3-venv
    say "installing maturin, NumPy and what the Python package is tested with from PyPI"
    mkdir -p "$(dirname "$PACKAGE")"
    {
        python3 -m venv "$PACKAGE" \
            && timeout 600 "$PACKAGE/bin/pip" install --no-deps --only-binary :all: --require-hashes -r python/requirements.txt
    } >"$log" 2>&1 || { tail -n 5 "$log" >&2; fail "the tools of the Python package cannot be installed (the whole output: $log)"; }
}

# A browser, and what drives it, from npm in the versions of the lock file.
has_browser() { have node && have chromium && [[ -d tests/browser/node_modules/puppeteer-core && -d tests/browser/node_modules/axe-core ]]; }

setup_browser() {
    has_browser || (install_browser) || say "no browser, so no report is looked at in one"
}

install_browser() {
    local missing=() log=$ROOT/target/browser.log
    have node || missing+=(nodejs)
    have npm || missing+=(npm)
    have chromium || missing+=(chromium)
    (( ${#missing[@]} == 0 )) || apt_install "${missing[@]}"
    say "installing what drives a browser from npm"
    mkdir -p "$ROOT/target"
    (cd tests/browser && timeout 300 npm ci --no-audit --no-fund) >"$log" 2>&1 \
        || { tail -n 5 "$log" >&2; fail "what drives a browser cannot be installed (the whole output: $log)"; }
}

cmd_fmt() { #: check the format of every Rust file
    cargo fmt --all --check || fail "not formatted: cargo fmt --all"
    (cd firmware && cargo fmt --check) || fail "not formatted: (cd firmware && cargo fmt)"
    (cd fuzz && cargo fmt --check) || fail "not formatted: (cd fuzz && cargo fmt)"
    (cd python && cargo fmt --check) || fail "not formatted: (cd python && cargo fmt)"
}

cmd_clippy() { #: clippy with warnings denied: workspace, Python package, and firmware for its target
    cargo clippy --quiet --locked --workspace --all-targets -- -D warnings
    # One folder of build products serves both workspaces.
    (cd python && CARGO_TARGET_DIR=$ROOT/target cargo clippy --quiet --locked --all-targets -- -D warnings)
    if target_has_clippy; then
        firmware_cargo clippy --quiet --locked --features cost --bins -- -D warnings
        local image
        for image in $(images); do image_cargo clippy "$image" -- -D warnings; done
    else
        say "SKIPPED clippy of the firmware: the toolchain for $TARGET has none"
    fi
}

cmd_python() { #: lint the Python tools, and try the checks of images on small images with and without a fault
    (cd firmware/checks && python3 -m unittest)
    if [[ -x $EMULATED/venv/bin/ruff ]]; then
        "$EMULATED/venv/bin/ruff" check --quiet --no-cache .
    else
        say "SKIPPED the lint of Python: no ruff here; ./ci.sh setup installs it where PyPI can be reached"
    fi
}

cmd_unit() { #: unit, property and golden tests on the host
    # The tests themselves say so where nobody looks: what a passing test prints is not shown.
    has_readers || say "SKIPPED exports as other makers read them: no cantools, mcap and networkx in target/readers; ./ci.sh setup installs them where PyPI can be reached"
    # With `pcapng`, which sim-host turns on for the CAN bus.
    cargo test --locked --workspace
}

# The command as `unit` has built it. An example is named, since the features of dev-dependencies count then, as they do for tests: without
# them the simulator would be compiled once more, which is two minutes of a processor.
build_command() { cargo build --locked --quiet --package sim-host --bin sim-host --example gallery; }

cmd_python-package() { #: build and install the Python package, and run its tests and notebooks
    has_package_tools || { say "SKIPPED the Python package: no tools in target/python; ./ci.sh setup installs them where PyPI can be reached"; return; }
    build_command
    # Without optimisation of what is tested for its bits: those are the same. The libraries below are those of the tests of Rust.
    PATH=$PACKAGE/bin:$PATH CARGO_TARGET_DIR=$ROOT/target MATURIN_PEP517_ARGS="--profile dev" \
        "$PACKAGE/bin/pip" install --quiet --no-deps --no-build-isolation --force-reinstall ./python
    (cd python && FUNNELNET_COMMAND=$ROOT/target/debug/sim-host "$PACKAGE/bin/python" -m pytest -q -p no:cacheprovider)
}

cmd_doc() { #: the crates' documentation, with warnings denied
    RUSTDOCFLAGS="-D warnings" cargo doc --quiet --locked --workspace --no-deps
}

# Crates below a user's test of a network.
readonly CRATES_OF_A_TEST=40

cmd_package() { #: pack and build what can be published (dry run), and count the crates below a test of a network
    local crates
    cargo clippy --quiet --locked --package funnelnet-sim --lib -- -D warnings
    crates=$(cargo tree --locked --quiet --package funnelnet-sim --edges normal,build --prefix none --format '{p}' | awk '{ print $1, $2 }' | sort -u | wc -l)
    say "$crates crates in a test of a network, funnelnet-sim among them"
    (( crates <= CRATES_OF_A_TEST )) || fail "more than $CRATES_OF_A_TEST crates below a test of a network"
    # In a folder of its own each time: cargo keeps what it has unpacked by the path of the registry, and takes an older law for this one.
    local folder status=0
    folder=$(mktemp -d)
    cargo publish --quiet --locked --dry-run --workspace --allow-dirty --target-dir "$folder" || status=$?
    rm -rf "$folder"
    (( status == 0 ))
}

cmd_deny() { #: licences, sources and wildcard versions of everything below the workspace, firmware, fuzz targets and Python package
    have cargo-deny || { say "SKIPPED licences and sources: no cargo-deny here; cargo install --locked cargo-deny"; return; }
    local folder
    for folder in . firmware fuzz python; do
        (cd "$folder" && cargo deny --locked --config "$ROOT/deny.toml" check bans licenses sources)
    done
}

cmd_semver() { #: the interfaces of what is published against those of the last tag
    local tag
    tag=$(git describe --tags --abbrev=0 2>/dev/null) || { say "SKIPPED semver checks: there is no tag to compare with"; return; }
    have cargo-semver-checks || { say "SKIPPED semver checks against $tag: no cargo-semver-checks here; cargo install --locked cargo-semver-checks"; return; }
    # Of the whole workspace these are the crates that can be published.
    cargo semver-checks --workspace --baseline-rev "$tag"
}

cmd_fuzz() { #: half a minute of fuzzing for each decoder, the node, the session, storage and the scenario reader
    # What fuzzing has found stays a test: the inputs of the corpus first, and then half a minute of new ones, from a fixed seed.
    fuzz/run.sh --seconds 30
}

cmd_sweep() { #: every f32 through every gain, against f64; 7 minutes of processor time, on all cores, not part of `test`
    cargo test --locked --release --package funnelnet-law --test sweep -- --include-ignored --nocapture
}

cmd_thumb() { #: the crates of a node alone for the target: no std, and with Debian's toolchain no alloc either
    local package
    for package in funnelnet-law funnelnet-app funnelnet-node funnelnet-link funnelnet-plant funnelnet-protocol funnelnet-store funnelnet-update; do
        target_cargo . core build --quiet --locked --target "$TARGET" --no-default-features --package "$package"
        say "$package builds for $TARGET without std"
    done
}

cmd_firmware() { #: build the firmware images
    firmware_cargo build --release --locked
    say "image: ${IMAGES#"$ROOT"/}/mps2_an386"
}

uf2_file() { # IMAGE
    python3 firmware/uf2.py "$1" "$(image_path "$1")" "$(image_path "$1").uf2" || exit 1
}

# Words behind `uf2`: what is to become a file. Set where sub-commands are told apart from words.
UF2_IMAGES=()

cmd_uf2() { #: build images by name (uf2 IMAGE...) and make UF2 files of them, for boards that take programs by drag and drop
    (( ${#UF2_IMAGES[@]} > 0 )) || fail "which image? For example: ./ci.sh uf2 rp2040_pico"
    local image
    for image in "${UF2_IMAGES[@]}"; do
        # Before anything is built.
        python3 firmware/uf2.py "$image" || exit 1
        image_build "$image"
        uf2_file "$image"
        say "drag this onto the board's drive: $(realpath --relative-to=. "$(image_path "$image").uf2")"
    done
}

cmd_selftest() { #: run the platform's own tests in the emulator: echo, clock, panic, sleep, a CAN bus that fails
    firmware_cargo build --release --locked --quiet --bin selftest
    cargo build --locked --quiet --workspace --example defmt_log --example selftest_configs
    python3 firmware/checks/selftest.py qemu-system-arm target/debug/examples/{defmt_log,selftest_configs} "$IMAGES/selftest"
}

# The tests that `unit` leaves out, and no others, here and in `hour`; they fail where they cannot run.
cmd_parity() { #: the simulator against emulated nodes, bit for bit, on one bus and on lines to each other, what can go wrong with emulators and benches, and emulated heaters
    firmware_cargo build --release --locked --quiet --bin mps2_an386 --bin mps2_peers --bin selftest --bin heater_emulated
    cargo test --locked --workspace --test parity --test emulator_faults --test bench --test bench_sync --test heaters --test lines -- --ignored
}

cmd_hour() { #: an hour of five emulated nodes with timers, against the simulator; their time is counted in instructions
    firmware_cargo build --release --locked --quiet --bin selftest
    cargo test --locked --workspace --test hour -- --ignored
}

cmd_boards-run() { #: run images of real boards on emulators that others wrote: start, storage, power cuts, watchdog, faults, bus, and loopback's bits
    if ! has_emulated; then
        [[ ${CI:-} != true ]] || fail "no emulators of boards: ./ci.sh setup"
        say "SKIPPED the images of boards on emulators: no node, unicorn or boot ROM; ./ci.sh setup installs them where npm and PyPI can be reached"
        return
    fi
    local image
    for image in $(emulated_images); do image_build "$image"; done
    uf2_file rp2040_pico_usb
    cargo build --locked --quiet --package sim-host --bins --example board_words --example defmt_log
    boards_run_pico & local pico=$!
    boards_run_arm || { kill "$pico" 2>/dev/null; wait "$pico"; fail "images of the boards with a Cortex-M4F"; }
    wait "$pico" || fail "images of the Raspberry Pi Pico"
}

boards_run_pico() {
    local nodes=5 ticks=300 image over_usb
    image=$(image_path rp2040_pico) over_usb=$(image_path rp2040_pico_usb)
    (cd firmware/emulated/pico && node --test --test-reporter=spec test/) || return
    say "a bench of $nodes Picos, $ticks ticks"
    python3 firmware/emulated/bench.py target/debug/sim-host firmware/emulated/pico/serve.mjs "$image" \
        "$nodes" scenarios/five-agents.toml --set "time.duration=${ticks}ms" || return
    # All of the scenario takes minutes; a funnel that closes faster has closed as far by then.
    local heaters=(coupling.funnel.rate=0.03 time.duration=200s)
    [[ ${FUNNEL_EXTENDED:-} != 1 ]] || heaters=()
    say "three heaters on Picos, each with a simulated block"
    python3 firmware/emulated/heaters.py target/debug/sim-host firmware/emulated/pico/serve-heater.mjs "$(image_path heater)" \
        firmware/heaters.toml ${heaters[@]+"${heaters[@]}"} || return
    say "$nodes Picos commissioned over a power cycle"
    python3 firmware/emulated/commission.py target/debug/sim-host firmware/emulated/pico/serve.mjs "$image" \
        "$nodes" scenarios/five-agents.toml --set "time.duration=50ms" || return
    say "the same bench and commissioning over USB"
    python3 firmware/emulated/bench.py target/debug/sim-host firmware/emulated/pico/serve-usb.mjs "$over_usb" \
        "$nodes" scenarios/five-agents.toml --set "time.duration=${ticks}ms" || return
    python3 firmware/emulated/commission.py target/debug/sim-host firmware/emulated/pico/serve-usb.mjs "$over_usb" \
        "$nodes" scenarios/five-agents.toml --set "time.duration=50ms"
}

boards_run_arm() {
    (cd firmware/emulated/arm && "$EMULATED/venv/bin/python" -m unittest --verbose)
}

cmd_update() { #: updates in the field: cuts at every write, the images of a Pico that takes them, an emulated one that is updated, and three by `bench --update` (minutes)
    local image picos=3
    cargo test --locked --package funnelnet-update
    cargo test --locked --package funnelnet-app --features update --test u25
    cargo test --locked --package sim-host --test update
    printf '| image | flash | of | static RAM | of |\n|---|---:|---:|---:|---:|\n'
    for image in rp2040_pico_boot rp2040_pico_update; do
        image_build "$image"
        image_size "$image" || fail "$image is over its budget"
        image_addresses "$image"
    done
    if ! has_emulated; then
        say "SKIPPED emulated Picos that are updated: no node or boot ROM; ./ci.sh setup"
        return
    fi
    cargo build --locked --quiet --package sim-host --bins --example board_words
    (cd firmware/emulated/pico && node --test --test-reporter=spec update/)
    say "a bench of $picos Picos is updated, and goes back because of one of them"
    python3 firmware/emulated/update.py target/debug/sim-host firmware/emulated/pico/serve-update.mjs "$(image_path rp2040_pico_boot)" \
        "$(image_path rp2040_pico_update)" "$picos" firmware/emulated/three.toml
}

cmd_socketcan() { #: benches on a real CAN bus: vcan in a guest kernel, nodes in processes of their own
    if ! has_socketcan; then
        # In CI a package that is missing is a fault of whoever set it up, unless this system's archive does not have it.
        [[ ${CI:-} != true ]] || ! has_package user-mode-linux \
            || fail "no user-mode Linux, can-utils, kmod, iproute2 or patchelf here: ./ci.sh setup"
        say "SKIPPED benches on SocketCAN: no user-mode Linux, can-utils, kmod, iproute2 or patchelf here; docs/machines.md says which systems have them"
        return
    fi
    local guest why status=0
    why=$(mktemp)
    guest=$(tests/socketcan/find-guest.sh target/guest 2>"$why") || status=$?
    if (( status != 0 )); then
        # A processor that no kernel knows is nobody's fault; anything else is.
        (( status == 1 )) || [[ ${CI:-} != true ]] || fail "no guest kernel for benches on SocketCAN: $(cat "$why")"
        say "SKIPPED benches on SocketCAN: $(cat "$why")"
        say "the way out: a machine with an older processor, or a user-mode Linux of 7.2 or later as linux.uml in PATH"
        rm -f "$why"
        return
    fi
    rm -f "$why"
    say "guest kernel: $guest"
    FUNNEL_GUEST=$guest cargo test --locked --package sim-host --test socketcan -- --include-ignored
}

cmd_cost() { #: count instructions on the emulated Cortex-M4F and on the host; Markdown, fails above a limit
    local over=0
    firmware_cargo build --release --locked --quiet --features cost --bin cost
    cargo build --release --locked --quiet --package system-load
    emulator_cost || over=1
    host_cost || over=1
    (( over == 0 )) || fail "too many instructions"
}

# The table that the image prints; 1 where a row is over its limit.
emulator_cost() {
    local status=0
    # In the foreground, so that who ends this script ends it, too.
    timeout --foreground 120 qemu-system-arm -M mps2-an386 -display none -serial none -monitor none -icount shift=0 \
        -semihosting-config enable=on,target=native -kernel "$IMAGES/cost" </dev/null || status=$?
    (( status <= 1 )) || fail "counting on the emulator ended with exit code $status (124: it took too long)"
    return "$status"
}

# Rows for the host; 1 where one is over its limit. Between two lengths of run everything but the ticks cancels.
host_cost() {
    local ideal can most status=0
    ideal=$(instructions_per_node_tick loopback_ticks) || exit 1
    can=$(instructions_per_node_tick can_ticks) || exit 1
    most=$((ideal * CAN_TIMES_TEN / 10))
    printf '\n| on the host (x86-64) | instructions | limit | what is counted |\n|---|---:|---:|---|\n'
    printf '| loopback, per node-tick | %d | %d | callgrind: 100 nodes of degree 4, bytes, bus and all |\n' \
        "$ideal" "$HOST_LIMIT"
    printf '| on `can`, per node-tick | %d | %d | the same on classic CAN, every frame with its bits |\n' "$can" "$most"
    (( ideal <= HOST_LIMIT )) || status=1
    (( can <= most )) || status=1
    return "$status"
}

instructions_per_node_tick() { # EXAMPLE
    local nodes=100 short=200 long=1200 few many ticks
    few=$(load_instructions "$1" $short) || exit 1
    many=$(load_instructions "$1" $long) || exit 1
    ticks=$((nodes * (long - short)))
    echo $(((many - few + ticks / 2) / ticks))
}

# Instructions of a whole run of one of the loads.
load_instructions() { # LOAD TICKS
    local log; log=$(mktemp)
    valgrind --tool=callgrind --callgrind-out-file=/dev/null "target/release/$1" "$2" \
        >"$log" 2>&1 </dev/null || { cat "$log" >&2; fail "valgrind failed"; }
    sed -nE 's/.*Collected *: *([0-9]+).*/\1/p' "$log"
    rm -f "$log"
}

cmd_bench() { #: node-ticks per second in loopback; depends on the machine, so nothing fails
    cargo build --release --locked --quiet --package system-load
    target/release/loopback_ticks 20000
}

# The book's page with tables of boards.
readonly BOARDS_PAGE=docs/book/src/boards.md

cmd_boards() { #: build every image; check flash and RAM against budgets, where it is linked to, that flashing leaves the storage alone, and the book's tables
    one_root_memory_map
    python3 firmware/boards.py check "$BOARDS_PAGE" || fail "the book's tables of boards"
    local image over=0
    printf '| image | flash | of | static RAM | of |\n|---|---:|---:|---:|---:|\n'
    for image in $(images); do
        image_build "$image"
        image_size "$image" || over=1
        image_addresses "$image"
    done
    (( over == 0 )) || fail "an image is over its budget"
    say "vectors at the beginning of each chip's flash, code in its flash, .data and .bss in its RAM, nothing that is flashed in its storage"
}

# A row of bytes; 1 where the image is over its budget. Everything static counts, with the buffers of the log.
image_size() { # IMAGE
    local path flash ram flash_budget ram_budget
    path=$(image_path "$1")
    flash=$(sections_size "$path" '\.(vector_table|text|rodata|data|boot2)')
    ram=$(sections_size "$path" '\.(data|bss|uninit)')
    flash_budget=$(image_field "$1" 5) ram_budget=$(image_field "$1" 6)
    printf '| %s | %d | %d | %d | %d |\n' "$1" "$flash" "$flash_budget" "$ram" "$ram_budget"
    (( flash <= flash_budget && ram <= ram_budget ))
}

sections_size() { # IMAGE PATTERN
    arm-none-eabi-size -A "$1" | awk -v pattern="^$2\$" '$1 ~ pattern { sum += $2 } END { print sum + 0 }'
}

image_addresses() { # IMAGE
    local path board flash flash_end ram ram_end boot2 section
    path=$(image_path "$1") board=$(image_field "$1" 2)
    flash=$(($(image_field "$1" 9))) ram=$(($(board_field "$board" 5)))
    flash_end=$((flash + $(image_field "$1" 10))) ram_end=$((ram + $(board_field "$board" 6)))
    expect_at "$path" .vector_table "$flash"
    for section in .text .rodata; do expect_within "$path" "$section" "$flash" "$flash_end"; done
    for section in .data .bss; do expect_within "$path" "$section" "$ram" "$ram_end"; done
    boot2=$(image_field "$1" 11)
    (( boot2 == 0 )) || expect_at "$path" .boot2 $((flash - boot2))
    image_storage "$path" "$board"
}

# The storage is where the table says, and nothing that is flashed is in it: what flashes erases what it writes, and no more.
image_storage() { # PATH BOARD
    local start end
    start=$(board_field "$2" 8)
    [[ -n $start ]] || return 0
    end=$((start + $(board_field "$2" 9)))
    expect_symbol "$1" __storage_start "$((start))"
    expect_symbol "$1" __storage_end "$end"
    expect_unloaded "$1" "$((start))" "$end"
}

# Calls in sequential-storage that can end in a panic, in an image at most: checks of its own that nothing here is known to fail.
readonly DEPENDENCY_PANICS=sequential-storage=12

cmd_panics() { #: check that no code of app, law, link, node, plant, protocol, store, update and firmware in the images leads to a panic
    local image paths=()
    for image in $(images); do
        image_build "$image"
        paths+=("$(image_path "$image")")
    done
    python3 firmware/checks/panics.py "$ROOT" law,link,node,protocol app,plant,store,update,firmware "$DEPENDENCY_PANICS" "${paths[@]}"
}

cmd_stack() { #: the deepest stack of every image, against a budget and the room that it has
    local image arguments=()
    for image in $(images); do
        image_build "$image"
        arguments+=("$(image_path "$image")=$(image_field "$image" 7)")
    done
    python3 firmware/checks/stack.py "${arguments[@]}"
}

cmd_boards-docs() { #: write the book's tables of boards and images, with the stack that each image has now
    local found
    found=$(mktemp)
    cmd_stack | tee "$found"
    python3 firmware/boards.py write "$BOARDS_PAGE" "$found"
    rm -f "$found"
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

expect_at() { # IMAGE SECTION ADDRESS
    local start
    read -r start _ < <(section_span "$1" "$2")
    (( start == $3 )) || fail "$(printf '%s of %s is at %#x, not %#x' "$2" "${1##*/}" "$start" "$3")"
}

expect_symbol() { # IMAGE SYMBOL ADDRESS
    local found
    found=$(arm-none-eabi-nm "$1" | awk -v name="$2" '$3 == name { print $1 }')
    [[ -n $found ]] || fail "${1##*/} has no symbol $2"
    (( 16#$found == $3 )) || fail "$(printf '%s of %s is %#x, not %#x' "$2" "${1##*/}" "$((16#$found))" "$3")"
}

# No segment that is loaded has an address from LOW on and below HIGH, where it runs or where it is flashed to.
expect_unloaded() { # IMAGE LOW HIGH
    local virtual physical in_file in_memory segments=0
    while read -r virtual physical in_file in_memory; do
        segments=$((segments + 1))
        expect_outside "${1##*/}" "$((virtual))" "$((virtual + in_memory))" "$2" "$3"
        expect_outside "${1##*/}" "$((physical))" "$((physical + in_file))" "$2" "$3"
    done < <(arm-none-eabi-readelf -lW "$1" | awk '$1 == "LOAD" { print $3, $4, $5, $6 }')
    (( segments > 0 )) || fail "${1##*/} has no segment to load"
}

expect_outside() { # NAME START END LOW HIGH
    (( $2 >= $5 || $3 <= $4 )) || fail "$(printf 'a segment of %s is at %#x..%#x, in the storage, %#x..%#x' "$@")"
}

# Anything more in it would silently win over the boards' memory maps.
one_root_memory_map() {
    [[ $(sed -E 's|/\*.*\*/||; /^\/\*/,/\*\//d; /^[[:space:]]*$/d' memory.x) == "INCLUDE board-memory.x" ]] \
        || fail "memory.x in the root must hold nothing but INCLUDE board-memory.x"
}

cmd_scenarios() { #: run every scenario in scenarios/ and judge its expectations
    # As the unit tests are built: the runs take 18 s so and 16 s in release, whose build takes ten minutes (`same-bits` holds both to equal bits).
    build_command
    # One for each core at a time.
    printf '%s\0' scenarios/*.toml | xargs -0 -n 1 -P "$(nproc)" bash -c '
        target/debug/sim-host check "$1" >/dev/null || { echo "ci.sh: error: check $1" >&2; exit 255; }
        target/debug/sim-host run --quiet "$1" || { echo "ci.sh: error: run $1" >&2; exit 255; }
        echo "ci.sh: $1 holds"' scenario
}

# Scenarios that no CAN bus carries: a coupling without nodes.
readonly NOT_ON_CAN="side-by-side-weakly-centralised"

cmd_same-bits() { #: run every scenario on `can` in debug, twice, and in release, and with Debian's compiler where it is: equal hash, equal can.log
    local scenario name builds=(debug debug release)
    cargo build --locked --quiet --package sim-host --bin sim-host
    cargo build --locked --quiet --release --package sim-host --bin sim-host
    if [[ -x /usr/bin/cargo && -x /usr/bin/rustc && $(rustc --version) != $(/usr/bin/rustc --version) ]]; then
        PATH=/usr/bin:$PATH CARGO_TARGET_DIR=$ROOT/target/debian cargo build --locked --quiet --package sim-host --bin sim-host
        builds+=(debian/debug)
    else
        say "SKIPPED the bits of a second compiler: /usr/bin has no Rust of another version"
    fi
    for scenario in scenarios/*.toml; do
        name=$(basename "$scenario" .toml)
        [[ $name != "$NOT_ON_CAN" ]] || continue
        same_bits "$scenario" "${builds[@]}"
    done
    say "every scenario but $NOT_ON_CAN has equal hashes and equal can.log on can, by ${builds[*]}"
}

same_bits() { # SCENARIO BUILD...
    local scenario=$1 build first="" bits folder status
    folder=$(mktemp -d)
    for build in "${@:2}"; do
        rm -rf "$folder/out"
        status=0
        # What is expected of the ideal bus may fail on this one; what is refused is a failure here.
        "target/$build/sim-host" run "$scenario" --quiet --set bus.model=can --set bus.bit_errors=1e-5 --out "$folder/out" >/dev/null 2>&1 || status=$?
        (( status <= 1 )) && [[ -s $folder/out/can.log ]] || fail "$scenario does not run on can: exit code $status of target/$build/sim-host"
        bits=$(sed -nE 's/.*"trace_hash": "(.*)".*/\1/p' "$folder/out/summary.json")-$(sha256sum <"$folder/out/can.log")
        [[ $bits == "${first:=$bits}" ]] || fail "$scenario on can: $first by ${2}, $bits by $build"
    done
    rm -rf "$folder"
}

cmd_browser() { #: look at reports in headless Chromium: on a phone, on a desk, on paper; SCREENSHOTS=FOLDER keeps pictures
    has_browser || { say "SKIPPED reports in a browser: no chromium, node and tests/browser/node_modules; ./ci.sh setup installs them where they can be had"; return; }
    build_command
    (cd tests/browser && CHROMIUM=$(command -v chromium) node --test --test-reporter=spec)
}

cmd_gallery() { #: draw the book's figures and compute its table of scenarios anew
    cargo run --release --locked --quiet --package sim-host --example gallery
}

cmd_gallery-check() { #: check that the book's table of scenarios is what they give now
    cargo run --locked --quiet --package sim-host --example gallery -- --check
}

cmd_book() { #: build the book as HTML in target/book, where mdBook is installed
    have mdbook || { say "SKIPPED the book: no mdbook here; cargo install mdbook"; return; }
    mdbook build docs/book
    say "the book: target/book/index.html"
}

# What `test` does. FIRST runs alone. Then the checks of the target run behind those of the host, and those of boards behind what waits for time to
# pass and leaves half of the processors idle. Emulators that are compared tick by tick come last, and alone.
readonly FIRST="setup fmt"
readonly ON_HOST="clippy doc python unit python-package scenarios gallery-check browser"
readonly ON_TARGET="firmware boards panics stack thumb cost package fuzz deny semver book"
readonly WAITING="socketcan selftest"
readonly BEHIND_WAITING="boards-run hour"
readonly LAST="parity"

cmd_test() { #: set up, then every check: those of the host and those of the target beside each other
    local name
    for name in $FIRST; do timed "$name"; done
    both "$ON_HOST" "$ON_TARGET"
    both "$WAITING" "$BEHIND_WAITING"
    for name in $LAST; do timed "$name"; done
    say "all checks passed"
}

# Checks, and others behind them, which get what these leave of the processors: some of them play nodes in real time.
both() { # CHECKS CHECKS-BEHIND
    local name behind log status=0
    log=$(mktemp)
    # In a process group of its own, so that all of it can be ended.
    set -m
    (renice -n 10 -p "$BASHPID" >/dev/null; for name in $2; do timed "$name"; done) >"$log" 2>&1 </dev/null &
    behind=$!
    set +m
    # shellcheck disable=SC2064 # as they are now
    trap "kill -- -$behind 2>/dev/null || true; say 'what ran beside, until then:'; cat '$log'; rm -f '$log'" EXIT
    for name in $1; do timed "$name"; done
    wait "$behind" || status=$?
    trap - EXIT
    say "what ran beside: $2"
    cat "$log"
    rm -f "$log"
    (( status == 0 )) || fail "the checks beside ended with exit code $status"
}

timed() { # NAME
    local began=$SECONDS me=$BASHPID before
    before=$(processor_seconds "$me")
    say "--- $1"
    "cmd_$1"
    say "$1 took $((SECONDS - began)) s, $(($(processor_seconds "$me") - before)) s of processor time"
}

# Of what a shell has started and waited for; 0 where the system does not say.
processor_seconds() { # PID
    [[ -r /proc/$1/stat ]] || { echo 0; return; }
    awk -v ticks="$(getconf CLK_TCK)" '{ sub(/.*\) /, ""); printf "%d", ($14 + $15) / ticks }' "/proc/$1/stat"
}

cmd_shards() { #: a sweep in eight shards on HyperQueue and on Slurm, each where it is installed, against the same in one process
    cargo build --release --locked --quiet --package sim-host
    tests/shards/run.sh target/release/sim-host
}

cmd_extended() { #: what takes too long for `test`: every f32 through every gain, the same bits in debug and release, memory of a long run, sweeps as Parquet, random networks, outages of edges against the law before, ten million fuzzed inputs per target, power cuts at every flash operation of the boards, updates of emulated Picos, shards on HyperQueue and Slurm; an hour
    cmd_sweep
    cmd_shards
    cmd_same-bits
    cargo test --locked -p sim-host --test memory -- --ignored --nocapture
    cargo test --locked -p sim-host --features parquet --lib --test sweep parquet
    cargo test --release --locked -p system-tests --test properties --test outages --test editions -- --ignored --nocapture
    FUNNEL_EXTENDED=1 cmd_boards-run
    cmd_update
    fuzz/run.sh --runs 10000000 can can_fd link node serial service session store
    fuzz/run.sh --runs 1000000 scenario
}

cmd_help() { #: list the sub-commands
    echo "usage: ./ci.sh SUB-COMMAND..."
    sed -nE 's/^cmd_([a-z_-]+)\(\) [{(] *#: (.*)/  \1\t\2/p' ci.sh | expand -t 18
}

# Without Python, `setup` reads them once there is one.
! have python3 || ! have cargo || read_boards

(( $# > 0 )) || { cmd_help >&2; exit 2; }
# What follows `uf2` are names of images.
if [[ $1 == uf2 ]]; then
    UF2_IMAGES=("${@:2}")
    set -- uf2
fi
for name in "$@"; do
    [[ $(type -t "cmd_$name") == function ]] || { cmd_help >&2; fail "no sub-command is called '$name'"; }
done
for name in "$@"; do
    "cmd_$name"
done
