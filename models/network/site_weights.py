"""Weights of wind sites half-way along the segments of a network, stored for the most recent sites."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base import geodesy
from skyway.models.wind.interpolation import site_weights, spatial, weights_at

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_KEPT, MAX_SITES = 8, 64
"""Sets of weights, and sites whose distances are kept, at most: each drone that measures the wind is a site of its own for half a minute."""


class SiteWeights:
    """Weights at fixed points.

    Parameters
    ----------
    lat, lon : ndarray, shape (points,)
        The points, degrees.
    """

    def __init__(self, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> None:
        self._lat, self._lon = lat, lon
        self._place_m = spatial(lat, lon)
        self._weights: dict[tuple[bytes, tuple[int, int] | None], NDArray[np.float64]] = {}
        self._distances: dict[tuple[float, float], NDArray[np.float64]] = {}

    def of(
        self, site_lat: NDArray[np.float64], site_lon: NDArray[np.float64], lattice: tuple[int, int] | None
    ) -> NDArray[np.float64]:
        """Weights of sites, shape (points, sites); see `models.wind.interpolation.site_weights`."""
        sites = np.array((site_lat, site_lon), dtype=np.float64)
        key = sites.tobytes(), lattice
        if key not in self._weights:
            if lattice is None:
                found = weights_at(np.stack([self._distance(*site) for site in sites.T.tolist()], axis=1))
            else:
                found = site_weights(self._lat, self._lon, site_lat, site_lon, lattice)
            _keep(self._weights, key, np.ascontiguousarray(found), MAX_KEPT)
        return self._weights[key]

    def joined(
        self, more: SiteWeights, order: NDArray[np.int64], points: tuple[NDArray[np.float64], NDArray[np.float64]]
    ) -> SiteWeights:
        """Return weights at these points and more, in another order: known ones need not be computed again."""
        found = SiteWeights(*points)
        for (sites, lattice), weights in self._weights.items():
            lat, lon = np.frombuffer(sites).reshape(2, -1)
            others = more.of(lat, lon, lattice)
            found._weights[sites, lattice] = np.concatenate((weights, others))[order]
        return found

    def _distance(self, lat: float, lon: float) -> NDArray[np.float64]:
        """Of a site from the points, m, shape (points,)."""
        if (lat, lon) not in self._distances:
            distance_m = geodesy.spatial_distance_m(self._place_m, spatial(lat, lon))
            _keep(self._distances, (lat, lon), distance_m, MAX_SITES)
        return self._distances[lat, lon]


def _keep(kept: dict[Any, NDArray[np.float64]], key: object, value: NDArray[np.float64], most: int) -> None:
    """Add to the stored items; the oldest are removed if there are too many."""
    while len(kept) >= most:
        del kept[next(iter(kept))]
    kept[key] = value
