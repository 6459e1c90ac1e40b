"""What a scenario will do, without a run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from . import _native
from ._scenario import Source, load


class Check:
    """What `check` found.

    Attributes:
        report: the dict of `sim-host check --json`.
        text: the text of `sim-host check`.
    """

    def __init__(self, report: dict[str, Any], text: str) -> None:
        self.report = report
        self.text = text

    @property
    def passed(self) -> bool:
        """Whether no finding failed; warnings do not count."""
        return self.report["pass"]

    @property
    def findings(self) -> list[dict[str, Any]]:
        """All findings, assumptions first."""
        return self.report["findings"]

    def __getitem__(self, name: str) -> dict[str, Any]:
        """The finding with this name, such as `"narrowest-funnel"`."""
        for finding in self.findings:
            if finding["name"] == name:
                return finding
        raise KeyError(name)

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        counts: dict[str, int] = {}
        for finding in self.findings:
            counts[finding["status"]] = counts.get(finding["status"], 0) + 1
        return f"<funnelnet.Check {self.report['scenario']!r}: " + ", ".join(f"{n} {status}" for status, n in counts.items()) + ">"


def check(scenario: Source, *, set: Mapping[str, Any] | None = None, seed: int | None = None) -> Check:
    """Says which assumptions and bounds hold, how narrow a funnel can be kept at this tick, and what to change, as `sim-host check` does.

    Args:
        scenario: a path, a dict, or what `load` gave.
        set: values put in first.
        seed: in place of the scenario's.

    Raises:
        ScenarioError: the scenario cannot be read.
    """
    report, text = _native.check(load(scenario, set, seed))
    return Check(json.loads(report), text)
