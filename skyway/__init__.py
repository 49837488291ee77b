"""skyway: plan, upload, fly and replay drone deliveries that must recharge on the way.

The facade loads its parts when they are first used:

>>> import skyway
>>> skyway.read_scenario(skyway.NEW_YORK)
Scenario(New York: 46 stations, 278 segments, 4 drones, wind record of 3 sites)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.base.lazy import exports

if TYPE_CHECKING:
    from skyway.building import build_scenario as build_scenario
    from skyway.missions.examples import NEW_YORK as NEW_YORK
    from skyway.models.base.errors import InfeasibleError as InfeasibleError
    from skyway.models.base.errors import InputError as InputError
    from skyway.models.base.errors import NoRouteError as NoRouteError
    from skyway.models.base.errors import SkywayError as SkywayError
    from skyway.models.composition.composition import Composition as Composition
    from skyway.models.composition.composition import State as State
    from skyway.models.composition.file import load as load_composition
    from skyway.models.composition.file import save as save_composition
    from skyway.models.composition.service import DroneService as DroneService
    from skyway.models.composition.service import Stop as Stop
    from skyway.models.drones.drone import Drone as Drone
    from skyway.models.flight.rules import FlightRules as FlightRules
    from skyway.models.network.network import Network as Network
    from skyway.models.network.station import ConnectionRule as ConnectionRule
    from skyway.models.network.station import Station as Station
    from skyway.models.queues.load import PadLoad as PadLoad
    from skyway.models.scenario.file import read_scenario as read_scenario
    from skyway.models.scenario.scenario import Scenario as Scenario
    from skyway.models.wind.ensemble import WindEnsemble as WindEnsemble
    from skyway.models.wind.forecast import constant_wind as constant_wind
    from skyway.planner.plan import compare as compare
    from skyway.planner.plan import plan as plan
    from skyway.planner.problem.objective import Objective as Objective
    from skyway.planner.problem.request import Request as Request
    from skyway.planner.result import Comparison as Comparison
    from skyway.planner.result import PlanResult as PlanResult
    from skyway.plots.plotting import plot as plot

__version__ = "0.2.0"

__all__, __getattr__ = exports(__name__)
if TYPE_CHECKING:
    __all__ += ["load_composition", "save_composition"]  # the only names that have another at home


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
