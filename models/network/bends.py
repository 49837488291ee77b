"""Ways around zones: the shortest ones that keep the margin, with bends at the corners of the zones' outlines.

Shortest ways among polygons bend at their corners only (Lozano-Perez and Wesley 1979), so that they are shortest paths in the graph of
corners that see each other. Obstacles are considered lazily: a way that is shortest among some of them and touches no other is
shortest among all.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.airspace.ways import at_any_height, chosen, lines
from skyway.models.base import geodesy
from skyway.models.network.zoned import flown_ways

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from skyway.models.airspace.airspace import Airspace
    from skyway.models.airspace.ways import Ways
    from skyway.models.network.station import Station

Corner = tuple[int, int]
"""A volume, and a corner of its outline."""
Bend = tuple[Corner, float, float]
"""A corner, its latitude and longitude."""
MAX_CORNERS = 400
"""Ways among more corners than this are not searched."""
MAX_ROUNDS = 30
MAX_PAIRS = 300
FEW_CORNERS = 24
SMOOTH, LEAST_M, MOST_M = 0.004, 2.0, 40.0
"""Outlines lie outside the widened zones by this share of their size, within these bounds, so that they have few corners."""


def with_bends(
    bends: Bends, stations: tuple[Station, ...], pairs: NDArray[np.int64]
) -> tuple[tuple[Station, ...], NDArray[np.int64]]:
    """Add the shortest ways around zones where these close segments; returns nodes and pairs, the new ones behind.

    If a zone is not always closed the straight segment stays, too, and there are ways around all zones and around those that
    always are. A bend that is already a node is reused. Of more than `MAX_PAIRS` closed segments the longer ones get none.
    """
    airspace = bends.airspace
    ends = np.unique(np.sort(pairs, axis=1), axis=0)
    level, _ = flown_ways(stations, ends, airspace.cruise_height_m)
    way, volume = airspace.hits(level)
    counts = airspace.closed[volume]
    nodes = {station.id: number for number, station in enumerate(stations)}
    bent = list(stations)
    added: list[tuple[int, int]] = []
    closed = np.unique(way[counts])
    length_m = geodesy.inverse(*(values[closed] for values in level[:4]))[0]
    for number in np.sort(closed[np.argsort(length_m, kind="stable")[:MAX_PAIRS]]).tolist():
        met = volume[counts & (way == number)]
        kinds = [airspace.closed]
        if airspace.always_closed[met].any() and not airspace.always_closed[airspace.closed].all():
            kinds.append(airspace.always_closed)
        a, b = (stations[node] for node in ends[number].tolist())
        for counted in kinds:
            path = bends.around(chosen(level, np.array([number])), counted)
            chain = [
                int(ends[number, 0]),
                *(_node(bends, one, a, b, bent, nodes) for one in path or ()),
                int(ends[number, 1]),
            ]
            added += [pair for one in pairwise(chain) for pair in (one, one[::-1])] if path else []
    if not added:
        return stations, pairs
    return tuple(bent), np.unique(np.concatenate((pairs, np.array(added, dtype=np.int64))), axis=0)


def _node(bends: Bends, bend: Bend, a: Station, b: Station, stations: list[Station], nodes: dict[str, int]) -> int:
    """Return the node of a bend of the way between two stations; its ground is taken to be as high as theirs, the higher."""
    (volume, corner), lat, lon = bend
    zone = bends.airspace.zones[bends.airspace.volumes[volume][0]]
    identity = f"around-{zone.id}-{volume}.{corner}"
    known = [ground for ground in (a.elevation_m, b.elevation_m) if ground is not None]
    if identity in nodes:
        node = nodes[identity]
        here = stations[node].elevation_m
        known += [] if here is None else [here]
        stations[node] = replace(stations[node], elevation_m=max(known, default=None))
        return node
    nodes[identity] = len(stations)
    kind = type(a)
    name = f"around {zone.name}"
    stations.append(kind(identity, name, lat, lon, max(known, default=None), 0, 0, flyover=True))
    return nodes[identity]


class Bends:
    """Ways around the zones of one airspace."""

    def __init__(self, airspace: Airspace) -> None:
        self.airspace = airspace
        self._corners: dict[int, list[Corner]] = {}
        self._at: dict[Corner, tuple[float, float]] = {}

    def around(self, way: Ways, counted: NDArray[np.bool_]) -> list[Bend] | None:
        """Return the bends of the shortest way between the ends of one way, flown at its heights, around the volumes that count.

        None if there is none of at most `max_detour` times its length; empty if the way itself is free.
        """
        ends = [(float(way.lat1[0]), float(way.lon1[0])), (float(way.lat2[0]), float(way.lon2[0]))]
        straight_m = geodesy.distance_m(*ends[0], *ends[1])
        band = self._in_band(way, counted)
        obstacles = self._crossed(ends)[0] & band
        for _ in range(MAX_ROUNDS):
            corners = [one for volume in sorted(obstacles) for one in self._outline(volume)]
            if len(corners) > MAX_CORNERS:
                return None
            path = self._shortest(ends, corners, obstacles, straight_m * self.airspace.max_detour)
            if path is None:
                return None
            places = [ends[0], *(self._at[corner] for corner in path), ends[1]]
            met = frozenset().union(*self._crossed(places)) & band
            if not met:
                return [(corner, *self._at[corner]) for corner in path]
            if met <= obstacles:
                return None
            obstacles = obstacles | met
        return None

    def to_one(
        self, places: NDArray[np.float64], goal: tuple[float, float]
    ) -> list[tuple[tuple[float, float], ...] | None]:
        """Return the bends of the shortest ways from many places (latitude, longitude) to one, around all volumes at any height.

        None if there is none of at most `max_detour` times the length, or there are too many corners to look at.
        """
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import dijkstra

        every = frozenset(range(len(self.airspace.volumes)))
        names = [one for volume in sorted(every) for one in self._outline(volume)]
        if not names or len(names) > MAX_CORNERS:
            return [None] * len(places)
        corners = np.array([self._at[one] for one in names])
        nodes = np.vstack((corners, goal))
        north, east = geodesy.local_offsets_m(nodes[:, 0], nodes[:, 1], *goal)
        here_north, here_east = geodesy.local_offsets_m(places[:, 0], places[:, 1], *goal)
        apart = np.hypot(north[:, None] - north, east[:, None] - east)
        first, last = np.triu_indices(len(nodes), k=1)
        free = self._free(np.column_stack((nodes[first], nodes[last])), every)
        first, last = first[free], last[free]
        graph = csr_array((np.maximum(apart[first, last], 1e-3), (first, last)), shape=apart.shape)
        left, before = dijkstra(  # type: ignore[call-overload]
            graph, directed=False, indices=len(corners), return_predecessors=True
        )
        to = np.hypot(here_north[:, None] - north[:-1], here_east[:, None] - east[:-1])
        whole = to + left[None, :-1]
        most = self.airspace.max_detour * np.hypot(here_north, here_east)
        found: list[tuple[tuple[float, float], ...] | None] = []
        for number in range(len(places)):
            path = None
            near = np.argsort(whole[number], kind="stable")
            near = near[whole[number][near] <= most[number]]
            if len(near):
                ends = np.column_stack((np.tile(places[number], (len(near), 1)), corners[near]))
                seen = near[self._free(ends, every)]
                if len(seen):
                    at, path = int(seen[0]), []
                    while at != len(corners):
                        path.append((float(corners[at, 0]), float(corners[at, 1])))
                        at = int(before[at])
            found.append(None if path is None else tuple(path))
        return found

    def _in_band(self, way: Ways, counted: NDArray[np.bool_]) -> frozenset[int]:
        """Volumes that count, and are as high as the way."""
        volumes = np.flatnonzero(counted)
        within = self.airspace.within(
            chosen(way, np.zeros(len(volumes), dtype=np.int64)), np.arange(len(volumes)), volumes
        )
        return frozenset(volumes[within].tolist())

    def _crossed(self, places: Sequence[tuple[float, float]]) -> list[frozenset[int]]:
        """Volumes that each piece of a way touches in plan."""
        pairs = np.array([(*a, *b) for a, b in pairwise(places)])
        return self._volumes_between(pairs)

    def _volumes_between(self, ends: NDArray[np.float64]) -> list[frozenset[int]]:
        way, volume = self.airspace.touched(at_any_height(*ends.T))
        found: list[set[int]] = [set() for _ in range(len(ends))]
        for number, one in zip(way.tolist(), volume.tolist(), strict=True):
            found[number].add(one)
        return [frozenset(one) for one in found]

    def _outline(self, volume: int) -> list[Corner]:
        """Convex corners of an outline a little outside the widened volume."""
        known = self._corners.get(volume)
        if known is not None:
            return known
        import shapely

        area = self.airspace.wide[volume]
        west, south, east, north = shapely.bounds(area)
        scale = math.cos(math.radians(min(max(abs(south), abs(north)), 89.0)))
        plane = shapely.transform(area, lambda xy: xy * (scale, 1.0))
        size_m = geodesy.M_PER_DEG * max((east - west) * scale, north - south)
        apart = min(max(SMOOTH * size_m, LEAST_M), MOST_M) / geodesy.M_PER_DEG
        outer = [shapely.Polygon(part.exterior) for part in shapely.get_parts(plane)]
        whole = shapely.union_all(outer)
        if shapely.count_coordinates(whole) <= FEW_CORNERS:
            apart = LEAST_M / geodesy.M_PER_DEG
        simple = whole.simplify(apart).buffer(1.5 * apart, join_style="mitre", mitre_limit=2.0)
        corners = [place for part in shapely.get_parts(simple) for place in _convex(np.asarray(part.exterior.coords))]
        known = [(volume, number) for number in range(len(corners))]
        self._at |= {one: (y, x / scale) for one, (x, y) in zip(known, corners, strict=True)}
        self._corners[volume] = known
        return known

    def _shortest(
        self, ends: Sequence[tuple[float, float]], corners: Sequence[Corner], obstacles: frozenset[int], limit_m: float
    ) -> list[Corner] | None:
        """Return the corners of the shortest way that touches none of some obstacles; None if it is too long."""
        from scipy.sparse import csr_array
        from scipy.sparse.csgraph import dijkstra

        places = np.array([*ends, *(self._at[one] for one in corners)])
        north, east = geodesy.local_offsets_m(places[:, 0], places[:, 1], *ends[0])
        xy = np.column_stack((east, north))
        apart = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
        detour = apart[0][:, None] + apart + apart[1][None]
        first, last = np.nonzero(np.triu(np.minimum(detour, detour.T) <= 1.001 * limit_m, k=1))
        free = self._free(np.column_stack((places[first], places[last])), obstacles)
        first, last = first[free], last[free]
        length = np.maximum(apart[first, last], 1e-3)
        graph = csr_array((length, (first, last)), shape=apart.shape)
        total, before = dijkstra(graph, directed=False, indices=0, return_predecessors=True)  # type: ignore[call-overload]
        if not total[1] <= limit_m:
            return None
        path, at = [], int(before[1])
        while at != 0:
            path.append(corners[at - 2])
            at = int(before[at])
        return path[::-1]

    def _free(self, ends: NDArray[np.float64], obstacles: frozenset[int]) -> NDArray[np.bool_]:
        """Which straight pieces, shape (pieces, 4), touch no obstacle."""
        import shapely

        areas = self.airspace.wide[sorted(obstacles)]
        shapely.prepare(areas)
        drawn = lines(at_any_height(*ends.T))
        free = np.ones(len(drawn), dtype=bool)
        for area in areas:
            free[free] = ~shapely.intersects(area, drawn[free])
        return free


def _convex(ring: NDArray[np.float64]) -> Iterable[tuple[float, float]]:
    """Return the corners of a ring at which it bends outwards."""
    corners = ring[:-1]
    into, out = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    turn = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0]
    area = float((ring[:-1, 0] * ring[1:, 1] - ring[1:, 0] * ring[:-1, 1]).sum())
    return [(float(x), float(y)) for x, y in corners[turn * math.copysign(1.0, area) > 0.0]]
