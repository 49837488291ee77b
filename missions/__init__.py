"""Missions: their items, files, checks and construction.

`read` and `write` files, `check` any mission, `diff` what was sent with what was read back, `leg_mission`,
`whole_mission` and `armed_mission` make missions of a composition, `family_named` is all in which one autopilot differs from
another.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.missions.autopilots.family import Dialect
    from skyway.missions.autopilots.read_back import Difference, diff
    from skyway.missions.autopilots.registry import family_named
    from skyway.missions.autopilots.wire import WireItem
    from skyway.missions.builder.from_composition import Export, armed_mission, leg_mission, whole_mission
    from skyway.missions.builder.mission_options import MissionOptions
    from skyway.missions.checks.energy import FlightConditions, LegEnergy
    from skyway.missions.checks.report import CheckReport, check
    from skyway.missions.checks.weather import ForecastWind, SteadyWind
    from skyway.missions.files.mission_file import read, write
    from skyway.missions.items.altitude_frames import Frame
    from skyway.missions.items.commands import Command
    from skyway.missions.items.coordinates import Point
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.finding import Finding
    from skyway.missions.items.geofence import FenceCircle, FencePolygon, Geofence
    from skyway.missions.items.mission import Home, Mission, MissionItem
    from skyway.missions.items.parameters import Parameter
    from skyway.missions.items.rally import RallyPoint, RallyPoints

_HOMES = {
    "CheckReport": "checks.report",
    "Command": "items.commands",
    "Dialect": "autopilots.family",
    "Difference": "autopilots.read_back",
    "Export": "builder.from_composition",
    "FenceCircle": "items.geofence",
    "FencePolygon": "items.geofence",
    "Finding": "items.finding",
    "FlightConditions": "checks.energy",
    "ForecastWind": "checks.weather",
    "Frame": "items.altitude_frames",
    "Geofence": "items.geofence",
    "Home": "items.mission",
    "LegEnergy": "checks.energy",
    "Mission": "items.mission",
    "MissionDocument": "items.document",
    "MissionItem": "items.mission",
    "MissionOptions": "builder.mission_options",
    "Parameter": "items.parameters",
    "Point": "items.coordinates",
    "RallyPoint": "items.rally",
    "RallyPoints": "items.rally",
    "SteadyWind": "checks.weather",
    "WireItem": "autopilots.wire",
    "armed_mission": "builder.from_composition",
    "check": "checks.report",
    "diff": "autopilots.read_back",
    "family_named": "autopilots.registry",
    "leg_mission": "builder.from_composition",
    "read": "files.mission_file",
    "whole_mission": "builder.from_composition",
    "write": "files.mission_file",
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
    "diff",
    "family_named",
    "leg_mission",
    "read",
    "whole_mission",
    "write",
]


def __getattr__(name: str) -> object:
    """Import what is asked for, and no sooner: `from skyway import missions` costs nothing."""
    if name == "dialect":  # its name until 0.17
        name = "family_named"
    if name not in _HOMES:
        raise AttributeError(f"module 'missions' has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
