"""Legs: the one under way, and their missions, as planned and from any position in the air."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

from skyway.missions.builder.leg_builder import LegBuilder
from skyway.missions.items.commands import Command
from skyway.models.base import geodesy
from skyway.models.composition.service import Place

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from skyway.link.supervisor.journal.parts import Expected
    from skyway.link.supervisor.soc.modelled_use import ModelledUse
    from skyway.missions.autopilots.family import Family
    from skyway.missions.builder.mission_options import MissionOptions
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.mission import Home
    from skyway.missions.items.parameters import Parameter
    from skyway.models.composition.composition import Composition
    from skyway.models.composition.service import DroneService
    from skyway.models.scenario.scenario import Scenario


@dataclass(frozen=True, slots=True)
class LegMission:
    """The upload for one leg."""

    document: MissionDocument
    """Mission, fence and rally points."""
    parameters: tuple[Parameter, ...]
    """Parameters that the mission needs on the vehicle."""
    way: tuple[tuple[float, float], ...]
    """Its waypoints, latitude and longitude, with beginning and end."""


@dataclass(slots=True)
class Leg:
    """The leg under way."""

    origin: str
    destination: str
    """`origin`, `destination`: station ids; the origin is None for one begun in the air."""
    via: tuple[str, ...]
    """Stations overflown."""
    diverts: tuple[str, ...]
    """Divert stations inside its fence."""
    mission: LegMission
    """The mission that the vehicle flies."""
    commanded_mps: float
    """Ground speed of the last command."""
    commanded_s: float = math.nan
    """Time of that command, POSIX seconds."""
    start_s: float = math.nan
    soc_start: float = math.nan
    reported_start: float = math.nan
    planned_s: float = math.nan
    planned_soc: float = math.nan
    planned_soc_sd: float = math.nan
    """`start_s`, `soc_start`, `reported_start`, `planned_s`, `planned_soc`, `planned_soc_sd`: take-off, charge at that time, and as
    reported by the vehicle; planned flight time and charge at the landing, and the standard deviation of that."""
    modelled: ModelledUse | None = None
    """Modelled charge used so far."""
    last: bool = False
    """The leg ends at the destination of the delivery."""
    learns: bool = True
    """The energy of the whole flight is used for learning."""
    lookahead: Expected | None = None
    """Its last expectation."""

    @property
    def home_ground_m(self) -> float:
        """Ground above sea level from which heights of its mission count; NaN if unknown."""
        home = self.mission.document.mission.home
        return math.nan if home is None or home.altitude_m is None else home.altitude_m

    @property
    def top_m(self) -> float:
        """Greatest height above sea level of its mission; NaN if unknown."""
        items = self.mission.document.mission.items
        heights = (item.z for item in items if item.command is Command.NAV_WAYPOINT)
        return self.home_ground_m + max(heights, default=math.nan)

    def begin(self, time_s: float, soc: float, reported_soc: float) -> None:
        """Begin with the take-off."""
        self.start_s, self.soc_start, self.reported_start = time_s, soc, reported_soc
        self.commanded_s = time_s
        if self.modelled is not None:
            self.modelled.begin(time_s)

    def command(self, speed_mps: float, time_s: float) -> None:
        """Take a ground speed command of an instant, POSIX seconds."""
        self.commanded_mps, self.commanded_s = speed_mps, time_s

    def expect(self, lookahead: Expected) -> None:
        """Take the present expectation."""
        self.lookahead = lookahead

    def lose(self, soc: float) -> None:
        """Subtract charge that was lost, not used, from the charge at the start."""
        self.soc_start -= soc

    def lose_reported(self, soc: float) -> None:
        """Subtract a fall of the vehicle's report that is not consumption from its report at the start."""
        self.reported_start -= soc

    def learn_nothing(self) -> None:
        """Exclude the whole flight from learning: part of it was used already."""
        self.learns = False


def with_places(composition: Composition, scenario: Scenario, stations: Sequence[str]) -> Composition:
    """Return a plan with the positions of some more stations."""
    network = scenario.network
    more: dict[str, Place] = {}
    for name in stations:
        if name not in composition.stations and name in network.index:
            more[name] = Place.of(network.stations[network.index[name]])
    return replace(composition, stations={**composition.stations, **more}) if more else composition


