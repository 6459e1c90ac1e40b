"""What the tests have in common: the command, whose results the package has to give."""

import json
import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCENARIOS = ROOT / "scenarios"


class Command:
    """`sim-host`, as `FUNNELNET_COMMAND` names it."""

    def __init__(self, path):
        self.path = path

    def __call__(self, *arguments, codes=(0, 1)):
        done = subprocess.run([self.path, *map(str, arguments)], cwd=ROOT, capture_output=True, text=True)
        assert done.returncode in codes, done.stderr
        return done.stdout

    def summary(self, scenario, sets=(), *more):
        settings = [word for each in sets for word in ("--set", each)]
        return json.loads(self("run", scenario, *settings, *more, "--json", "-", "-q"))


@pytest.fixture(scope="session")
def command():
    path = os.environ.get("FUNNELNET_COMMAND")
    # A test of equality with nothing would be green for nothing.
    assert path and Path(path).exists(), "FUNNELNET_COMMAND has to be the path of sim-host; ./ci.sh python-package builds it"
    return Command(path)


@pytest.fixture
def five():
    return SCENARIOS / "five-agents.toml"
