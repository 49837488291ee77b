"""Hops: straight pieces of way between two places, and their time and energy in the wind.

The vehicle holds the commanded ground speed as long as its airspeed |ground - wind| allows, and flies slower where it does not.
Checks fly the hops of a mission one after the other; the search for places to recharge computes each separately.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.wind.triangle import along_across, ground_speed

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.missions.checks.energy import FlightConditions

SAME_PLACE_M = 0.5
"""A shorter way counts as no way: no wind prevents it."""


class Hops(NamedTuple):
    """Straight pieces of way, each array of shape (hops,)."""

    lat: NDArray[np.float64]
    lon: NDArray[np.float64]
    """Of their middle."""
    length_m: NDArray[np.float64]
    bearing_deg: NDArray[np.float64]
    speed_mps: NDArray[np.float64]
    """Commanded, over the ground."""
    hold_s: NDArray[np.float64]
    climb_s: NDArray[np.float64]
    descent_s: NDArray[np.float64]
    apart: NDArray[np.bool_]
    """Whether climb and descent come before or after the way instead of on it."""
    above_ground_m: NDArray[np.float64]
    """Mean height of the way."""


def hop_times(
    hops: Hops, conditions: FlightConditions, elapsed_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Fly hops, each separately, in every wind.

    Parameters
    ----------
    elapsed_s : ndarray, shape (members, hops)
        Start of each, after the first take-off.

    Returns
    -------
    time_s, possible_mps, needed_mps : ndarray, shape (members, hops)
        Seconds, holds included, infinite if the wind prevents the flight; greatest ground speed, 0 there; and the airspeed required for
        the commanded ground speed.
    """
    drone = conditions.drone
    angle = np.radians(hops.bearing_deg)
    north, east = conditions.weather.at(hops.lat, hops.lon, elapsed_s, hops.above_ground_m)
    along, across = along_across(north, east, np.cos(angle), np.sin(angle))
    possible = ground_speed(drone.max_airspeed_mps, along, across, drone.wind_limit_mps)
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.minimum(possible, hops.speed_mps)
        level_s = np.where(hops.length_m > SAME_PLACE_M, hops.length_m / speed, 0.0)
    vertical_s = hops.climb_s + hops.descent_s
    time_s = np.where(hops.apart, level_s + vertical_s, np.maximum(level_s, vertical_s)) + hops.hold_s
    return time_s, possible, np.hypot(hops.speed_mps - along, across)
