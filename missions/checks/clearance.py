"""Check of ground clearance at known ground heights: homes, landings, stations.

Between two places whose ground is known the vehicle must be above the higher one: the ground need not fall, or rise,
where the vehicle does. The required clearance is the mission's own: that over the two ends of the flight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.checks.near_stations import NearStations
from skyway.missions.items.altitude_frames import TERRAIN_FRAMES
from skyway.missions.items.commands import LAND_COMMANDS, TAKEOFF_COMMANDS
from skyway.missions.items.finding import Finding
from skyway.models.base import geodesy
from skyway.models.base.formatting import height_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from skyway.missions.checks.route import Route, RouteLeg, Step
    from skyway.missions.items.coordinates import Point
    from skyway.missions.items.finding import Severity
    from skyway.missions.items.mission import Mission
    from skyway.models.network.station import Station

SAME_PLACE_M = 20.0
STRAIGHT = 1.02
"""A way at most this much longer than the direct one counts as one segment."""
SLACK_M = 1.0
"""Heights are rounded, and grounds known only to about this."""


@dataclass(frozen=True, slots=True)
class Knot:
    """A place of one flight: item, height flown there (NaN: unknown), and ground where known, both above home."""

    item: int
    point: Point
    height_m: float
    ground_m: float | None


def check_clearance(mission: Mission, route: Route, stations: Sequence[Station]) -> Iterator[Finding]:
    """Check every flight between the places whose ground is known."""
    for leg, knots, _ in flights(mission, route, stations):
        yield from _check_flight(knots, _own_clearance(leg, knots))


def items_over_stations(mission: Mission, route: Route, stations: Sequence[Station]) -> frozenset[int]:
    """Items over known ground, whose height above it is judged here, not by the heights of the ends."""
    if not stations:
        return frozenset()
    known = (knot for _, knots, _ in flights(mission, route, stations) for knot in knots[1:])
    return frozenset(knot.item for knot in known if knot.ground_m)


def flights(
    mission: Mission, route: Route, stations: Sequence[Station]
) -> Iterator[tuple[RouteLeg, tuple[Knot, ...], float | None]]:
    """Yield each flight with its places, and the height of its home above the sea, if known."""
    near = NearStations(stations)
    start_m = 0.0
    home_m = mission.home.altitude_m if mission.home is not None else None
    for leg in route.legs:
        # height of home above sea level, for the comparison of the stations on the way with the heights
        at_start_m = near.ground_m(leg.start)
        zero_m = home_m if at_start_m is None else at_start_m - start_m
        yield leg, _knots(mission, leg, start_m, zero_m, near), zero_m
        start_m = next_ground_m(mission, leg)
        if leg.ground_hold_s is None:
            home_m = None  # home moves at the next arming, and only a station gives its height there


def _knots(
    mission: Mission, leg: RouteLeg, start_m: float, zero_m: float | None, near: NearStations
) -> tuple[Knot, ...]:
    """Return the places of a flight at the height that it passes them, from the end of the climb to the landing."""
    steps = leg.steps[:-1] if leg.landing == "return" else leg.steps  # the height of a return is the vehicle's own
    if leg.start is None or not steps:
        return ()
    landing_m = landing_ground_m(mission, leg)
    lat, lon = np.array([step.point.lat for step in steps]), np.array([step.point.lon for step in steps])
    from_start, _ = geodesy.inverse(leg.start.lat, leg.start.lon, lat, lon)
    to_end, _ = geodesy.inverse(lat[-1], lon[-1], lat, lon)
    knots = [Knot(steps[0].item, leg.start, _height_m(mission, steps[0]), start_m)]
    for index, step in enumerate(steps):
        lands = mission.items[step.item].command in LAND_COMMANDS
        ground = start_m if from_start[index] < SAME_PLACE_M else None
        if landing_m is not None and to_end[index] < SAME_PLACE_M:
            ground = landing_m
        at_station_m = None if zero_m is None else near.ground_m(step.point)
        if zero_m is not None and at_station_m is not None:
            ground = at_station_m - zero_m
        # the way to a landing is flown at the height before it, and then straight down
        height = knots[-1].height_m if lands else _height_m(mission, step)
        knots.append(Knot(step.item, step.point, height, ground))
    return tuple(knots)


def _height_m(mission: Mission, step: Step) -> float:
    """Height above home, NaN if it is above terrain: then it is clear by definition."""
    return math.nan if mission.items[step.item].frame in TERRAIN_FRAMES else step.height_m


def next_ground_m(mission: Mission, leg: RouteLeg) -> float:
    """Ground at the start of the next flight, in its own heights: 0 if home moved there, or nothing is known."""
    return (landing_ground_m(mission, leg) or 0.0) if leg.ground_hold_s is not None else 0.0


def landing_ground_m(mission: Mission, leg: RouteLeg) -> float | None:
    """Ground height of the landing, if its altitude gives it: many files have an arbitrary altitude there.

    Below zero it must be the ground; above, only if the vehicle descends to it vertically.
    """
    if leg.landing != "land" or not leg.steps:
        return None
    last = leg.steps[-1]
    if math.isnan(last.height_m) or mission.items[last.item].frame in TERRAIN_FRAMES:
        return None
    if last.height_m <= 0.0:
        return last.height_m
    before = leg.steps[-2] if len(leg.steps) > 1 else last
    above = mission.items[before.item].command not in (TAKEOFF_COMMANDS | LAND_COMMANDS)
    apart = geodesy.distance_m(before.point.lat, before.point.lon, last.point.lat, last.point.lon)
    comes_down = above and apart < SAME_PLACE_M and before.height_m - last.height_m >= SLACK_M
    return last.height_m if comes_down else None


def _own_clearance(leg: RouteLeg, knots: Sequence[Knot]) -> float:
    """Clearance that the mission keeps over known ground; 0 if an end is unknown."""
    if leg.landing != "land" or len(knots) < 2 or knots[1].ground_m is None or knots[-1].ground_m is None:
        return 0.0
    over = [knot.height_m - knot.ground_m for knot in knots[1:] if knot.ground_m is not None]
    return max(0.0, min(over)) if all(map(math.isfinite, over)) else 0.0


def _check_flight(knots: Sequence[Knot], own_m: float) -> Iterator[Finding]:
    """Judge each segment with an end of known ground; places on one straight line are one segment."""
    known = [index for index, knot in enumerate(knots) if knot.ground_m is not None]
    for first, last in pairwise(known):
        way = knots[first : last + 1]
        if not all(math.isfinite(knot.height_m) for knot in way):
            continue
        if _is_straight(way):
            yield from _check_segment(way, own_m)
        else:  # the ground between is unknown: it must not descend below the known end before it is elsewhere
            yield from _check_open_end(way[0], way[1])
            yield from _check_open_end(way[-1], way[-2])
    if known and known[-1] < len(knots) - 1:
        yield from _check_open_end(knots[known[-1]], knots[known[-1] + 1])


def _check_segment(way: Sequence[Knot], own_m: float) -> Iterator[Finding]:
    """Judge a straight way between two places of known ground."""
    grounds = [knot.ground_m for knot in (way[0], way[-1]) if knot.ground_m is not None]
    ground, slopes = max(grounds), max(grounds) - min(grounds) > SLACK_M
    lowest = min(way, key=lambda knot: knot.height_m)
    item = way[1].item if lowest is way[0] else lowest.item
    if lowest.height_m <= ground and (slopes or ground != 0.0):  # 0 to 0 is reported by the check of heights
        yield _finding("error", item, lowest.height_m, ground, own_m)
    elif slopes and lowest.height_m < ground + own_m - SLACK_M:
        yield _finding("warning", item, lowest.height_m, ground, own_m)


def _check_open_end(known: Knot, other: Knot) -> Iterator[Finding]:
    """Judge a way between a place of known ground and one of unknown ground."""
    ground = known.ground_m
    if ground and known.height_m <= ground:  # 0 is reported by the check of heights
        yield _finding("error", known.item, known.height_m, ground, 0.0)
    elif ground and other.height_m <= ground:
        yield _finding("warning", other.item, other.height_m, ground, 0.0)


def _finding(severity: Severity, item: int, height_m: float, ground_m: float, own_m: float) -> Finding:
    message = (
        f"flies at {height_text(height_m)} above home, and the ground at the higher end of this way is at {height_text(ground_m)}:"
        " it need not fall, or rise, where the vehicle does"
    )
    remedy = f"stay at {height_text(ground_m + own_m)} or higher between the two ends" if own_m else "fly higher"
    return Finding(severity, item, "below-clearance", message, remedy)


def _is_straight(way: Sequence[Knot]) -> bool:
    """Whether a way is one line in plan and in height: one segment, split or not."""
    if len(way) == 2:
        return True
    lat, lon = np.array([knot.point.lat for knot in way]), np.array([knot.point.lon for knot in way])
    steps, _ = geodesy.inverse(lat[:-1], lon[:-1], lat[1:], lon[1:])
    flown = np.insert(np.cumsum(steps), 0, 0.0)
    height = np.array([knot.height_m for knot in way])
    if flown[-1] > STRAIGHT * geodesy.distance_m(lat[0], lon[0], lat[-1], lon[-1]) + SAME_PLACE_M:
        return False
    even = height[0] + (height[-1] - height[0]) * flown / max(flown[-1], 1e-9)
    return bool(np.all(np.abs(height - even) <= SLACK_M))
