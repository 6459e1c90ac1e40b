"""A scenario over many values and seeds."""

from __future__ import annotations

import csv
import os
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from . import _native, _tables, _toml
from ._scenario import Source, load


class Sweep:
    """The table of a sweep, a row for each run, in the order of their numbers.

    `sweep["bus.loss"]` is a column: numbers where all its cells are numbers (NaN where one is empty), else strings.

    Attributes:
        exit_code: that of `sim-host sweep`: 0 where every run passes, 1 where one fails, 2 where one is refused, 4 for a defect.
        columns: the columns by name.
    """

    def __init__(self, columns: dict[str, np.ndarray], exit_code: int) -> None:
        self.columns = columns
        self.exit_code = exit_code

    @property
    def passed(self) -> bool:
        """Whether every run passes."""
        return self.exit_code == 0

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["run"])

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame` with the columns of `runs.csv`."""
        return _tables.to_pandas(self.columns)

    def to_polars(self) -> Any:
        """A `polars.DataFrame` with the columns of `runs.csv`."""
        return _tables.to_polars(self.columns)

    def __repr__(self) -> str:
        verdicts, counts = np.unique(self.columns["verdict"], return_counts=True)
        return f"<funnelnet.Sweep: {len(self)} runs, " + ", ".join(f"{n} {verdict}" for verdict, n in zip(verdicts, counts)) + ">"


def sweep(
    scenario: Source,
    *,
    grid: Mapping[str, Sequence[Any]] | None = None,
    ranges: Mapping[str, str] | None = None,
    sobol: int | None = None,
    lhs: int | None = None,
    design_seed: int = 1,
    seeds: int = 1,
    independent: bool = False,
    set: Mapping[str, Any] | None = None,
    seed: int | None = None,
    out: str | os.PathLike[str] | None = None,
    resume: bool = False,
    jobs: int | None = None,
    allow_refused: bool = False,
) -> Sweep:
    """Runs a scenario over values and seeds on all cores, as `sim-host sweep` does: the same points, seeds and figures.

    Args:
        scenario: a path, a dict, or what `load` gave.
        grid: keys with the values that each is to have, in every combination.
        ranges: keys with what to draw from, such as `{"bus.loss": "0.0..0.3"}`, for `sobol` or `lhs`.
        sobol: so many Owen-scrambled Sobol points.
        lhs: a Latin hypercube of so many points.
        design_seed: seed of the drawing.
        seeds: repetitions of each point.
        independent: mixes the point into the seed.
        set: values put in first.
        seed: of the first repetition, in place of the scenario's.
        out: the folder of the sweep, as `--out`; without it nothing is kept but the table that is returned.
        resume: goes on with the rows that are in `out`.
        jobs: threads; as many as there are cores by default.
        allow_refused: a run that is refused is a row, and not the end of the sweep.

    Raises:
        ScenarioError: the scenario cannot be read.
        RunError: nothing was run, since a point or the folder is refused.
        KeyboardInterrupt: Ctrl-C; with `out`, the rows of runs that have ended are kept.
    """
    if sobol is not None and lhs is not None:
        raise ValueError("sobol and lhs: one of them")
    if ranges and sobol is None and lhs is None:
        raise ValueError("ranges: say how many points are drawn, by sobol or lhs")
    if resume and out is None:
        raise ValueError("resume: needs the folder, out")
    read = load(scenario, set, seed)
    axes = [f"{key}=" + ",".join(_toml.argument(value, key) for value in values) for key, values in (grid or {}).items()]
    drawn = [f"{key}={text}" for key, text in (ranges or {}).items()]
    drawing = None
    if sobol is not None or lhs is not None:
        drawing = ("sobol", sobol, design_seed) if sobol is not None else ("lhs", lhs, design_seed)

    def into(folder: Path) -> Sweep:
        command = f"funnelnet.sweep(grid={axes!r}, ranges={drawn!r}, seeds={seeds})"
        table, exit_code = _native.sweep(read, axes, drawn, drawing, seeds, independent, folder, resume, jobs, allow_refused, command)
        return Sweep(_read(Path(table)), exit_code)

    if out is not None:
        return into(Path(out))
    with tempfile.TemporaryDirectory(prefix="funnelnet-sweep-") as folder:
        return into(Path(folder))


def _read(table: Path) -> dict[str, np.ndarray]:
    with table.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    names, rows = rows[0], rows[1:]
    return {name: _column(name, [row[at] for row in rows]) for at, name in enumerate(names)}


def _column(name: str, cells: list[str]) -> np.ndarray:
    # A hash may have no letter in it.
    if name in ("trace_hash", "verdict", "why"):
        return np.array(cells)
    try:
        return np.array([int(cell) for cell in cells])
    except ValueError:
        pass
    try:
        return np.array([float(cell) if cell else np.nan for cell in cells])
    except ValueError:
        return np.array(cells)
