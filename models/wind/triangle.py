"""Wind and flight through it: the wind triangle (paper, equations 1-6) and the height profile.

With bearing theta and wind FROM theta_w: delta = theta - theta_w, A = W cos(180 - delta) along the course (positive is
a tailwind), C = W sin(180 - delta) across it, B = sqrt(S^2 - C^2), ground speed A + B.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Quantity: TypeAlias = Any
"""What the equations take: a number, as kernels hand it over, or an array of many legs."""
MIN_GROUND_SPEED_MPS = 1.0
"""Nobody flies a leg that would be slower than this."""


def vector(speed_mps: ArrayLike, from_deg: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(north, east) velocity of the air, where it moves TOWARDS, of winds given as people say them."""
    angle = np.radians(np.asarray(from_deg, dtype=np.float64))
    speed = np.asarray(speed_mps, dtype=np.float64)
    return -speed * np.cos(angle), -speed * np.sin(angle)


def speed_from(north_mps: ArrayLike, east_mps: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Speed and FROM direction in [0, 360) of wind vectors; calm has direction 0."""
    north = np.asarray(north_mps, dtype=np.float64)
    east = np.asarray(east_mps, dtype=np.float64)
    speed = np.hypot(north, east)
    direction = np.mod(np.degrees(np.arctan2(-east, -north)), 360.0)
    direction = np.where((speed == 0.0) | (direction >= 360.0), 0.0, direction)
    return speed, direction


def height_factor(height_m: Quantity, measured_at_m: Quantity, exponent: float) -> Any:
    """Ratio of the wind at a height to the wind where it was measured: (h / h0) ** exponent. Takes numbers or arrays."""
    return (height_m / measured_at_m) ** exponent


def along_across(north: Quantity, east: Quantity, cos_bearing: Quantity, sin_bearing: Quantity) -> tuple[Any, Any]:
    """Components A and C of a wind: along a course and across it, m/s. Takes numbers or arrays; also compiled, for kernels."""
    return north * cos_bearing + east * sin_bearing, east * cos_bearing - north * sin_bearing


def forward_mps(airspeed_mps: Quantity, across_mps: Quantity) -> Any:
    """B: what the crosswind leaves of the airspeed along the course, m/s; 0 where it leaves none. Numbers or arrays; also compiled."""
    square = airspeed_mps * airspeed_mps - across_mps * across_mps
    return np.sqrt(0.5 * (square + abs(square)))  # the root of max(square, 0), without a branch


def flyable(along_mps: Quantity, forward: Quantity, square_wind: Quantity, wind_limit_mps: Quantity) -> Any:
    """Whether a course can be flown at A + B in a wind of such a square, m2/s2. Numbers or arrays; also compiled."""
    fast = along_mps + forward >= MIN_GROUND_SPEED_MPS
    return (forward > 0.0) & fast & (square_wind <= wind_limit_mps * wind_limit_mps)


def ground_speed(
    airspeed_mps: ArrayLike,
    tailwind_mps: ArrayLike,
    crosswind_mps: ArrayLike,
    wind_limit_mps: ArrayLike = math.inf,
    max_ground_speed_mps: ArrayLike = math.inf,
) -> NDArray[np.float64]:
    """Ground speed of many legs, broadcast; 0 where a leg cannot be flown, never NaN."""
    s, a, c, limit = (
        np.asarray(v, dtype=np.float64) for v in (airspeed_mps, tailwind_mps, crosswind_mps, wind_limit_mps)
    )
    b = forward_mps(s, c)
    return np.where(flyable(a, b, a * a + c * c, limit), np.minimum(a + b, max_ground_speed_mps), 0.0)
