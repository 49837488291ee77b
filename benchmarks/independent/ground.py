"""Stations and segments on a plane: all that the world knows of a network."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_A_M, _E2 = 6_378_137.0, 0.006_694_379_990_14  # WGS-84
CORRECTIONS = 4


@dataclass(frozen=True)
class Plane:
    """Tangent plane of the ellipsoid at a centre, degrees: distances on it are 1e-4 short 100 km away, 1e-5 within 40 km."""

    lat: float
    lon: float

    def xy(self, lat: ArrayLike, lon: ArrayLike) -> NDArray[np.float64]:
        """Positions, shape (..., 2), metres north and east."""
        east = np.radians(np.asarray(lon, dtype=np.float64) - self.lon)
        north = np.radians(np.asarray(lat, dtype=np.float64))
        x, y, z = _from_axis(north, east)
        x0, _, z0 = _from_axis(math.radians(self.lat), 0.0)
        sine, cosine = math.sin(math.radians(self.lat)), math.cos(math.radians(self.lat))
        return np.stack(((z - z0) * cosine - (x - x0) * sine, y), axis=-1)

    def lat_lon(self, xy: NDArray[np.float64]) -> tuple[float, float]:
        """Latitude and longitude of a position, degrees, by successive corrections: each leaves a hundredth of the distance."""
        lat, lon = self.lat, self.lon
        for _ in range(CORRECTIONS):
            north, east = np.degrees((xy - self.xy(lat, lon)) / _A_M).tolist()
            lat, lon = lat + north, lon + east / math.cos(math.radians(lat))
        return lat, lon


def _from_axis(lat: ArrayLike, lon: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Cartesian coordinates of points of the ellipsoid, radians, m."""
    lat, lon = np.asarray(lat, dtype=np.float64), np.asarray(lon, dtype=np.float64)
    normal = _A_M / np.sqrt(1.0 - _E2 * np.sin(lat) ** 2)
    level = normal * np.cos(lat)
    return level * np.cos(lon), level * np.sin(lon), normal * (1.0 - _E2) * np.sin(lat)


@dataclass(frozen=True, eq=False)
class Ground:
    """A network.

    Attributes
    ----------
    ids : tuple of str
    xy : ndarray, shape (stations, 2)
        Metres north and east on `plane`.
    pads, spots : ndarray of int, shape (stations,)
    tail, head : ndarray of int, shape (segments,)
    arrivals_per_s, charging_s : ndarray, shape (stations, 168)
        Other drones by hour of the week, local time; hour 0 is Monday 00:00.
    timezone : str
    """

    ids: tuple[str, ...]
    plane: Plane
    xy: NDArray[np.float64]
    pads: NDArray[np.int64]
    spots: NDArray[np.int64]
    tail: NDArray[np.int64]
    head: NDArray[np.int64]
    arrivals_per_s: NDArray[np.float64]
    charging_s: NDArray[np.float64]
    timezone: str
