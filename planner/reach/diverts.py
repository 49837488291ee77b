"""Divert stations of a leg: from every point of it one can be landed at with a margin.

Plans name them, and the online policy begins no leg that has a point without one other than the end that it is flown to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.planner.reach.reach import Flown

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.planner.reach.reach import Place, Reach


@dataclass(frozen=True, slots=True)
class DivertCover:
    """Divert stations of a leg."""

    stations: tuple[str, ...]
    """Enough that every covered point of the leg has one; those that cover most come first."""
    gap_m: float | None
    """How far along the leg the first point lies that has none; None where all have one."""


def divert_cover(
    reach: Reach, way: Sequence[Place], time_s: float, soc: float, *, floor_soc: float, epsilon: float,
    destination: str, full: frozenset[str] = frozenset(), reserve_soc: float = 0.0, most: int | None = None,
    every_m: float | None = None,
) -> DivertCover:  # fmt: skip
    """Find divert stations for every point of a leg to `destination`, along the way of `Reach.way`.

    The destination itself counts, where it has pads, from the point on from which no other station is nearer in time.
    Stations that are `full` do not keep the reserve. There are at most `most`, for points `every_m` apart; by default both
    are those of the online policy.

    `time_s` and `soc` are those of the take-off. A divert lands below `floor_soc` with no more than the probability
    `epsilon`. `reserve_soc` is kept likewise by the destination from the start, or by another station from each point,
    in the winds in which it is flown that far.
    """
    flights = PointFlights(reach, way, time_s, destination, every_m)
    return flights.cover(soc, floor_soc=floor_soc, epsilon=epsilon, full=full, reserve_soc=reserve_soc, most=most)


class PointFlights:
    """Flights from the points of a leg to stations: they do not depend on the charge, and are worked out once for several.

    The arguments are those of `divert_cover`.
    """

    def __init__(
        self, reach: Reach, way: Sequence[Place], time_s: float, destination: str, every_m: float | None = None
    ) -> None:
        self._reach, self._high = reach, reach.flying_over(reach.cleared_on(way))
        self._points = _points(way, every_m or reach.parameters.point_every_m)
        self._places = [place for place, _ in self._points]
        (climb_s, climb_soc), (self._descent_s, descent_soc) = reach.ends(way)
        self._begins_s = time_s + climb_s
        flown = self._high.along(self._places, self._begins_s)
        spent, used = np.zeros((2, len(reach.wind), len(self._points)))
        spent[:, 1:] = flown.time_s
        used[:, 1:] = flown.soc
        self._used = used + climb_soc
        self._doubt = flown.doubt[:, -1:]
        self._at_end = self._used[:, -1:] + descent_soc
        self._mean_s = reach.expected(spent)
        self._ends_at = reach.network.index[destination]
        nodes = reach.pads_near(self._places, 1.0)
        self._nodes = nodes[nodes != self._ends_at]
        self._clear: dict[tuple[int, int], bool] = {}

    def cover(
        self,
        soc: float,
        *,
        floor_soc: float,
        epsilon: float,
        full: frozenset[str] = frozenset(),
        reserve_soc: float = 0.0,
        most: int | None = None,
    ) -> DivertCover:
        """Find divert stations for every point, for a charge at the take-off; see `divert_cover`."""
        reach, points = self._reach, self._points
        near_enough = np.isin(self._nodes, reach.pads_near(self._places, soc))
        nodes = self._nodes[near_enough]
        roomy = np.array([reach.network.stations[node].id not in full for node in nodes], dtype=bool)
        safe = np.zeros((len(points), len(nodes)), dtype=bool)
        nearest = np.zeros(len(points), dtype=bool)
        keeps = reach.p_below(soc, self._at_end, reserve_soc, self._doubt)[0] <= epsilon
        flown_on = reach if keeps else _not_hopeless(reach, soc, self._at_end, self._doubt, reserve_soc)
        for row in range(len(points)):
            if not len(nodes):
                break
            time_s, taken, doubt = (one[:, row, near_enough] for one in self._flights)
            left_s = float(self._mean_s[-1] - self._mean_s[row]) + self._descent_s
            nearest[row] = reach.network.pads[self._ends_at] > 0 and left_s <= float(reach.expected(time_s).min())
            cost = self._used[:, row, None] + taken
            sure = reach.p_below(soc, cost, floor_soc, doubt) <= epsilon
            near = np.flatnonzero(
                sure & (keeps or roomy & (flown_on.p_below(soc, cost, reserve_soc, doubt) <= epsilon))
            )
            near = near[np.argsort(reach.expected(cost)[near])][:12]
            safe[row, near[self._clear_to(row, nodes[near])]] = True
        uncovered = np.flatnonzero(~(safe.any(axis=1) | nearest))
        gap = float(points[uncovered[0]][1]) if len(uncovered) else None
        most = reach.parameters.max_diverts if most is None else most
        chosen = _fewest(safe, most)
        chosen += [k for k in _beside(reach, self._places, nodes, safe) if k not in chosen][: most - len(chosen)]
        return DivertCover(tuple(reach.network.stations[nodes[k]].id for k in chosen), gap)

    def _at_s(self, row: int) -> float:
        return self._begins_s + float(self._mean_s[row])

    @cached_property
    def _flights(self) -> Flown:
        """Flights from every point to all stations, shape (members, points, stations)."""
        flown = self._high.all_to_stations(self._places, self._begins_s + self._mean_s, self._nodes)
        return Flown(*(one.reshape(len(one), len(self._points), len(self._nodes)) for one in flown))

    def _clear_to(self, row: int, nodes: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether no zone lies before stations, from a point."""
        asked = np.array([node for node in nodes.tolist() if (row, node) not in self._clear], dtype=np.int64)
        if len(asked):
            found = self._high.clear(self._places[row], asked, self._at_s(row)).tolist()
            self._clear.update(zip(((row, node) for node in asked.tolist()), found, strict=True))
        return np.array([self._clear[row, node] for node in nodes.tolist()], dtype=bool)


