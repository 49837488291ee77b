"""Interpolation of wind between its sites: by the inverse square of the distance, or bilinear on a lattice."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def idw_weights(lat: ArrayLike, lon: ArrayLike, site_lat: ArrayLike, site_lon: ArrayLike) -> NDArray[np.float64]:
    """Weights of sites at points, degrees, by the inverse square of the distance, shape (points, sites); rows sum to 1.

    Within a millimetre of a site it alone counts.

    Source: D. Shepard, "A two-dimensional interpolation function for irregularly-spaced data", 1968.
    """
    points, sites = spatial(lat, lon), spatial(site_lat, site_lon)
    return weights_at(geodesy.spatial_distance_m(points[:, None], sites))


def spatial(lat: ArrayLike, lon: ArrayLike) -> NDArray[np.float64]:
    """Places, degrees, in space (`models.base.geodesy.earth_xyz`), m, shape (places, 3)."""
    return geodesy.earth_xyz(np.column_stack([np.atleast_1d(np.asarray(one, dtype=np.float64)) for one in (lat, lon)]))


def site_weights(
    lat: ArrayLike, lon: ArrayLike, site_lat: ArrayLike, site_lon: ArrayLike, lattice: tuple[int, int] | None = None
) -> NDArray[np.float64]:
    """Weights of sites at points, degrees, shape (points, sites); rows sum to 1.

    Bilinear where the sites are the nodes of a `lattice` (rows, columns), row by row, latitude and longitude ascending: outside it the wind of
    its edge continues. Otherwise by `idw_weights`.
    """
    if lattice is None:
        return idw_weights(lat, lon, site_lat, site_lon)
    rows, columns = lattice
    lats = np.asarray(site_lat, dtype=np.float64).reshape(rows, columns)[:, 0]
    lons = np.asarray(site_lon, dtype=np.float64).reshape(rows, columns)[0]
    east = np.mod(np.atleast_1d(np.asarray(lon, dtype=np.float64)) - lons[0] + 180.0, 360.0) - 180.0
    across = _hats(east, lons - lons[0])
    along = _hats(np.atleast_1d(np.asarray(lat, dtype=np.float64)), lats)
    return np.asarray((along[:, :, None] * across[:, None, :]).reshape(-1, rows * columns))


def _hats(place: NDArray[np.float64], nodes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights of ascending nodes at places on a line, shape (places, nodes)."""
    if len(nodes) == 1:
        return np.ones((len(place), 1))
    below = np.clip(np.searchsorted(nodes, place, side="right") - 1, 0, len(nodes) - 2)
    share = np.clip((place - nodes[below]) / (nodes[below + 1] - nodes[below]), 0.0, 1.0)
    found = np.zeros((len(place), len(nodes)))
    row = np.arange(len(place))
    found[row, below] = 1.0 - share
    found[row, below + 1] = share
    return found


def weights_at(distance_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same from distances, metres, shape (points, sites)."""
    weights = np.square(np.maximum(distance_m, 1e-3))
    np.divide(1.0, weights, out=weights)
    weights /= weights.sum(axis=1, keepdims=True)
    at_site = np.flatnonzero((distance_m <= 1e-3).any(axis=1))
    if len(at_site):
        there = distance_m[at_site] == distance_m[at_site].min(axis=1, keepdims=True)
        weights[at_site] = there / there.sum(axis=1, keepdims=True)
    return np.asarray(weights)
