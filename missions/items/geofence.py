"""Geofences: areas to stay inside or outside."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.missions.items.coordinates import Point


@dataclass(frozen=True, slots=True)
class FencePolygon:
    """A polygon to stay inside, or outside."""

    vertices: tuple[Point, ...]
    """At least three; the first is not repeated at the end."""
    inclusion: bool = True
    """True: stay inside; False: stay outside."""
    extra: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)
    """Other contents of a file; not compared."""


@dataclass(frozen=True, slots=True)
class FenceCircle:
    """A circle to stay inside, or outside."""

    center: Point
    """Its middle."""
    radius_m: float
    """Metres."""
    inclusion: bool = True
    """True: stay inside; False: stay outside."""
    extra: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)
    """Other contents of a file; not compared."""


@dataclass(frozen=True, slots=True)
class Geofence:
    """All areas of a vehicle's fence.

    With several inclusion areas PX4 requires the vehicle to be inside any of them, ArduPilot inside all of them unless bit 1 of
    FENCE_OPTIONS is set.
    """

    polygons: tuple[FencePolygon, ...] = ()
    circles: tuple[FenceCircle, ...] = ()
    return_point: Point | None = None
    """ArduPilot's destination after a breach, if one is set."""
    return_altitude_m: float = 0.0
    """Height above home there; 0 if none was given."""
    extra: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)
    """Other contents of a file; not compared."""

    def __bool__(self) -> bool:
        return bool(self.polygons or self.circles or self.return_point)

    @property
    def areas(self) -> tuple[FencePolygon | FenceCircle, ...]:
        """Polygons, then circles."""
        return (*self.polygons, *self.circles)
