"""Missions: their items, files, checks and construction.

`read` and `write` files, `check` any mission, `diff` the mission sent with the mission read back, `leg_mission`,
`whole_mission` and `armed_mission` make missions of a composition, `family_named` returns all differences of one autopilot from the
others.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.base.lazy import exports

if TYPE_CHECKING:
    from skyway.missions.autopilots.family import Family as Dialect  # noqa: F401  its former name
    from skyway.missions.autopilots.family import Family as Family
    from skyway.missions.autopilots.read_back import Difference as Difference
    from skyway.missions.autopilots.read_back import diff as diff
    from skyway.missions.autopilots.registry import family_named as dialect  # noqa: F401  its former name
    from skyway.missions.autopilots.registry import family_named as family_named
    from skyway.missions.autopilots.wire import WireItem as WireItem
    from skyway.missions.builder.from_composition import Export as Export
    from skyway.missions.builder.from_composition import armed_mission as armed_mission
    from skyway.missions.builder.from_composition import leg_mission as leg_mission
    from skyway.missions.builder.from_composition import whole_mission as whole_mission
    from skyway.missions.builder.mission_options import MissionOptions as MissionOptions
    from skyway.missions.checks.energy import FlightConditions as FlightConditions
    from skyway.missions.checks.energy import LegEnergy as LegEnergy
    from skyway.missions.checks.report import CheckReport as CheckReport
    from skyway.missions.checks.report import check as check
    from skyway.missions.checks.weather import ForecastWind as ForecastWind
    from skyway.missions.checks.weather import SteadyWind as SteadyWind
    from skyway.missions.files.mission_file import read as read
    from skyway.missions.files.mission_file import write as write
    from skyway.missions.items.altitude_frames import Frame as Frame
    from skyway.missions.items.commands import Command as Command
    from skyway.missions.items.coordinates import Point as Point
    from skyway.missions.items.document import MissionDocument as MissionDocument
    from skyway.missions.items.finding import Finding as Finding
    from skyway.missions.items.geofence import FenceCircle as FenceCircle
    from skyway.missions.items.geofence import FencePolygon as FencePolygon
    from skyway.missions.items.geofence import Geofence as Geofence
    from skyway.missions.items.mission import Home as Home
    from skyway.missions.items.mission import Mission as Mission
    from skyway.missions.items.mission import MissionItem as MissionItem
    from skyway.missions.items.parameters import Parameter as Parameter
    from skyway.missions.items.rally import RallyPoint as RallyPoint
    from skyway.missions.items.rally import RallyPoints as RallyPoints

__all__, __getattr__ = exports(__name__)
