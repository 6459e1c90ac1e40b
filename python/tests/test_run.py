"""`run`: the bits and the summary of the command, as arrays."""

import csv
import os
import signal
import threading
import time
import tomllib

import numpy as np
import pytest
from conftest import SCENARIOS

import funnelnet

# What depends on the moment and on who asked.
OF_THE_MOMENT = ("command", "wall_s")

SHORT = "1s"
FIVE_SCENARIOS = [
    ("five-agents.toml", {}),
    ("narrow-ring.toml", {}),
    ("lossy-ring.toml", {}),
    ("vector-oscillators.toml", {}),
    ("five-agents.toml", {"bus.model": "can", "bus.loss": 0.2}),
]


@pytest.mark.parametrize(("name", "sets"), FIVE_SCENARIOS)
def test_the_summary_and_the_hash_are_those_of_the_command(command, name, sets):
    sets = {"time.duration": SHORT, **sets}
    there = command.summary(SCENARIOS / name, [f"{key}={value}" for key, value in sets.items()])
    here = funnelnet.run(SCENARIOS / name, set=sets)
    assert here.trace_hash == there["trace_hash"] and len(here.trace_hash) == 16
    assert {k: v for k, v in here.summary.items() if k not in OF_THE_MOMENT} == {k: v for k, v in there.items() if k not in OF_THE_MOMENT}
    assert here.is_firmware and here.own_fields == []


def test_another_seed_gives_another_hash():
    hashes = {funnelnet.run(SCENARIOS / "lossy-ring.toml", set={"time.duration": "200ms"}, seed=seed).trace_hash for seed in (1, 2)}
    assert len(hashes) == 2


@pytest.mark.parametrize("name", ["five-agents.toml", "vector-oscillators.toml"])
def test_the_arrays_are_the_columns_of_the_trajectory(command, tmp_path, name):
    command("run", SCENARIOS / name, "--set", "time.duration=200ms", "--out", tmp_path / "out", "--every", "10ms", "-q")
    r = funnelnet.run(SCENARIOS / name, set={"time.duration": "200ms"}, every="10ms")
    with (tmp_path / "out" / "trajectory.csv").open(newline="") as file:
        names, *rows = list(csv.reader(file))
    here = r.columns()
    assert list(here) == [name for at, name in enumerate(names) if any(row[at] for row in rows)]
    for name, column in here.items():
        there = np.array([float(row[names.index(name)] or "nan") for row in rows])
        # Columns of f32 nodes are written with the digits that give their f32 again.
        assert np.allclose(column, there, rtol=1e-7, atol=0, equal_nan=True), name
        if name.startswith("x_"):
            assert np.array_equal(column.astype(np.float32), there.astype(np.float32)), name


def test_out_holds_the_files_of_the_command(command, tmp_path, five):
    sets = {"time.duration": "100ms"}
    funnelnet.run(five, set=sets, out=tmp_path / "here")
    command("run", five, "--set", "time.duration=100ms", "--out", tmp_path / "there", "-q")
    names = sorted(path.name for path in (tmp_path / "there").iterdir())
    assert sorted(path.name for path in (tmp_path / "here").iterdir()) == names and "trajectory.csv" in names
    for name in set(names) - {"summary.json"}:
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes(), name


def test_arrays_are_not_copied_and_read_only(five):
    r = funnelnet.run(five, set={"time.duration": "100ms"})
    assert r.x is r.x and r.x.shape == (101, 5) and r.t.shape == (101,) and r.xi.shape == (101,)
    # The memory is that of Rust, which NumPy has taken over.
    assert not r.x.flags.owndata and type(r.x.base).__name__ == "PySliceContainer"
    assert np.shares_memory(r.columns()["x_3"], r.x)
    with pytest.raises(ValueError, match="read-only"):
        r.x[0, 0] = 1.0


def test_arrays_outlive_their_run(five):
    x = funnelnet.run(five, set={"time.duration": "100ms"}).x
    again = funnelnet.run(five, set={"time.duration": "100ms"}).x
    assert np.array_equal(x, again)


