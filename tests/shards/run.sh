#!/usr/bin/env bash
# A sweep in eight shards on HyperQueue and on Slurm, each where it is installed, against the same sweep in one process.
#
# Usage: tests/shards/run.sh PATH/TO/sim-host
#
# HyperQueue: the Python package `hyperqueue`, of the interpreter in PYTHON (default: python3). Slurm: Debian's slurmctld, slurmd, slurm-client and munge, as
# root; a controller and a node are started on this machine with files, keys and ports of their own, and ended.
set -euo pipefail
HERE=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
PROGRAM=$(realpath "$1")
PYTHON=${PYTHON:-python3}
readonly HERE PROGRAM PYTHON
PLACE=$(mktemp -d)
trap 'rm -rf "$PLACE"' EXIT
cd "$PLACE"
cp "$HERE/../../scenarios/five-agents.toml" five.toml
# Of two seconds, without a solver: a shard is what is tried here. Two runs of three fail.
SWEEP=("$PROGRAM" sweep five.toml --set time.duration=2s --set "expect={ final_spread = 5.0 }" --grid bus.loss=0.0,0.1,0.2 --grid graph.kind=ring,star --seeds 40 --resume)

say() { printf 'shards: %s\n' "$*"; }
# The columns that do not depend on the machine.
figures() { "$PYTHON" "$HERE/figures.py" "$1"; }
same() { # NAME
    cmp <(figures one/runs.csv) <(figures "$1/runs.csv") || { say "$1: another table"; exit 1; }
    say "$1: the $(($(wc -l < "$1/runs.csv") - 1)) rows of one process"
}

code=0
"${SWEEP[@]}" --out one 2>/dev/null || code=$?
((code <= 1)) || { say "the sweep in one process ended with $code"; exit 1; }

if "$PYTHON" -c 'import hyperqueue' 2>/dev/null; then
    "$PYTHON" "$HERE/on_hyperqueue.py" 8 "${SWEEP[@]}" --out hyperqueue
    same hyperqueue
else
    say "SKIPPED HyperQueue: $PYTHON has no module hyperqueue; pip install hyperqueue, and PYTHON=..."
fi

if command -v slurmctld >/dev/null && command -v slurmd >/dev/null && command -v munged >/dev/null && [[ $(id -u) == 0 ]]; then
    "$HERE/on-slurm.sh" 8 "${SWEEP[@]}" --out slurm
    same slurm
else
    say "SKIPPED Slurm: needs root, and slurmctld, slurmd, slurm-client and munge of Debian"
fi
