"""Ways to pads with bends: around zones, exclusion areas and the corners of a fence, where the straight way is closed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.missions.checks.areas import fence_shapes
from skyway.models.airspace.airspace import Airspace
from skyway.models.network.bends import Bends

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import shapely
    from numpy.typing import NDArray

    from skyway.missions.items.geofence import Geofence

Place = tuple[float, float]
Via = tuple[Place, ...]
"""Latitude and longitude of the bends of a way, in the order that they are flown."""
MAX_DETOUR = 3.0
"""Greatest ratio of the length of a way with bends to the straight one."""
INSIDE_M = 3.0
"""Distance inside a fence that a way keeps at its corners."""
_M_PER_DEG = 111_195.0


class BentWays:
    """Ways with bends, for straight ways that a fence or zones close.

    `shut` returns which straight pieces (lon, lat), shape (pieces, 2, 2), are closed; `places` (latitude, longitude) are all possible
    ends of ways.
    """

    def __init__(
        self,
        fence: Geofence,
        zones: Airspace | None,
        shut: Callable[[NDArray[np.float64]], NDArray[np.bool_]],
        *,
        every: bool,
        places: NDArray[np.float64],
    ) -> None:
        self.shut = shut
        closed = () if zones is None else _near(zones.wide[zones.closed], places)
        areas = [*closed, *_closed_by(fence, every=every)]
        names = [str(number) for number in range(len(areas))]
        self.bends = Bends(replace(Airspace.of_polygons(names, areas), max_detour=MAX_DETOUR)) if areas else None

    def to(self, places: NDArray[np.float64], goal: Place) -> list[Via | None]:
        """Return the bends of the ways from places (latitude, longitude) to one; None if no way exists."""
        if self.bends is None or not len(places):
            return [None] * len(places)
        found = self.bends.to_one(places, goal)
        return [
            None if via is None or self._is_shut([(float(lat), float(lon)), *via, goal]) else via
            for (lat, lon), via in zip(places.tolist(), found, strict=True)
        ]

    def _is_shut(self, chain: Sequence[Place]) -> bool:
        at = np.array(chain)[:, ::-1]
        return bool(self.shut(np.stack((at[:-1], at[1:]), axis=1)).any())


def _near(areas: NDArray[np.object_], places: NDArray[np.float64]) -> list[shapely.Geometry]:
    """Return the areas that a way between places (latitude, longitude) may have to go around."""
    import shapely

    least, most = places.min(axis=0), places.max(axis=0)
    south, west = least - (most - least)
    north, east = most + (most - least)
    return list(areas[shapely.intersects(areas, shapely.box(west, south, east, north))])


def _closed_by(fence: Geofence, *, every: bool) -> list[shapely.Geometry]:
    """Return the areas that a fence closes: its exclusion areas, and the bays of its inclusion areas.

    A bay is the area between an inclusion area and its hull, extended outwards, so that no way leads around it outside of the fence.
    """
    import shapely
    from shapely import affinity

    allowed, forbidden = fence_shapes(fence, every=every)
    found = [] if forbidden is None else list(shapely.get_parts(forbidden))
    if allowed is None or allowed.is_empty:
        return found
    inner = allowed.buffer(-INSIDE_M / _M_PER_DEG)
    if inner.is_empty:
        return found
    hull = inner.convex_hull
    for bay in shapely.get_parts(shapely.difference(hull, inner)):
        mouth = shapely.intersection(bay.buffer(1e-9), hull.boundary)
        out = affinity.scale(mouth, 4.0, 4.0, origin=hull.centroid)
        found.append(shapely.union(bay, shapely.convex_hull(shapely.union(mouth, out))).buffer(1e-9))
    return [area for area in found if area.area > 0.0]
