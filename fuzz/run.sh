#!/usr/bin/env bash
# Fuzzes every target, or those that are named: ./fuzz/run.sh [--runs N | --seconds S] [TARGET...]
#
# libFuzzer on the stable toolchain: the coverage passes of the compiler need RUSTC_BOOTSTRAP, and nothing else that is not stable.
# The corpus is fuzz/corpus/TARGET; what made a target fail is left in fuzz/artifacts/TARGET.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

limit=-max_total_time=30
targets=()
while (( $# > 0 )); do
    case $1 in
        --runs) limit=-runs=$2; shift 2 ;;
        --seconds) limit=-max_total_time=$2; shift 2 ;;
        *) targets+=("$1"); shift ;;
    esac
done
(( ${#targets[@]} > 0 )) || mapfile -t targets < <(cd targets && ls | sed 's/\.rs$//')

# The simulator is compiled for the one target that reads scenarios.
builds=()
for target in "${targets[@]}"; do
    builds+=(--bin "$target")
    [[ $target != scenario ]] || builds+=(--features scenario)
done

host=$(rustc -vV | sed -n 's/^host: //p')
coverage="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4"
coverage+=" -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table"
coverage+=" -Cllvm-args=-sanitizer-coverage-trace-compares --cfg fuzzing"
# With a target named, build scripts are compiled without coverage.
RUSTC_BOOTSTRAP=1 RUSTFLAGS=$coverage CARGO_TARGET_DIR=../target/fuzz cargo build --quiet --locked --release --target "$host" "${builds[@]}"

# One target; says how it went.
fuzz() {
    local target=$1 log=../target/fuzz/$1.log seeds=("corpus/$1") runs cover
    [[ $target != scenario ]] || seeds+=(../scenarios)
    mkdir -p "corpus/$target" "artifacts/$target" "../target/fuzz/corpus/$target"
    # New inputs go to the first folder, which is not the repository's.
    if "../target/fuzz/$host/release/$target" "../target/fuzz/corpus/$target" "${seeds[@]}" "$limit" -seed=1 -print_final_stats=1 \
        -artifact_prefix="artifacts/$target/" -rss_limit_mb=2048 >"$log" 2>&1; then
        runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
        cover=$(grep -o 'cov: [0-9]*' "$log" | tail -1)
        # A target that runs nothing has checked nothing.
        (( ${runs:-0} > 0 )) || { echo "fuzz: $target has run nothing" >&2; return 1; }
        echo "fuzz: $target: $runs runs, ${cover:-cov: 0}, no failure"
    else
        tail -30 "$log" >&2
        echo "fuzz: $target FAILED; the input is in fuzz/artifacts/$target" >&2
        return 1
    fi
}

# As many at a time as there are cores.
failed=0
running=0
for target in "${targets[@]}"; do
    if (( running >= $(nproc) )); then
        wait -n || failed=1
        running=$((running - 1))
    fi
    fuzz "$target" &
    running=$((running + 1))
done
while (( running > 0 )); do
    wait -n || failed=1
    running=$((running - 1))
done
exit "$failed"
