"""Check of heights over a terrain model: contact with ground or obstacle, and the clearance."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.missions.checks.limits import USUAL_CEILING_M
from skyway.missions.checks.near_stations import NearStations
from skyway.missions.items.altitude_frames import TERRAIN_FRAMES
from skyway.missions.items.commands import LAND_COMMANDS, TAKEOFF_COMMANDS, Command
from skyway.missions.items.finding import Finding
from skyway.models.base import geodesy
from skyway.models.base.formatting import distance_text, height_text, place_text
from skyway.models.composition.heights import LegHeights, NearObstacle, obstacles_told

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from skyway.missions.checks.route import Route, RouteLeg
    from skyway.missions.items.coordinates import Point
    from skyway.missions.items.mission import Mission
    from skyway.models.flight.way_heights import Over
    from skyway.models.network.station import Station

DIFFER_M = 15.0
"""A larger difference between the height of home and that of the terrain there is reported."""
SLACK_M = 1.0
"""Heights are rounded, and so are terrain models."""
MAX_SAMPLES = 200_000
_COLUMN_M = 0.5


class _Way(NamedTuple):
    """A flight sampled along its way; heights above mean sea level."""

    lat: NDArray[np.float64]
    lon: NDArray[np.float64]
    along_m: NDArray[np.float64]
    height_m: NDArray[np.float64]
    item: NDArray[np.int64]
    path: list[tuple[float, float]]
    """(along, height) of the points of the mission."""


def check_terrain(
    mission: Mission, route: Route, over: Over, stations: Sequence[Station]
) -> tuple[list[Finding], tuple[LegHeights | None, ...]]:
    """Judge every flight of a route over a terrain model; returns findings, and the heights of each flight for pictures."""
    homes, findings = homes_m(mission, route, over, stations)
    heights: list[LegHeights | None] = []
    for leg, zero_m in zip(route.legs, homes, strict=True):
        way = _way(mission, leg, over, zero_m)
        if way is None:
            heights.append(None)
            continue
        ground = over.terrain.ground_m(way.lat, way.lon)
        every_m = max(over.terrain.spacing_m, 5.0)
        top = over.terrain.top_m(way.lat, way.lon, over.clearance.radius_m + 0.5 * every_m)
        findings += _judged(way, ground, top, over)
        _, obstacle = over.terrain.obstacles_near(way.lat, way.lon, over.clearance.radius_m + 0.5 * every_m)
        heights.append(_told(way, ground, top, obstacles_told(way.along_m, obstacle, ground, over.terrain)))
    return findings, tuple(heights)


def homes_m(
    mission: Mission, route: Route, over: Over, stations: Sequence[Station]
) -> tuple[list[float], list[Finding]]:
    """Height above the sea of each flight's home, NaN if not given; and notes on it."""
    findings: list[Finding] = []
    homes: list[float] = []
    near = NearStations(stations)
    moved = True
    for number, leg in enumerate(route.legs):
        if moved:
            zero_m, told = _home_m(mission, leg, over, near, first=number == 0)
            findings += told
        homes.append(zero_m)
        moved = leg.ground_hold_s is None  # home moves at the next arming
    return homes, findings


def _home_m(
    mission: Mission, leg: RouteLeg, over: Over, near: NearStations, *, first: bool
) -> tuple[float, list[Finding]]:
    """Height above sea level of a flight's home, and notes on it.

    The file's home, or the station there; the terrain, if it contradicts that by much.
    """
    if leg.start is None:
        return math.nan, []
    ground = _ground_at(over, leg.start)
    home = mission.home.altitude_m if first and mission.home is not None else None
    said = near.ground_m(leg.start) if home is None else home
    if said is None or (math.isnan(ground) and home is None):
        return (ground if said is None else said), []
    if math.isnan(ground) or abs(said - ground) <= DIFFER_M:
        return said, []
    message = f"home is at {height_text(said)} in the file, but the ground there is at {height_text(ground)} in the terrain model, which is used"  # fmt: skip
    feet = abs(said * 0.3048 - ground) <= DIFFER_M or abs(said - ground * 0.3048) <= DIFFER_M
    remedy = "is one of them in feet?" if feet else "correct the height of home, or the terrain model"
    return ground, [Finding("warning", None, "home-off-terrain", message, remedy)]


def _ground_at(over: Over, point: Point) -> float:
    return float(over.terrain.ground_m(np.array([point.lat]), np.array([point.lon]))[0])


