"""Rally points: alternatives to home for a return."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.missions.items.coordinates import Point


@dataclass(frozen=True, slots=True)
class RallyPoint:
    """A place to go to and land."""

    point: Point
    """On the map."""
    altitude_m: float
    """Height above home at which to arrive."""
    extra: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)
    """Other contents of a file (an old rally file: break altitude, landing direction, flags); not compared."""


@dataclass(frozen=True, slots=True)
class RallyPoints:
    """The rally points of a vehicle."""

    points: tuple[RallyPoint, ...] = ()
    """In order."""
    extra: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)
    """Other contents of a file; not compared."""

    def __len__(self) -> int:
        return len(self.points)
