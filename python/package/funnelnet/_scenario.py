"""Scenarios: from a path or a dict."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from . import _toml
from ._native import Scenario

Source = str | os.PathLike[str] | Mapping[str, Any] | Scenario

# How messages name a scenario that stands in no file.
IN_A_DICT = "<dict>"


def load(scenario: Source, set: Mapping[str, Any] | None = None, seed: int | None = None) -> Scenario:
    """Reads and checks a scenario.

    Args:
        scenario: the path of a file, or a dict with the same keys. Files that a dict names are looked for in the working directory.
        set: keys as `--set` takes them (`"bus.loss"`, `"node.3.state"`) with their values.
        seed: in place of the scenario's.

    Raises:
        ScenarioError: with every mistake that was found.
        TypeError: a value that TOML does not have.
    """
    if isinstance(scenario, Scenario):
        if set or seed is not None:
            raise TypeError("set and seed are for a path or a dict: this scenario has been read already")
        return scenario
    sets = [(key, _toml.value(value, key)) for key, value in (set or {}).items()]
    if seed is not None:
        sets.append(("seed", _toml.value(seed, "seed")))
    if isinstance(scenario, Mapping):
        return Scenario(Path(IN_A_DICT), _toml.document(scenario), sets)
    return Scenario(Path(scenario), None, sets)
