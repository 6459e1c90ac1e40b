#!/bin/sh
# The benches that sim-host/tests/socketcan judges, on vcan0 and vcan1, with its files in the work folder.
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

# Waits for so many frames on vcan0: a guest on a slow computer takes seconds until nodes have begun, or hardly any time.
under_way() { candump -n "$1" vcan0 >/dev/null; }

# The scenario $1, expecting nothing.
unjudged() { sed '/^\[expect\]/,/^$/d' "$scenarios/$1"; }

# Where a reference is expected, it is computed first, while the nodes wait.
sed '/^reference_error/d' "$scenarios/five-agents.toml" >five.toml

# 2,000 ticks, with somebody listening who knows nothing of them.
candump -L vcan0 >candump.log &
listener=$!
sleep 0.5
bench whole "$scenarios/five-agents.toml" --set time.duration=2s --every 1ms
sleep 0.2
kill $listener

# The same with the scenario's bus, beside that bus in loopback.
bench bus five.toml --set bus.model=can --set time.duration=1s

# Frames that are none of the nodes.
candump -L vcan0 >candump-foreign.log &
listener=$!
sleep 0.5
bench foreign five.toml --set time.duration=1s &
run=$!
while [ ! -s candump-foreign.log ]; do sleep 0.1; done
cansend vcan0 12345678#DEADBEEF
cansend vcan0 123#R4
cansend vcan0 00000123#R
wait $run
sleep 0.2
kill $listener

# States of two components in frames of CAN FD, and the same on a bus that cannot.
unjudged vector-oscillators.toml >vector.toml
candump -L vcan0 >candump-fd.log &
listener=$!
sleep 0.5
benches=fd.toml bench fd vector.toml --set time.duration=1s --every 1ms
sleep 0.2
kill $listener
benches=fd-mixed.toml bench fd-mixed vector.toml --set time.duration=200ms
benches=no-fd.toml bench no-fd vector.toml --set time.duration=200ms

# Two nodes on lines of their own, three on the bus; for more ticks than the eight bits of a classic frame tell apart.
benches=mixed.toml bench mixed five.toml --set time.duration=600ms

# Two nodes on each of two buses, and one on a line.
candump -L vcan0 >candump-two-0.log &
listeners=$!
candump -L vcan1 >candump-two-1.log &
listeners="$listeners $!"
sleep 0.5
benches=two.toml bench two five.toml --set time.duration=600ms
sleep 0.2
kill $listeners

# Nodes that tick by their own clock: all on one bus, with somebody listening; no two neighbours on the same bus; two on lines in CAN FD.
# Ticks are long, since a guest kernel on a busy computer keeps a process waiting for a tenth of a second; nothing is expected of a node that
# then is late, but that it is counted: not even that it stops, as it does when it has heard nobody for some ticks.
patient="--set safety.lost_neighbours=126"
unjudged five-agents.toml >unjudged.toml
unjudged five-agents-path.toml >path.toml
candump -L vcan0 >candump-own.log &
listener=$!
sleep 0.5
benches=own.toml bench own unjudged.toml $patient --set time.tick=50ms --set time.duration=13500ms --every 50ms
sleep 0.2
kill $listener
benches=own-apart.toml bench own-apart path.toml $patient --set time.tick=200ms --set time.duration=12s --set bus.latency=100ms
benches=own-fd-mixed.toml bench own-fd-mixed vector.toml $patient --set time.tick=50ms --set time.duration=13500ms

# Whoever is on the bus can stop it, without the program.
benches=own.toml bench halted five.toml --set time.tick=50ms --set time.duration=10min &
under_way 100
cansend vcan0 000#02000000
wait $!

# What a real bus does not do is skipped, and said to be.
bench skipped "$scenarios/lossy-ring.toml" --set graph.nodes=5 --set time.duration=100ms

# A node dies.
bench killed five.toml --set time.duration=10min &
under_way 100
kill -KILL "$(process_of 3)"
date +%s.%N >killed.at
wait $!
date +%s.%N >killed.end

# Another one takes its place while the others go on, two of them on lines, for more ticks than a classic frame tells apart.
sed '1a on_loss = "go-on"' mixed.toml >go-on.toml
benches=go-on.toml bench go-on unjudged.toml --set time.duration=3s &
under_way 100
kill -KILL "$(process_of 3)"
wait $!

# Somebody else comes with the ids 1 to 5.
bench first five.toml --set time.duration=3s &
sleep 0.4
bench twins five.toml --set time.duration=100ms
wait
