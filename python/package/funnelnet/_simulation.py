"""A network for who owns the clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import _fields, _native
from ._scenario import Source, load


@dataclass(frozen=True)
class Steps:
    """What the nodes saw at some ticks; arrays are (tick, node), and (tick, node, component) for vector states, read-only.

    Attributes:
        t: time, s.
        x: states, state units.
        nu: diffusive terms as the nodes believe them, state units.
        psi: funnels as the nodes have them, state units.
        u: coupling inputs, state units / s.
    """

    t: np.ndarray
    x: np.ndarray
    nu: np.ndarray
    psi: np.ndarray
    u: np.ndarray


@dataclass(frozen=True)
class Verdict:
    """Whether the guarantee held, by the true states and the scenario's funnels.

    Attributes:
        holds: every diffusive term was known and inside its funnel, and all checks of a run hold.
        reasons: why not, as sentences.
        max_ratio: largest |nu| / psi over all nodes and ticks.
        breaches: node-ticks outside.
    """

    holds: bool
    reasons: list[str]
    max_ratio: float
    breaches: int


class Simulation:
    """A network that goes on when it is told to: the nodes and the bits of `run`, without the expectations.

    Args:
        scenario: a path, a dict, or what `load` gave.
        set: values put in first.
        seed: in place of the scenario's.
        fields: vector fields in Python, as for `run`; the network is then not the firmware's.

    Raises:
        ScenarioError: the scenario cannot be read.
        RunError: the network cannot be simulated.
    """

    def __init__(
        self,
        scenario: Source,
        *,
        set: Mapping[str, Any] | None = None,
        seed: int | None = None,
        fields: _fields.Fields = None,
    ) -> None:
        self.scenario = load(scenario, set, seed)
        own = _fields.native(fields, self.scenario.nodes)
        self.own_fields = sorted(node for _, _, nodes in own for node in nodes)
        self._native = _native.Simulation(self.scenario, own)
        self._seconds = 0.0

    @property
    def is_firmware(self) -> bool:
        """Whether the firmware would give these bits: no field is in Python."""
        return not self.own_fields

    @property
    def is_done(self) -> bool:
        """Whether all ticks of the scenario were run."""
        return self._native.next_tick > self._native.last_tick

    @property
    def seconds(self) -> float:
        """Time of the last tick that was run, s; of the first one where there was none."""
        return self._seconds

    def step(self, until: float | None = None) -> Steps:
        """Runs all ticks up to and with the time `until` (s), or the next tick alone, and gives what the nodes saw at them.

        There is no tick in it where that time has passed already, and none after the end of the scenario.

        Raises:
            StopIteration: all ticks were run before.
            KeyboardInterrupt: Ctrl-C, which ends the simulation.
        """
        seen = Steps(**self._native.step(until))
        if len(seen.t):
            self._seconds = float(seen.t[-1])
        return seen

    def verdict(self) -> Verdict:
        """Judges the ticks so far, and ends the simulation. One that is not complete does not hold."""
        return Verdict(*self._native.verdict())
