"""Summary of a wind forecast: mean, range and prevailing direction.

A forecast is an ensemble: many winds are possible on a leg, at the time and height at which it is flown. They are summarised
by their mean speed, the 10 and 90 % quantiles of the speed, and the direction from which most of them come.
The length of the mean vector is not a typical speed: winds from all sides cancel in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base.formatting import direction_text
from skyway.models.base.statistics import weighted_quantile
from skyway.models.wind.triangle import height_factor, speed_from, vector

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from skyway.models.wind.ensemble import WindEnsemble

LOW, HIGH = 0.1, 0.9
"""Quantiles of the speed that are shown beside its mean."""
SECTOR_DEG = 90.0
"""Width of the sector within which winds count as blowing from one direction."""
PREVAILS = 0.5
"""A direction prevails if more than this share of the winds comes from one sector; below, the direction is variable."""
CALM_MPS = 0.05
"""Weaker winds have no direction."""


@dataclass(frozen=True, slots=True)
class Wind:
    """Wind as speed and FROM direction: one wind, or a range of possible winds."""

    speed_mps: float
    """Metres per second; the mean of the possible winds."""
    from_deg: float | None
    """Where it blows FROM, degrees clockwise from true north; None is variable."""
    p10_mps: float | None = None
    p90_mps: float | None = None
    """Speeds that 10 and 90 % of the winds do not exceed; None: one wind."""

    @property
    def certain(self) -> bool:
        """Whether it is one wind; otherwise its figures have only the digits that a forecast supports."""
        if self.p10_mps is None or self.p90_mps is None:
            return True
        return self.p90_mps - self.p10_mps < CALM_MPS and (self.from_deg is not None or self.p90_mps < CALM_MPS)

    @property
    def range_text(self) -> str:
        """Speeds for people without unit: ``8 (5 to 11)``, or ``7.5`` where it is one wind."""
        if self.certain or self.p10_mps is None or self.p90_mps is None:
            return f"{self.speed_mps:.1f}"
        return f"{self.speed_mps:.0f} ({self.p10_mps:.0f} to {self.p90_mps:.0f})"

    @property
    def direction_text(self) -> str:
        """Direction for people: ``203°``, to ten degrees (``200°``) where it is not certain, or ``variable``."""
        if self.from_deg is None:
            return "variable"
        return direction_text(self.from_deg, 1 if self.certain else 10)

    def __str__(self) -> str:
        """``8 (5 to 11) m/s from 200°``; ``8 (5 to 11) m/s, variable direction``; ``7.5 m/s from 203°``; ``calm``."""
        if max(self.speed_mps, self.p90_mps or 0.0) < CALM_MPS:
            return "calm"
        if self.from_deg is None:
            return f"{self.range_text} m/s, variable direction"
        return f"{self.range_text} m/s from {self.direction_text}"


class Passage(NamedTuple):
    """Place and time at which a wind is met: a segment, at its middle, or a place."""

    lat_deg: float
    lon_deg: float
    """WGS-84."""
    begin_s: float
    end_s: float
    """POSIX seconds; the same twice is an instant."""
    factor: float = 1.0
    """Ratio of the wind at the flown height to that at the height of the summary
    (`models.flight.heights.wind_factors`)."""


@dataclass(frozen=True, slots=True)
class WindSummary:
    """The winds that are possible there."""

    mean_mps: float
    p10_mps: float
    p90_mps: float
    """Mean speed, and the speeds that 10 and 90 % of the winds do not exceed."""
    from_deg: float | None
    """Prevailing direction that the wind blows FROM: the mean direction of the winds in the sector of 90 degrees that
    holds most of them. None: variable, no sector holds more than half of them."""
    sector_share: float
    """Share of the winds in that sector."""
    north_mps: float
    east_mps: float
    """Mean vector TOWARDS; for components along and across a course, see `components`."""

    def as_data(self) -> dict[str, float | None]:
        """Data from which `summary_from` makes the same text: mean speed, p10, p90, direction."""
        return {
            "mean_mps": self.mean_mps, "p10_mps": self.p10_mps, "p90_mps": self.p90_mps, "from_deg": self.from_deg,
            "sector_share": self.sector_share,
        }  # fmt: skip

    def components(self, course_deg: float) -> tuple[float, float]:
        """Mean wind along a course (tailwind positive) and across it (from its left positive), m/s."""
        angle = np.radians(course_deg)
        cos, sin = float(np.cos(angle)), float(np.sin(angle))
        return self.north_mps * cos + self.east_mps * sin, self.east_mps * cos - self.north_mps * sin

    @property
    def wind(self) -> Wind:
        """The same in the form of a plan and its file."""
        return Wind(self.mean_mps, self.from_deg, self.p10_mps, self.p90_mps)

    def __str__(self) -> str:
        """``8 (5 to 11) m/s from 200°``; see `Wind`."""
        return str(self.wind)


def summary_from(data: Mapping[str, float | None]) -> WindSummary | None:
    """Return the summary from `WindSummary.as_data`; None if its speeds are unknown. The mean vector is not kept."""
    speeds = [data.get(name) for name in ("mean_mps", "p10_mps", "p90_mps")]
    mean, low, high = (math.nan if speed is None else speed for speed in speeds)
    if not math.isfinite(mean + low + high):
        return None
    return WindSummary(mean, low, high, data.get("from_deg"), data.get("sector_share") or 0.0, math.nan, math.nan)


def summarise_wind(
    ensemble: WindEnsemble, passages: Sequence[Passage], height_m: float, profile_exponent: float
) -> WindSummary:
    """Summarise the possible winds of an ensemble on a way at a height above ground; of one member: that wind.

    Each passage counts with its duration; instants count equally. The wind grows with height by
    `models.wind.triangle.height_factor`.
    """
    factor = height_factor(height_m, ensemble.height_m, profile_exponent)
    lat, lon = [one.lat_deg for one in passages], [one.lon_deg for one in passages]
    places = ensemble.weights(lat, lon)
    total = sum(one.end_s - one.begin_s for one in passages)
    north, east, weight = [], [], []
    for one, place in zip(passages, places, strict=True):
        for slot, seconds in _slots(ensemble, one):
            share = seconds / total if total > 0.0 else 1.0 / len(passages)
            north.append(one.factor * (ensemble.north[:, slot] @ place))
            east.append(one.factor * (ensemble.east[:, slot] @ place))
            weight.append(share * ensemble.probability)
    return summary_of(factor * np.concatenate(north), factor * np.concatenate(east), np.concatenate(weight))


def summary_of(
    north_mps: NDArray[np.float64], east_mps: NDArray[np.float64], weight: NDArray[np.float64]
) -> WindSummary:
    """Summarise winds TOWARDS (north, east), each of a weight, shape (winds,) each; the weights need not sum to 1."""
    weight = weight / weight.sum()
    speed, direction = speed_from(north_mps, east_mps)
    from_deg, share = _prevailing(direction, np.where(speed < CALM_MPS, 0.0, weight))
    return WindSummary(
        mean_mps=float(weight @ speed),
        p10_mps=weighted_quantile(speed, weight, LOW),
        p90_mps=weighted_quantile(speed, weight, HIGH),
        from_deg=from_deg if share > PREVAILS else None,
        sector_share=share,
        north_mps=float(weight @ north_mps),
        east_mps=float(weight @ east_mps),
    )


def _slots(ensemble: WindEnsemble, passage: Passage) -> list[tuple[int, float]]:
    """Slots of the wind that a passage falls into, with the seconds in each."""
    first, last = ensemble.slot_at(passage.begin_s), ensemble.slot_at(passage.end_s)
    edges = ensemble.start_s + ensemble.slot_s * np.arange(first + 1, last + 1)
    marks = np.concatenate(([passage.begin_s], edges, [passage.end_s]))
    return list(zip(range(first, last + 1), np.diff(marks).tolist(), strict=True))


def _prevailing(direction_deg: NDArray[np.float64], weight: NDArray[np.float64]) -> tuple[float, float]:
    """Mean direction of the winds in the sector that holds most of them, and the share of all winds in it.

    A sector that holds most begins at one of the winds: going round in their order, its end never goes back.
    """
    total = float(weight.sum())
    if total <= 0.0:
        return 0.0, 0.0
    order = np.argsort(direction_deg, kind="stable")
    angle, mass = direction_deg[order], weight[order]
    around, twice = np.concatenate((angle, angle + 360.0)), np.concatenate((mass, mass))
    below = np.concatenate(([0.0], np.cumsum(twice)))
    end = np.searchsorted(around, angle + SECTOR_DEG + 1e-9, side="right")
    end = np.minimum(end, np.arange(len(angle)) + len(angle))
    held = below[end] - below[: len(angle)]
    first = int(np.argmax(held > held.max() - 1e-12))
    inside = slice(first, int(end[first]))
    north, east = vector(twice[inside], around[inside])
    _, middle = speed_from(north.sum(), east.sum())
    return float(middle), min(float(held[first]), 1.0)
