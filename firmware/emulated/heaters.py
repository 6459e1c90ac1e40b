"""Three Picos with the image `heater` on a bench, each with a simulated block at its converter and its PWM: they agree on a temperature within
their funnel, by what the host has heard and by what the blocks are.

The other worlds are part of it: with one converter that is stuck, with one PWM that leads nowhere, and without the law, the same must not pass.

usage: heaters.py SIM-HOST SERVER IMAGE SCENARIO [section.key=value]...      SERVER: pico/serve-heater.mjs
"""

import csv
import json
import pathlib
import subprocess
import sys
import tempfile
import tomllib

from bench import Port, powered

NODES, BROKEN = 3, 1
# Largest difference of two blocks at the end, and of a block from what its node says: the converter counts 0.08 K. K.
SPREAD, OFF = 1.5, 0.2
# Conversions beside one for each of the ticks from 0 on: for the state that is announced before.
ANNOUNCED = 1


def run(host, server, image, scenario, settings, fault=None):
    """Three heaters, one of which may have a fault: what is wrong with the run."""
    tick = tomllib.loads(pathlib.Path(scenario).read_text())["time"]["tick"].removesuffix("ms")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        faults = [[fault] if fault and node == BROKEN else [] for node in range(NODES)]
        # As firmware/src/bin/heater_emulated.rs deals the blocks: by the remainder of the node's id.
        ports = [Port(server, image, str((node + 1) % NODES), str(int(tick) / 1000), str(folder / f"block{node}.json"), *fault)
                 for node, fault in enumerate(faults)]
        with powered(ports) as bench:
            overrides = [argument for setting in settings for argument in ("--set", setting)]
            command = [host, "bench", scenario, "--bench", bench, "--quiet", "--out", folder, *overrides]
            done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            for port in ports:
                port.finish()
        if not (folder / "summary.json").is_file():
            sys.exit(f"heaters.py: no run: {done.stderr}")
        blocks = [json.loads((folder / f"block{node}.json").read_text()) for node in range(NODES)]
        return complaints(json.loads((folder / "summary.json").read_text()), said(folder / "trajectory.csv"), blocks)


def said(trajectory):
    """The temperatures that the nodes have said last."""
    with trajectory.open() as file:
        last = list(csv.DictReader(file))[-1]
    return [float(last[f"x_{node + 1}"]) for node in range(NODES)]


def complaints(summary, states, blocks):
    """What is wrong with a run: by the host's verdict, by what nodes have counted, and by the blocks."""
    celsius = [block["celsius"] for block in blocks]
    spread = max(celsius) - min(celsius)
    counters = {name: summary["counters"][name] for name in ("breaches", "coasted", "overruns", "line_errors")}
    off = [round(abs(is_ - says), 2) for is_, says in zip(celsius, states)]
    print(f"{summary['ticks']} ticks of three heaters: {', '.join(f'{each:.2f}' for each in celsius)} degrees C, |nu|/psi at most "
          f"{summary['funnel']['max_ratio']:.2f}, {summary['wall_s']:.0f} s", flush=True)
    found = [
        (not summary["passed"], "the host's verdict"),
        (not summary["funnel"]["max_ratio"] < 1, f"a funnel was left: {summary['funnel']['max_ratio']}"),
        (any(counters.values()), f"counters {counters}"),
        (summary["stopped"] or summary["ended_early"], f"stopped: {summary['stopped']}, {summary['ended_early']}"),
        ([block["conversions"] for block in blocks] != [summary["ticks"] + 1 + ANNOUNCED] * NODES, "not one conversion for each tick"),
        (not spread < SPREAD, f"the blocks are {spread:.2f} K apart"),
        (not max(off) < OFF, f"a block is not as its node says: {off} K"),
        (any(block["drive"] for block in blocks), "a heater is on after the stop"),
    ]
    return [text for is_so, text in found if is_so]


# What may be wrong, and how it must be seen: the host alone would not see the first one.
WORLDS = (
    ("with a converter that is stuck", "stuck", (), "a block is not as its node says"),
    ("with a PWM that leads nowhere", "unwired", (), "a funnel was left"),
    ("without the law", None, ("coupling.kind=none",), "K apart"),
)


def main(host, server, image, scenario, *settings):
    if wrong := run(host, server, image, scenario, settings):
        sys.exit(f"heaters.py: {'; '.join(wrong)}")
    for world, fault, also, seen in WORLDS:
        wrong = "; ".join(run(host, server, image, scenario, (*settings, *also), fault))
        if seen not in wrong:
            sys.exit(f"heaters.py: {world} it is not seen that {seen}: {wrong}")
        print(f"{world}: {wrong}", flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 5:
        sys.exit(__doc__)
    main(*sys.argv[1:])
