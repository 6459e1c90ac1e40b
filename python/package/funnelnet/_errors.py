"""What can go wrong."""

from __future__ import annotations

from typing import Any


class FunnelnetError(Exception):
    """Any error of this package."""


class ScenarioError(FunnelnetError, ValueError):
    """A scenario that cannot be read.

    The attributes are those of the first mistake; `mistakes` has all of them, as dicts with the same keys.

    Attributes:
        file: the file as it was named; `<dict>` for a dict, `set['key']` for a value of `set`.
        line: from 1; `None` where the value stands in no file.
        column: in characters from 1, or `None`.
        key: the full key, such as `coupling.funnel.rate`; empty where no key is concerned.
        found: the value as written, or `None`.
        allowed: what is allowed, with its unit.
        hint: a change that would mend it, or `None`.
    """

    def __init__(self, message: str, mistakes: list[dict[str, Any]]) -> None:
        super().__init__(message)
        self.mistakes = mistakes
        first = mistakes[0]
        self.file: str = first["file"]
        self.line: int | None = first["line"]
        self.column: int | None = first["column"]
        self.key: str = first["key"]
        self.found: str | None = first["found"]
        self.allowed: str = first["allowed"]
        self.hint: str | None = first["hint"]

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.mistakes)


class RunError(FunnelnetError):
    """A run that did not come to an end.

    Attributes:
        exit_code: the one with which the command `sim-host` would end.
    """

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.exit_code)
