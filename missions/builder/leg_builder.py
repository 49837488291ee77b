"""Builder of the items, fence and rally points of one leg, for one autopilot.

The heights of a leg are those of `models.flight.way_heights`: the vehicle climbs straight above the station of take-off, flies from
knot to knot, and lands straight down. Heights in items count from home: the site of the last arming.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.builder.corridor import corridor
from skyway.missions.builder.mission_options import MAX_GROUND_SPEED_MPS
from skyway.missions.builder.release_items import released_on_way
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.course import pieces
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.geofence import Geofence
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.missions.items.parameters import FlightNeeds
from skyway.missions.items.rally import RallyPoint, RallyPoints
from skyway.models.base import geodesy
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.formatting import place_text, speed_text
from skyway.models.composition.release import hovers
from skyway.models.flight.way_heights import Knot, level_over_m, level_within_m, way_heights

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from skyway.missions.autopilots.family import Family
    from skyway.missions.builder.mission_options import MissionOptions
    from skyway.models.composition.composition import Composition
    from skyway.models.composition.service import DroneService, Place
    from skyway.models.flight.way_heights import Over, WayHeights

MAV_TYPE_QUADROTOR = 2
GROUND_SPEED = 1.0
"""Speed type of DO_CHANGE_SPEED; multirotors hold ground speed whatever its value."""
NO_THROTTLE_CHANGE = -1.0
GRIPPER_RELEASE = 0.0


class LegBuilder:
    """Makes the parts of missions from one composition."""

    def __init__(self, composition: Composition, dialect: Family, options: MissionOptions) -> None:
        self.composition = composition
        self.dialect = dialect
        self.options = options
        self.cruise_height_m = options.cruise_height_m or composition.cruise_height_m
        self.climb_rate_mps = options.climb_rate_mps or composition.climb_rate_mps
        self.descent_rate_mps = options.descent_rate_mps or composition.descent_rate_mps
        self.max_speed_mps = min(
            options.max_ground_speed_mps or math.inf, composition.max_ground_speed_mps, MAX_GROUND_SPEED_MPS
        )
        self.over = self._terrain()

    def _terrain(self) -> Over | None:
        """Terrain model with the required clearance over it: in the wider of its corridor and the fence."""
        over, planned = self.options.over, self.composition.terrain
        if over is None:
            if planned is None:
                return None
            problem = "the plan was made over a terrain model, which is not given"
            files = ", ".join(planned.files)
            raise InputError(Fault(problem, field="terrain", value=files, remedy="give it with --terrain"))
        clearance = over.clearance if planned is None else planned.clearance
        wide = max(clearance.corridor_width_m, self.options.corridor_width_m or 0.0)
        return replace(over, clearance=replace(clearance, corridor_width_m=wide), cruise_height_m=self.cruise_height_m)

    def place(self, station: str) -> Place:
        """Return the place of a station."""
        return self.composition.stations[station]

    def ground_m(self, station: str) -> float:
        """Ground height of a station; an `InputError` if it is unknown."""
        known = self.options.elevation_m.get(station, self.place(station).elevation_m)
        if known is None and self.over is not None:
            place = self.place(station)
            found = float(self.over.terrain.ground_m(np.array([place.lat]), np.array([place.lon]))[0])
            known = found if math.isfinite(found) else None
        if known is None:
            raise InputError(
                Fault(
                    "the ground height is unknown, so heights above it cannot be computed",
                    field=f"stations[{station}].elevation_m",
                    remedy=f"add elevation_m to the station, or give --elevation {station}=METRES",
                )
            )
        return known

    def speed_mps(self, service: DroneService) -> float:
        """Return the commanded ground speed of a leg."""
        return min(service.ground_speed_mps, self.max_speed_mps)

    def check_elevations(self, services: Sequence[DroneService]) -> None:
        """Refuse with every station whose ground height is missing, not only the first."""
        named = dict.fromkeys(station for s in services for station in (s.origin, *s.via, s.destination, *s.diverts))
        faults: list[Fault] = []
        for station in named:
            try:
                self.ground_m(station)
            except InputError as error:
                faults += error.faults
        if faults:
            raise InputError(faults)

    def position(self, command: Command, station: str, height_m: float) -> MissionItem:
        """An item at a station, with yaw left to the vehicle."""
        place = self.place(station)
        return self._positioned(command, place.lat, place.lon, height_m)

    def _positioned(self, command: Command, lat: float, lon: float, height_m: float) -> MissionItem:
        point = Point.of_degrees(lat, lon)
        return MissionItem(
            command,
            Frame.GLOBAL_RELATIVE_ALT,
            param4=self.dialect.open_yaw_deg,
            x=point.lat_e7,
            y=point.lon_e7,
            z=round(height_m, 2),
        )

    def heights(self, service: DroneService) -> WayHeights:
        """Flight heights of a leg. Raises an `InputError` if the ground below is unknown."""
        stations = (service.origin, *service.via, service.destination)
        places = [(self.place(station).lat, self.place(station).lon) for station in stations]
        least = [self.place(station).least for station in stations]
        ground_m = [self.ground_m(station) for station in stations]
        found = way_heights(places, ground_m, self.cruise_height_m, self.over, least)
        if found.unknown is not None:
            problem = f"leg {service.origin} to {service.destination}: the ground height is unknown"
            remedy = "give a terrain model that covers the leg: there is a void, or the leg leaves the model"
            raise InputError(Fault(problem, field="terrain", value=place_text(*found.unknown), remedy=remedy))
        return found

    def above(self, service: DroneService, home_ground_m: float) -> MissionItem:
        """Return the waypoint that ends the climb, straight above the origin."""
        height = self.heights(service).knots[0].height_m - home_ground_m
        return self.position(Command.NAV_WAYPOINT, service.origin, height)

    def speed(self, speed_mps: float) -> MissionItem:
        """Return the item that commands a ground speed."""
        return MissionItem(
            Command.DO_CHANGE_SPEED, Frame.MISSION, GROUND_SPEED, round(speed_mps, 2), NO_THROTTLE_CHANGE
        )

    def way(self, service: DroneService, home_ground_m: float) -> list[MissionItem]:
        """Speed item, overflown stations and approach, then LAND."""
        items = [self.speed(self.speed_mps(service))]
        segments = list(self._segments(service))
        before, *knots = self.heights(service).knots
        for knot in knots:
            if knot.segment != before.segment:
                before = Knot(knot.segment, 0.0, before.height_m)
            from_m, to_m = before.height_m - home_ground_m, knot.height_m - home_ground_m
            span = knot.share - before.share
            for lat, lon, share in segments[knot.segment]:
                if before.share < share < knot.share:
                    height = from_m + (share - before.share) / span * (to_m - from_m)
                    items.append(self._positioned(Command.NAV_WAYPOINT, lat, lon, height))
            if knot != before:
                items.append(self._positioned(Command.NAV_WAYPOINT, *self._at(service, knot), to_m))
            before = knot
        land_height = self.ground_m(service.destination) - home_ground_m
        items.append(self.position(Command.NAV_LAND, service.destination, land_height))
        return items

    def _at(self, service: DroneService, knot: Knot) -> tuple[float, float]:
        """Position of a knot of a leg."""
        stations = (service.origin, *service.via, service.destination)
        start, end = (self.place(one) for one in stations[knot.segment : knot.segment + 2])
        if knot.share in (0.0, 1.0):
            return (start.lat, start.lon) if knot.share == 0.0 else (end.lat, end.lon)
        length, bearing = geodesy.inverse(start.lat, start.lon, end.lat, end.lon)
        return geodesy.direct(start.lat, start.lon, float(bearing), knot.share * float(length))

    def _segments(self, service: DroneService) -> Iterator[list[tuple[float, float, float]]]:
        """Yield the points along each segment of a leg, the end included, with the fraction of its length."""
        places = [self.place(station) for station in (service.origin, *service.via, service.destination)]
        for start, end in pairwise(places):
            yield list(pieces(start.lat, start.lon, end.lat, end.lon))

    def departure(self, service: DroneService, home_ground_m: float) -> list[MissionItem]:
        """TAKEOFF and the end of the climb."""
        above = self.above(service, home_ground_m)
        return [replace(above, command=Command.NAV_TAKEOFF), above]

    def leg(self, service: DroneService, *, last: bool, onward: DroneService | None = None) -> MissionDocument:
        """Return one leg as a separate mission, heights above the ground at its take-off; the last one delivers.

        If the package is released in the air it continues with the flight `onward`, and lands where that does.
        """
        ground = self.ground_m(service.origin)
        items = [*self.departure(service, ground), *self.way(service, ground)]
        if last:
            items = self.delivered(items, service.destination, ground, onward)
        mission = self.mission(items, self.home(service.origin))
        services = self.flown_together(service, onward, last=last)
        return MissionDocument(mission, self.fence(services), self.rally(services, ground))

    def flown_together(
        self, service: DroneService, onward: DroneService | None, *, last: bool
    ) -> tuple[DroneService, ...]:
        """Return the flights of one mission: a leg, and that from a target on where it does not land."""
        together = last and onward is not None and hovers(self.options.release)
        return (service, onward) if together and onward is not None else (service,)

    def delivered(
        self, items: list[MissionItem], station: str, home_ground_m: float, onward: DroneService | None
    ) -> list[MissionItem]:
        """Return the items of a way to the target, which end with LAND, with the release; a release in the air replaces LAND."""
        if not hovers(self.options.release):
            return [*items, *self.delivery()]
        return [*items[:-1], *released_on_way(self, station, home_ground_m, onward)]

    def turn(
        self,
        station: str,
        here: tuple[float, float, float],
        home_ground_m: float,
        speed_mps: float,
        *,
        last: bool,
        home: Home | None,
        onward: DroneService | None = None,
    ) -> MissionDocument:
        """Return the mission from the air to a station: level, and nowhere below the vehicle's present height.

        It begins with a waypoint at the vehicle's position (`here`: latitude, longitude, height above home), never with a
        TAKEOFF, which PX4 would fly back to. Home is where the leg under way began, with its ground height; the station
        is the `last` if the delivery ends there.
        """
        ground = self.ground_m(station) - home_ground_m
        lat, lon, height_m = here
        # above home as well: the vehicle may still be climbing there, or have descended towards a lower destination
        top = max(height_m, max(ground, 0.0) + self.cruise_height_m)
        if self.over is not None:
            place = np.array([self.place(station).lat]), np.array([self.place(station).lon])
            level = float(level_over_m((lat, lon), *place, self.over)[0]) - home_ground_m
            top = max(top, level) if math.isfinite(level) else top  # over unknown ground there is no better estimate
        items = [
            self._positioned(Command.NAV_WAYPOINT, lat, lon, top),
            self.speed(min(speed_mps, self.max_speed_mps)),
            self.position(Command.NAV_WAYPOINT, station, top),
            self.position(Command.NAV_LAND, station, ground),
        ]
        if last:
            items = self.delivered(items, station, home_ground_m, onward)
        return MissionDocument(self.mission(items, home or self.home(station)))

    def delivery(self) -> list[MissionItem]:
        """Items after the landing at the target: release and disarm."""
        return [*self.release(), *self.dialect.disarm()]

    def release(self) -> list[MissionItem]:
        """Release of the package; nothing if a person does it, after the vehicle has disarmed."""
        if self.options.release == "hand":
            return []
        return [MissionItem(Command.DO_GRIPPER, Frame.MISSION, float(self.options.gripper), GRIPPER_RELEASE)]

    def fence(self, services: Sequence[DroneService]) -> Geofence:
        """Return the corridor around these legs and the ways to their divert stations."""
        if self.options.corridor_width_m is None:
            return Geofence()
        route: list[tuple[float, float]] = []
        diverts: list[tuple[list[tuple[float, float]], tuple[float, float]]] = []
        for service in services:
            origin = self.place(service.origin)
            points = [(lat, lon) for segment in self._segments(service) for lat, lon, _ in segment]
            part = [(origin.lat, origin.lon), *points]
            route += part
            for station in service.diverts:
                place = self.place(station)
                diverts.append((part, (place.lat, place.lon)))
        return Geofence((corridor(route, diverts, width_m=self.options.corridor_width_m),))

    def rally(self, services: Sequence[DroneService], lowest_home_m: float) -> RallyPoints:
        """Divert stations at the heights of their legs, from the lowest home of the mission.

        A vehicle may turn to one from anywhere on a leg: the way there clears both ends of the leg too.
        """
        levels = self._divert_levels_m(services)
        points = []
        for station, level in levels.items():
            place = self.place(station)
            points.append(RallyPoint(Point.of_degrees(place.lat, place.lon), round(level - lowest_home_m, 2)))
        return RallyPoints(tuple(points))

    def _divert_levels_m(self, services: Sequence[DroneService]) -> dict[str, float]:
        """Height above sea level that clears the ways from anywhere on these legs to each of their divert stations."""
        levels: dict[str, float] = {}
        for service in services:
            stations = (service.origin, *service.via, service.destination)
            ends = max(self.ground_m(name) for name in stations)
            for divert in service.diverts:
                level = max(ends, self.ground_m(divert)) + self.cruise_height_m
                for pair in pairwise(stations):
                    level = max(level, self._level_within_m((*pair, divert)))
                levels[divert] = max(levels.get(divert, -math.inf), level)
        return levels

    def _level_within_m(self, stations: Sequence[str]) -> float:
        """Height above sea level that clears any straight way between these stations; no height where it is unknown."""
        if self.over is None:
            return -math.inf
        level = level_within_m([(self.place(one).lat, self.place(one).lon) for one in stations], self.over)
        return level if math.isfinite(level) else -math.inf

    def home(self, station: str) -> Home:
        """Return the home of a mission that begins at a station."""
        place = self.place(station)
        return Home(Point.of_degrees(place.lat, place.lon), self.ground_m(station))

    def mission(self, items: Sequence[MissionItem], home: Home) -> Mission:
        """Return the mission of these items, with the fields that ground stations require."""
        speed = max(self.speed_mps(service) for service in self.composition.services)
        return Mission(
            tuple(items),
            home,
            round(speed, 2),
            round(speed, 2),
            self.dialect.firmware,
            MAV_TYPE_QUADROTOR,
        )

    def needs(self, services: Sequence[DroneService], document: MissionDocument) -> FlightNeeds:
        """Return the vehicle settings that a mission of these legs requires."""
        grounds = [
            self.ground_m(station) for s in services for station in (s.origin, *s.via, s.destination, *s.diverts)
        ]
        commands = [item.command for item in document.mission.items]
        highest = max(grounds) + self.cruise_height_m
        if self.over is not None:
            ways = [self._level_within_m((s.origin, *s.via, s.destination)) for s in services]
            highest = max(highest, *ways, *self._divert_levels_m(services).values())
        landing = commands.index(Command.NAV_LAND) if Command.NAV_LAND in commands else len(commands)
        return FlightNeeds(
            ground_speed_mps=max(self.speed_mps(service) for service in services),
            climb_rate_mps=self.climb_rate_mps,
            descent_rate_mps=self.descent_rate_mps,
            return_height_m=math.ceil(highest - min(grounds)),
            fenced=bool(document.fence),
            has_rally_points=len(document.rally) > 0,
            continues_after_landing=landing < len(commands) - 1,
            stays_armed=Command.NAV_DELAY in commands,
            uses_gripper=Command.DO_GRIPPER in commands or Command.NAV_PAYLOAD_PLACE in commands,
            uses_winch=Command.DO_WINCH in commands,
        )

    def warnings(self, services: Sequence[DroneService]) -> tuple[str, ...]:
        """Return warnings on these legs for the operator."""
        found = [
            f"leg {service.origin} to {service.destination} is planned at {speed_text(service.ground_speed_mps)} and"
            f" commanded at {speed_text(self.speed_mps(service))}: it takes longer than planned"
            for service in services
            if service.ground_speed_mps > self.speed_mps(service) + 0.01
        ]
        if hovers(self.options.release):
            found.append(
                "the drone does not land at the target, and a package that stays on board flies on with it; the mission does not contain the commands of a winch or a payload place"
            )
        if self.options.release == "hand":
            found.append("the package is released by a person after the landing at the target: confirm it in skyway")
        return tuple(found)
