"""Columns as tables of pandas and polars, which are installed by who wants them."""

from __future__ import annotations

from typing import Any

import numpy as np


def flat(columns: dict[str, Any]) -> dict[str, np.ndarray]:
    """One-dimensional columns with the names of `trajectory.csv`: `x_1`, or `x_1_0` for a vector state."""
    table: dict[str, np.ndarray] = {}
    for name, array in columns.items():
        if array is None:
            continue
        if array.ndim == 1:
            table[name] = array
        elif name in ("xi", "blended"):
            table.update({f"{name}_{component}": array[:, component] for component in range(array.shape[1])})
        elif array.ndim == 2:
            table.update({f"{name}_{node + 1}": array[:, node] for node in range(array.shape[1])})
        else:
            places = np.ndindex(array.shape[1:])
            table.update({f"{name}_{node + 1}_{component}": array[:, node, component] for node, component in places})
    return table


def to_pandas(columns: dict[str, Any]) -> Any:
    import pandas

    return pandas.DataFrame(columns)


def to_polars(columns: dict[str, Any]) -> Any:
    import polars

    return polars.DataFrame(columns)
