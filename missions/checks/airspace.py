"""Check of the route against the airspace: zones in three dimensions and in time, and the maximum height above ground."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.missions.checks.areas import MAX_FINDINGS, breach_findings, ways_to_rally
from skyway.missions.checks.clearance import Knot, flights
from skyway.missions.checks.terrain import homes_m
from skyway.missions.items.altitude_frames import TERRAIN_FRAMES
from skyway.missions.items.finding import Finding
from skyway.models.airspace.ways import Ways, at_any_height, columns, flown_at, together
from skyway.models.base import geodesy
from skyway.models.base.formatting import height_text

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from skyway.missions.checks.energy import LegEnergy
    from skyway.missions.checks.route import Route, RouteLeg
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.mission import Mission
    from skyway.models.airspace.airspace import Airspace
    from skyway.models.flight.way_heights import Over
    from skyway.models.network.station import Station

OPEN_S = 366 * 86_400.0
"""Longest duration of a hold that a person ends by arming, and of a flight of unknown length: later flights are tested over all of it."""
SAMPLE_M = 30.0
"""Sampling distance of the ground of a terrain model."""


class _Flight(NamedTuple):
    """The ways of one flight, the item that each leads to, and the time of flight, if known."""

    ways: Ways
    items: tuple[int, ...]
    from_s: float | None
    until_s: float | None


def check_airspace(
    document: MissionDocument,
    route: Route,
    zones: Airspace,
    stations: Sequence[Station],
    legs: Sequence[LegEnergy],
    *,
    depart_s: float | None = None,
    max_height_m: float = math.inf,
    over: Over | None = None,
) -> Iterator[Finding]:
    """Check every flight against the zones that are closed while it is flown, and against the greatest height above ground.

    The ground is that of the terrain model `over` which it is flown, otherwise that of the stations, and linear between.

    Without a departure zones count at all times. The straight ways to the nearest rally points count at all heights and times.
    """
    for flight in _flights(document.mission, route, stations, legs, depart_s, over):
        yield from _check_flight(flight, zones, max_height_m)
    ways = ways_to_rally(document, route)
    through = zones.crossed_by(at_any_height(ways[:, 0, 1], ways[:, 0, 0], ways[:, 1, 1], ways[:, 1, 0]))
    found = list(dict.fromkeys(route.steps[int(index)].item for index in np.flatnonzero(through)))
    if found:
        message = f"the straight way to the nearest rally point crosses a no-fly zone from {len(found)} items"
        yield Finding("warning", found[0], "divert-through-zone", message, "move the rally point, or add another")


def _check_flight(flight: _Flight, zones: Airspace, max_height_m: float) -> Iterator[Finding]:
    seen: dict[tuple[int, str], str] = {}
    for way, zone, _ in zones.conflicts(flight.ways, flight.from_s, flight.until_s):
        seen.setdefault((flight.items[way], zone.id), f"{zone.label}: {zone.kind}, active {zone.activation}")
    for (item, identity), what in list(seen.items())[:MAX_FINDINGS]:
        remedy = (
            f"go around it, or give --authorized {identity}"
            if ": authorization" in what
            else "go around it, or fly at another time"
        )
        yield Finding("error", item, "no-fly-zone", f"the way to this item crosses a no-fly zone: {what}", remedy)
    if len(seen) > MAX_FINDINGS:
        yield Finding("error", None, "no-fly-zone", f"so do {len(seen) - MAX_FINDINGS} more ways", "go around them")
    told = {
        zone.id: (flight.items[way], zone)
        for way, zone, _ in reversed(zones.told(flight.ways, flight.from_s, flight.until_s))
    }
    for item, zone in list(told.values())[:MAX_FINDINGS]:
        under = "with the authorization for" if zone.kind == "authorization" else "under the conditions of"
        said = f": {zone.message}" if zone.message else ""
        yield Finding(
            "info", item, "zone-conditions", f"the way to this item is flown {under} {zone.label}{said}", "keep to them"
        )
    most = min(zones.max_height_m, max_height_m)
    message = f"the way to this item is higher than {height_text(most)} above the ground"
    yield from breach_findings(
        flight.items, zones.too_high(flight.ways, max_height_m), "above-max-height", message, "fly lower there"
    )


def _flights(
    mission: Mission,
    route: Route,
    stations: Sequence[Station],
    legs: Sequence[LegEnergy],
    depart_s: float | None,
    over: Over | None,
) -> Iterator[_Flight]:
    begin_s, open_s = depart_s, 0.0
    homes: Sequence[float | None] = [None] * len(route.legs)
    if over is not None:
        homes, _ = homes_m(mission, route, over, stations)
    for (leg, knots, known_m), energy, over_m in zip(flights(mission, route, stations), legs, homes, strict=True):
        if energy.time_s is None:
            open_s = OPEN_S
        end_s = None if begin_s is None else begin_s + (energy.time_s or 0.0)
        if knots:
            zero_m = known_m if over_m is None else over_m
            ways, items = _ways(mission, leg, knots, math.nan if zero_m is None else zero_m, over)
            yield _Flight(ways, items, begin_s, None if end_s is None else end_s + open_s)
        if leg.ground_hold_s is None:
            open_s = OPEN_S
        begin_s = None if end_s is None else end_s + (leg.ground_hold_s or 0.0)


def _ways(
    mission: Mission, leg: RouteLeg, knots: Sequence[Knot], zero_m: float, over: Over | None
) -> tuple[Ways, tuple[int, ...]]:
    """Climb, level ways and slopes, and descent of a flight, with the item that each leads to."""
    lat, lon = np.array([knot.point.lat for knot in knots]), np.array([knot.point.lon for knot in knots])
    ground_m = _grounds(knots, lat, lon)
    terrain = np.array([mission.items[knot.item].frame in TERRAIN_FRAMES for knot in knots])
    clearance_m = np.array([mission.items[knot.item].z for knot in knots])
    if leg.landing == "land":  # the way to a landing is flown at the height before it
        terrain[-1], clearance_m[-1] = terrain[-2], clearance_m[-2]
    if not math.isfinite(zero_m):
        over = None
    if over is not None and terrain.any():
        below_m = over.terrain.ground_m(lat, lon) - zero_m
        ground_m = np.where(terrain & np.isfinite(below_m), below_m, ground_m)
    over_terrain = ground_m + clearance_m
    height_m = np.where(terrain, over_terrain, np.array([knot.height_m for knot in knots]))
    places = lat[:-1], lon[:-1], lat[1:], lon[1:]
    ways = flown_at(places, (height_m[:-1], height_m[1:]), (ground_m[:-1], ground_m[1:]))
    above_sea = flown_at(places, (zero_m + height_m[:-1], zero_m + height_m[1:]), (math.nan, math.nan))
    ways = ways._replace(low_m=above_sea.low_m, high_m=above_sea.high_m)
    if over is not None:
        low, high = _above_terrain(lat, lon, zero_m + height_m, over)
        ways = ways._replace(low_agl_m=low, high_agl_m=high)
        if terrain.any():
            lowest, highest = _above_terrain(lat, lon, np.zeros(len(lat)), over)
            ways = _following(ways, terrain[1:], clearance_m[1:], (-highest, -lowest), height_m[:-1] - ground_m[:-1])
    parts = [ways]
    items = [knot.item for knot in knots[1:]]
    ends = [0, len(knots) - 1] if leg.landing == "land" else [0]
    parts.append(columns(lat[ends], lon[ends], zero_m + ground_m[ends], height_m[ends] - ground_m[ends]))
    items += [knots[end].item for end in ends]
    if leg.landing == "return" and leg.steps:  # at the height set in the vehicle
        home, last = leg.steps[-1].point, knots[-1].point
        parts.append(at_any_height(np.array([last.lat]), np.array([last.lon]), home.lat, home.lon))
        items.append(leg.steps[-1].item)
    return together(*parts), tuple(items)


def _following(
    ways: Ways,
    follows: NDArray[np.bool_],
    clearance_m: NDArray[np.float64],
    ground_m: tuple[NDArray[np.float64], NDArray[np.float64]],
    begin_agl_m: NDArray[np.float64],
) -> Ways:
    """Return ways of which some follow the terrain at a clearance, given the lowest and the highest ground below each."""
    lowest, highest = ground_m
    return ways._replace(
        low_m=np.where(follows, np.minimum(ways.low_m, lowest + clearance_m), ways.low_m),
        high_m=np.where(follows, np.maximum(ways.high_m, highest + clearance_m), ways.high_m),
        low_agl_m=np.where(follows, np.minimum(begin_agl_m, clearance_m), ways.low_agl_m),
        high_agl_m=np.where(follows, np.maximum(begin_agl_m, clearance_m), ways.high_agl_m),
    )


def _above_terrain(
    lat: NDArray[np.float64], lon: NDArray[np.float64], height_m: NDArray[np.float64], over: Over
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least and greatest height above the ground of the terrain model on each piece of a way; infinite if it is unknown."""
    length_m, _ = geodesy.inverse(lat[:-1], lon[:-1], lat[1:], lon[1:])
    count = np.ceil(length_m / SAMPLE_M).astype(np.int64) + 2
    first = np.concatenate(([0], np.cumsum(count)[:-1]))
    of = np.repeat(np.arange(len(count)), count)
    share = (np.arange(count.sum()) - first[of]) / (count - 1)[of]
    east = (np.diff(lon) + 180.0) % 360.0 - 180.0
    at = lat[of] + share * np.diff(lat)[of], lon[of] + share * east[of]
    above = height_m[of] + share * np.diff(height_m)[of] - over.terrain.ground_m(*at)
    unknown = np.isnan(above)
    low = np.minimum.reduceat(np.where(unknown, -np.inf, above), first)
    return low, np.maximum.reduceat(np.where(unknown, np.inf, above), first)


def _grounds(knots: Sequence[Knot], lat: NDArray[np.float64], lon: NDArray[np.float64]) -> NDArray[np.float64]:
    """Ground above home at each place, interpolated linearly over unknown places."""
    steps = [geodesy.distance_m(*a, *b) for a, b in pairwise(zip(lat.tolist(), lon.tolist(), strict=True))]
    flown = np.insert(np.cumsum(steps), 0, 0.0)
    known = [i for i, knot in enumerate(knots) if knot.ground_m is not None]
    return np.asarray(np.interp(flown, flown[known], [knots[i].ground_m or 0.0 for i in known]))
