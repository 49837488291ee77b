"""Options of a drone in the air: its destination at another airspeed, or another station inside its fence.

Each option has the time at which it lands, with which charge, how probably below the reserve, and when the delivery then arrives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base import geodesy

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.planner.online.hindsight import Hindsight
    from skyway.planner.reach.reach import Flown, Place, Reach


HALF, EMPTY = 10.0, 100.0
"""A landing below half of the reserve, and a battery that is empty in the air, count as so many landings below the reserve more."""


@dataclass(frozen=True, slots=True)
class Option:
    """One thing to do."""

    station: str
    """Where it lands."""
    airspeed_mps: float
    """Planned on the way there."""
    lands_s: float
    soc: float
    """Expected landing, POSIX seconds, and charge then."""
    p_reserve: float
    p_half: float
    p_empty: float
    """Probability of landing below the reserve, if there is a place; of landing below half of it, and of a battery that is empty before."""
    distance_m: float
    """Way left."""
    p_no_room: float = 0.0
    """Probability of finding no place there until it has hovered down to the reserve, wherever it could turn to meanwhile."""
    arrival_s: float = math.nan
    """Expected arrival of the delivery, POSIX seconds; NaN where it was not computed."""

    @property
    def p_below(self) -> float:
        """Probability of landing below the reserve, or hovering for a place until then."""
        return 1.0 - (1.0 - self.p_reserve) * (1.0 - self.p_no_room)

    @property
    def risk(self) -> float:
        """Quantity to minimise where no option keeps the reserve: landings below it, weighted more by `HALF` and `EMPTY`."""
        return self.p_below + HALF * self.p_half + EMPTY * self.p_empty

    def with_room(self, no_place: Callable[[float, float], float], soc_per_s: float, floors: Floors) -> Option:
        """Return the same with the risk of hovering for a place down to the reserve.

        `no_place` is the chance to find none at its station from a time, POSIX seconds, for so many seconds.
        """
        return replace(self, p_no_room=no_place(self.lands_s, max(self.soc - floors.reserve, 0.0) / soc_per_s))

    def as_data(self) -> dict[str, Any]:
        """For the journal."""
        return {
            "station": self.station, "airspeed_mps": round(self.airspeed_mps, 1), "soc": round(self.soc, 3),
            "p_below_reserve": round(self.p_below, 4), "p_empty": round(self.p_empty, 4),
            "arrival_s": self.arrival_s,
        }  # fmt: skip


def clearly_safer(one: Option, other: Option, share: float) -> bool:
    """Whether an option has less than a share of the risk of another: of the weighted risk, or of landings below the reserve if nothing worse is likelier with it.

    In some winds of a forecast no station may be reached: what is as probable for both, weighted by `EMPTY`, would hide the difference.
    """
    if one.risk < share * other.risk:
        return True
    no_worse = one.p_half <= other.p_half and one.p_empty <= other.p_empty
    return no_worse and one.p_below < share * other.p_below


@dataclass(frozen=True, slots=True)
class Floors:
    """Charges that landings are judged by: the reserve, and the share of it that a divert may use."""

    reserve: float
    half: float


def along_way(way: Sequence[Place], distance_m: float) -> Place:
    """Return the point of a way after so many metres, or its end."""
    for a, b in pairwise(way):
        length = geodesy.distance_m(*a, *b)
        if length >= distance_m:
            lat, lon = geodesy.direct(*a, geodesy.bearing_deg(*a, *b), distance_m)
            return float(lat), float(lon)
        distance_m -= length
    return way[-1]


def going_on(
    reach: Reach, way: Sequence[Place], station: str, time_s: float, soc: float, floors: Floors
) -> tuple[Option, Flown]:
    """Return the outcome of flying on along a way."""
    flown = reach.to_the_end(way, time_s)
    cost = flown.soc[:, None]
    length = sum(geodesy.distance_m(*a, *b) for a, b in pairwise(way))
    low, lower, empty = (
        float(reach.p_below(soc, cost, floor, flown.doubt[:, None])[0])
        for floor in (floors.reserve, floors.half, reach.parameters.empty_soc)
    )
    option = Option(
        station,
        reach.airspeed_mps,
        time_s + float(reach.expected(flown.time_s)),
        soc - float(reach.expected(flown.soc)) * reach.belief.mean_ratio,
        low,
        lower,
        empty,
        length,
    )
    return option, flown


def other_airspeeds(
    reach: Reach, way: Sequence[Place], station: str, time_s: float, soc: float, floors: Floors
) -> list[Option]:
    """Return the outcome of flying on slower or faster, where it is known what that costs."""
    if reach.load is None:
        return []
    speeds = (share * reach.airspeed_mps for share in reach.parameters.airspeed_shares)
    fit = [speed for speed in speeds if reach.parameters.min_airspeed_mps <= speed <= reach.drone.max_airspeed_mps]
    return [going_on(reach.at_airspeed(speed), way, station, time_s, soc, floors)[0] for speed in fit]


def other_stations(
    reach: Reach, here: Place, names: Sequence[str], time_s: float, soc: float, floors: Floors
) -> list[Option]:
    """Return the outcome of flying straight to stations without a zone in between."""
    index = reach.network.index
    nodes = np.array([index[name] for name in names], dtype=np.int64)
    nodes = nodes[reach.clear(here, nodes, time_s)] if len(nodes) else nodes
    if not len(nodes):
        return []
    flown = reach.to_stations(here, time_s, nodes)
    times, costs = reach.expected(flown.time_s), reach.expected(flown.soc) * reach.belief.mean_ratio
    low, lower, empty = (
        reach.p_below(soc, flown.soc, floor, flown.doubt)
        for floor in (floors.reserve, floors.half, reach.parameters.empty_soc)
    )
    length, _ = geodesy.inverse(*here, reach.network.lat[nodes], reach.network.lon[nodes])
    return [
        Option(
            reach.network.stations[int(node)].id,
            reach.airspeed_mps,
            time_s + float(times[row]),
            soc - float(costs[row]),
            float(low[row]),
            float(lower[row]),
            float(empty[row]),
            float(length[row]),
        )
        for row, node in enumerate(nodes)
    ]


def earliest_s(reach: Reach, option: Option, destination: str) -> float:
    """No delivery by way of an option arrives before this: straight on from its landing at the greatest speed, charged already."""
    if option.station == destination:
        return option.lands_s
    network = reach.network
    a, b = network.index[option.station], network.index[destination]
    length = geodesy.distance_m(
        float(network.lat[a]), float(network.lon[a]), float(network.lat[b]), float(network.lon[b])
    )
    return option.lands_s + length / reach.drone.max_ground_speed_mps + reach.rules.climb_s + reach.rules.descent_s


def arriving(option: Option, onward: Hindsight) -> float:
    """Expected arrival of the delivery by way of an option, POSIX seconds."""
    found = onward.arrival_s(option.station, option.lands_s, option.soc)
    return found if math.isfinite(found) else option.lands_s + onward.parameters.never_s
