"""The native half; what users call is in the modules beside it."""

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

class Scenario:
    """A scenario that has been read and checked; `load` makes one."""

    def __init__(self, path: str | PathLike[str], text: str | None, sets: list[tuple[str, str]]) -> None: ...
    @property
    def title(self) -> str: ...
    @property
    def seed(self) -> int: ...
    @property
    def nodes(self) -> int: ...
    @property
    def tick(self) -> float:
        """Tick in seconds."""
    @property
    def duration(self) -> float:
        """Duration in seconds."""
    @property
    def toml(self) -> str:
        """The TOML that gives it again, with everything set."""

_Fields = list[tuple[Callable[[float, Any], Any], bool, list[int]]]

class Simulation:
    def __init__(self, scenario: Scenario, fields: _Fields) -> None: ...
    @property
    def next_tick(self) -> int: ...
    @property
    def last_tick(self) -> int: ...
    def step(self, until: float | None = None) -> dict[str, Any]: ...
    def verdict(self) -> tuple[bool, list[str], float, int]: ...

def run(
    scenario: Scenario,
    on: str,
    every: str | None,
    out: str | PathLike[str] | None,
    fields: _Fields,
    progress: Callable[[float, float], object] | None,
    nodes: list[int] | None,
    threads: int | None,
    command: str,
) -> tuple[str, dict[str, Any]]: ...
def check(scenario: Scenario) -> tuple[str, str]: ...
def sweep(
    scenario: Scenario,
    grid: list[str],
    ranges: list[str],
    drawing: tuple[str, int, int] | None,
    seeds: int,
    independent: bool,
    out: str | PathLike[str],
    resume: bool,
    jobs: int | None,
    allow_refused: bool,
    command: str,
) -> tuple[Path, int]: ...
