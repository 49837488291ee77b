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
    from skyway.models.composition_file import load as load_composition
    from skyway.models.composition_file import save as save_composition
    from skyway.models.drone import Drone
    from skyway.models.errors import InfeasibleError, InputError, NoRouteError, SkywayError
    from skyway.models.flight import FlightRules
    from skyway.models.load import PadLoad
    from skyway.models.network import ConnectionRule, Network, Station
    from skyway.models.scenario import Scenario
    from skyway.models.scenario_file import read_scenario
    from skyway.models.services import Composition, DroneService, State, Stop
    from skyway.models.wind_ensemble import WindEnsemble
    from skyway.models.wind_forecast import constant_wind
    from skyway.planner.objective import Objective
    from skyway.planner.plan import compare, plan
    from skyway.planner.request import Request
    from skyway.planner.result import Comparison, PlanResult
    from skyway.plotting import plot

__version__ = "0.1.0"

_HOMES = {
    "NEW_YORK": ("skyway.missions.examples", "NEW_YORK"),
    "load_composition": ("skyway.models.composition_file", "load"),
    "save_composition": ("skyway.models.composition_file", "save"),
    "Drone": ("skyway.models.drone", "Drone"),
    "InfeasibleError": ("skyway.models.errors", "InfeasibleError"),
    "InputError": ("skyway.models.errors", "InputError"),
    "NoRouteError": ("skyway.models.errors", "NoRouteError"),
    "SkywayError": ("skyway.models.errors", "SkywayError"),
    "FlightRules": ("skyway.models.flight", "FlightRules"),
    "PadLoad": ("skyway.models.load", "PadLoad"),
    "ConnectionRule": ("skyway.models.network", "ConnectionRule"),
    "Network": ("skyway.models.network", "Network"),
    "Station": ("skyway.models.network", "Station"),
    "Scenario": ("skyway.models.scenario", "Scenario"),
    "read_scenario": ("skyway.models.scenario_file", "read_scenario"),
    "Composition": ("skyway.models.services", "Composition"),
    "DroneService": ("skyway.models.services", "DroneService"),
    "State": ("skyway.models.services", "State"),
    "Stop": ("skyway.models.services", "Stop"),
    "WindEnsemble": ("skyway.models.wind_ensemble", "WindEnsemble"),
    "constant_wind": ("skyway.models.wind_forecast", "constant_wind"),
    "Objective": ("skyway.planner.objective", "Objective"),
    "compare": ("skyway.planner.plan", "compare"),
    "plan": ("skyway.planner.plan", "plan"),
    "Request": ("skyway.planner.request", "Request"),
    "Comparison": ("skyway.planner.result", "Comparison"),
    "PlanResult": ("skyway.planner.result", "PlanResult"),
    "build_scenario": ("skyway.building", "build_scenario"),
    "plot": ("skyway.plotting", "plot"),
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
