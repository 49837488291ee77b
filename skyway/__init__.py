"""skyway: plan, upload, fly and replay drone deliveries that must recharge on the way.

The facade loads its parts when they are first used:

>>> import skyway
>>> skyway.read_scenario(skyway.NEW_YORK)
Scenario(New York hospitals: 46 stations, 504 segments, 4 drones, wind record of 3 sites)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from missions.examples import NEW_YORK
    from models.composition_file import load as load_composition
    from models.composition_file import save as save_composition
    from models.drone import Drone
    from models.errors import InfeasibleError, InputError, NoRouteError, SkywayError
    from models.flight import FlightRules
    from models.load import PadLoad
    from models.network import ConnectionRule, Network, Station
    from models.scenario import Scenario
    from models.scenario_file import read_scenario
    from models.services import Composition, DroneService, State, Stop
    from models.wind_ensemble import WindEnsemble
    from models.wind_forecast import constant_wind
    from planner.objective import Objective
    from planner.plan import compare, plan
    from planner.request import Request
    from planner.result import Comparison, PlanResult
    from skyway.building import build_scenario
    from skyway.plotting import plot

__version__ = "0.1.0"

_HOMES = {
    "NEW_YORK": ("missions.examples", "NEW_YORK"),
    "load_composition": ("models.composition_file", "load"),
    "save_composition": ("models.composition_file", "save"),
    "Drone": ("models.drone", "Drone"),
    "InfeasibleError": ("models.errors", "InfeasibleError"),
    "InputError": ("models.errors", "InputError"),
    "NoRouteError": ("models.errors", "NoRouteError"),
    "SkywayError": ("models.errors", "SkywayError"),
    "FlightRules": ("models.flight", "FlightRules"),
    "PadLoad": ("models.load", "PadLoad"),
    "ConnectionRule": ("models.network", "ConnectionRule"),
    "Network": ("models.network", "Network"),
    "Station": ("models.network", "Station"),
    "Scenario": ("models.scenario", "Scenario"),
    "read_scenario": ("models.scenario_file", "read_scenario"),
    "Composition": ("models.services", "Composition"),
    "DroneService": ("models.services", "DroneService"),
    "State": ("models.services", "State"),
    "Stop": ("models.services", "Stop"),
    "WindEnsemble": ("models.wind_ensemble", "WindEnsemble"),
    "constant_wind": ("models.wind_forecast", "constant_wind"),
    "Objective": ("planner.objective", "Objective"),
    "compare": ("planner.plan", "compare"),
    "plan": ("planner.plan", "plan"),
    "Request": ("planner.request", "Request"),
    "Comparison": ("planner.result", "Comparison"),
    "PlanResult": ("planner.result", "PlanResult"),
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