def leaving(leg: Leg, back: Composition, now_s: float, hover_soc: float) -> Leg:
    """Return the rest of a leg that has released its package in the air: the first flight of the way back, under the same mission."""
    service = back.services[0]
    places = [back.stations[name] for name in (service.origin, *service.via, service.destination)]
    return replace(
        leg, origin=service.origin, destination=service.destination, via=service.via, diverts=service.diverts, last=False,
        mission=replace(leg.mission, way=tuple((place.lat, place.lon) for place in places)),
        commanded_mps=service.ground_speed_mps, commanded_s=now_s, lookahead=None, learns=False,
        planned_s=leg.planned_s + service.flight_time_s,
        planned_soc=leg.planned_soc - hover_soc - (service.soc_depart - service.soc_arrive),
    )  # fmt: skip


def plan_leg(
    composition: Composition,
    service: DroneService,
    family: Family,
    options: MissionOptions,
    *,
    last: bool,
    onward: DroneService | None = None,
) -> LegMission:
    """Build the mission of a leg that begins at a station; the last one releases the package, in the air on its way to the end of `onward`.

    The parameters allow the greatest ground speed of the plan, not only that of the leg: the speed is sent again in flight.
    """
    build = LegBuilder(composition, family, options)
    flown = build.flown_together(service, onward, last=last)
    build.check_elevations(flown)
    document = build.leg(service, last=last, onward=onward)
    needs = replace(build.needs(flown, document), ground_speed_mps=build.max_speed_mps)
    # a leg may be diverted to the destination in flight
    release = build.options.release
    needs = replace(needs, uses_gripper=release in ("gripper", "place"), uses_winch=release == "winch")
    places = [build.place(name) for name in (service.origin, *service.via, service.destination)]
    way = tuple((place.lat, place.lon) for place in places)
    return LegMission(document, build.dialect.parameters(needs), way)


def turn_leg(
    composition: Composition,
    station: str,
    here: tuple[float, float, float],
    home_ground_m: float,
    speed_mps: float,
    family: Family,
    options: MissionOptions,
    *,
    last: bool,
    home: Home | None,
    onward: DroneService | None = None,
) -> LegMission:
    """Build the mission from the air to a station: heights count from the home of the present leg.

    `here` is where the vehicle is (lat, lon, height above home); see `LegBuilder.turn`.
    """
    build = LegBuilder(composition, family, options)
    place = build.place(station)
    document = build.turn(station, here, home_ground_m, speed_mps, last=last, home=home, onward=onward)
    return LegMission(document, (), (here[:2], (place.lat, place.lon)))


def cross_track_m(way: Sequence[tuple[float, float]], lat: float, lon: float) -> float:
    """Distance of a point from a route, metres."""
    import numpy as np

    north, east = geodesy.local_offsets_m([p[0] for p in way], [p[1] for p in way], lat, lon)
    points = np.column_stack((north, east))
    best = float(np.hypot(*points.T).min())
    for a, b in pairwise(points):
        along = b - a
        square = float(along @ along)
        if square > 0.0:
            share = min(max(float(-a @ along) / square, 0.0), 1.0)
            best = min(best, float(np.hypot(*(a + share * along))))
    return best


def waypoint_m(leg: Leg, lat: float, lon: float) -> float:
    """Distance of a point from the nearest waypoint of a leg's mission, metres; infinite if it has none."""
    items = leg.mission.document.mission.items
    points = [one.point for one in items if one.command is Command.NAV_WAYPOINT and one.point is not None]
    if not points:
        return math.inf
    north, east = geodesy.local_offsets_m([p.lat for p in points], [p.lon for p in points], lat, lon)
    return min(map(math.hypot, north.tolist(), east.tolist()))


def station_at(stations: Mapping[str, Place], lat: float, lon: float, within_m: float) -> str | None:
    """Name the nearest of some places within a distance, or None."""
    names = list(stations)
    if not names:
        return None
    distance, _ = geodesy.inverse(lat, lon, [stations[n].lat for n in names], [stations[n].lon for n in names])
    nearest = int(distance.argmin())
    return names[nearest] if float(distance[nearest]) <= within_m else None
