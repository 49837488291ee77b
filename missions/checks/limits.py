"""Check of speeds, distances and heights against the limits of vehicles."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.checks.clearance import items_over_stations, next_ground_m
from skyway.missions.items.altitude_frames import RELATIVE_FRAMES, TERRAIN_FRAMES, Frame
from skyway.missions.items.commands import LAND_COMMANDS, TAKEOFF_COMMANDS, Command
from skyway.missions.items.finding import Finding
from skyway.models.base import geodesy
from skyway.models.base.formatting import distance_text, height_text
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from skyway.missions.checks.route import Route, RouteLeg, Step
    from skyway.missions.items.coordinates import Point
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.mission import Mission, MissionItem
    from skyway.models.drones.drone import Drone
    from skyway.models.network.station import Station

AUTOPILOT_MAX_SPEED_MPS = 20.0
FAR_FROM_HOME_M = 10_000.0
"""PX4 refuses a first position farther away (MIS_DIST_1WP)."""
FAR_RALLY_M = 5_000.0
"""A rally point farther than this from the whole route is reported."""
USUAL_CEILING_M = 120.0
"""Height above ground allowed in most countries without a permit."""
LOW_TAKEOFF_M = 3.0
"""PX4 requires a take-off height of its acceptance radius (2 m) and 1 m more."""
_ABOVE_HERE = RELATIVE_FRAMES | {Frame.GLOBAL_TERRAIN_ALT}
_CANDIDATES = 8


def check_speeds(mission: Mission, drone: Drone) -> Iterator[Finding]:
    """Check every speed item against the limits of the vehicle and the autopilots."""
    limit = min(AUTOPILOT_MAX_SPEED_MPS, drone.max_ground_speed_mps)
    for number, item in enumerate(mission.items):
        if item.command != Command.DO_CHANGE_SPEED or item.param1 not in (0.0, 1.0):
            continue
        if item.param2 > limit:
            message = f"orders {item.param2:g} m/s, and the vehicle flies at most {limit:g} m/s over ground"
            yield Finding("error", number, "speed-limit", message, f"order at most {limit:g} m/s")
        elif math.isnan(item.param2) or item.param2 == 0:
            yield Finding("warning", number, "speed-missing", "commands no speed", "give a speed in m/s")


def check_home_distance(mission: Mission, route: Route) -> Iterator[Finding]:
    """Check the way to the first position, and that it is known where it begins."""
    steps = route.steps
    home = mission.home
    if home is None:
        yield from _home_unknown(mission, route)
    elif steps:
        first = steps[0]
        away = geodesy.distance_m(home.point.lat, home.point.lon, first.point.lat, first.point.lon)
        if away > FAR_FROM_HOME_M:
            message = f"the first position is {distance_text(away)} from the planned home: PX4 refuses more than 10 km"
            yield Finding("warning", first.item, "far-from-home", message, "correct the home, or the position")


def _home_unknown(mission: Mission, route: Route) -> Iterator[Finding]:
    """Tell what the ways from home and back are taken to be where the file does not say where home is."""
    if not route.steps:
        return
    first = route.steps[0]
    if mission.items[first.item].command in TAKEOFF_COMMANDS:
        if any(leg.landing == "return" for leg in route.legs):
            message = "home is not in the file: the flight is taken to return to the place of its first TAKEOFF"
            yield Finding("info", first.item, "home-unknown", message, "set the planned home")
    elif any(item.command in (*TAKEOFF_COMMANDS, Command.NAV_RETURN_TO_LAUNCH) for item in mission.items):
        message = "home is not in the file: it is taken to be at this first position, and the way there is not counted"
        yield Finding("warning", first.item, "home-unknown", message, "set the planned home")


def check_rally_distances(document: MissionDocument, route: Route) -> Iterator[Finding]:
    """Report rally points far from the whole route, with the distance."""
    steps, rally = route.steps, document.rally.points
    if not steps or not rally:
        return
    nearest, away = _nearest([point.point for point in rally], [step.point for step in steps])
    longest = max(_length_m(leg) for leg in route.legs)
    for number in np.flatnonzero(away > FAR_RALLY_M).tolist():
        distance = float(away[number])
        message = (
            f"rally point {number} is {distance_text(distance)} from here, the nearest place of the mission: a vehicle"
            " that goes there needs the energy for it"
        )
        yield Finding(
            "warning" if distance > longest else "info",
            steps[nearest[number]].item,
            "rally-far",
            message,
            "put a rally point near the route",
        )


def _nearest(points: Sequence[Point], places: Sequence[Point]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return for each point the nearest place, the first of equals, and its distance, m.

    Candidates are nearest by the chord, which orders places like the geodesic except for near ties.
    """
    from scipy.spatial import cKDTree  # imported late: 0.2 s

    here, there = (np.array([(p.lat, p.lon) for p in group]) for group in (points, places))
    there, first = np.unique(there, axis=0, return_index=True)
    count = min(_CANDIDATES, len(there))
    tree = cKDTree(geodesy.earth_xyz(there))
    found = tree.query(geodesy.earth_xyz(here), k=count)[1].reshape(len(here), count)
    away, _ = geodesy.inverse(here[:, :1], here[:, 1:], there[found, 0], there[found, 1])
    best = np.argmin(away, axis=1)
    rows = np.arange(len(here))
    return first[found[rows, best]], away[rows, best]


