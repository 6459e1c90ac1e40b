"""`sim-host bench --update` on Picos that an emulator runs, with the boot loader and the program that are flashed: all have the new program
after it, for good, and with one on which that does not come up none has it.

Judged by the command's words and exit code, by what `--update` finds afterwards, and by what the flash of each board holds at the end.

usage: update.py SIM-HOST SERVER BOOT PROGRAM NODES SCENARIO [argument of sim-host bench]...      SERVER: pico/serve-update.mjs
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time
import zlib

import bench


def flat(elf, out):
    """The bytes of a program, as they are in flash."""
    subprocess.run(["arm-none-eabi-objcopy", "-O", "binary", "--gap-fill", "0xff", elf, out], check=True)
    return out.read_bytes()


def update(host, image, file, scenario, *arguments):
    """What the command says, its exit code, and how long it takes."""
    begin = time.monotonic()
    done = subprocess.run([host, "bench", scenario, "--bench", file, "--update", image, *arguments], capture_output=True, text=True)
    print(done.stdout + done.stderr, end="", flush=True)
    print(f"exit code {done.returncode}, {time.monotonic() - begin:.0f} s", flush=True)
    return done


class World:
    """Boards with the old program, some of which have a flaw."""

    def __init__(self, server, boot, program, folder, flaws):
        self.reports = [folder / f"board{node}.json" for node in range(1, len(flaws) + 1)]
        uids = [f"{bench.UID + node:016x}" for node in range(1, len(flaws) + 1)]
        self.ports = [bench.Port(server, boot, program, uid, str(report), *flaw, uid=uid) for uid, report, flaw in zip(uids, self.reports, flaws)]

    def end(self):
        """What each board's flash holds."""
        for port in self.ports:
            port.finish()
        return [json.loads(report.read_text()) for report in self.reports]


def expect(is_so, what, *more):
    if not is_so:
        sys.exit(f"update.py: not so: {what} {more or ''}")


def main(host, server, boot, program, nodes, scenario, *arguments):
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        old = flat(program, folder / "old.bin")
        # The same with a word more: another program, to the bit.
        new = old + b"new!"
        os.environ.update(OLD_LENGTH=str(len(old)), NEW_LENGTH=str(len(new)))

        def is_new(found):
            return found["new"] == zlib.crc32(new)

        def is_old(found):
            return found["old"] == zlib.crc32(old) and not is_new(found)

        image = folder / "new.bin"
        image.write_bytes(new)
        print(f"{nodes} Picos are updated", flush=True)
        world = World(server, boot, program, folder, [()] * int(nodes))
        with bench.powered(world.ports) as file:
            # The ELF file of what runs is a program, too, and nothing is to be done.
            same = update(host, program, file, scenario, *arguments)
            expect(same.returncode == 0 and "already; nothing was sent" in same.stdout, "all run the program that they came with")
            done = update(host, image, file, scenario, *arguments)
            expect(done.returncode == 0 and done.stdout.count("has the new program") == int(nodes), "all have the new program")
            again = update(host, image, file, scenario, *arguments)
            expect(again.returncode == 0 and "already; nothing was sent" in again.stdout, "all run it already")
            found = world.end()
        expect(all(is_new(each) and not each["on_trial"] for each in found), "each flash holds the new program for good", found)
        # Into the swap, and at the end.
        expect(all(each["resets"] == 2 for each in found), "each was restarted twice", found)
        print(f"{nodes} Picos, of which the last does not come up with it", flush=True)
        world = World(server, boot, program, folder, [()] * (int(nodes) - 1) + [("hangs",)])
        with bench.powered(world.ports) as file:
            done = update(host, image, file, scenario, *arguments)
            expect(done.returncode == 1, "the exit code is 1")
            expect(f"node {nodes} came back with the program that it had" in done.stderr, "it is named")
            expect("no node has changed: each has the program that it had" in done.stderr, "the others went back")
            found = world.end()
        expect(all(is_old(each) and not each["on_trial"] for each in found), "each flash holds the old program", found)
        # Into the swap and back, by the command or by the watchdog.
        expect(all(each["resets"] == 2 for each in found), "each was restarted twice", found)
    print(f"{nodes} Picos have the new program, and with one on which it does not come up all have the old one", flush=True)


if __name__ == "__main__":
    if len(sys.argv) < 7:
        sys.exit(__doc__)
    main(*sys.argv[1:])
