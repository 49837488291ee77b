"""Ways between the work and the pads: their heights, whether they may be flown, and their time and energy.

A way to a pad climbs at the point where the work is left to a height that is safe all along, is level, and comes down on the pad; the
way back is the reverse. The safe height is the greatest of the mission's height, the requested height above the pad's
ground, and the height required by a terrain model. The way is straight; if that leaves the fence or enters a zone, it bends around that, or there is none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.checks.areas import leaves_fence
from skyway.missions.checks.hops import SAME_PLACE_M, Hops
from skyway.missions.checks.manoeuvres import LIFT_OFF_S, TOUCH_DOWN_S, turn_s
from skyway.missions.items.altitude_frames import TERRAIN_FRAMES
from skyway.missions.recharge.bent_ways import BentWays
from skyway.models.base import geodesy
from skyway.models.base.errors import Fault, InputError
from skyway.models.flight.way_heights import level_over_m

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.missions.autopilots.family import Family
    from skyway.missions.checks.energy import FlightConditions
    from skyway.missions.items.document import MissionDocument
    from skyway.missions.recharge.bent_ways import Via
    from skyway.missions.recharge.work import Work
    from skyway.models.airspace.airspace import Airspace
    from skyway.models.flight.way_heights import Over
    from skyway.models.network.station import Station

STEADY_S = 5.0
"""Time in which a vehicle stands still where the work continues, so that it starts exactly there."""
LOWEST_M = 20.0
"""Least height of a way above the ground of a pad."""


@dataclass(frozen=True, slots=True)
class TransitRules:
    """Options of ways to pads."""

    speed_mps: float
    """Over the ground."""
    height_m: float | None = None
    """Least height above home; without one the greatest height of the mission."""
    over: Over | None = None
    """Terrain model that they are flown over."""
    zones: Airspace | None = None


@dataclass(frozen=True, eq=False, slots=True)
class PadWays:
    """Pads, and the ways between them and the points of the work."""

    pads: tuple[Station, ...]
    ground_m: tuple[float, ...]
    """Of each pad, above the home of the mission."""
    level_m: NDArray[np.float64]
    """Shape (points, pads). Height above home of the way; NaN if there is none."""
    back_level_m: NDArray[np.float64]
    """Likewise, of the way back, which may lead to another place (`WorkPoint.resume_share`)."""
    between_level_m: NDArray[np.float64]
    """Shape (pads, pads)."""
    via: Mapping[tuple[int, int], Via]
    back_via: Mapping[tuple[int, int], Via]
    between_via: Mapping[tuple[int, int], Via]
    """By point and pad, and by pad and pad, the bends of ways that are not straight, in the order in which they are flown."""
    above_terrain: bool
    """Whether they are flown at a height above terrain, as the mission is."""


def pad_grounds_m(pads: Sequence[Station], home_m: float | None, over: Over | None, *, level: bool) -> list[float]:
    """Return the ground of pads above the home of a mission; `level` assumes unknown ground to be as high as home.

    An `InputError` names every pad whose ground is unknown, or reports that the height of home is unknown.
    """
    if level:
        return [0.0 if home_m is None or pad.elevation_m is None else pad.elevation_m - home_m for pad in pads]
    known = [pad.elevation_m if pad.elevation_m is not None else _terrain_m(pad, over) for pad in pads]
    remedy = "give it, or --terrain, or --level-ground if the ground is level"
    faults = [
        Fault(f"the ground height of pad {pad.id} is unknown", field="elevation_m", remedy=remedy)
        for pad, ground in zip(pads, known, strict=True)
        if ground is None
    ]
    if home_m is None:
        remedy = "give --home-elevation, or --terrain, or --level-ground if the ground is level"
        faults.insert(0, Fault("the height of the mission's home above sea level is unknown", remedy=remedy))
    if faults or home_m is None:
        raise InputError(faults)
    return [float(ground or 0.0) - home_m for ground in known]


def _terrain_m(pad: Station, over: Over | None) -> float | None:
    if over is None:
        return None
    ground = float(over.terrain.ground_m(np.array([pad.lat]), np.array([pad.lon]))[0])
    return ground if math.isfinite(ground) else None


def pad_ways(
    work: Work,
    document: MissionDocument,
    pads: Sequence[Station],
    ground_m: Sequence[float],
    rules: TransitRules,
    families: Sequence[Family],
) -> PadWays:
    """Compute the ways between all points of a mission and all pads."""
    items = document.mission.items
    above_terrain = rules.over is None and any(items[step.item].frame in TERRAIN_FRAMES for step in work.steps)
    highest = max((step.height_m for step in work.steps), default=0.0)
    floor = np.array([max(highest, rules.height_m or 0.0, ground + LOWEST_M) for ground in ground_m])
    home_m = 0.0 if work.mission.home is None else work.mission.home.altitude_m or 0.0

    def shut_ways(ends: NDArray[np.float64]) -> NDArray[np.bool_]:
        shut = np.zeros(len(ends), dtype=bool)
        for every in {family.within_every_inclusion_area for family in families}:
            shut |= leaves_fence(ends, document.fence, every=every)
        if rules.zones is not None:
            shut |= _in_zones(ends, rules.zones)
        return shut

    strict = any(family.within_every_inclusion_area for family in families)

    all_places = np.array([*((point.lat, point.lon) for point in work.points), *((pad.lat, pad.lon) for pad in pads)])
    bent = BentWays(document.fence, rules.zones, shut_ways, every=strict, places=all_places)

    def top_m(chain: Sequence[tuple[float, float]], least_m: float) -> float:
        """Height required by a terrain model on a way with bends; NaN if the ground is unknown."""
        if rules.over is None:
            return least_m
        tops = [
            level_over_m(one, np.array([other[0]]), np.array([other[1]]), rules.over)[0] - home_m
            for one, other in pairwise(chain)
        ]
        return float(np.max([least_m, *tops]))

    def levels(
        places: NDArray[np.float64], least: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], dict[tuple[int, int], Via]]:
        """Height of the ways from places to all pads, and their bends; `least` has the shape (places, pads)."""
        found = least.copy()
        vias: dict[tuple[int, int], Via] = {}
        for number, pad in enumerate(pads):
            if rules.over is not None:
                top = level_over_m((pad.lat, pad.lon), places[:, 0], places[:, 1], rules.over) - home_m
                found[:, number] = np.maximum(found[:, number], top)  # NaN if the ground is unknown
            ends = np.empty((len(places), 2, 2))
            ends[:, 0, 0], ends[:, 0, 1], ends[:, 1] = places[:, 1], places[:, 0], (pad.lon, pad.lat)
            shut = np.flatnonzero(shut_ways(ends))
            found[shut, number] = np.nan
            ways_around = bent.to(places[shut], (pad.lat, pad.lon))
            for row, via in zip(shut.tolist(), ways_around, strict=True):
                if via is not None:
                    here_at = float(places[row, 0]), float(places[row, 1])
                    found[row, number] = top_m([here_at, *via, (pad.lat, pad.lon)], float(least[row, number]))
                    vias[row, number] = via
        return found, vias

    here = np.array([(point.lat, point.lon) for point in work.points])
    heights = np.array([point.height_m for point in work.points])
    back = np.array([work.at(point.step, point.resume_share)[:2] for point in work.points])
    at_pads = np.array([(pad.lat, pad.lon) for pad in pads])
    least = np.maximum(heights[:, None], floor[None, :])
    level, via = levels(here, least)
    same = np.all(here == back, axis=1)
    back_level, back_via = level.copy(), {key: one for key, one in via.items() if same[key[0]]}
    if not same.all():
        others = np.flatnonzero(~same)
        back_level[others], more = levels(back[others], least[others])
        back_via |= {(int(others[row]), pad): one for (row, pad), one in more.items()}
    between, between_via = levels(at_pads, np.maximum(floor[:, None], floor[None, :]))
    return PadWays(
        tuple(pads),
        tuple(ground_m),
        level,
        back_level,
        between,
        via,
        {key: one[::-1] for key, one in back_via.items()},
        between_via,
        above_terrain,
    )


def _in_zones(ends: NDArray[np.float64], zones: Airspace) -> NDArray[np.bool_]:
    from skyway.models.airspace.ways import at_any_height

    return np.asarray(zones.crossed_by(at_any_height(ends[:, 0, 1], ends[:, 0, 0], ends[:, 1, 1], ends[:, 1, 0])))


def hops_to_pads(work: Work, ways: PadWays, rules: TransitRules, conditions: FlightConditions) -> Hops:
    """Hops from every point to every pad, pad by pad within each point."""
    here = np.array([(point.lat, point.lon) for point in work.points])
    heights = np.array([point.height_m for point in work.points])
    hops = _hops(here, heights, ways, ways.level_m, ways.via, rules, conditions, back=False)
    return hops._replace(hold_s=hops.hold_s + np.repeat(_turns_s(work), len(ways.pads)) + TOUCH_DOWN_S)


def hops_from_pads(work: Work, ways: PadWays, rules: TransitRules, conditions: FlightConditions) -> Hops:
    """Hops from every pad to the place where the work of every point resumes, until it is as far as the point; likewise ordered."""
    at = [work.at(point.step, point.resume_share) for point in work.points]
    here, heights = np.array([one[:2] for one in at]), np.array([one[2] for one in at])
    hops = _hops(here, heights, ways, ways.back_level_m, ways.back_via, rules, conditions, back=True)
    again = np.array([_flown_again_s(work, number) for number in range(len(work.points))])
    stays = STEADY_S + again + _turns_s(work)
    return hops._replace(hold_s=hops.hold_s + np.repeat(stays, len(ways.pads)) + LIFT_OFF_S)


def _turns_s(work: Work) -> NDArray[np.float64]:
    """Time of braking from the speed of the work, or of accelerating to it, at each point."""
    return np.array([turn_s(point.speed_mps) for point in work.points])


def _flown_again_s(work: Work, number: int) -> float:
    """Time for the stretch that is flown a second time, between the last picture and the place where the work was left."""
    point = work.points[number]
    if point.share == point.resume_share:
        return 0.0
    length = geodesy.distance_m(*work.places[point.step], *work.places[point.step + 1])
    return (point.share - point.resume_share) * length / max(point.speed_mps, 0.1)


def hops_between_pads(ways: PadWays, rules: TransitRules, conditions: FlightConditions) -> Hops:
    """Hops from every pad to every pad."""
    here = np.array([(pad.lat, pad.lon) for pad in ways.pads])
    hops = _hops(
        here, np.array(ways.ground_m), ways, ways.between_level_m, ways.between_via, rules, conditions, back=False
    )
    return hops._replace(hold_s=hops.hold_s + LIFT_OFF_S + TOUCH_DOWN_S)


def bent_hops(work: Work | None, ways: PadWays, rules: TransitRules, *, back: bool) -> tuple[Hops, NDArray[np.int64]]:
    """Return the level pieces of ways that bend, and the number of the way of each, as `hops_to_pads`, or `hops_from_pads`, numbers them.

    Between pads without `work`. These have the climbs, the descents and the holds of these ways, and no length.
    """
    pads = len(ways.pads)
    at_pads = [(pad.lat, pad.lon) for pad in ways.pads]
    vias = ways.between_via if work is None else ways.back_via if back else ways.via
    level_m = ways.between_level_m if work is None else ways.back_level_m if back else ways.level_m
    ends: list[tuple[float, float, float, float]] = []
    owner: list[int] = []
    heights: list[float] = []
    for (row, pad), via in vias.items():
        if work is None:
            here = at_pads[row]
        else:
            point = work.points[row]
            lat, lon, _ = work.at(point.step, point.resume_share if back else point.share)
            here = lat, lon
        chain = [at_pads[pad], *via, here] if back else [here, *via, at_pads[pad]]
        for one, other in pairwise(chain):
            ends.append((*one, *other))
            owner.append(row * pads + pad)
            heights.append(float(level_m[row, pad]))
    lat1, lon1, lat2, lon2 = np.array(ends, dtype=np.float64).reshape(-1, 4).T
    length, bearing = geodesy.inverse(lat1, lon1, lat2, lon2)
    none = np.zeros(len(ends))
    hops = Hops(
        *geodesy.midpoint(lat1, lon1, bearing, length),
        length,
        bearing,
        np.full(len(ends), rules.speed_mps),
        none,
        none,
        none,
        np.ones(len(ends), dtype=bool),
        np.array(heights),
    )
    return hops, np.array(owner, dtype=np.int64)


def _hops(
    here: NDArray[np.float64],
    height_m: NDArray[np.float64],
    ways: PadWays,
    level_m: NDArray[np.float64],
    vias: Mapping[tuple[int, int], Via],
    rules: TransitRules,
    conditions: FlightConditions,
    *,
    back: bool,
) -> Hops:
    pads = len(ways.pads)
    lat, lon = (np.repeat(here[:, axis], pads) for axis in (0, 1))
    pad_lat = np.tile([pad.lat for pad in ways.pads], len(here))
    pad_lon = np.tile([pad.lon for pad in ways.pads], len(here))
    ground, height, level = np.tile(ways.ground_m, len(here)), np.repeat(height_m, pads), level_m.ravel()
    ends = (pad_lat, pad_lon, lat, lon) if back else (lat, lon, pad_lat, pad_lon)
    length, bearing = geodesy.inverse(*ends)
    middle = geodesy.midpoint(ends[0], ends[1], bearing, length)
    # it stands at its begin, and over the pad
    speed = min(rules.speed_mps, conditions.drone.max_ground_speed_mps)
    moves = length > SAME_PLACE_M
    climb, descent = (level - ground, level - height) if back else (level - height, level - ground)
    length = length.copy()
    length[[row * pads + pad for row, pad in vias]] = 0.0  # see `bent_hops`
    return Hops(
        *middle,
        length,
        bearing,
        np.full(len(length), rules.speed_mps),
        np.where(moves, 2.0 * turn_s(speed), 0.0),
        climb / conditions.climb_rate_mps,
        descent / conditions.descent_rate_mps,
        np.ones(len(length), dtype=bool),
        np.maximum(level - np.minimum(ground, 0.0), 0.0),
    )
