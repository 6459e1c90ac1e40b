"""Boards that others' emulators run behind pseudo-terminals, and `sim-host bench` on them as on real ones.

usage: bench.py SIM-HOST SERVER IMAGE NODES SCENARIO [argument of sim-host bench]...      SERVER: pico/serve.mjs
"""

import contextlib
import os
import pathlib
import pty
import subprocess
import sys
import tempfile
import threading
import tty

UID = 0xE6605838832B1000


class Port:
    """A pseudo-terminal with an emulated board at its other end, which `node SERVER ARGUMENT...` runs."""

    def __init__(self, server, *arguments, uid=None):
        self.uid = uid
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        self.path = os.ttyname(slave)
        # Kept open: the terminal would hang up between the programs that open it.
        self.slave = slave
        self.board = subprocess.Popen(["node", server, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        for source, sink in ((self.master, self.board.stdin.fileno()), (self.board.stdout.fileno(), self.master)):
            threading.Thread(target=pump, args=(source, sink), daemon=True).start()

    def end(self):
        """As if its power went."""
        self.board.kill()
        self.board.wait()

    def finish(self):
        """The same, once its emulator has said what it has seen."""
        self.board.terminate()
        self.board.wait()


def pump(source, sink):
    try:
        while data := os.read(source, 4096):
            os.write(sink, data)
    except OSError:
        pass  # one of the two has ended


def bench_file(ports):
    lines = ["version = 1", "baud = 1000000", 'answer_within = "60s"']
    for node, port in enumerate(ports, 1):
        lines += ["[[node]]", f"id = {node}", f'serial = "{port.path}"']
        lines += [f'uid = "{port.uid}"'] if port.uid else []
    return "\n".join(lines)


def board(server, image, node, storage=None):
    """A board with a number of its own; `storage` is a file for what its flash keeps, or None."""
    uid = f"{UID + node:016x}"
    return Port(server, image, uid, *([] if storage is None else [storage]), uid=uid)


def boards(server, image, nodes, storage=lambda node: None):
    """Boards with power, and a bench file that names them."""
    return powered([board(server, image, node, storage(node)) for node in range(1, int(nodes) + 1)])


@contextlib.contextmanager
def powered(ports):
    """These boards with power, and a bench file that names them."""
    try:
        with tempfile.TemporaryDirectory() as folder:
            bench = pathlib.Path(folder) / "bench.toml"
            bench.write_text(bench_file(ports))
            yield bench
    finally:
        for port in ports:
            port.end()


def run(host, scenario, bench, *arguments):
    """An ordinary bench, of which every bit is to be loopback's."""
    done = subprocess.run([host, "bench", scenario, "--bench", bench, *arguments], stdout=subprocess.PIPE, text=True)
    print(done.stdout, end="", flush=True)
    if done.returncode:
        sys.exit(done.returncode)
    # A scenario may be content with less; these boards are to have every bit.
    if "bit for bit as loopback" not in done.stdout:
        sys.exit("bench.py: not bit for bit as loopback")


def main(host, server, image, nodes, scenario, *arguments):
    with boards(server, image, nodes) as bench:
        run(host, scenario, bench, *arguments)


if __name__ == "__main__":
    if len(sys.argv) < 6:
        sys.exit(__doc__)
    main(*sys.argv[1:])
