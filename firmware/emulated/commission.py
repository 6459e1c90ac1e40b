"""`sim-host bench --commission` on boards that others' emulators run, over a power cycle: what each says after it is what it was given.

The proof is what `bench --list` hears of boards that have had no power: the run after it configures its nodes itself. The other world is
part of it: the same boards with flash that forgets are blank, and the comparison says so.

usage: commission.py SIM-HOST SERVER IMAGE NODES SCENARIO [argument of sim-host bench]...      SERVER: pico/serve.mjs
"""

import pathlib
import re
import subprocess
import sys
import tempfile
import time

from bench import boards, run

BOOT_S = 60
GIVEN = re.compile(r'uid = "([0-9a-f]{16})": was blank, is (id \d+ with configuration [0-9a-f]{8})$', re.MULTILINE)
LISTED = re.compile(r'uid = "([0-9a-f]{16})" .*?, (blank|id \d+ with configuration [0-9a-f]{8}), last reset: ([a-z -]+), starts: (\d+)$', re.MULTILINE)


def said(*command):
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    print(done.stdout, end="", flush=True)
    if done.returncode:
        sys.exit(done.returncode)
    return done.stdout


def listing(host, bench, uids):
    """What `--list` hears of these: uid, id with checksum, reset and starts of each. It waits for two seconds, in which emulated boards may
    not start; and it asks the ports of the machine, too."""
    end = time.monotonic() + BOOT_S
    while True:
        found = [each for each in LISTED.findall(said(host, "bench", "--bench", bench, "--list")) if each[0] in uids]
        if len(found) == len(uids) or time.monotonic() > end:
            return found


def commission(host, server, image, nodes, scenario, arguments, storage):
    """What blank boards are given, then said by them when they have power again: uid to id with checksum, of each."""
    with boards(server, image, nodes, storage) as bench:
        given = dict(GIVEN.findall(said(host, "bench", scenario, "--bench", bench, "--commission", *arguments)))
    if len(given) != int(nodes) or len(set(given.values())) != int(nodes):
        sys.exit(f"commission.py: {len(given)} of {nodes} boards were blank and have a configuration of their own")
    with boards(server, image, nodes, storage) as bench:
        found = listing(host, bench, given)
        if any((reset, starts) != ("power-on", "1") for *_, reset, starts in found):
            sys.exit("commission.py: not every board has just been given power")
        listed = {uid: has for uid, has, *_ in found}
        if listed == given:
            run(host, scenario, bench, *arguments)
    return given, listed


def main(host, server, image, nodes, scenario, *arguments):
    with tempfile.TemporaryDirectory() as folder:
        given, listed = commission(host, server, image, nodes, scenario, arguments, lambda node: str(pathlib.Path(folder) / f"flash{node}"))
    if listed != given:
        sys.exit(f"commission.py: given {given}, after a power cycle {listed}")
    given, listed = commission(host, server, image, nodes, scenario, arguments, lambda node: None)
    if listed != dict.fromkeys(given, "blank"):
        sys.exit(f"commission.py: flash that forgets, and yet after a power cycle {listed}")
    print(f"{nodes} boards have what they were given after a power cycle; with flash that forgets all of them are blank")


if __name__ == "__main__":
    if len(sys.argv) < 6:
        sys.exit(__doc__)
    main(*sys.argv[1:])
