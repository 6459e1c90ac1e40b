"""What is said to a board and what its answers say: from the project's own host program (sim-host/examples/board_words.rs), so that these
tests know no byte of the wire."""

import json
import os
import pathlib
import subprocess

SCENARIO = "firmware/emulated/pair.toml"
ROOT = pathlib.Path(__file__).resolve().parents[3]
IMAGES = ROOT / "firmware/target/thumbv7em-none-eabihf/release"
HOST = pathlib.Path(os.environ.get("FUNNEL_HOST", ROOT / "target/debug"))
PROGRAM, LOG_READER = HOST / "examples/board_words", HOST / "examples/defmt_log"
# Kinds of replies that tests wait for (protocol/README.md).
IDENTITY, CONFIGURED, REPORT, STORED, STAGED = 0x41, 0x43, 0x46, 0x48, 0x4C
# The kind of a state on a serial line.
STATE = 0x13


def words(scenario, *overrides):
    """All that is said to the nodes of a scenario, and what loopback gives, tick by tick."""
    return json.loads(subprocess.run([PROGRAM, ROOT / scenario, *overrides], check=True, capture_output=True).stdout)


class Words:
    """Those of two nodes, read once."""

    known = {}

    @classmethod
    def of(cls, *overrides):
        if overrides not in cls.known:
            cls.known[overrides] = words(SCENARIO, *overrides)
        return cls.known[overrides]


def read(frames):
    """What frames of a node say."""
    text = "".join(f"{frame.hex()}\n" for frame in frames)
    done = subprocess.run([PROGRAM, "--read"], input=text, check=True, capture_output=True, text=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


def log_of(board):
    """The log that it has written since it was last read: text, with the times of its clock in front."""
    done = subprocess.run([LOG_READER, board.path(None)], input=board.core.log(), check=True, capture_output=True)
    return done.stdout.decode()
