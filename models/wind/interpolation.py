"""Interpolation of wind between its sites, by the inverse square of the distance."""

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
    points = (np.atleast_1d(np.asarray(values, dtype=np.float64))[:, None] for values in (lat, lon))
    places = (np.asarray(values, dtype=np.float64)[None, :] for values in (site_lat, site_lon))
    distance, _ = geodesy.inverse(*points, *places)
    return weights_at(distance)


def weights_at(distance_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same from distances, metres, shape (points, sites)."""
    nearest = distance_m.min(axis=1, keepdims=True)
    ratio = np.maximum(nearest, 1e-3) / np.maximum(distance_m, 1e-3)
    weights = np.where(nearest <= 1e-3, distance_m == nearest, ratio**2)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))
