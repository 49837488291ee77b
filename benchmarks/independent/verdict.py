"""What a world makes of a planner's promises: deliveries that were flown, summed up beside what was said of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.independent.delivery import DELIVERED, STRANDED
from benchmarks.independent.information import LEVELS
from benchmarks.independent.statistics import over_days, percent, wilson

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

RESERVE = 0.2
SAME_TIME, TENTH_S = 0.002, 0.1
"""Distances on the plane of a world are those of the ellipsoid within this share, and times are written in tenths of a second: many deliveries in light
wind take the same time, that of the greatest speed over ground, and would be late by it."""


TOLD = 0.0, 0.001, 0.01, 0.03, 0.1, 1.001
"""Classes of what is told of landings below the reserve."""


@dataclass(frozen=True)
class Verdict:
    """What a world makes of a planner's promises; shares from 0 to 1, intervals over days.

    Attributes
    ----------
    deliveries
        Flown; where some were left out (`Study.share`) each counts for as many as it stands for.
    stands_for : float
        Deliveries that those flown stand for.
    below, below_wilson, below_blocks, below_days
        Share of deliveries with a landing below the reserve. The intervals are Wilson's for independent deliveries, Wilson's as if all deliveries of an order on one
        day ended alike, and the bootstrap over days, which is of no width where there are none.
    lowest : (float, float, float)
        Lowest charge at a landing: the least of all deliveries, and what one in 1,000 and one in 100 of them is below.
    on_time : tuple
        (level, promised, kept, interval) at the levels of the plan's own quantiles.
    """

    world: str
    orders: int
    unplanned: int
    deliveries: int
    stands_for: float
    landings: int
    below_landings: int
    lowest: tuple[float, float, float]
    below_count: int
    below: float
    below_wilson: tuple[float, float]
    below_blocks: tuple[float, float]
    below_days: tuple[float, float]
    promised_below: float
    stranded: int
    not_delivered: int
    mean_min: float
    mean_days_min: tuple[float, float]
    promised_mean_min: float
    on_time: tuple[tuple[float, float, float, tuple[float, float]], ...]

    def line(self) -> str:
        """One line for people."""
        times = "  ".join(
            f"{100 * level:.0f}%: {100 * said:.1f} -> {percent(kept, days, '{:.1f}'.format)}"
            for level, said, kept, days in self.on_time
        )
        return (
            f"{self.world:<20} {self.orders} of {self.orders + self.unplanned} orders, {self.deliveries:>6} deliveries for {self.stands_for:.0f}: {self.below_count} below {percent(self.below, self.below_days)} "
            f"(Wilson {_interval(self.below_wilson)}, by order and day {_interval(self.below_blocks)}, "
            f"promised {100 * self.promised_below:.3f}; of landings {100 * self.below_landings / max(self.landings, 1):.2f}, "
            f"1 % below SoC {self.lowest[2]:.3f}) stranded {self.stranded} failed {self.not_delivered} "
            f"mean {self.mean_min:.1f} min [{self.mean_days_min[0]:.1f}, {self.mean_days_min[1]:.1f}] "
            f"promised {self.promised_mean_min:.1f}  on time {times}"
        )


@dataclass(frozen=True)
class Told:
    """What fixed routes tell of landings below the reserve, from `low` to `high`, and what becomes of them."""

    low: float
    high: float
    orders: int
    deliveries: int
    told: float
    met: float
    met_days: tuple[float, float]

    def line(self) -> str:
        """One line for people."""
        return (
            f"  told {100 * self.low:g} to {100 * self.high:g} %: {self.orders} orders, {self.deliveries} deliveries of the fixed route: "
            f"told {100 * self.told:.2f} %, met {percent(self.met, self.met_days)}"
        )


def in_time(time_s: NDArray[np.float64], due_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether deliveries arrive by the times at which they are due; infinite: never."""
    return np.asarray(time_s <= due_s * (1.0 + SAME_TIME) + TENTH_S)


