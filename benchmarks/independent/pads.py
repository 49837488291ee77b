"""Queues at the pads by event simulation: first come, first served, and our drone among strangers."""

from __future__ import annotations

import heapq
import math
from bisect import bisect_right
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from typing import TYPE_CHECKING, Literal
from zoneinfo import ZoneInfo

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from benchmarks.independent.ground import Ground

Charging = Literal["exponential", "lognormal"]
LOGNORMAL_SIGMA = 0.5
WARM_UP_S = 48 * 3600.0
"""Strangers come so long before the departure; stations near or above full load would need weeks."""
OUT_OF_ORDER = 0.1


@lru_cache(maxsize=256)
def hours_of_week(timezone: str, first_hour: int, hours: int) -> tuple[int, ...]:
    """Local hour of the week, Monday 00:00 being 0, in which each of consecutive hours of UTC begins."""
    zone = ZoneInfo(timezone)
    stamps = [datetime.fromtimestamp((first_hour + k) * 3600.0, UTC).astimezone(zone) for k in range(hours)]
    return tuple(24 * stamp.weekday() + stamp.hour for stamp in stamps)


def arrivals(
    rng: np.random.Generator, rate_per_s: NDArray[np.float64], hour: tuple[int, ...], start_s: float
) -> NDArray[np.float64]:
    """Arrival times of a Poisson process with an hourly rate, by thinning; `hour[k]` is the row of the k-th hour from `start_s`."""
    most = float(rate_per_s.max(initial=0.0))
    if most <= 0.0:
        return np.empty(0)
    span = 3600.0 * len(hour)
    times = np.sort(rng.uniform(0.0, span, rng.poisson(most * span)))
    rates = rate_per_s[np.asarray(hour)[(times / 3600.0).astype(np.int64)]]
    return np.asarray(start_s + times[rng.uniform(0.0, most, len(times)) < rates])


def services(rng: np.random.Generator, mean_s: NDArray[np.float64], law: Charging) -> NDArray[np.float64]:
    """Times on a pad with given means."""
    if law == "exponential":
        return np.asarray(rng.exponential(1.0, len(mean_s)) * mean_s)
    return np.asarray(rng.lognormal(-0.5 * LOGNORMAL_SIGMA**2, LOGNORMAL_SIGMA, len(mean_s)) * mean_s)


def pad_starts(came_s: list[float], service_s: list[float], pads: int) -> list[float]:
    """When each of a line, in order of arrival, gets one of the pads; event by event."""
    free = [-math.inf] * pads
    heapq.heapify(free)
    starts = []
    for came, service in zip(came_s, service_s, strict=True):
        begin = max(came, heapq.heappop(free))
        starts.append(begin)
        heapq.heappush(free, begin + service)
    return starts


@dataclass(frozen=True, eq=False)
class Line:
    """Strangers at one station: when they come, get a pad, and leave; each list ascends but for the last."""

    pads: int
    spots: int
    out: int
    came_s: list[float]
    began_s: list[float]
    service_s: list[float]
    left_s: list[float]

    def present(self, time_s: float) -> int:
        """Strangers on pads and in line."""
        return bisect_right(self.came_s, time_s) - bisect_right(self.left_s, time_s)

    def told(self, time_s: float) -> int:
        """What the pad service tells: a pad out of order is not free."""
        return self.present(time_s) + self.out

    def pad_time(self, time_s: float) -> float:
        """When one that comes at a time gets a pad; infinite without pads."""
        if self.pads == 0:
            return math.inf
        before = bisect_right(self.came_s, time_s)
        ends = [begin + service for begin, service in zip(self.began_s[:before], self.service_s[:before], strict=True)]
        busy = heapq.nlargest(self.pads, [end for end in ends if end > time_s])
        return time_s if len(busy) < self.pads else busy[-1]

    def place_time(self, time_s: float) -> float:
        """When one that comes at a time finds a pad or a spot free: as soon as enough of those before it have left."""
        if self.pads == 0:
            return time_s
        before = bisect_right(self.came_s, time_s)
        ends = sorted(
            b + s for b, s in zip(self.began_s[:before], self.service_s[:before], strict=True) if b + s > time_s
        )
        too_many = len(ends) - (self.pads + self.spots) + 1
        return time_s if too_many <= 0 else ends[too_many - 1]

    def before(self, came_s: float, time_s: float) -> int:
        """Strangers at a time that came no later than `came_s`."""
        last = bisect_right(self.came_s, came_s)
        return sum(b + s > time_s for b, s in zip(self.began_s[:last], self.service_s[:last], strict=True))


class Stations:
    """The lines of one run, each simulated when it is first asked for.

    Parameters
    ----------
    ground : Ground
    seed : tuple of int
        Of the run.
    start_s, hours : float
        Departure, by the calendar of the delivery, and for how long strangers come.
    factor : (float, float)
        Arrivals are the profile's times a factor drawn between these.
    law : Charging
    broken : bool
        One pad of ten is out of order (one at each station works).
    """

    def __init__(
        self,
        ground: Ground,
        seed: tuple[int, ...],
        start_s: float,
        hours: int,
        factor: tuple[float, float] = (1.0, 1.0),
        law: Charging = "exponential",
        *,
        broken: bool = False,
    ) -> None:
        self.ground, self.seed, self.law, self.broken = ground, seed, law, broken
        self.first_hour = math.floor((start_s - WARM_UP_S) / 3600.0)
        self.hour = hours_of_week(ground.timezone, self.first_hour, hours + round(WARM_UP_S / 3600.0))
        self.factor = float(np.random.default_rng((*seed, 1)).uniform(*factor))
        self._lines: dict[int, Line] = {}

    def line(self, node: int) -> Line:
        """The strangers at a station."""
        if node not in self._lines:
            self._lines[node] = self._simulate(node)
        return self._lines[node]

    def _simulate(self, node: int) -> Line:
        pads, spots = int(self.ground.pads[node]), int(self.ground.spots[node])
        if pads == 0:
            return Line(0, spots, 0, [], [], [], [])
        rng = np.random.default_rng((*self.seed, 2, node))
        out = min(int(rng.binomial(pads, OUT_OF_ORDER)), pads - 1) if self.broken else 0
        begin = 3600.0 * self.first_hour
        came = arrivals(rng, self.factor * self.ground.arrivals_per_s[node], self.hour, begin)
        hour = np.asarray(self.hour)[((came - begin) / 3600.0).astype(np.int64)]
        service = services(rng, self.ground.charging_s[node][hour], self.law).tolist()
        began = pad_starts(came.tolist(), service, pads - out)
        left = sorted(b + s for b, s in zip(began, service, strict=True))
        return Line(pads - out, spots, out, came.tolist(), began, service, left)