def _not_hopeless(
    reach: Reach, soc: float, at_end: NDArray[np.float64], doubt: NDArray[np.float64], reserve_soc: float
) -> Reach:
    """Return the same for those members alone in which a leg is flown to its end: in the others it is turned before."""
    hopeless = reach.below(soc, at_end, reserve_soc, doubt)[:, 0] > reach.parameters.p_hopeless
    return reach.in_members(~hopeless)


def _beside(reach: Reach, places: Sequence[Place], nodes: NDArray[np.int64], safe: NDArray[np.bool_]) -> list[int]:
    """Return stations that lie beside a way and are safe from a part of it, the nearest first: a drone may recharge there."""
    lat, lon = np.array(places).T
    network, most_m, found = reach.network, reach.parameters.beside_m, []
    served = np.flatnonzero(safe.any(axis=0))
    there = nodes[served]
    near = geodesy.perhaps_within(lat[:, None], lon[:, None], network.lat[there], network.lon[there], most_m)
    for k in served[near.any(axis=0)]:
        station = network.stations[nodes[k]]
        north, east = geodesy.local_offsets_m(lat, lon, station.lat, station.lon)
        off = float(np.hypot(north, east).min())
        if off <= most_m:
            found.append((off, int(k)))
    return [k for _, k in sorted(found)]


def _points(way: Sequence[Place], every_m: float) -> list[tuple[Place, float]]:
    """Points of a way not farther apart than `every_m`, with the distance flown to each."""
    found: list[tuple[Place, float]] = [(way[0], 0.0)]
    flown = 0.0
    for before, after in pairwise(way):
        length = geodesy.distance_m(*before, *after)
        parts = max(1, math.ceil(length / every_m))
        inner = geodesy.along(*before, *after, parts - 1)
        found += [(point, flown + length * (k + 1) / parts) for k, point in enumerate(inner)]
        flown += length
        found.append((after, flown))
    return found


def _fewest(safe: NDArray[np.bool_], most: int) -> list[int]:
    """Return few columns that together cover every row that any column covers (greedily)."""
    left = safe.any(axis=1)
    chosen: list[int] = []
    while left.any() and len(chosen) < most:
        gain = safe[left].sum(axis=0)
        best = int(np.argmax(gain))
        chosen.append(best)
        left &= ~safe[:, best]
    return chosen
