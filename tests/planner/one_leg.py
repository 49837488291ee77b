"""The wind triangle of one leg, by `models.wind.triangle.ground_speed`."""

import math
from typing import NamedTuple

from skyway.models.wind.triangle import ground_speed


class WindTriangle(NamedTuple):
    """Wind along the course (tailwind positive) and across it (from the left positive), and the ground speed; 0: not flyable."""

    tailwind_mps: float
    crosswind_mps: float
    ground_speed_mps: float


def wind_triangle(airspeed_mps, wind_mps, wind_from_deg, bearing_deg, **limits):
    """Solve the wind triangle for one leg (equations 1-6); `limits` are those of `ground_speed`."""
    angle = math.radians(180.0 - (bearing_deg - wind_from_deg))
    along, across = wind_mps * math.cos(angle), wind_mps * math.sin(angle)
    return WindTriangle(along, across, float(ground_speed(airspeed_mps, along, across, **limits)))
