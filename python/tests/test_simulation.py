"""`Simulation`: the bits of a run, tick by tick."""

import os
import signal
import threading
import time

import numpy as np
import pytest
from conftest import SCENARIOS

import funnelnet


@pytest.mark.parametrize(
    ("name", "sets"),
    [("five-agents.toml", {}), ("lossy-ring.toml", {}), ("vector-oscillators.toml", {}), ("five-agents.toml", {"bus.model": "can"})],
)
def test_its_ticks_are_those_of_a_run(name, sets):
    sets = {"time.duration": "200ms", **sets}
    tick = funnelnet.load(SCENARIOS / name, sets).tick
    r = funnelnet.run(SCENARIOS / name, set=sets, every=f"{round(tick * 1e6)}us")
    network = funnelnet.Simulation(SCENARIOS / name, set=sets)
    parts = [network.step(), network.step(until=50 * tick), network.step(until=1.0)]
    assert [len(part.t) for part in parts] == [1, 50, len(r.t) - 51]
    for column in ("t", "x", "nu", "psi", "u"):
        assert np.array_equal(np.concatenate([getattr(part, column) for part in parts]), getattr(r, column)), column
    assert network.is_done and network.is_firmware
    verdict = network.verdict()
    assert verdict.max_ratio == r.summary["funnel"]["max_ratio"] and verdict.breaches == r.summary["funnel"]["breaches"]


def test_time_goes_forward_alone(five):
    network = funnelnet.Simulation(five, set={"time.duration": "100ms"})
    assert network.step(until=0.01).t[-1] == 0.01
    assert len(network.step(until=0.005).t) == 0 and network.step().t[0] == 0.011
    for wrong in (-1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="until"):
            network.step(until=wrong)
    network.step(until=1.0)
    with pytest.raises(StopIteration):
        network.step()


def test_a_simulation_that_is_not_complete_does_not_hold(five):
    network = funnelnet.Simulation(five, set={"time.duration": "1s"})
    network.step(until=0.1)
    verdict = network.verdict()
    assert not verdict.holds and "the run ended after 101 of 1001 ticks" in verdict.reasons[0]
    with pytest.raises(RuntimeError, match="has ended"):
        network.step()


def test_a_complete_one_holds_unless_nobody_is_heard(five):
    for loss, holds in ((0.0, True), (1.0, False)):
        network = funnelnet.Simulation(five, set={"time.duration": "300ms", "bus.loss": loss})
        network.step(until=1.0)
        assert network.verdict().holds == holds


def test_fields_in_python(five):
    sets = {"time.duration": "100ms", "expect": {}}
    network = funnelnet.Simulation(five, set=sets, fields={2: lambda t, x: -x})
    assert network.own_fields == [2] and not network.is_firmware
    x = network.step(until=1.0).x
    assert np.array_equal(x, funnelnet.run(five, set=sets, fields={2: lambda t, x: -x}).x)
    vectorised = funnelnet.Simulation(five, set=sets, fields=funnelnet.Vectorised(lambda t, x: -x, nodes=[2]))
    assert np.array_equal(vectorised.step(until=1.0).x, x)


def test_a_field_that_raises_ends_it(five):
    def breaks(t, x):
        if t > 0.05:
            raise LookupError("no more")
        return -x

    network = funnelnet.Simulation(five, set={"time.duration": "100ms"}, fields={1: breaks})
    network.step(until=0.04)
    with pytest.raises(LookupError, match="no more"):
        network.step(until=0.09)
    with pytest.raises(RuntimeError, match="has ended"):
        network.step()


def test_a_field_may_ask_for_the_time_of_its_simulation(five):
    # The thread that steps and the one that asks are two: neither waits for the other with a lock of the other's.
    seen, network = [], None

    def field(t, x):
        if network is not None:
            seen.append(network.is_done)
        return -x

    network = funnelnet.Simulation(five, set={"time.duration": "20ms"}, fields={1: field})
    network.step(until=1.0)
    assert seen and not any(seen)


def test_ctrl_c(five):
    network = funnelnet.Simulation(five, set={"time.duration": "40000s"})
    threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        network.step(until=40000.0)
    assert time.monotonic() - began < 10


def test_one_that_cannot_be_is_refused(five):
    with pytest.raises(funnelnet.ScenarioError):
        funnelnet.Simulation(five, set={"time.tick": "0ms"})
