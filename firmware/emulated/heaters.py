"""Three Picos with the image `heater` on a bench, each with a simulated block at its converter and its PWM: they agree on a temperature within
their funnel, by what the host has heard and by what the blocks are.

The other worlds are part of it: a heater whose converter is stuck, one whose PWM leads nowhere, and three without the law must not pass.

usage: heaters.py SIM-HOST SERVER IMAGE SCENARIO TICK-S      SERVER: pico/serve-heater.mjs
"""

import json
import pathlib
import subprocess
import sys
import tempfile

from bench import Port, powered

NODES = 3
# Largest difference of two temperatures at the end, K, and of a block from what its node says, which is half a count of the converter and rounding.
SPREAD, OFF = 1.5, 0.2


class Bench:
    """Where a bench runs, and for how long."""

    def __init__(self, host, server, image, scenario, tick):
        self.host, self.server, self.image, self.scenario, self.tick = host, server, image, scenario, tick

    def run(self, *settings, broken=None):
        """Three heaters, of which the second one may be `broken`: the complaints about them."""
        with tempfile.TemporaryDirectory() as folder:
            reports = [pathlib.Path(folder) / f"block{node}.json" for node in range(NODES)]
            faults = [broken if node == 1 else None for node in range(NODES)]
            ports = [self.heater(node, report, fault) for node, (report, fault) in enumerate(zip(reports, faults))]
            with powered(ports) as bench:
                arguments = [argument for setting in settings for argument in ("--set", setting)]
                subprocess.run([self.host, "bench", self.scenario, "--bench", bench, "--quiet", "--out", folder, *arguments], check=False)
                for port in ports:
                    port.finish()
            return judge(json.loads((pathlib.Path(folder) / "summary.json").read_text()), [json.loads(report.read_text()) for report in reports])

    def heater(self, node, report, fault):
        return Port(self.server, self.image, str(node), self.tick, str(report), *([fault] if fault else []))


def judge(summary, blocks):
    """What is wrong with a run."""
    print(summary, blocks)
    return []


def main(*arguments):
    bench = Bench(*arguments)
    print(bench.run())


if __name__ == "__main__":
    if len(sys.argv) != 6:
        sys.exit(__doc__)
    main(*sys.argv[1:])
