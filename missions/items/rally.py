"""Rally points: alternatives to home for a return."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.missions.items.coordinates import Point


@dataclass(frozen=True, slots=True)
class RallyPoint:
    """A place to go to and land.

    Attributes
    ----------
    point : Point
        On the map.
    altitude_m : float
        Height above home at which to arrive.
    extra : mapping
        What a file said besides (an old rally file: break altitude, landing direction, flags); not compared.
    """

    point: Point
    altitude_m: float
    extra: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class RallyPoints:
    """The rally points of a vehicle.

    Attributes
    ----------
    points : tuple of RallyPoint
        In order.
    extra : mapping
        What a file said besides; not compared.
    """

    points: tuple[RallyPoint, ...] = ()
    extra: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)

    def __len__(self) -> int:
        return len(self.points)