def _way(mission: Mission, leg: RouteLeg, over: Over, zero_m: float) -> _Way | None:
    """Sample a flight: vertical climbs and descents are omitted; None if nothing is known of it."""
    if leg.start is None or not leg.steps or math.isnan(zero_m):
        return None
    every_m = max(over.terrain.spacing_m, 5.0)
    at, height_m, flown_m = leg.start, math.nan, 0.0
    followed_m: float | None = None
    parts: list[tuple[NDArray[np.float64], ...]] = []
    path: list[tuple[float, float]] = []
    for step in leg.steps:
        command = mission.items[step.item].command
        above = mission.items[step.item].frame in TERRAIN_FRAMES
        length, bearing = (float(one) for one in geodesy.inverse(at.lat, at.lon, step.point.lat, step.point.lon))
        level = step.height_m + (_ground_at(over, step.point) if above else zero_m)
        begin, end = height_m, level
        if command in TAKEOFF_COMMANDS or math.isnan(begin):
            begin = level  # vertical climb first
        elif command in LAND_COMMANDS or command == Command.NAV_RETURN_TO_LAUNCH:
            end = begin  # vertical descent at the end
        if command not in LAND_COMMANDS:
            followed_m = step.height_m if above else None
        elif not above:
            followed_m = None
        if length > _COLUMN_M and math.isfinite(begin + end):
            count = min(math.ceil(length / every_m) + 1, MAX_SAMPLES)
            share = np.linspace(0.0, 1.0, count)
            lat, lon = geodesy.ahead(
                np.full(count, at.lat), np.full(count, at.lon), np.full(count, bearing), share * length
            )
            heights = begin + share * (end - begin)
            if followed_m is not None:
                heights = followed_m + over.terrain.ground_m(lat, lon)
            parts.append((lat, lon, flown_m + share * length, heights, np.full(count, float(step.item))))
            path += [(flown_m, float(heights[0])), (flown_m + length, float(heights[-1]))]
        flown_m += length
        at = step.point
        height_m = level
    if not parts or sum(len(part[0]) for part in parts) > 5 * MAX_SAMPLES:
        return None
    lat, lon, along, heights, item = (np.concatenate(one) for one in zip(*parts, strict=True))
    return _Way(lat, lon, along, heights, item.astype(np.int64), path)


def _judged(way: _Way, ground: NDArray[np.float64], top: NDArray[np.float64], over: Over) -> Iterator[Finding]:
    """Judge a flight: contacts, unknown ground, and places with less than the clearance."""
    unknown = np.flatnonzero(np.isnan(ground))
    if len(unknown):
        k = int(unknown[0])
        message = f"the ground is not known at {_place(way, k)}: a void of the terrain model, or beyond it"
        yield Finding(
            "error", int(way.item[k]), "terrain-unknown", message, "give a terrain model that covers the flight"
        )
    above = np.where(np.isnan(ground), -np.inf, way.height_m - ground)
    highest = int(np.argmax(above))
    if above[highest] > USUAL_CEILING_M + SLACK_M:
        message = f"{height_text(float(above[highest]))} above the ground at {_place(way, highest)}: most countries allow {height_text(USUAL_CEILING_M)}"
        yield Finding("info", int(way.item[highest]), "high", message, "needs a permit")
    obstacle, which = over.terrain.obstacles_near(way.lat, way.lon, over.clearance.position_error_m + 5.0)
    solid = np.fmax(ground, obstacle)
    left = np.where(np.isnan(solid), np.inf, way.height_m - solid)
    worst = int(np.argmin(left))
    if left[worst] <= 0.0:
        what = "the ground"
        if np.isfinite(obstacle[worst]) and obstacle[worst] > ground[worst]:
            what = f"the obstacle {over.terrain.obstacles.names[int(which[worst])]}"
        message = f"touches {what} at {_place(way, worst)}: flies at {height_text(float(way.height_m[worst]))}, and {what} reaches up to {height_text(float(solid[worst]))} above sea level"  # fmt: skip
        fly = height_text(math.ceil(over.clearance.least_m - float(left[worst])))
        yield Finding("error", int(way.item[worst]), "below-terrain", message, f"fly {fly} higher there")
        return
    over_top = np.where(np.isnan(top), np.inf, way.height_m - top)
    worst = int(np.argmin(over_top))
    if over_top[worst] < over.clearance.least_m - SLACK_M:
        radius = height_text(over.clearance.radius_m)
        message = f"is {_over_words(float(over_top[worst]))} the highest ground or obstacle within {radius} of {_place(way, worst)}"
        fly = height_text(math.ceil(over.clearance.least_m - float(over_top[worst])))
        remedy = f"fly {fly} higher there, for a clearance of {height_text(over.clearance.least_m)}"
        yield Finding("warning", int(way.item[worst]), "below-terrain-clearance", message, remedy)


def _over_words(metres: float) -> str:
    return f"{height_text(abs(metres))} {'above' if metres >= 0.0 else 'below'}"


def _place(way: _Way, k: int) -> str:
    return f"{place_text(float(way.lat[k]), float(way.lon[k]))}, {distance_text(float(way.along_m[k]))} along"


def _told(
    way: _Way, ground: NDArray[np.float64], top: NDArray[np.float64], obstacles: tuple[NearObstacle, ...]
) -> LegHeights | None:
    """Findings on a flight; None over unknown ground."""
    if np.isnan(ground).any() or np.isnan(top).any():
        return None
    return LegHeights.sampled(way.along_m, ground, top, way.height_m, way.path, obstacles)
