"""Ground speeds of a search: of a known wind, of a table, or averaged over the members of a forecast."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from skyway.models.flight.kernels import along_across, flyable, forward_mps
from skyway.models.jit.compiled import compiled
from skyway.models.wind.triangle import MIN_GROUND_SPEED_MPS
from skyway.planner.problem.flight_table import ground_speeds

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.flight.rules import SegmentWind

MIN_OPEN = 0.5
"""A segment is open in a slot where members of at least this probability can fly it."""
_COURSES = 72
"""Directions in which the greatest mean speed is looked for; between them it is no more than is added for it."""


class Speeds(Protocol):
    """Ground speeds of a network's segments by slot."""

    @property
    def slots(self) -> int:
        """Number of slots."""

    def over(self, first: int, last: int, segments: NDArray[np.int64]) -> NDArray[np.float64]:
        """Speeds over some segments in slots from the first to the last, shape (slots, segments); 0 where closed."""

    def fastest_mps(self, first: int, last: int) -> float:
        """Speed that none exceeds in slots from the first to the last."""


class TrueSpeeds:
    """Those of one member."""

    def __init__(self, air: SegmentWind, member: int = 0) -> None:
        self._air, self._member = air, member
        self.slots = int(air.north.shape[1])

    def over(self, first: int, last: int, segments: NDArray[np.int64]) -> NDArray[np.float64]:
        """See `Speeds`."""
        return ground_speeds(self._air, self._member, np.arange(first, last + 1), segments)

    def fastest_mps(self, first: int, last: int) -> float:
        """See `Speeds`."""
        air, rows = self._air, slice(first, last + 1)
        wind = float(np.hypot(air.north[self._member, rows], air.east[self._member, rows]).max())
        return min(air.max_ground_speed_mps, air.airspeed_mps + min(wind, air.wind_limit_mps))


class GivenSpeeds:
    """Those of a table, shape (slots, segments)."""

    def __init__(self, table: NDArray[np.float64]) -> None:
        self._table = table
        self.slots = len(table)

    def over(self, first: int, last: int, segments: NDArray[np.int64]) -> NDArray[np.float64]:
        """See `Speeds`."""
        return self._table[first : last + 1][:, segments]

    def fastest_mps(self, first: int, last: int) -> float:
        """See `Speeds`."""
        return max(float(self._table[first : last + 1].max()), 1.0)


@compiled
def _mean_speeds(
    air: SegmentWind, probability: NDArray[np.float64], first: int, last: int, segments: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Speeds whose times are the means of the members', m/s, shape (slots, segments); 0 where too few can fly.

    The harmonic mean over the members m that can fly: v = sum p_m / sum (p_m / v_m), where the p_m sum to `MIN_OPEN` at
    least.

    Takes a probability for each member, slots in order, and segments of the air.
    """
    count, sites = len(segments), air.weight.shape[1]
    # The segments' data as contiguous arrays: all segments are computed together, member by member.
    weight, cos, sin = np.empty((sites, count)), np.empty(count), np.empty(count)
    for i in range(count):
        for site in range(sites):
            weight[site, i] = air.weight[segments[i], site]
        cos[i], sin[i] = air.cos_bearing[segments[i]], air.sin_bearing[segments[i]]
    north, east, share, pace = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    out = np.empty((last - first + 1, count))
    for slot in range(first, last + 1):
        share[:] = 0.0
        pace[:] = 0.0
        for member in range(len(probability)):
            if probability[member] <= 0.0:
                continue
            # The member's wind over each segment.
            north[:] = 0.0
            east[:] = 0.0
            for site in range(sites):
                to_north, to_east = air.north[member, slot, site], air.east[member, slot, site]
                for i in range(count):
                    north[i] += weight[site, i] * to_north
                    east[i] += weight[site, i] * to_east
            for i in range(count):  # `models.flight.kernels.speed_in`, without branches
                along, across = along_across(north[i], east[i], cos[i], sin[i])
                forward = forward_mps(air.airspeed_mps, across)
                square = north[i] * north[i] + east[i] * east[i]
                part = probability[member] if flyable(along, forward, square, air.wind_limit_mps) else 0.0
                share[i] += part
                pace[i] += part / min(max(along + forward, MIN_GROUND_SPEED_MPS), air.max_ground_speed_mps)
        for i in range(count):
            shut = air.shut[slot, air.shut_of[segments[i]]]
            out[slot - first, i] = share[i] / pace[i] if share[i] >= MIN_OPEN and not shut else 0.0
    return out


class MeanSpeeds:
    """Speeds whose flight time is the mean over the members that can fly, computed on request.

    Parameters
    ----------
    air, probability
        The forecast.
    hours : float
        From here on the last slot's speeds hold on.
    """

    def __init__(self, air: SegmentWind, probability: NDArray[np.float64], hours: float) -> None:
        self._air, self._probability = air, np.ascontiguousarray(probability)
        self.slots = int(air.north.shape[1])
        self._count = min(int(np.ceil(hours * 3600.0 / air.slot_s)) + 1, self.slots)
        self._known = np.zeros(len(air.distance_m), dtype=np.int64)

    @cached_property
    def _table(self) -> NDArray[np.float64]:
        return np.zeros((self._count, len(self._air.distance_m)))

    def over(self, first: int, last: int, segments: NDArray[np.int64]) -> NDArray[np.float64]:
        """See `Speeds`."""
        most = min(last, self._count - 1) + 1
        missing = segments[self._known[segments] < most]
        if len(missing):
            self._table[:most, missing] = _mean_speeds(self._air, self._probability, 0, most - 1, missing)
            self._known[missing] = most
        return self._table[np.minimum(np.arange(first, last + 1), self._count - 1)][:, segments]

    def fastest_mps(self, first: int, last: int) -> float:
        """See `Speeds`."""
        return float(self._fastest_mps[min(first, self._count - 1) : min(last, self._count - 1) + 1].max())

    @cached_property
    def _fastest_mps(self) -> NDArray[np.float64]:
        """Speed that no mean over a segment exceeds, by slot.

        In a direction no member is faster than with the strongest tail wind of any site, and the mean of those that fly
        is no faster than that of those that always do or than the fastest of those that may not.
        """
        air, kept = self._air, self._probability > 0.0
        north, east = air.north[kept, : self._count], air.east[kept, : self._count]
        angle = np.arange(_COURSES) * (2.0 * np.pi / _COURSES)
        wind = np.hypot(north, east)
        tail = (north[..., None] * np.cos(angle) + east[..., None] * np.sin(angle)).max(axis=2)
        tail += wind.max(axis=2)[..., None] * (np.pi / _COURSES)
        speed = np.clip(air.airspeed_mps + tail, MIN_GROUND_SPEED_MPS, air.max_ground_speed_mps)
        always = wind.max(axis=2) < min(air.wind_limit_mps, air.airspeed_mps - MIN_GROUND_SPEED_MPS)
        share = np.where(always, self._probability[kept][:, None], 0.0)[..., None]
        mean = np.divide(
            share.sum(axis=0), (share / speed).sum(axis=0), out=np.zeros(speed.shape[1:]), where=share.sum(axis=0) > 0.0
        )
        others = np.where(always[..., None], 0.0, speed).max(axis=0)
        return np.asarray(np.maximum(mean, others).max(axis=1), dtype=np.float64)
