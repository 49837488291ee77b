"""Weather limits of a drone, or of an operation in a region, besides the wind."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.models.base.fields import Table


@dataclass(frozen=True, slots=True, kw_only=True)
class WeatherLimits:
    """Weather limits that close flights; none by default.

    Attributes
    ----------
    gust_mps : float
        Strongest gust, at the height that it is forecast for (10 m).
    rain_mm_h : float
        Heaviest rain, as water.
    visibility_m : float
        Least visibility.
    temperature_min_c, temperature_max_c : float
        Of the air at 2 m.
    no_icing : bool
        Not where ice may form on rotors: between -15 and 2 °C in rain, or at a humidity of 95 % and more.
    daylight_only : bool
        Only from sunrise to sunset.
    """

    gust_mps: float = math.inf
    rain_mm_h: float = math.inf
    visibility_m: float = 0.0
    temperature_min_c: float = -math.inf
    temperature_max_c: float = math.inf
    no_icing: bool = False
    daylight_only: bool = False

    def stricter(self, other: WeatherLimits) -> WeatherLimits:
        """Return the limits that satisfy both."""
        return WeatherLimits(
            gust_mps=min(self.gust_mps, other.gust_mps),
            rain_mm_h=min(self.rain_mm_h, other.rain_mm_h),
            visibility_m=max(self.visibility_m, other.visibility_m),
            temperature_min_c=max(self.temperature_min_c, other.temperature_min_c),
            temperature_max_c=min(self.temperature_max_c, other.temperature_max_c),
            no_icing=self.no_icing or other.no_icing,
            daylight_only=self.daylight_only or other.daylight_only,
        )


NO_LIMITS = WeatherLimits()
"""Only the wind closes flights."""


def read_limits(table: Table) -> WeatherLimits:
    """Read a table of limits; its faults join those of the file."""
    usual = NO_LIMITS
    found = WeatherLimits(
        gust_mps=table.number("gust_mps", usual.gust_mps, above=0, high=math.inf),
        rain_mm_h=table.number("rain_mm_h", usual.rain_mm_h, low=0, high=math.inf),
        visibility_m=table.number("visibility_m", usual.visibility_m, low=0, high=100_000),
        temperature_min_c=table.number("temperature_min_c", usual.temperature_min_c, low=-math.inf, high=60),
        temperature_max_c=table.number("temperature_max_c", usual.temperature_max_c, low=-60, high=math.inf),
        no_icing=table.flag("no_icing", default=False),
        daylight_only=table.flag("daylight_only", default=False),
    )
    table.finish()
    return found
