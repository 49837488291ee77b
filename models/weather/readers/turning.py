"""Winds along the axes of a grid, turned to true north.

An angle is that of the grid's second axis (its north), clockwise from true north, at a point. With components u and v along the
grid: east = u cos a + v sin a, north = v cos a - u sin a.

Sources: WMO-No. 306, Manual on Codes, volume I.2, flag table 3.3 (resolution and component flags); J. P. Snyder, "Map Projections, a
Working Manual", USGS Professional Paper 1395 (1987), equations 15-3 and 15-8 (cone constant of the Lambert conformal projection), 21-9
(polar stereographic); G. Doms and M. Baldauf, "A Description of the Nonhydrostatic Regional COSMO-Model", part I, section 3.3 (rotated pole).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


def lambert_angle_deg(
    lon: NDArray[np.float64], centre_deg: float, parallel1_deg: float, parallel2_deg: float
) -> NDArray[np.float64]:
    """Angle of a Lambert conformal grid at longitudes, degrees; its north is true along the central meridian."""
    first, second = np.radians(parallel1_deg), np.radians(parallel2_deg)
    if abs(first - second) < 1e-9:
        cone = np.sin(first)
    else:
        tangent = np.tan(np.pi / 4.0 + np.array([first, second]) / 2.0)
        cone = np.log(np.cos(first) / np.cos(second)) / np.log(tangent[1] / tangent[0])
    return np.asarray(cone * _signed(lon - centre_deg))


def polar_angle_deg(lon: NDArray[np.float64], centre_deg: float, *, south: bool = False) -> NDArray[np.float64]:
    """Angle of a polar stereographic grid at longitudes, degrees."""
    return np.asarray((-1.0 if south else 1.0) * _signed(lon - centre_deg))


def rotated_angle_deg(
    lat: NDArray[np.float64], lon: NDArray[np.float64], south_pole_lat_deg: float, south_pole_lon_deg: float
) -> NDArray[np.float64]:
    """Angle of a rotated latitude-longitude grid at true latitudes and longitudes, degrees.

    The grid's north points along the great circle to its northern pole, the antipode of the southern one: its azimuth is the angle.
    """
    pole_lat, pole_lon = -south_pole_lat_deg, south_pole_lon_deg + 180.0
    phi, pole = np.radians(lat), np.radians(pole_lat)
    apart = np.radians(pole_lon - lon)
    across = np.cos(pole) * np.sin(apart)
    along = np.cos(phi) * np.sin(pole) - np.sin(phi) * np.cos(pole) * np.cos(apart)
    return np.asarray(np.degrees(np.arctan2(across, along)))


def turned(
    u: NDArray[np.float64], v: NDArray[np.float64], angle_deg: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(north, east) of components along a grid; the angles belong to the last axis."""
    angle = np.radians(angle_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    return v * cos - u * sin, u * cos + v * sin


def _signed(degrees: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.mod(degrees + 180.0, 360.0) - 180.0)
