"""Networks of funnel-coupled nodes: runs, checks and sweeps of scenarios, with results as NumPy arrays.

>>> import funnelnet
>>> r = funnelnet.run("scenarios/five-agents.toml", set={"time.duration": "1s"})
>>> r.x.shape
(1001, 5)
"""

from ._check import Check, check
from ._errors import FunnelnetError, RunError, ScenarioError
from ._fields import Vectorised
from ._run import LargeRun, Run, run
from ._scenario import Scenario, load
from ._simulation import Simulation, Steps, Verdict
from ._sweep import Sweep, sweep

__all__ = [
    "Check",
    "FunnelnetError",
    "LargeRun",
    "Run",
    "RunError",
    "Scenario",
    "ScenarioError",
    "Simulation",
    "Steps",
    "Sweep",
    "Vectorised",
    "Verdict",
    "check",
    "load",
    "run",
    "sweep",
]
