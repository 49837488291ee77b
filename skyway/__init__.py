"""skyway: plan, upload, fly and replay drone deliveries that must recharge on the way.

The facade loads its parts when they are first used:

>>> import skyway
>>> skyway.read_scenario(skyway.NEW_YORK)
Scenario(New York: 46 stations, 278 segments, 4 drones, wind record of 3 sites)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skyway.building import build_scenario
    from skyway.missions.examples import NEW_YORK
    from skyway.models.base.errors import InfeasibleError, InputError, NoRouteError, SkywayError
    from skyway.models.composition.composition import Composition, DroneService, State, Stop
    from skyway.models.composition.file import load as load_composition
    from skyway.models.composition.file import save as save_composition
    from skyway.models.drones.drone import Drone
    from skyway.models.flight.rules import FlightRules
    from skyway.models.network.network import ConnectionRule, Network, Station
    from skyway.models.queues.load import PadLoad
    from skyway.models.scenario.file import read_scenario
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.forecast import constant_wind
    from skyway.planner.plan import compare, plan
    from skyway.planner.problem.objective import Objective
    from skyway.planner.problem.request import Request
    from skyway.planner.result import Comparison, PlanResult
    from skyway.plots.plotting import plot

__version__ = "0.1.0"

_HOMES = {
    "NEW_YORK": ("skyway.missions.examples", "NEW_YORK"),
    "load_composition": ("skyway.models.composition.file", "load"),
    "save_composition": ("skyway.models.composition.file", "save"),
    "Drone": ("skyway.models.drones.drone", "Drone"),
    "InfeasibleError": ("skyway.models.base.errors", "InfeasibleError"),
    "InputError": ("skyway.models.base.errors", "InputError"),
    "NoRouteError": ("skyway.models.base.errors", "NoRouteError"),
    "SkywayError": ("skyway.models.base.errors", "SkywayError"),
    "FlightRules": ("skyway.models.flight.rules", "FlightRules"),
    "PadLoad": ("skyway.models.queues.load", "PadLoad"),
    "ConnectionRule": ("skyway.models.network.network", "ConnectionRule"),
    "Network": ("skyway.models.network.network", "Network"),
    "Station": ("skyway.models.network.network", "Station"),
    "Scenario": ("skyway.models.scenario.scenario", "Scenario"),
    "read_scenario": ("skyway.models.scenario.file", "read_scenario"),
    "Composition": ("skyway.models.composition.composition", "Composition"),
    "DroneService": ("skyway.models.composition.composition", "DroneService"),
    "State": ("skyway.models.composition.composition", "State"),
    "Stop": ("skyway.models.composition.composition", "Stop"),
    "WindEnsemble": ("skyway.models.wind.ensemble", "WindEnsemble"),
    "constant_wind": ("skyway.models.wind.forecast", "constant_wind"),
    "Objective": ("skyway.planner.problem.objective", "Objective"),
    "compare": ("skyway.planner.plan", "compare"),
    "plan": ("skyway.planner.plan", "plan"),
    "Request": ("skyway.planner.problem.request", "Request"),
    "Comparison": ("skyway.planner.result", "Comparison"),
    "PlanResult": ("skyway.planner.result", "PlanResult"),
    "build_scenario": ("skyway.building", "build_scenario"),
    "plot": ("skyway.plots.plotting", "plot"),
}

__all__ = [
    "NEW_YORK",
    "Comparison",
    "Composition",
    "ConnectionRule",
    "Drone",
    "DroneService",
    "FlightRules",
    "InfeasibleError",
    "InputError",
    "Network",
    "NoRouteError",
    "Objective",
    "PadLoad",
    "PlanResult",
    "Request",
    "Scenario",
    "SkywayError",
    "State",
    "Station",
    "Stop",
    "WindEnsemble",
    "build_scenario",
    "compare",
    "constant_wind",
    "load_composition",
    "plan",
    "plot",
    "read_scenario",
    "save_composition",
]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'skyway' has no attribute {name!r}")
    module, attribute = _HOMES[name]
    return getattr(import_module(module), attribute)
