"""Missions: what a vehicle flies, and the files operators keep it in.

`read` and `write` files, `check` any mission, `diff` what was sent with what was read back, `leg_mission`,
`whole_mission` and `armed_mission` make missions of a composition, `dialect` is one autopilot's way with them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.missions.checks.energy import FlightConditions, LegEnergy
    from skyway.missions.checks.report import CheckReport, check
    from skyway.missions.checks.weather import ForecastWind, SteadyWind
    from skyway.missions.commands import Command, Frame
    from skyway.missions.comparison import Difference, diff
    from skyway.missions.coordinates import Point
    from skyway.missions.dialects import dialect
    from skyway.missions.dialects.protocol import Dialect
    from skyway.missions.dialects.wire import WireItem
    from skyway.missions.document import MissionDocument
    from skyway.missions.finding import Finding
    from skyway.missions.from_composition import Export, armed_mission, leg_mission, whole_mission
    from skyway.missions.geofence import FenceCircle, FencePolygon, Geofence
    from skyway.missions.mission import Home, Mission, MissionItem
    from skyway.missions.mission_file import read, write
    from skyway.missions.mission_options import MissionOptions
    from skyway.missions.parameters import Parameter
    from skyway.missions.rally import RallyPoint, RallyPoints

_HOMES = {
    "CheckReport": "checks.report",
    "Command": "commands",
    "Dialect": "dialects.protocol",
    "Difference": "comparison",
    "Export": "from_composition",
    "FenceCircle": "geofence",
    "FencePolygon": "geofence",
    "Finding": "finding",
    "FlightConditions": "checks.energy",
    "ForecastWind": "checks.weather",
    "Frame": "commands",
    "Geofence": "geofence",
    "Home": "mission",
    "LegEnergy": "checks.energy",
    "Mission": "mission",
    "MissionDocument": "document",
    "MissionItem": "mission",
    "MissionOptions": "mission_options",
    "Parameter": "parameters",
    "Point": "coordinates",
    "RallyPoint": "rally",
    "RallyPoints": "rally",
    "SteadyWind": "checks.weather",
    "WireItem": "dialects.wire",
    "armed_mission": "from_composition",
    "check": "checks.report",
    "dialect": "dialects",
    "diff": "comparison",
    "leg_mission": "from_composition",
    "read": "mission_file",
    "whole_mission": "from_composition",
    "write": "mission_file",
}

__all__ = [
    "CheckReport",
    "Command",
    "Dialect",
    "Difference",
    "Export",
    "FenceCircle",
    "FencePolygon",
    "Finding",
    "FlightConditions",
    "ForecastWind",
    "Frame",
    "Geofence",
    "Home",
    "LegEnergy",
    "Mission",
    "MissionDocument",
    "MissionItem",
    "MissionOptions",
    "Parameter",
    "Point",
    "RallyPoint",
    "RallyPoints",
    "SteadyWind",
    "WireItem",
    "armed_mission",
    "check",
    "dialect",
    "diff",
    "leg_mission",
    "read",
    "whole_mission",
    "write",
]


def __getattr__(name: str) -> object:
    """Import what is asked for, and no sooner: `from skyway import missions` costs nothing."""
    if name not in _HOMES:
        raise AttributeError(f"module 'missions' has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
