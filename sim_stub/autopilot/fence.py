"""Geofences and rally points as the vehicle enforces them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.sim_stub.autopilot.items import Command, Item
from skyway.sim_stub.plant.physics import offset_m

if TYPE_CHECKING:
    from collections.abc import Sequence

_POLYGONS = {Command.FENCE_POLYGON_INCLUSION: True, Command.FENCE_POLYGON_EXCLUSION: False}
_CIRCLES = {Command.FENCE_CIRCLE_INCLUSION: True, Command.FENCE_CIRCLE_EXCLUSION: False}


@dataclass(frozen=True, slots=True)
class Area:
    """A polygon or circle."""

    inclusion: bool
    """The vehicle must be inside rather than outside."""
    corners: tuple[tuple[float, float], ...]
    """Of a polygon, latitude and longitude; of a circle its centre alone."""
    radius_m: float = 0.0
    """0 for a polygon."""

    def contains(self, lat: float, lon: float) -> bool:
        """Whether a point is inside."""
        if self.radius_m > 0.0:
            return math.hypot(*offset_m(lat, lon, *self.corners[0])) <= self.radius_m
        inside = False
        last_lat, last_lon = self.corners[-1]
        for corner_lat, corner_lon in self.corners:
            if (corner_lat > lat) != (last_lat > lat):
                crossing = corner_lon + (lat - corner_lat) * (last_lon - corner_lon) / (last_lat - corner_lat)
                if lon < crossing:
                    inside = not inside
            last_lat, last_lon = corner_lat, corner_lon
        return inside


@dataclass(frozen=True, slots=True)
class Fence:
    """All areas of a fence."""

    areas: tuple[Area, ...] = ()
    consistent: bool = True
    """False where the vertex counts of the items disagree: no area is then enforced."""

    @classmethod
    def from_items(cls, items: Sequence[Item]) -> Fence:
        """Read the items; a polygon is as many successive vertices as its first one gives."""
        areas: list[Area] = []
        index = 0
        while index < len(items):
            item = items[index]
            if item.command in _CIRCLES:
                circle = ((item.lat, item.lon),)
                areas.append(Area(_CIRCLES[Command(item.command)], circle, max(item.p1, 0.01)))
                index += 1
            elif item.command in _POLYGONS:
                count = int(item.p1) if math.isfinite(item.p1) else 0
                corners = items[index : index + count]
                same = all(c.command == item.command and c.p1 == item.p1 for c in corners)
                if count < 3 or len(corners) < count or not same:
                    return cls((), consistent=False)
                places = tuple((c.lat, c.lon) for c in corners)
                areas.append(Area(_POLYGONS[Command(item.command)], places))
                index += count
            else:
                index += 1
        return cls(tuple(areas))

    def breached(self, lat: float, lon: float, *, any_inclusion: bool) -> bool:
        """Whether a point, degrees, is where it must not be.

        Inside `any_inclusion` area of several is enough (PX4), or it must be inside all of them (ArduPilot).
        """
        wanted = [area.contains(lat, lon) for area in self.areas if area.inclusion]
        if wanted and not (any(wanted) if any_inclusion else all(wanted)):
            return True
        return any(area.contains(lat, lon) for area in self.areas if not area.inclusion)
