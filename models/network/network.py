"""The skyway network: stations, delivery targets and the segments between them, as objects and arrays."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy, views
from skyway.models.base.errors import Fault, refuse
from skyway.models.base.formatting import place_text
from skyway.models.flight.level_steps import NO_LEAST
from skyway.models.flight.way_heights import segment_heights
from skyway.models.network.bends import Bends, with_bends
from skyway.models.network.overs import joined_pairs, with_overs
from skyway.models.network.site_weights import SiteWeights
from skyway.models.network.station import Station
from skyway.models.network.station_names import find
from skyway.models.network.zoned import flown_ways, flyable, ground_of, inside, least_of, raised, renumbered
from skyway.models.wind.interpolation import weights_at

if TYPE_CHECKING:
    from collections.abc import Sequence

    import networkx as nx
    import pandas as pd
    from numpy.typing import ArrayLike, NDArray

    from skyway.models.airspace.airspace import Airspace
    from skyway.models.flight.level_steps import Least
    from skyway.models.flight.way_heights import Over, SegmentHeights
    from skyway.models.network.station import ConnectionRule
    from skyway.models.network.zoned import Raised


SHORTEST_M = 1.0
"""A shorter segment counts as this long, so that every flight has a speed and a course."""


@dataclass(frozen=True)
class Network:
    """Stations and directed segments, as objects and as arrays.

    Segments are sorted by their start, so that those leaving node ``i`` are ``first[i] : first[i + 1]``.

    Attributes
    ----------
    stations : tuple of Station
        Node ``i`` is ``stations[i]``.
    tail, head : ndarray of int, shape (segments,)
        Start and end node of each segment.
    distance_m, bearing_deg : ndarray, shape (segments,)
        Geodesic length (at least `SHORTEST_M`) and initial bearing from tail to head.
    rule : ConnectionRule or None
        The rule the segments were made by; None if they were given.
    zones : Airspace or None
        Zones; no segment crosses one that is closed at all times.
    over : Over or None
        Terrain model that segments are flown over; None if the ground is known at stations alone.
    restricted : ndarray of int, shape (pairs, 2)
        Segments that come into a zone which is closed at some times, or until it is authorized, each with the number of the
        volume in ``zones.volumes``; in order of segments.
    longest_m : float
        Longest segment that was given, where ways around zones are in its place; else 0.
    """

    stations: tuple[Station, ...]
    tail: NDArray[np.int64]
    head: NDArray[np.int64]
    distance_m: NDArray[np.float64]
    bearing_deg: NDArray[np.float64]
    rule: ConnectionRule | None = None
    zones: Airspace | None = None
    over: Over | None = None
    restricted: NDArray[np.int64] = field(default_factory=lambda: np.empty((0, 2), dtype=np.int64))
    longest_m: float = 0.0

    @classmethod
    def from_pairs(
        cls,
        stations: Sequence[Station],
        pairs: NDArray[np.int64],
        *,
        rule: ConnectionRule | None = None,
        zones: Airspace | None = None,
    ) -> Network:
        """Build from directed index pairs, shape (segments, 2).

        Pairs are left out whose segment crosses a zone that is closed at all times, or would be flown too high above the ground.
        Ways around zones, of at most ``zones.max_detour`` times the straight length, lead over nodes behind the stations that are
        only flown over.

        An `InputError` refuses unknown ends, segments from a station to itself, stations with the same id or with a negative
        number of pads.
        """
        stations = tuple(stations)
        if zones is None or zones.max_detour <= 1.0:
            return cls._of(stations, pairs, rule, zones)
        whole = cls._of(stations, pairs, rule, None)  # checked before anything is added
        pairs = np.column_stack((whole.tail, whole.head))
        bent = joined_pairs(
            with_bends(Bends(zones), stations, pairs), with_overs(zones, stations, pairs), len(stations)
        )
        return replace(cls._of(*bent, rule, zones), longest_m=float(whole.distance_m.max(initial=0.0)))

    @classmethod
    def _of(
        cls,
        stations: tuple[Station, ...],
        pairs: NDArray[np.int64],
        rule: ConnectionRule | None,
        zones: Airspace | None,
    ) -> Network:
        """Build from pairs as they are, see `from_pairs`."""
        pairs = np.unique(np.asarray(pairs, dtype=np.int64).reshape(-1, 2), axis=0)
        unknown = ((pairs < 0) | (pairs >= len(stations))).any(axis=1)
        loops = np.unique(pairs[~unknown & (pairs[:, 0] == pairs[:, 1]), 0])
        faults = _repeated_ids(stations)
        faults += [
            Fault("must be 0 or more", field=f"{one.id}.{name}", value=getattr(one, name))
            for one in stations
            for name in ("pads", "holding_spots")
            if getattr(one, name) < 0
        ]
        faults += [Fault("names no node", field="segment", value=pair) for pair in pairs[unknown].tolist()]
        loop = "a segment leads from a station to itself"
        faults += [Fault(loop, field="segment", value=stations[node].id) for node in loops.tolist()]
        refuse(faults)
        lat = np.array([s.lat for s in stations])
        lon = np.array([s.lon for s in stations])
        restricted = np.empty((0, 2), dtype=np.int64)
        if zones is not None and len(pairs):
            kept, restricted = flyable(stations, pairs, zones)
            pairs = pairs[kept]
        tail, head = pairs[:, 0].copy(), pairs[:, 1].copy()
        distance, bearing = geodesy.inverse(lat[tail], lon[tail], lat[head], lon[head])
        return cls(stations, tail, head, np.maximum(distance, SHORTEST_M), bearing, rule, zones, None, restricted)

    def __len__(self) -> int:
        return len(self.stations)

    def __repr__(self) -> str:
        count = sum(not station.flyover for station in self.stations)
        return f"Network({views.counted(count, 'station')}, {views.counted(len(self.tail), 'segment')})"

    def to_frame(self) -> pd.DataFrame:
        """Return the stations as a pandas DataFrame."""
        return views.frame(views.station_rows(self), "id")

    def _repr_html_(self) -> str:
        return views.html_table(repr(self), views.station_rows(self))

    @cached_property
    def lat(self) -> NDArray[np.float64]:
        """Latitudes, degrees, shape (nodes,)."""
        return np.array([station.lat for station in self.stations], dtype=np.float64)

    @cached_property
    def lon(self) -> NDArray[np.float64]:
        """Longitudes, degrees, shape (nodes,)."""
        return np.array([station.lon for station in self.stations], dtype=np.float64)

    @cached_property
    def ground_m(self) -> NDArray[np.float64]:
        """Ground above mean sea level at each node, metres, shape (nodes,); NaN if it is not known."""
        return ground_of(self.stations)

    def ground_at_m(self, lat: ArrayLike, lon: ArrayLike) -> NDArray[np.float64]:
        """Ground at places, metres above mean sea level, shape (places,): from the terrain model, otherwise interpolated between the stations whose ground is known, as wind is.

        NaN if none is known.
        """
        if self.over is not None:
            here, there = (np.atleast_1d(np.asarray(one, dtype=np.float64)) for one in (lat, lon))
            found = self.over.terrain.ground_m(here, there)
            if np.isfinite(found).all():
                return found
            return np.where(np.isfinite(found), found, replace(self, over=None).ground_at_m(here, there))
        known = np.flatnonzero(np.isfinite(self.ground_m))
        if not len(known):
            return np.full(np.shape(np.atleast_1d(lat)), math.nan)
        lowest = self.ground_m[known].min()  # so that the ground between stations of one height has that very height
        lats, lons = (np.atleast_1d(np.asarray(one, dtype=np.float64))[:, None] for one in (lat, lon))
        distance_m = geodesy.coarse_distance_m(lats, lons, self.lat[known], self.lon[known])
        return np.asarray(lowest + weights_at(distance_m) @ (self.ground_m[known] - lowest))

    def highest_agl_m(self, cruise_height_m: float) -> NDArray[np.float64]:
        """Greatest height above ground on each segment, flown alone at a cruise height, metres, shape (segments,)."""
        pairs = np.column_stack((self.tail, self.head))
        return flown_ways(self.stations, pairs, cruise_height_m, self.flown)[0].high_agl_m

    @cached_property
    def flown(self) -> SegmentHeights | None:
        """Heights at which the segments are flown over the terrain model; None without one."""
        if self.over is None:
            return None
        pairs = np.column_stack((self.tail, self.head))
        return segment_heights(self.lat, self.lon, self.ground_m, pairs, self.over, least_of(self.stations))

    def least_at(self, places: Sequence[tuple[float, float]]) -> list[Least] | None:
        """Least heights of places of a way, those of the nodes that stand there; None if there are none."""
        if not self._leasts:
            return None
        found = [self._leasts.get((float(lat), float(lon)), NO_LEAST) for lat, lon in places]
        return found if any(one != NO_LEAST for one in found) else None

    @cached_property
    def _leasts(self) -> dict[tuple[float, float], Least]:
        """Least heights by place, of the nodes that have some."""
        leasts = least_of(self.stations)
        if leasts is None:
            return {}
        places = zip(self.lat.tolist(), self.lon.tolist(), leasts.tolist(), strict=True)
        return {(lat, lon): (least, agl) for lat, lon, (least, agl) in places if max(least, agl) > -math.inf}

    def raised(self, cruise_height_m: float) -> Raised | None:
        """Return the extra height of segments over zones above the cruise height; None if there are none, and over a terrain model."""
        if self.over is not None or least_of(self.stations) is None:
            return None
        return raised(self.stations, np.column_stack((self.tail, self.head)), cruise_height_m)

    def over_terrain(self, over: Over) -> Network:
        """Return the same over a terrain model: grounds that stations lack are filled in, segments over unknown ground left out."""
        found = over.terrain.ground_m(self.lat, self.lon)
        stations = tuple(
            replace(one, elevation_m=round(float(ground), 2))
            if (one.elevation_m is None or one.flyover) and math.isfinite(ground)
            else one
            for one, ground in zip(self.stations, found, strict=True)
        )
        whole = replace(self, stations=stations, over=over)
        flown = whole.flown
        known = np.isfinite(flown.up_m) if flown is not None else np.ones(len(self.tail), dtype=bool)
        if flown is None or (known.all() and self.zones is None):
            return whole
        kept, restricted = np.flatnonzero(known), np.empty((0, 2), dtype=np.int64)
        if self.zones is not None:  # they are compared with the heights over the terrain
            pairs = np.column_stack((self.tail, self.head))[kept]
            open_, restricted = flyable(stations, pairs, self.zones, type(flown)(*(values[kept] for values in flown)))
            kept = kept[open_]
        left = replace(
            whole, tail=self.tail[kept], head=self.head[kept], distance_m=self.distance_m[kept], bearing_deg=self.bearing_deg[kept],
            restricted=restricted,
        )  # fmt: skip
        left.__dict__["flown"] = type(flown)(*(values[kept] for values in flown))
        return left

    @cached_property
    def pads(self) -> NDArray[np.int64]:
        """Pads of each station, shape (nodes,)."""
        return np.array([station.pads for station in self.stations], dtype=np.int64)

    @cached_property
    def first(self) -> NDArray[np.int64]:
        """Index of the first segment leaving each node, shape (nodes + 1,)."""
        return np.searchsorted(self.tail, np.arange(len(self.stations) + 1)).astype(np.int64)

    @cached_property
    def index(self) -> dict[str, int]:
        """Node of each station id."""
        return {station.id: number for number, station in enumerate(self.stations)}

    @cached_property
    def midpoints(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(lat, lon) half-way along each segment, degrees, shape (segments,) each."""
        return geodesy.midpoint(self.lat[self.tail], self.lon[self.tail], self.bearing_deg, self.distance_m)

    def site_weights(
        self,
        site_lat: NDArray[np.float64],
        site_lon: NDArray[np.float64],
        lattice: tuple[int, int] | None = None,
    ) -> NDArray[np.float64]:
        """Weights of wind sites half-way along each segment, shape (segments, sites), kept for the most recently used sites.

        See `models.wind.interpolation.site_weights`.
        """
        return self.wind_weights.of(site_lat, site_lon, lattice)

    @cached_property
    def wind_weights(self) -> SiteWeights:
        """Weights of wind sites half-way along each segment."""
        return SiteWeights(*self.midpoints)

    @cached_property
    def graph(self) -> nx.DiGraph:
        """The same as a networkx graph: station ids with their attributes, edges with distance and bearing."""
        import networkx as nx  # imported late: 90 ms

        graph = nx.DiGraph()
        for station in self.stations:
            graph.add_node(
                station.id,
                name=station.name,
                lat=station.lat,
                lon=station.lon,
                elevation_m=station.elevation_m,
                pads=station.pads,
            )
        ids = [station.id for station in self.stations]
        for tail, head, distance, bearing in zip(
            self.tail.tolist(),
            self.head.tolist(),
            self.distance_m.tolist(),
            self.bearing_deg.tolist(),
            strict=True,
        ):
            graph.add_edge(ids[tail], ids[head], distance_m=distance, bearing_deg=bearing)
        return graph

    def articulation_stations(self) -> list[str]:
        """Stations, by id, whose removal would split the network (its articulation points).

        Raises a `ModuleNotFoundError` if package `networkx` is not installed (extra ``graph``).
        """
        import networkx as nx

        return sorted(nx.articulation_points(self.graph.to_undirected(as_view=True)))

    def parts(self) -> list[tuple[str, ...]]:
        """Weakly connected parts, largest first, as station ids."""
        part = np.arange(len(self.stations))  # least node that each is known to be connected to
        before = part - 1
        while not np.array_equal(part, before):
            before = part.copy()
            np.minimum.at(part, self.tail, before[self.head])
            np.minimum.at(part, self.head, before[self.tail])
            part = part[part]
        groups: dict[int, list[str]] = {}
        for node, station in zip(part.tolist(), self.stations, strict=True):
            groups.setdefault(node, []).append(station.id)
        return sorted((tuple(group) for group in groups.values()), key=len, reverse=True)

    def find(self, text: str) -> int:
        """Return the node of a station; see `models.network.station_names.find`."""
        return find(self.stations, self.index, text)

    def with_target(
        self,
        lat: float,
        lon: float,
        *,
        id: str = "target",  # noqa: A002
        kind: str = "delivery target",
    ) -> Network:
        """Add a delivery target without pads, or another `kind` of place, joined to the stations by the network's rule; it is the last node.

        Where segments were given rather than made by a rule, the target is joined to every station within the length of
        the longest given segment. Raises an `InputError` if it is out of range or inside a no-fly zone.
        """
        faults = geodesy.coordinate_faults(lat, lon)
        refuse(faults)
        if self.zones is not None:
            refuse(inside(self.zones, lat, lon))
        unique_id = id
        while unique_id in self.index:
            unique_id += "-new"
        target = Station(unique_id, f"{kind} {place_text(lat, lon)}", lat, lon, None, 0, 0)
        near = self._near(lat, lon)
        node = np.full(len(near), len(self.stations))
        pairs = np.concatenate((np.column_stack((near, node)), np.column_stack((node, near))))
        stations = (*self.stations, target)
        if self.zones is not None and self.zones.max_detour > 1.0:
            stations, pairs = self._bent(stations, pairs)
        star = Network._of(stations, pairs, None, self.zones)
        if self.over is not None:
            star = star.over_terrain(self.over)
        tail = np.concatenate((self.tail, star.tail))
        head = np.concatenate((self.head, star.head))
        order = np.lexsort((head, tail))
        joined = Network(
            stations=star.stations,
            tail=tail[order],
            head=head[order],
            distance_m=np.concatenate((self.distance_m, star.distance_m))[order],
            bearing_deg=np.concatenate((self.bearing_deg, star.bearing_deg))[order],
            rule=self.rule,
            zones=self.zones,
            over=self.over,
            longest_m=self.longest_m,
            restricted=renumbered(self.restricted, star.restricted, len(self.tail), order),
        )
        if self.flown is not None and star.flown is not None:  # properties of the old segments need not be found again
            both = (np.concatenate(parts)[order] for parts in zip(self.flown, star.flown, strict=True))
            joined.__dict__["flown"] = type(self.flown)(*both)
        joined.__dict__["wind_weights"] = self.wind_weights.joined(star.wind_weights, order, joined.midpoints)
        return joined

    @cached_property
    def _bends(self) -> Bends:
        if self.zones is None:
            raise ValueError("a network without zones has no ways around them")
        return Bends(self.zones)

    def _bent(
        self, stations: tuple[Station, ...], pairs: NDArray[np.int64]
    ) -> tuple[tuple[Station, ...], NDArray[np.int64]]:
        """Add ways around zones to the segments of a target, which stays the last node; segments that are known are left out."""
        count = len(self.stations)
        if self.zones is None:
            return stations, pairs
        around, over = with_bends(self._bends, stations, pairs), with_overs(self.zones, stations, pairs)
        stations, pairs = joined_pairs(around, over, len(stations))
        new = len(stations) - count - 1
        rank = np.concatenate((np.arange(count), [count + new], count + np.arange(new)))
        pairs = rank[pairs]
        known = set(zip(self.tail.tolist(), self.head.tolist(), strict=True))
        fresh = [n for n, pair in enumerate(pairs.tolist()) if tuple(pair) not in known]
        return (*stations[:count], *stations[count + 1 :], stations[count]), pairs[fresh]

    def _near(self, lat: float, lon: float) -> NDArray[np.int64]:
        """Stations that the network's rule joins to a position."""
        longest_m = float(self.distance_m.max(initial=self.longest_m))
        limit = longest_m if self.rule is None else self.rule.max_length_m
        landed = np.array([not station.flyover for station in self.stations], dtype=bool)
        near = np.flatnonzero(geodesy.perhaps_within(lat, lon, self.lat, self.lon, limit) & landed)
        north, east = geodesy.local_offsets_m(self.lat[near], self.lon[near], lat, lon)
        reach = np.hypot(north, east)
        order = np.argsort(reach, kind="stable")
        order = order[reach[order] <= limit]
        if self.rule is not None and self.rule.kind == "nearest":
            order = order[: self.rule.nearest]
        if self.rule is not None and self.rule.kind == "gabriel":
            order = order[_free_circles(np.column_stack((north, east))[order])]
        return np.sort(near[order])

    def with_pads(self, pads: int) -> Network:
        """Return the same network with that many pads at every station that has any."""
        stations = tuple(replace(s, pads=pads) if s.pads else s for s in self.stations)
        return replace(self, stations=stations)


def _free_circles(offset: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return for which offsets, shape (points, 2), the circle from the origin to there holds no other point."""
    limit = (1.0 + 1e-9) * (offset**2).sum(axis=1)
    return np.array([not (offset @ point > limit).any() for point in offset], dtype=bool)


def _repeated_ids(stations: tuple[Station, ...]) -> list[Fault]:
    counts = Counter(station.id for station in stations)
    problem = "two stations have the same id"
    return [Fault(problem, field="id", value=name) for name, count in counts.items() if count > 1]
