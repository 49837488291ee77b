"""Arrivals that `fly` tells at its decisions on the ground, beside the deliveries."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.independent.statistics import over_days, percent
from benchmarks.independent.verdict import in_time

if TYPE_CHECKING:
    from collections.abc import Sequence

TOLD = "told_arrivals"
"""Key of a document: of each delivery a list of (decision, half by, 95 % by), s after the departure."""


@dataclass(frozen=True)
class ToldArrivals:
    """How often told arrivals are kept: those told first of each delivery, or all of them.

    Attributes
    ----------
    half, most : (float, (float, float))
        Share delivered by the time at which half, and 95 %, should be; with the interval over days.
    """

    which: str
    deliveries: int
    told: int
    half: tuple[float, tuple[float, float]]
    most: tuple[float, tuple[float, float]]

    def line(self) -> str:
        """One line for people."""
        return f"  arrivals told, {self.which}: {self.told} in {self.deliveries} deliveries; 50 % kept {percent(*self.half)}, 95 % kept {percent(*self.most)}"


def told_arrivals(documents: Sequence[dict[str, Any]]) -> list[ToldArrivals]:
    """Sum up what was told on the way; nothing where no arrivals were told."""
    flown = [one for one in documents if one["planned"] and TOLD in one]
    deliveries = [
        (day, math.inf if time_s is None else time_s, told)
        for one in flown
        for day, time_s, told in zip(one["day"], one["delivery_s"], one[TOLD], strict=True)
        if told
    ]
    found = []
    for which, count in (("first", 1), ("all", None)):
        rows = [(day, time_s, *one) for day, time_s, told in deliveries for one in told[:count]]
        if rows:
            day, time_s, _, half_s, most_s = np.array(rows, dtype=float).T
            kept = [in_time(time_s, due_s).astype(float) for due_s in (half_s, most_s)]
            shares = [(float(one.mean()), over_days(one, day.astype(np.int64))) for one in kept]
            found.append(ToldArrivals(which, len(deliveries), len(rows), shares[0], shares[1]))
    return found
