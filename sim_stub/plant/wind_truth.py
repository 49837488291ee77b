"""The true wind: constant, or a day of a record, with gusts.

Directions are FROM at the edge and vectors TOWARDS inside, as everywhere. A record is measured near the ground and
carried to flying height by the power law of `models.wind.triangle`; a constant wind is the wind at every height.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.wind import triangle as wind

if TYPE_CHECKING:
    import random

    from skyway.models.wind.ensemble import WindEnsemble

HEIGHT_EXPONENT = 0.2
_LOWEST_M = 2.0
_MAX_CACHED = 20_000


class WindTruth(Protocol):
    """The mean wind at a place and instant."""

    def at(self, posix_s: float, lat: float, lon: float, height_m: float) -> tuple[float, float]:
        """(north, east) m/s towards, at a height above ground."""
        ...


@dataclass(frozen=True, slots=True)
class ConstantWind:
    """The same wind everywhere and always."""

    north_mps: float = 0.0
    east_mps: float = 0.0
    """`north_mps`, `east_mps`: where the air moves TOWARDS."""

    @classmethod
    def of(cls, speed_mps: float, from_deg: float) -> ConstantWind:
        """A wind as people say it."""
        north, east = wind.vector(speed_mps, from_deg)
        return cls(float(north), float(east))

    def at(self, posix_s: float, lat: float, lon: float, height_m: float) -> tuple[float, float]:  # noqa: ARG002
        """(north, east) m/s towards."""
        return self.north_mps, self.east_mps


@dataclass(frozen=True, slots=True)
class RecordedWind:
    """A day of a wind record, or a forecast with one member, as the truth."""

    series: WindEnsemble
    """Its first member is what blows; each slot's wind is that of its middle, joined linearly."""
    _cache: dict[tuple[int, float, float], tuple[float, float]] = field(default_factory=dict)

    def at(self, posix_s: float, lat: float, lon: float, height_m: float) -> tuple[float, float]:
        """(north, east) m/s towards: sites weighted by inverse distance squared."""
        series = self.series
        place = (posix_s - series.start_s) / series.slot_s - 0.5
        slot = math.floor(place)
        first, second = self._slot(slot, lat, lon), self._slot(slot + 1, lat, lon)
        share = place - slot
        factor = wind.height_factor(max(height_m, _LOWEST_M), series.height_m, HEIGHT_EXPONENT)
        return (
            factor * (first[0] + share * (second[0] - first[0])),
            factor * (first[1] + share * (second[1] - first[1])),
        )

    def _slot(self, slot: int, lat: float, lon: float) -> tuple[float, float]:
        series = self.series
        row = min(max(slot, 0), series.north.shape[1] - 1)
        key = (row, round(lat, 3), round(lon, 3))
        found = self._cache.get(key)
        if found is not None:
            return found
        shrink = math.cos(math.radians(lat))
        square = (series.site_lat - lat) ** 2 + ((series.site_lon - lon) * shrink) ** 2
        weight = 1.0 / np.maximum(square, 1e-10)
        weight /= weight.sum()
        if len(self._cache) > _MAX_CACHED:
            self._cache.clear()
        self._cache[key] = float(series.north[0, row] @ weight), float(series.east[0, row] @ weight)
        return self._cache[key]


@dataclass(slots=True)
class Gusts:
    """Ornstein-Uhlenbeck gusts about the mean wind, exact for any step."""

    generator: random.Random
    """Seeded."""
    intensity: float = 0.12
    """Standard deviation as a share of the mean wind."""
    time_s: float = 8.0
    """Correlation time."""
    north_mps: float = 0.0
    east_mps: float = 0.0

    def step(self, mean_mps: float, duration_s: float) -> tuple[float, float]:
        """(north, east) of the gust after a time."""
        keep = math.exp(-duration_s / self.time_s)
        sigma = self.intensity * mean_mps * math.sqrt(1.0 - keep * keep)
        self.north_mps = keep * self.north_mps + sigma * self.generator.gauss(0.0, 1.0)
        self.east_mps = keep * self.east_mps + sigma * self.generator.gauss(0.0, 1.0)
        return self.north_mps, self.east_mps


def parse_constant(text: str) -> ConstantWind | None:
    """Read ``8@270`` (8 m/s FROM 270 degrees); None where the text is something else.

    An `InputError` refuses what is of that form, but absurd.
    """
    found = re.fullmatch(r"\s*(-?[\d.]+)\s*@\s*(-?[\d.]+)\s*", text)
    if found is None:
        return None
    try:
        speed, direction = float(found[1]), float(found[2])
    except ValueError:
        return None
    if not 0.0 <= speed <= 60.0 or not -360.0 <= direction <= 360.0:
        remedy = "SPEED@FROM, for example 8@270: 8 m/s from the west"
        raise InputError(Fault("not a wind", field="--wind", value=text, remedy=remedy))
    return ConstantWind.of(speed, direction)
