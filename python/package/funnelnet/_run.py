"""A scenario to its end."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Literal

import numpy as np

from . import _fields, _native, _tables
from ._scenario import Source, load

# The columns of a run, in the order of `trajectory.csv`.
COLUMNS = ("t", "x", "nu", "psi", "u", "xi", "blended", "true_nu", "asked_psi")


class _Judged:
    """What every run has: its summary, and what follows from it."""

    summary: dict[str, Any]

    @property
    def passed(self) -> bool:
        """Whether all expectations of the scenario and all checks hold: exit code 0 of the command."""
        return self.summary["passed"]

    @property
    def trace_hash(self) -> str | None:
        """Hash of all states, equal to that of the command; `None` for the reference."""
        return self.summary["trace_hash"]

    @property
    def failures(self) -> list[str]:
        """What does not hold, as sentences."""
        expect = [f"{e['name']} {e['value']} is not below {e['limit']}" for e in self.summary["expect"] if not e["pass"]]
        return expect + [f"{c['name']}: {c['text']}" for c in self.summary["checks"] if not c["pass"]]

    def columns(self) -> dict[str, np.ndarray]:
        raise NotImplementedError

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame` with the columns of the CSV file."""
        return _tables.to_pandas(self.columns())

    def to_polars(self) -> Any:
        """A `polars.DataFrame` with the columns of the CSV file."""
        return _tables.to_polars(self.columns())


class LargeRun(_Judged):
    """What a run with `bus.model = "none"` came to. Arrays are read-only, and not copied.

    Attributes:
        summary: the dict of `summary.json`.
        t: time, s.
        quantiles: the columns of `quantiles.csv` behind the time, by name: `x_mean`, `x_q00`, ..., `ratio_q100`, `u_q100`.
        nodes: ids of the nodes that were asked for, ascending.
        x: their states, (time, node), state units.
        nu: their diffusive terms, state units.
        psi: their funnels, state units.
        u: their coupling inputs, state units / s.
    """

    t: np.ndarray
    quantiles: dict[str, np.ndarray]
    nodes: list[int]
    x: np.ndarray
    nu: np.ndarray
    psi: np.ndarray
    u: np.ndarray

    def __init__(self, summary: dict[str, Any], columns: dict[str, Any]) -> None:
        self.summary = summary
        for name in ("t", "quantiles", "nodes", "x", "nu", "psi", "u"):
            setattr(self, name, columns[name])

    def columns(self) -> dict[str, np.ndarray]:
        """One-dimensional columns: those of `quantiles.csv`, and, with the names of `trajectory.csv`, those of the nodes that were asked for."""
        of_nodes = {f"{name}_{id}": getattr(self, name)[:, at] for name in ("x", "nu", "psi", "u") for at, id in enumerate(self.nodes)}
        return {"t": self.t, **self.quantiles, **of_nodes}

    def __repr__(self) -> str:
        verdict = "passed" if self.passed else "failed"
        return f"<funnelnet.LargeRun {self.summary['scenario']!r}: {verdict}, {len(self.t)} rows of quantiles over {self.summary['nodes']} nodes>"


class Run(_Judged):
    """What a run came to. Arrays are (time, node), and (time, node, component) for vector states; they are read-only, and not copied.

    Attributes:
        summary: the dict of `summary.json`.
        t: time, s.
        x: states, state units.
        nu: diffusive terms as the nodes believe them, state units.
        psi: funnels as the nodes have them, state units.
        u: coupling inputs, state units / s.
        xi: emergent trajectory, (time,) or (time, component), state units; `None` where it is not known.
        blended: blended dynamics, likewise.
        true_nu: diffusive terms of the true states, state units.
        asked_psi: the funnels that they are judged by, state units.
    """

    t: np.ndarray
    x: np.ndarray
    nu: np.ndarray
    psi: np.ndarray
    u: np.ndarray
    xi: np.ndarray | None
    blended: np.ndarray | None
    true_nu: np.ndarray
    asked_psi: np.ndarray

    def __init__(self, summary: dict[str, Any], columns: dict[str, Any]) -> None:
        self.summary = summary
        for name in COLUMNS:
            setattr(self, name, columns[name])

    @property
    def is_firmware(self) -> bool:
        """Whether the firmware would give these bits: f32 nodes ran, and none with a field in Python."""
        return self.trace_hash is not None and not self.own_fields

    @property
    def own_fields(self) -> list[int]:
        """Ids of the nodes whose fields are in Python: with any, the result is not the firmware's."""
        return self.summary.get("own_fields", [])

    def columns(self) -> dict[str, np.ndarray]:
        """One-dimensional columns with the names of `trajectory.csv`, views of the arrays."""
        return _tables.flat({name: getattr(self, name) for name in COLUMNS})

    def __repr__(self) -> str:
        verdict = "passed" if self.passed else "failed"
        own = f", not the firmware's: fields of nodes {self.own_fields} are in Python" if self.own_fields else ""
        return f"<funnelnet.Run {self.summary['scenario']!r} on {self.summary['on']}: {verdict}, {len(self.t)} rows of {self.summary['nodes']} nodes{own}>"


def run(
    scenario: Source,
    *,
    set: Mapping[str, Any] | None = None,
    seed: int | None = None,
    on: Literal["loopback", "reference"] = "loopback",
    every: str | None = None,
    out: str | os.PathLike[str] | None = None,
    fields: _fields.Fields = None,
    progress: Callable[[float, float], object] | None = None,
    nodes: Iterable[int] | None = None,
    threads: int | None = None,
) -> Run | LargeRun:
    """Runs a scenario and judges it, as `sim-host run` does: the same bits, the same summary.

    Args:
        scenario: a path, a dict with the keys of a scenario file, or what `load` gave.
        set: values put in first, such as `{"bus.loss": 0.1, "time.duration": "5s"}`.
        seed: in place of the scenario's.
        on: `"loopback"`, the f32 nodes of the firmware on a simulated bus; or `"reference"`, the continuous-time system in f64.
        every: time between two rows, such as `"10ms"`; by default every tick, thinned to 2,000 rows.
        out: a folder for the files that `sim-host run --out` writes.
        fields: vector fields in Python in place of the scenario's: a callable `f(t, x)` for every node, a dict of them by node id, or `Vectorised`. `t` is in
            seconds, `x` a float, or an array for a vector state; the rate is in state units per second. A field has to depend on `t` and `x` alone: it is
            also called for predictions, and in no fixed order.
        progress: called about 20 times a second with the simulated time and the end, both in seconds.
        nodes: with `bus.model = "none"` alone, ids of the nodes that get columns; the result is a `LargeRun` then, with some 200 rows of quantiles.
        threads: with `bus.model = "none"` alone; by default one per core. No figure depends on it.

    Raises:
        ScenarioError: the scenario cannot be read.
        RunError: the run did not come to an end.
        KeyboardInterrupt: Ctrl-C. With `out`, what was recorded until then is written.
    """
    read = load(scenario, set, seed)
    target = None if out is None else os.fspath(out)
    command = f"funnelnet.run(on={on!r}, seed={read.seed})"
    asked = None if nodes is None else [int(id) for id in nodes]
    text, columns = _native.run(read, on, every, target, _fields.native(fields, read.nodes), progress, asked, threads, command)
    kind = LargeRun if "quantiles" in columns else Run
    return kind(json.loads(text), columns)
