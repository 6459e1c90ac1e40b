"""Python's values as TOML: a scenario in a dict goes through the one reader of scenarios."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any


def value(of: Any, key: str) -> str:
    """A value in one line; `key` is named where there is no such value in TOML."""
    if isinstance(of, bool):
        return "true" if of else "false"
    if isinstance(of, str):
        # JSON's escapes are TOML's, but for DEL, which TOML wants escaped too.
        return json.dumps(of, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(of, Mapping):
        return "{ " + ", ".join(f"{name(k, key)} = {value(v, f'{key}.{k}')}" for k, v in of.items()) + " }"
    if isinstance(of, (list, tuple)):
        return "[" + ", ".join(value(v, f"{key}.{n}") for n, v in enumerate(of)) + "]"
    if isinstance(of, int):
        return str(of)
    if isinstance(of, float):
        return repr(float(of))
    if hasattr(of, "tolist"):
        # Arrays and scalars of NumPy.
        return value(of.tolist(), key)
    raise TypeError(f"{key}: a scenario holds strings, numbers, booleans, lists and dicts, not {type(of).__name__}")


def name(key: Any, inside: str) -> str:
    """A key, quoted where it is no bare one."""
    if not isinstance(key, str):
        raise TypeError(f"{inside or 'scenario'}: keys are strings, and {key!r} is none")
    is_bare = key.isascii() and key.replace("-", "").replace("_", "").isalnum()
    return key if is_bare else json.dumps(key)


# What the command line takes for a string without quotes, as people write kinds and times there.
BARE = re.compile(r"(?!(?:true|false|inf|nan)$)[A-Za-z][A-Za-z0-9_-]*|[0-9]+(?:\.[0-9]+)?(?:ns|us|ms|s|min|h)")


def argument(of: Any, key: str) -> str:
    """A value as people write it on the command line, so that a table has the same cells."""
    return of if isinstance(of, str) and BARE.fullmatch(of) else value(of, key)


def document(scenario: Mapping[str, Any]) -> str:
    """A dict as a file: each of its keys on a line."""
    return "".join(f"{name(key, '')} = {value(of, str(key))}\n" for key, of in scenario.items())