def test_tables_have_the_columns(five):
    r = funnelnet.run(five, set={"time.duration": "100ms"})
    pandas, polars = r.to_pandas(), r.to_polars()
    assert list(pandas.columns) == polars.columns == list(r.columns())
    assert np.array_equal(pandas["x_2"].to_numpy(), r.x[:, 1]) and np.array_equal(polars["x_2"].to_numpy(), r.x[:, 1])


@pytest.mark.parametrize("name", ["five-agents.toml", "median-5.toml", "vector-oscillators.toml", "partition.toml"])
def test_a_dict_is_the_same_scenario(name):
    with (SCENARIOS / name).open("rb") as file:
        scenario = tomllib.load(file)
    sets = {"time.duration": "100ms", "event": [], "expect": {}}
    assert funnelnet.run(scenario, set=sets).trace_hash == funnelnet.run(SCENARIOS / name, set=sets).trace_hash


def test_a_dict_may_hold_numpy(five):
    with five.open("rb") as file:
        scenario = tomllib.load(file)
    scenario["time"]["duration"] = "100ms"
    expected = funnelnet.run(scenario, set={"agent.state": 0.5}).trace_hash
    assert funnelnet.run(scenario, set={"agent.state": np.float64(0.5)}).trace_hash == expected


def test_the_reference_has_no_hash_and_is_not_the_firmware(command, five):
    sets = {"time.duration": "1s"}
    r = funnelnet.run(five, set=sets, on="reference")
    there = command.summary(five, ["time.duration=1s"], "--on", "reference")
    assert r.trace_hash is None and not r.is_firmware
    assert r.summary["funnel"] == there["funnel"] and r.summary["on"] == "reference"


def test_a_mistake_in_a_file_has_file_line_and_key(tmp_path, five):
    text = five.read_text().replace("[bus]", "[bus]\nlos = 0.1") if "[bus]" in five.read_text() else five.read_text() + "\n[bus]\nlos = 0.1\n"
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(funnelnet.ScenarioError) as caught:
        funnelnet.run(path)
    error = caught.value
    line = text.splitlines().index("los = 0.1") + 1
    assert (error.file, error.line, error.column, error.key) == (str(path), line, 1, "bus.los")
    assert "loss" in error.hint and str(error).startswith(f"{path}:{line}:1: ")
    assert isinstance(error, ValueError) and isinstance(error, funnelnet.FunnelnetError)


def test_all_mistakes_are_there(five):
    with pytest.raises(funnelnet.ScenarioError) as caught:
        funnelnet.load(five, set={"bus.loss": 2, "coupling.funnel.rate": "fast"})
    mistakes = caught.value.mistakes
    assert {mistake["key"] for mistake in mistakes} == {"bus.loss", "coupling.funnel.rate"}
    assert {mistake["file"] for mistake in mistakes} == {"set[\"bus.loss\"]", "set[\"coupling.funnel.rate\"]"}
    assert all(mistake["line"] is None for mistake in mistakes)


def test_a_mistake_in_a_dict_has_its_key(five):
    with five.open("rb") as file:
        scenario = tomllib.load(file)
    scenario["graph"]["nodes"] = -5
    with pytest.raises(funnelnet.ScenarioError) as caught:
        funnelnet.check(scenario)
    error = caught.value
    assert (error.file, error.line, error.key, error.found) == ("<dict>", None, "graph.nodes", "-5")
    assert str(error).startswith("<dict>: graph.nodes")


def test_what_toml_does_not_have_is_named():
    with pytest.raises(TypeError, match=r"time\.tick: .* not NoneType"):
        funnelnet.load({"time": {"tick": None}})


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(funnelnet.ScenarioError) as caught:
        funnelnet.run(tmp_path / "none.toml")
    assert caught.value.line is None and "none.toml" in str(caught.value)


def test_what_cannot_be_run_is_refused(five):
    with pytest.raises(ValueError, match="loopback"):
        funnelnet.run(five, on="emulator")
    with pytest.raises(funnelnet.RunError, match="whole ticks") as caught:
        funnelnet.run(five, every="1500us")
    assert caught.value.exit_code == 2
    with pytest.raises(ValueError, match="bus.model"):
        funnelnet.run(five, nodes=[1])
    large = {"bus.model": "none", "expect": {}}
    with pytest.raises(ValueError, match="reference"):
        funnelnet.run(five, set=large, on="reference")
    with pytest.raises(ValueError, match="fields"):
        funnelnet.run(five, set=large, fields={1: lambda t, x: -x})
    with pytest.raises(funnelnet.RunError, match="nodes 6: ids are 1 to 5"):
        funnelnet.run(five, set=large, nodes=[1, 6])
    with pytest.raises(funnelnet.RunError, match="take run"):
        funnelnet.Simulation(five, set=large)