def _length_m(leg: RouteLeg) -> float:
    places = [*([leg.start] if leg.start else []), *(step.point for step in leg.steps)]
    lat, lon = np.array([p.lat for p in places]), np.array([p.lon for p in places])
    return float(geodesy.inverse(lat[:-1], lon[:-1], lat[1:], lon[1:])[0].sum()) if len(places) > 1 else 0.0


def check_reach(route: Route, drone: Drone) -> Iterator[Finding]:
    """Check for segments that are too long for any battery."""
    steps = route.steps
    if not steps:
        return
    lat = np.array([step.point.lat for step in steps])
    lon = np.array([step.point.lon for step in steps])
    length, _ = geodesy.inverse(lat[:-1], lon[:-1], lat[1:], lon[1:])
    reach = drone.endurance_empty_s * drone.max_airspeed_mps
    for index in np.flatnonzero(length > reach)[:20]:
        message = (
            f"is {distance_text(length[index])} from the position before, beyond the range of the vehicle"
            f" ({distance_text(reach)})"
        )
        here, there = steps[index].point, steps[index + 1].point
        exchanged = abs(there.lon) <= 90.0 and geodesy.distance_m(here.lat, here.lon, there.lon, there.lat) <= reach
        remedy = "correct the coordinates, or land and recharge between"
        if exchanged:
            remedy = "latitude and longitude look exchanged: correct the coordinates"
        yield Finding("error", steps[index + 1].item, "too-far", message, remedy)


def check_heights(mission: Mission, route: Route, stations: Sequence[Station] = ()) -> Iterator[Finding]:
    """Check heights above home, take-off heights, and references that cannot be resolved."""
    over_stations = items_over_stations(mission, route, stations)
    known_ground = mission.home is not None and mission.home.altitude_m is not None
    seen: set[int] = set()
    absolute: list[int] = []
    start_m = 0.0
    for leg in route.legs:
        lowest_m = min(start_m, _lowest_ground_m(leg))
        leaves_m, start_m = start_m, next_ground_m(mission, leg)
        for step in leg.steps:
            if step.item in seen:
                continue
            seen.add(step.item)
            if not math.isnan(step.height_m):
                known = step.item in over_stations
                yield from _height(step, mission.items[step.item], leaves_m, -math.inf if known else lowest_m)
            elif (
                not known_ground and mission.items[step.item].is_located and not math.isnan(mission.items[step.item].z)
            ):
                absolute.append(step.item)
    for number, item in enumerate(mission.items):
        # a take-off at the vehicle's position, whose place is not in the file
        if (
            item.command in TAKEOFF_COMMANDS
            and item.frame in _ABOVE_HERE
            and number not in seen
            and item.z < LOW_TAKEOFF_M
        ):
            yield _too_low(number, item.z)
    if absolute:
        message = f"{counted(len(absolute), 'height')} above sea level, and the height of home is unknown: not checked, and climbs not counted"
        yield Finding("info", absolute[0], "height-reference", message, "give the altitude of the planned home")


def _lowest_ground_m(leg: RouteLeg) -> float:
    """Height above home of the lower end of a flight: 0, or where it lands."""
    end = leg.steps[-1].height_m if leg.steps and leg.landing == "land" else 0.0
    return min(0.0, end) if math.isfinite(end) else 0.0


def _too_low(number: int, height_m: float) -> Finding:
    message = f"takes off to {height_m:g} m: PX4 refuses less than {LOW_TAKEOFF_M:g} m"
    return Finding("error", number, "takeoff-too-low", message, "climb higher")


def _height(step: Step, item: MissionItem, leaves_m: float, lowest_m: float) -> Iterator[Finding]:
    flies_on = item.command not in LAND_COMMANDS and item.command != Command.NAV_RETURN_TO_LAUNCH
    if item.command in TAKEOFF_COMMANDS and step.height_m < leaves_m + LOW_TAKEOFF_M:
        yield _too_low(step.item, step.height_m - leaves_m)
    elif flies_on and step.height_m <= lowest_m:
        message = f"{item.name} at {step.height_m:g} m above home is not above the ground at either end of the flight"
        yield Finding("warning", step.item, "not-above-ground", message, "correct only if the ground is lower there")
    elif step.height_m > USUAL_CEILING_M and item.frame not in TERRAIN_FRAMES:
        message = f"{height_text(step.height_m)} above home: most countries allow {height_text(USUAL_CEILING_M)}"
        yield Finding("info", step.item, "high", message, "needs a permit, unless the ground is higher there")
