"""Fields in Python: they do what the scenario's do, and say that they are not the firmware's."""

import math

import numpy as np
import pytest
from conftest import SCENARIOS

import funnelnet

SETS = {"time.duration": "500ms", "expect": {}}


def fields_of(path):
    """The fields of a scenario whose nodes are affine with sines, as callables by id."""
    import tomllib

    with path.open("rb") as file:
        scenario = tomllib.load(file)

    def field(dynamics):
        slope, offset, sines = dynamics.get("slope", 0.0), dynamics.get("offset", 0.0), dynamics.get("sines", [])
        return lambda t, x: slope * x + offset + sum(s["amplitude"] * math.sin(s.get("frequency", 0) * t + s.get("phase", 0)) for s in sines)

    default = scenario.get("agent", {}).get("dynamics", {})
    own = {node["id"]: node.get("dynamics", default) for node in scenario.get("node", [])}
    return {id: field(own.get(id, default)) for id in range(1, scenario["graph"]["nodes"] + 1)}


@pytest.mark.parametrize("on", ["loopback", "reference"])
def test_the_fields_of_the_scenario_in_python_give_its_motion(five, on):
    expected = funnelnet.run(five, set=SETS, on=on)
    r = funnelnet.run(five, set=SETS, on=on, fields=fields_of(five))
    assert np.abs(r.x - expected.x).max() < (1e-4 if on == "loopback" else 1e-6)
    # A field that is another one moves them elsewhere.
    other = funnelnet.run(five, set=SETS, on=on, fields={**fields_of(five), 3: lambda t, x: -5.0})
    assert np.abs(other.x - expected.x).max() > 1e-2


@pytest.mark.parametrize("on", ["loopback", "reference"])
def test_such_a_result_says_that_it_is_not_the_firmwares(five, on):
    r = funnelnet.run(five, set=SETS, on=on, fields={2: lambda t, x: -x, 4: lambda t, x: -x})
    assert r.summary["own_fields"] == [2, 4] == r.own_fields and not r.is_firmware
    assert "not the firmware's" in repr(r)
    assert "own_fields" not in funnelnet.run(five, set=SETS, on=on).summary


@pytest.mark.parametrize("bus", ["ideal", "can"])
def test_vectorised_gives_the_bits_of_scalar(five, bus):
    sets = {**SETS, "bus.model": bus}
    scalar = funnelnet.run(five, set=sets, fields=lambda t, x: -2.0 * x + 3.0 * t)
    vectorised = funnelnet.run(five, set=sets, fields=funnelnet.Vectorised(lambda t, x: -2.0 * x + 3.0 * t))
    assert scalar.trace_hash == vectorised.trace_hash
    assert scalar.trace_hash != funnelnet.run(five, set=sets, fields=lambda t, x: -2.0 * x + 3.1 * t).trace_hash


def test_vectorised_is_called_for_all_nodes_at_once(five):
    sets = {**SETS, "time.duration": "100ms"}
    calls = {True: 0, False: 0}

    def field(t, x):
        calls[x.shape == (5,)] += 1
        return -x

    funnelnet.run(five, set=sets, on="reference", fields=funnelnet.Vectorised(field))
    together = calls[True]
    scalar = [0]

    def one(t, x):
        scalar[0] += 1
        return -x

    funnelnet.run(five, set=sets, on="reference", fields=one)
    assert calls[False] == 0 and together < scalar[0] / 1.5


def test_groups_of_nodes(five):
    groups = [funnelnet.Vectorised(lambda t, x: -x, nodes=[1, 3]), funnelnet.Vectorised(lambda t, x: -x, nodes=[5])]
    r = funnelnet.run(five, set=SETS, fields=groups)
    assert r.own_fields == [1, 3, 5]
    assert r.trace_hash == funnelnet.run(five, set=SETS, fields={1: lambda t, x: -x, 3: lambda t, x: -x, 5: lambda t, x: -x}).trace_hash


def test_vector_states():
    path = SCENARIOS / "vector-oscillators.toml"
    nodes = funnelnet.load(path).nodes
    sets = {"time.duration": "100ms", "expect": {}}
    field = lambda t, x: np.array([x[1], -x[0]])
    scalar = funnelnet.run(path, set=sets, fields={1: field, 2: field})
    assert scalar.x.shape[1:] == (nodes, 2)
    group = funnelnet.Vectorised(lambda t, x: np.stack([x[:, 1], -x[:, 0]], axis=1), nodes=[1, 2])
    assert funnelnet.run(path, set=sets, fields=group).trace_hash == scalar.trace_hash


@pytest.mark.parametrize("on", ["loopback", "reference"])
def test_an_exception_of_a_field_is_raised(five, on):
    def breaks(t, x):
        if t > 0.2:
            raise ZeroDivisionError("at a fifth")
        return 0.0

    with pytest.raises(ZeroDivisionError, match="at a fifth"):
        funnelnet.run(five, set=SETS, on=on, fields={1: breaks})


def test_a_field_that_is_not_defined_everywhere(five):
    # math.sqrt refuses what the look for the steepest slope tries, and no node comes there.
    r = funnelnet.run(five, set={**SETS, "agent.state": 2.0, "agent.dynamics": {"kind": "affine"}, "node": []}, fields=lambda t, x: 1.0 - math.sqrt(x))
    assert r.passed


def test_what_is_no_field_is_refused(five):
    with pytest.raises(ValueError, match=r"shape \[2\], and its x has shape \[5\]"):
        funnelnet.run(five, set=SETS, fields=funnelnet.Vectorised(lambda t, x: x[:2]))
    with pytest.raises(ValueError, match="node 6: ids are 1 to 5 here"):
        funnelnet.run(five, set=SETS, fields={6: lambda t, x: 0.0})
    with pytest.raises(ValueError, match="node 2 has two"):
        funnelnet.run(five, set=SETS, fields=[funnelnet.Vectorised(lambda t, x: x), funnelnet.Vectorised(lambda t, x: x, nodes=[2])])
    with pytest.raises(TypeError):
        funnelnet.run(five, set=SETS, fields={1: lambda t, x: "fast"})
    with pytest.raises(TypeError):
        funnelnet.run(five, set=SETS, fields=[1.0])


@pytest.mark.parametrize("id", [1, 2])
def test_a_sensor_fails_beside_fields_in_a_run_and_in_a_simulation(five, id):
    event = [{"at": "100ms", "kind": "sensor", "node": 2, "offset": 0.5, "for": "200ms"}]
    arguments = {"set": {**SETS, "event": event}, "fields": {id: lambda t, x: -x}}
    r = funnelnet.run(five, **arguments, every="1ms")
    ticks = funnelnet.Simulation(five, **arguments).step(until=0.5)
    assert np.array_equal(r.x, ticks.x) and np.ptp(r.x[:, 1]) > 0.1
    calm = funnelnet.run(five, **{**arguments, "set": SETS}, every="1ms")
    assert np.abs(r.x - calm.x)[110:290].max() > 5e-3