def verdict(documents: Sequence[dict[str, Any]]) -> Verdict:
    """Sum the orders of one world up."""
    flown = [one for one in documents if one["planned"]]
    day = np.array([value for one in flown for value in one["day"]], dtype=np.int64)
    block = np.array(
        [100_000_000 * number + value for number, one in enumerate(flown) for value in one["day"]], dtype=np.int64
    )
    weight = np.array([value for one in flown for value in one["weight"]], dtype=float)
    ending = [value for one in flown for value in one["ending"]]
    landings = [value for one in flown for value in one["landings"]]
    below = np.array([any(soc < RESERVE - 1e-9 for soc in socs) for socs in landings], dtype=float)
    time_s = np.array(
        [math.nan if value is None else value for one in flown for value in one["delivery_s"]], dtype=float
    )
    due = np.array([one["promised_quantile_s"] for one in flown for _ in one["day"]])
    said = np.array([one["promised"] for one in flown for _ in one["day"]])
    kept = in_time(np.where(np.isnan(time_s), math.inf, time_s)[:, None], due)
    of_order = np.array([sum(one["weight"]) for one in flown], dtype=float)

    def mean_of(name: str) -> float:
        return float(np.average([one[name] for one in flown], weights=of_order))

    there = np.isfinite(time_s)
    mean_days = over_days(time_s, day, weight)
    return Verdict(
        world=documents[0]["world"],
        orders=len(flown),
        unplanned=len(documents) - len(flown),
        deliveries=len(ending),
        stands_for=float(weight.sum()),
        landings=sum(len(socs) for socs in landings),
        below_landings=sum(soc < RESERVE - 1e-9 for socs in landings for soc in socs),
        lowest=_lowest(landings),
        below_count=int(below.sum()),
        below=float(np.average(below, weights=weight)),
        below_wilson=_wilson(below, weight, np.arange(len(below))),
        below_blocks=_wilson(below, weight, block),
        below_days=over_days(below, day, weight),
        promised_below=1.0 - mean_of("promised_reserve"),
        stranded=ending.count(STRANDED),
        not_delivered=len(ending) - ending.count(DELIVERED) - ending.count(STRANDED),
        mean_min=float(np.average(time_s[there], weights=weight[there])) / 60.0,
        mean_days_min=(mean_days[0] / 60.0, mean_days[1] / 60.0),
        promised_mean_min=mean_of("promised_mean_s") / 60.0,
        on_time=tuple(
            (
                level,
                float(np.average(said[:, k], weights=weight)),
                float(np.average(kept[:, k], weights=weight)),
                over_days(kept[:, k].astype(float), day, weight),
            )
            for k, level in enumerate(LEVELS)
        ),
    )


def told_and_met(documents: Sequence[dict[str, Any]]) -> list[Told]:
    """Fixed routes by what their plans tell of landings below the reserve in wind that no site tells, of orders that were screened."""
    flown = [one for one in documents if one["planned"] and one.get("told_below") is not None]
    found = []
    for low, high in pairwise(TOLD):
        mine = [one for one in flown if low <= one["told_below"] < high]
        if mine:
            soc = np.array([value for one in mine for value in one["route_lowest"]], dtype=float)
            day = np.array([value for one in mine for value in one["route_day"]], dtype=np.int64)
            told = np.array([one["told_below"] for one in mine for _ in one["route_day"]])
            there = np.isfinite(soc)
            below = (soc[there] < RESERVE - 1e-9).astype(float)
            found.append(
                Told(
                    low,
                    high,
                    len(mine),
                    len(below),
                    float(told[there].mean()),
                    float(below.mean()),
                    over_days(below, day[there]),
                )
            )
    return found


def _wilson(below: NDArray[np.float64], weight: NDArray[np.float64], block: NDArray[np.int64]) -> tuple[float, float]:
    """Interval of a share: of each of the two strata that screening makes, with as many trials as it has blocks, and their ends added up."""
    low = high = 0.0
    alone = weight == 1.0
    for one in (alone, ~alone):
        if one.any():
            share, count = np.average(below[one], weights=weight[one]), len(np.unique(block[one]))
            ends, part = wilson(float(share * count), count), weight[one].sum() / weight.sum()
            low, high = low + part * ends[0], high + part * ends[1]
    return float(low), float(high)


def _interval(ends: tuple[float, float]) -> str:
    return f"[{100.0 * ends[0]:.2f}, {100.0 * ends[1]:.2f}]"


def _lowest(landings: Sequence[Sequence[float]]) -> tuple[float, float, float]:
    least = [min(socs) for socs in landings if socs] or [math.nan]
    low, thousandth, hundredth = np.quantile(least, (0.0, 0.001, 0.01)).tolist()
    return low, thousandth, hundredth
