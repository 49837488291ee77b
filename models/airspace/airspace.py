"""Whether a way may be flown at a height and a time: the same code for planners, missions, checks, flights and reports."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.airspace.areas import widened
from skyway.models.airspace.ways import Ways, at_any_height, lines
from skyway.models.airspace.zone import CLOSING, Volume, Zone
from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import shapely
    from numpy.typing import NDArray

    from skyway.models.airspace.activation import Span

FEW = 200
"""Fewer ways than this, or than there are zones, are searched in a stored tree of the zones; more ways in a tree of the ways."""

USUAL_MARGIN_M, USUAL_HEIGHT_MARGIN_M, USUAL_DETOUR = 50.0, 10.0, 1.5
"""Default distance from zones, and default limit of detours around them."""


class Conflict(NamedTuple):
    """A way that may not be flown, and why."""

    way: int
    zone: Zone
    span: Span
    """When the zone is active while it is flown, POSIX seconds; at any time: infinite."""


@dataclass(frozen=True)
class Airspace:
    """Zones, and the distance that flights keep from them.

    Attributes
    ----------
    zones : tuple of Zone
        Of all kinds; those that are prohibited, or need an authorization that is not given, are closed while they are
        active.
    margin_m, height_margin_m : float
        Least distance from a closed zone to the side, and above or below it.
    max_height_m : float
        Greatest height above ground of any flight.
    cruise_height_m : float
        Above the higher ground of a segment, at which flights are flown (`models.flight.rules.FlightRules`).
    max_detour : float
        A way around zones is at most as many times as long as the straight one; at 1 there are none.
    authorized : frozenset of str
        Ids of zones for which an authorization was given.
    notes : tuple of Fault
        Parts of the files that were not understood, and count as closed.
    handed : tuple of str
        Files given in addition to those of the scenario.
    """

    zones: tuple[Zone, ...] = ()
    margin_m: float = 0.0
    height_margin_m: float = 0.0
    max_height_m: float = math.inf
    cruise_height_m: float = 60.0
    max_detour: float = 1.0
    authorized: frozenset[str] = frozenset()
    notes: tuple[Fault, ...] = ()
    handed: tuple[str, ...] = ()

    @classmethod
    def of_polygons(cls, names: Sequence[str], polygons: Sequence[shapely.Geometry]) -> Airspace:
        """Return zones that are closed at all heights and times."""
        pairs = zip(names, polygons, strict=True)
        return cls(tuple(Zone(name, name, "prohibited", (Volume(polygon),)) for name, polygon in pairs))

    def with_authorized(self, ids: Iterable[str]) -> Airspace:
        """Return the same with authorizations for more zones.

        Raises an `InputError` if there is no such zone, or if it is prohibited and no authorization opens it.
        """
        asked = list(dict.fromkeys(ids))
        kinds = {zone.id: zone.kind for zone in self.zones}
        faults = []
        for identity in asked:
            if identity not in kinds:
                close = difflib.get_close_matches(identity, kinds, n=1)
                remedy = f"did you mean {close[0]!r}?" if close else "skyway airspace FILE lists the zones"
                faults.append(Fault("no such zone", field="authorized", value=identity, remedy=remedy))
            elif kinds[identity] == "prohibited":
                faults.append(Fault("is prohibited: no authorization opens it", field="authorized", value=identity))
        if faults:
            raise InputError(faults)
        return replace(self, authorized=self.authorized | set(asked)) if asked else self

    def with_zones(self, zones: Sequence[Zone], notes: Sequence[Fault] = ()) -> Airspace:
        """Return the same with more zones, and with the usual margins and ways around where there are none yet."""
        more = replace(self, zones=(*self.zones, *zones), notes=(*self.notes, *notes))
        if (self.margin_m, self.height_margin_m, self.max_detour) != (0.0, 0.0, 1.0):
            return more
        return replace(more, margin_m=USUAL_MARGIN_M, height_margin_m=USUAL_HEIGHT_MARGIN_M, max_detour=USUAL_DETOUR)

    def is_closed(self, zone: Zone) -> bool:
        """Whether a zone is closed while it is active: prohibited, or without the authorization that it requires."""
        return zone.kind == "prohibited" or (zone.kind == "authorization" and zone.id not in self.authorized)

    @cached_property
    def volumes(self) -> tuple[tuple[int, Volume], ...]:
        """Number of the zone, and volume, of all zones that can be closed."""
        return tuple(
            (i, volume) for i, zone in enumerate(self.zones) if zone.kind in CLOSING for volume in zone.volumes
        )

    @cached_property
    def closed(self) -> NDArray[np.bool_]:
        """Whether each of `volumes` is closed while it is active."""
        return np.array([self.is_closed(self.zones[i]) for i, _ in self.volumes], dtype=bool)

    @cached_property
    def polygons(self) -> tuple[shapely.Geometry, ...]:
        """Areas of the closed volumes."""
        return tuple(volume.area for (_, volume), closed in zip(self.volumes, self.closed, strict=True) if closed)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the zones of `polygons`."""
        return tuple(self.zones[i].name for (i, _), closed in zip(self.volumes, self.closed, strict=True) if closed)

    @cached_property
    def wide(self) -> NDArray[np.object_]:
        """Areas of all `volumes`, wider by the margin."""
        return widened([volume.area for _, volume in self.volumes], self.margin_m)

    def hits(self, ways: Ways) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pairs of a way and one of `volumes` that the way enters, or passes nearer than the margins: numbers of both, in order.

        Whether and when the volume is closed is not considered.
        """
        if not self.volumes or not len(ways.lat1):
            none = np.empty(0, dtype=np.int64)
            return none, none
        way, volume = self.touched(ways)
        within = self.within(ways, way, volume)
        pairs = np.unique(np.column_stack((way[within], volume[within])), axis=0)
        return pairs[:, 0], pairs[:, 1]

    def touched(self, ways: Ways) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Pairs of a way and one of `volumes` that the way passes over, into or under, or nearer than the margin: numbers of both."""
        return self._crossed(lines(ways))

    def conflicts(self, ways: Ways, from_s: float | None = None, until_s: float | None = None) -> list[Conflict]:
        """Return why ways may not be flown between two times, POSIX seconds, or at any time.

        An empty result means that they may be flown. A zone that becomes active as the flight ends, or ends as it begins, does not count.
        """
        found: dict[tuple[int, int], Conflict] = {}
        spans: dict[int, list[Span]] = {}
        for way, volume in zip(*(one.tolist() for one in self.hits(ways)), strict=True):
            number = self.volumes[volume][0]
            if not self.closed[volume] or (way, number) in found:
                continue
            if number not in spans:
                spans[number] = active(self.zones[number], from_s, until_s)
            if spans[number]:
                found[way, number] = Conflict(way, self.zones[number], spans[number][0])
        return list(found.values())

    def too_high(self, ways: Ways, max_height_m: float = math.inf) -> NDArray[np.bool_]:
        """Ways that are somewhere higher above the ground than the region or the drone allows."""
        return np.asarray(ways.high_agl_m > min(self.max_height_m, max_height_m) + 1e-6)

    def crossed_by(self, ways: Ways) -> NDArray[np.bool_]:
        """Which ways may not be flown at any time, or only at some times, shape (ways,)."""
        way, volume = self.hits(ways)
        crossed = np.zeros(len(ways.lat1), dtype=bool)
        crossed[way[self.closed[volume]]] = True
        return crossed

    def holding(
        self, lat: NDArray[np.float64], lon: NDArray[np.float64], climbed: Ways | None = None
    ) -> dict[int, Zone]:
        """Closed zone by the number of each place that is within one at any time, its border included: at any height, or at heights of the climb."""
        way, volume = self.hits(at_any_height(lat, lon, lat, lon) if climbed is None else climbed)
        pairs = zip(way[::-1].tolist(), volume[::-1].tolist(), strict=True)
        return {place: self.zones[self.volumes[one][0]] for place, one in pairs if self.closed[one]}

    @cached_property
    def always_closed(self) -> NDArray[np.bool_]:
        """Whether each of `volumes` is prohibited at all times."""
        zones = (self.zones[i] for i, _ in self.volumes)
        return np.array([zone.kind == "prohibited" and zone.activation.is_permanent for zone in zones], dtype=bool)

    def _crossed(self, drawn: NDArray[np.object_]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Line and area of each pair that touch, in longitude and latitude."""
        import shapely

        bounds = shapely.bounds(drawn)
        found = []
        for shift, these in (
            (0.0, np.arange(len(drawn))),
            (-360.0, np.flatnonzero(bounds[:, 2] > 180.0)),
            (360.0, np.flatnonzero(bounds[:, 0] < -180.0)),
            *self._beyond(bounds),
        ):
            some = drawn[these]
            if shift and len(some):
                some = shapely.transform(some, lambda xy, east=shift: xy + np.array((east, 0.0)))
            if not len(some):
                continue
            if len(some) < FEW * max(1, len(self.wide) // FEW):
                line, area = self._tree.query(some, predicate="intersects")
            else:  # areas are prepared once each, which justifies a tree of the lines
                area, line = shapely.STRtree(some).query(self.wide, predicate="intersects")
            found.append((these[line], area))
        return np.concatenate([one for one, _ in found]), np.concatenate([one for _, one in found]).astype(np.int64)

    def _beyond(self, bounds: NDArray[np.float64]) -> list[tuple[float, NDArray[np.int64]]]:
        """Offsets of longitude for lines near the 180th meridian where areas continue beyond it."""
        west, east = self._reach
        turns = []
        if east > 180.0:
            turns.append((360.0, np.flatnonzero(bounds[:, 0] + 360.0 <= east)))
        if west < -180.0:
            turns.append((-360.0, np.flatnonzero(bounds[:, 2] - 360.0 >= west)))
        return turns

    @cached_property
    def _reach(self) -> tuple[float, float]:
        """Least and greatest longitude of the areas."""
        import shapely

        bounds = shapely.bounds(self.wide)
        return float(bounds[:, 0].min()), float(bounds[:, 2].max())

    @cached_property
    def _tree(self) -> shapely.STRtree:
        import shapely

        return shapely.STRtree(self.wide)

    @cached_property
    def _limits(self) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64], NDArray[np.bool_]]:
        """Least floor and greatest ceiling of each of `volumes`, and whether each counts from the ground."""
        floors = [volume.floor.lowest() for _, volume in self.volumes]
        ceilings = [volume.ceiling.highest() for _, volume in self.volumes]
        return (
            np.array([value for value, _ in floors]),
            np.array([agl for _, agl in floors], dtype=bool),
            np.array([value for value, _ in ceilings]),
            np.array([agl for _, agl in ceilings], dtype=bool),
        )

    def within(self, ways: Ways, way: NDArray[np.int64], volume: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Which pairs of way and volume overlap in height, or come nearer than the margin."""
        floor, floor_agl, ceiling, ceiling_agl = (values[volume] for values in self._limits)
        highest = np.where(floor_agl, ways.high_agl_m[way], ways.high_m[way])
        lowest = np.where(ceiling_agl, ways.low_agl_m[way], ways.low_m[way])
        return (highest >= floor - self.height_margin_m) & (lowest <= ceiling + self.height_margin_m)

    def told(self, ways: Ways, from_s: float | None = None, until_s: float | None = None) -> list[Conflict]:
        """Return the conditions of a flight along ways: zones with conditions, and those entered by authorization."""
        others = replace(
            self,
            zones=tuple(
                replace(zone, kind="prohibited") if zone.kind == "conditional" or not self.is_closed(zone) else zone
                for zone in self.zones
                if zone.kind == "conditional" or (zone.kind == "authorization" and not self.is_closed(zone))
            ),
            margin_m=0.0,
            height_margin_m=0.0,
        )
        known = {zone.id: zone for zone in self.zones}
        return [one._replace(zone=known[one.zone.id]) for one in others.conflicts(ways, from_s, until_s)]


def active(zone: Zone, from_s: float | None, until_s: float | None) -> list[Span]:
    """Return when a zone is active between two times; where no times are given it counts as always active."""
    if from_s is None or until_s is None:
        return [(-math.inf, math.inf)]
    spans = zone.activation.spans(from_s, until_s)
    return [(begin, end) for begin, end in spans if from_s == until_s or (end > from_s and begin < until_s)]
