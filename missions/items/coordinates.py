"""Coordinates as the autopilots store them: integers of 1e-7 degree (about 1 cm)."""

from __future__ import annotations

from typing import NamedTuple

from skyway.models.base.formatting import stored_degrees

E7 = 10_000_000


def to_e7(value: float) -> int:
    """Round a value to an integer of 1e-7."""
    return round(value * E7)


def from_e7(value: int) -> float:
    """Return the value of an integer of 1e-7; the nearest double, so that it prints with at most 7 decimals."""
    return value / E7


class Point(NamedTuple):
    """A place on the map, compared exactly."""

    lat_e7: int
    lon_e7: int
    """Latitude and longitude, WGS-84, in 1e-7 degree."""

    @property
    def lat(self) -> float:
        """Latitude, degrees."""
        return self.lat_e7 / E7

    @property
    def lon(self) -> float:
        """Longitude, degrees."""
        return self.lon_e7 / E7

    @classmethod
    def of_degrees(cls, lat: float, lon: float) -> Point:
        """Round a position in degrees."""
        return cls(round(lat * E7), round(lon * E7))

    def __str__(self) -> str:
        return ",".join(stored_degrees(self.lat, self.lon))
