"""skyway: plan, upload, fly and replay drone deliveries that must recharge on the way.

The facade loads its parts when they are first used:

>>> import skyway
>>> scenario = skyway.read_scenario(skyway.NEW_YORK)  # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from missions.examples import NEW_YORK
    from models.composition_file import load as load_composition
    from models.composition_file import save as save_composition
    from models.errors import InfeasibleError, InputError, NoRouteError, SkywayError
    from models.scenario import Scenario
    from models.scenario_file import read_scenario
    from models.services import Composition, DroneService, State, Stop
    from planner.plan import compare, plan
    from planner.request import Request

__version__ = "0.1.0"

_HOMES = {
    "NEW_YORK": ("missions.examples", "NEW_YORK"),
    "load_composition": ("models.composition_file", "load"),
    "save_composition": ("models.composition_file", "save"),
    "InfeasibleError": ("models.errors", "InfeasibleError"),
    "InputError": ("models.errors", "InputError"),
    "NoRouteError": ("models.errors", "NoRouteError"),
    "SkywayError": ("models.errors", "SkywayError"),
    "Scenario": ("models.scenario", "Scenario"),
    "read_scenario": ("models.scenario_file", "read_scenario"),
    "Composition": ("models.services", "Composition"),
    "DroneService": ("models.services", "DroneService"),
    "State": ("models.services", "State"),
    "Stop": ("models.services", "Stop"),
    "compare": ("planner.plan", "compare"),
    "plan": ("planner.plan", "plan"),
    "Request": ("planner.request", "Request"),
}

__all__ = [
    "NEW_YORK",
    "Composition",
    "DroneService",
    "InfeasibleError",
    "InputError",
    "NoRouteError",
    "Request",
    "Scenario",
    "SkywayError",
    "State",
    "Stop",
    "compare",
    "load_composition",
    "plan",
    "read_scenario",
    "save_composition",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'skyway' has no attribute {name!r}")
    module, attribute = _HOMES[name]
    return getattr(import_module(module), attribute)
