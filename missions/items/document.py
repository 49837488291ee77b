"""A mission with its fence and rally points, as in one file or one vehicle."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from skyway.missions.items.geofence import Geofence
from skyway.missions.items.mission import Mission
from skyway.missions.items.rally import RallyPoints

if TYPE_CHECKING:
    from collections.abc import Mapping


@dataclass(frozen=True, slots=True)
class MissionDocument:
    """Mission, fence and rally points that are uploaded together."""

    mission: Mission = field(default_factory=Mission)
    fence: Geofence = field(default_factory=Geofence)
    rally: RallyPoints = field(default_factory=RallyPoints)
    extra: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)
    """Other contents of a file; not compared."""

    @property
    def places(self) -> list[tuple[float, float]]:
        """Latitude and longitude of all items that have a place, degrees."""
        return [(one.point.lat, one.point.lon) for one in self.mission.items if one.point is not None]
