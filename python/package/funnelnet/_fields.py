"""Vector fields in Python."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Vectorised:
    """A field of several nodes at once.

    Args:
        f: `f(t, x)`, with `t` in seconds and `x` an array (node,) or (node, component) of the states of these nodes, in the order of `nodes`. It gives
            their rates, in state units per second, in an array of the same shape. The rate of a node depends on its own state alone.
        nodes: their ids; all nodes if it is left out.
    """

    f: Callable[[float, Any], Any]
    nodes: tuple[int, ...] | None = None

    def __init__(self, f: Callable[[float, Any], Any], nodes: Iterable[int] | None = None) -> None:
        object.__setattr__(self, "f", f)
        object.__setattr__(self, "nodes", None if nodes is None else tuple(nodes))


Fields = Callable[[float, Any], Any] | Vectorised | Mapping[int, Callable[[float, Any], Any]] | Iterable[Vectorised] | None


def native(fields: Fields, count: int) -> list[tuple[Callable[[float, Any], Any], bool, list[int]]]:
    """Callables, whether they are vectorised, and the ids of their nodes."""
    every = list(range(1, count + 1))
    if fields is None:
        return []
    if isinstance(fields, Vectorised):
        fields = [fields]
    if isinstance(fields, Mapping):
        return [(f, False, [int(node)]) for node, f in fields.items()]
    if callable(fields):
        return [(fields, False, every)]
    groups = list(fields)
    if not all(isinstance(group, Vectorised) for group in groups):
        raise TypeError("fields: a callable, a dict of them by node id, a Vectorised, or a list of Vectorised")
    return [(group.f, True, every if group.nodes is None else list(group.nodes)) for group in groups]
