#!/bin/sh
# The benches that sim-host/tests/socketcan.rs judges, on vcan0, with its files in the work folder.
# The program is $1; the folder with the scenarios is $2.
program=$1 scenarios=$2

bench() { # OUT OPTIONS...
    out=$1
    shift
    "$program" bench --bench "${benches:-can.toml}" --out "$out" "$@" >"$out.out" 2>"$out.err"
    echo $? >"$out.status"
}

# Process of the host node with this unique number.
process_of() {
    for process in /proc/[0-9]*; do
        tr '\0' ' ' <"$process/cmdline" 2>/dev/null | grep -q -- "node --inherited --uid $1 " && echo "${process#/proc/}" && return
    done
}

# Where a reference is expected, it is computed first, while the nodes wait.
sed '/^reference_error/d' "$scenarios/five-agents.toml" >five.toml

# 2,000 ticks, with somebody listening who knows nothing of them.
candump -L vcan0 >candump.log &
listener=$!
sleep 0.5
bench whole "$scenarios/five-agents.toml" --set time.duration=2s --every 1ms
sleep 0.2
kill $listener

# States of two components in frames of CAN FD, and the same on a bus that cannot.
sed '/^\[expect\]/,/^$/d' "$scenarios/vector-oscillators.toml" >vector.toml
candump -L vcan0 >candump-fd.log &
listener=$!
sleep 0.5
benches=fd.toml bench fd vector.toml --set time.duration=1s --every 1ms
sleep 0.2
kill $listener
benches=fd-mixed.toml bench fd-mixed vector.toml --set time.duration=200ms
benches=no-fd.toml bench no-fd vector.toml --set time.duration=200ms

# Two nodes on lines of their own, three on the bus.
benches=mixed.toml bench mixed five.toml --set time.duration=200ms

# What a real bus does not do is skipped, and said to be.
bench skipped "$scenarios/lossy-ring.toml" --set graph.nodes=5 --set time.duration=100ms

# A node dies.
bench killed five.toml --set time.duration=10min &
sleep 1.5
kill -KILL "$(process_of 3)"
date +%s.%N >killed.at
wait $!
date +%s.%N >killed.end

# Somebody else comes with the ids 1 to 5.
bench first five.toml --set time.duration=3s &
sleep 0.4
bench twins five.toml --set time.duration=100ms
wait
