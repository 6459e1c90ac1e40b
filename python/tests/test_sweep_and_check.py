"""`sweep` and `check`: the tables and findings of the command."""

import csv
import json
import os
import signal
import threading
import time

import numpy as np
import pytest
from conftest import SCENARIOS

import funnelnet

SETS = {"time.duration": "100ms"}
GRID = {"bus.loss": [0.0, 0.1], "graph.kind": ["ring", "complete"]}
OPTIONS = ["--set", "time.duration=100ms", "--grid", "bus.loss=0.0,0.1", "--grid", "graph.kind=ring,complete", "--seeds", "2"]


def test_a_sweep_is_that_of_the_command(command, tmp_path):
    scenario = SCENARIOS / "lossy-ring.toml"
    command("sweep", scenario, *OPTIONS, "--out", tmp_path / "there", "-q")
    with (tmp_path / "there" / "runs.csv").open(newline="") as file:
        there = list(csv.DictReader(file))
    here = funnelnet.sweep(scenario, set=SETS, grid=GRID, seeds=2, out=tmp_path / "here")
    with (tmp_path / "here" / "runs.csv").open(newline="") as file:
        written = list(csv.DictReader(file))
    of_the_machine = ("wall_s", "cpu_s")
    strip = lambda rows: [{k: v for k, v in row.items() if k not in of_the_machine} for row in rows]
    assert len(here) == 8 and strip(written) == strip(there)
    assert np.array_equal(here["sync.final_spread"], [float(row["sync.final_spread"]) for row in there])
    assert list(here["graph.kind"][:4]) == ["ring", "ring", "complete", "complete"]
    assert list(here.to_pandas().columns) == here.to_polars().columns == list(there[0])


def test_a_sweep_of_the_command_is_gone_on_with(command, tmp_path):
    scenario = SCENARIOS / "lossy-ring.toml"
    command("sweep", scenario, *OPTIONS, "--out", tmp_path / "whole", "-q")
    lines = (tmp_path / "whole" / "runs.csv").read_text().splitlines(keepends=True)
    (tmp_path / "whole" / "runs.csv").write_text("".join(lines[:4]))
    here = funnelnet.sweep(scenario, set=SETS, grid=GRID, seeds=2, out=tmp_path / "whole", resume=True)
    assert list(here["run"]) == list(range(1, 9))
    assert (tmp_path / "whole" / "runs.csv").read_text().startswith("".join(lines[:4]))


def test_a_sweep_without_a_folder_leaves_none(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    here = funnelnet.sweep(SCENARIOS / "lossy-ring.toml", set=SETS, ranges={"bus.loss": "0.0..0.3"}, lhs=3, seeds=1)
    assert len(here) == 3 and here["bus.loss"].max() < 0.3 and list(tmp_path.iterdir()) == []


def test_resume_goes_on_and_another_sweep_is_refused(tmp_path):
    scenario = SCENARIOS / "lossy-ring.toml"
    first = funnelnet.sweep(scenario, set=SETS, grid={"bus.loss": [0.0, 0.2]}, out=tmp_path)
    with pytest.raises(funnelnet.RunError, match="resume"):
        funnelnet.sweep(scenario, set=SETS, grid={"bus.loss": [0.0, 0.2]}, out=tmp_path)
    again = funnelnet.sweep(scenario, set=SETS, grid={"bus.loss": [0.0, 0.2]}, out=tmp_path, resume=True)
    assert np.array_equal(first["wall_s"], again["wall_s"])
    with pytest.raises(funnelnet.RunError) as caught:
        funnelnet.sweep(scenario, set=SETS, grid={"bus.loss": [0.0, 0.3]}, out=tmp_path, resume=True)
    assert caught.value.exit_code == 2


def test_a_point_that_is_refused():
    scenario, grid = SCENARIOS / "lossy-ring.toml", {"bus.loss": [0.0, 7.0]}
    with pytest.raises(funnelnet.RunError, match="nothing was run"):
        funnelnet.sweep(scenario, set=SETS, grid=grid)
    here = funnelnet.sweep(scenario, set=SETS, grid=grid, allow_refused=True)
    assert here["verdict"][1] == "refused"


def test_the_seed_of_a_sweep():
    here = funnelnet.sweep(SCENARIOS / "lossy-ring.toml", set=SETS, seed=7, seeds=3)
    assert list(here["seed"]) == [7, 8, 9]


def test_options_that_do_nothing_are_refused():
    for options in ({"sobol": 4, "lhs": 4}, {"ranges": {"bus.loss": "0.0..0.3"}}, {"resume": True}):
        with pytest.raises(ValueError):
            funnelnet.sweep(SCENARIOS / "lossy-ring.toml", **options)


@pytest.mark.parametrize("name", ["five-agents.toml", "narrow-ring.toml", "leader-1000.toml"])
def test_a_check_is_that_of_the_command(command, name):
    there = json.loads(command("check", SCENARIOS / name, "--json", codes=(0, 2)))
    here = funnelnet.check(SCENARIOS / name)
    assert here.report == there and here.passed == there["pass"]
    assert str(here) == command("check", SCENARIOS / name, codes=(0, 2)).rstrip("\n")


def test_ctrl_c_ends_a_check_at_once():
    field = {"kind": "affine", "slope": -1.0, "offset": 1.0, "sines": [{"amplitude": 8.0, "frequency": 3.0}]}
    slow = {"graph.nodes": 120, "node": [], "agent.dynamics": field, "agent.random": {"offset": {"uniform": [-3.0, 3.0]}}, "bus.loss": 0.05, "expect": {}}
    began = time.monotonic()
    funnelnet.check(SCENARIOS / "lossy-ring.toml", set=slow)
    whole = time.monotonic() - began
    threading.Timer(0.2 * whole, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        funnelnet.check(SCENARIOS / "lossy-ring.toml", set=slow)
    assert time.monotonic() - began < 0.6 * whole


def test_a_finding_by_name(five):
    here = funnelnet.check(five)
    assert here["narrowest-funnel"]["name"] == "narrowest-funnel" and "Check" in repr(here)
    with pytest.raises(KeyError):
        here["nothing"]
    assert not funnelnet.check(five, set={"coupling.funnel.end": 1e-7}).passed or len(here.findings) > 5