def test_a_network_without_a_bus_has_quantiles_and_the_nodes_that_are_asked_for(command, tmp_path, five):
    agents = {"agent.dynamics": {"kind": "affine", "slope": -1.0}, "agent.random": {"offset": {"uniform": [-1.0, 1.0]}}, "node": []}
    sets = {"bus.model": "none", "expect": {}, "graph.nodes": 300, "time.duration": "200ms", **agents}
    r = funnelnet.run(five, set=sets, nodes=[7, 2, 7], every="10ms", out=tmp_path / "here")
    assert isinstance(r, funnelnet.LargeRun) and r.nodes == [2, 7] and r.x.shape == (21, 2) and "LargeRun" in repr(r)
    command("run", tmp_path / "here" / "scenario.toml", "--out", tmp_path / "there", "--nodes", "2,7", "--every", "10ms", "-q")
    for name in ("quantiles.csv", "trajectory.csv", "scenario.toml"):
        assert (tmp_path / "here" / name).read_bytes() == (tmp_path / "there" / name).read_bytes(), name
    summary = (tmp_path / "there" / "summary.json").read_text()
    assert f'"{r.trace_hash}"' in summary and r.passed == ('"passed": true' in summary)
    columns = r.columns()
    for name in ("quantiles.csv", "trajectory.csv"):
        with (tmp_path / "there" / name).open(newline="") as file:
            names, *rows = list(csv.reader(file))
        for at, column in enumerate(names):
            there = np.array([float(row[at]) for row in rows])
            assert np.allclose(columns[column], there, rtol=1e-7, atol=0), column
    assert np.all(r.quantiles["x_q00"] <= r.quantiles["x_q50"]) and not r.x.flags.writeable
    # No figure depends on the number of threads.
    assert funnelnet.run(five, set=sets, threads=1).trace_hash == r.trace_hash


def test_progress_comes_in_the_order_of_time(five):
    seen = []
    funnelnet.run(five, set={"time.duration": "200s", "expect": {}}, progress=lambda t, end: seen.append((t, end)))
    times = [t for t, _ in seen]
    assert len(seen) >= 2 and times == sorted(times) and times[-1] > 0 and {end for _, end in seen} == {200.0}


def test_an_exception_of_progress_ends_the_run(five):
    def refuse(_, __):
        raise LookupError("enough")

    began = time.monotonic()
    with pytest.raises(LookupError, match="enough"):
        funnelnet.run(five, set={"time.duration": "40000s", "expect": {}}, progress=refuse)
    assert time.monotonic() - began < 10


def test_ctrl_c_ends_a_run_and_keeps_what_was_recorded(tmp_path, five):
    threading.Timer(0.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        funnelnet.run(five, set={"time.duration": "40000s", "expect": {}}, out=tmp_path / "out")
    assert time.monotonic() - began < 10
    summary = (tmp_path / "out" / "summary.json").read_text()
    assert "interrupted" in summary and '"passed": false' in summary


def test_other_threads_run_meanwhile(five):
    count, stop = [0], threading.Event()

    def counts():
        while not stop.is_set():
            count[0] += 1
            time.sleep(0.001)

    thread = threading.Thread(target=counts)
    thread.start()
    try:
        before = count[0]
        funnelnet.run(five, set={"time.duration": "100s", "expect": {}})
        assert count[0] - before > 10
    finally:
        stop.set()
        thread.join()


def test_two_runs_at_once_are_those_one_after_the_other():
    names = ["lossy-ring.toml", "narrow-ring.toml"]
    run = lambda name: funnelnet.run(SCENARIOS / name, set={"time.duration": "500ms"}).trace_hash
    alone, together = [run(name) for name in names], [None, None]
    threads = [threading.Thread(target=lambda at=at: together.__setitem__(at, run(names[at]))) for at in (0, 1)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert together == alone
