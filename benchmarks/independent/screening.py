"""Which deliveries are flown as they are decided in the air, where that costs too much for all: those of which the fixed route comes near the reserve, and a share of the others.

Decisions in the air cost thirty times what the flight costs. The fixed route is flown in all runs of an order first; a run whose route lands below the
reserve, close above it or never is flown again with decisions, since its wind, queues and vehicle are the bad ones. Of the others a share is, and each of
them counts for as many as it stands for (W. Cochran, "Sampling Techniques" (1977), chapter 5A: stratified sampling).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.independent.delivery import DELIVERED, STRANDED, deliver

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from benchmarks.independent.delivery import Setting
    from benchmarks.independent.information import Order, Policy

CLOSE_SOC = 0.22
"""A landing of the fixed route with less than that is close to the reserve, which is 20 %."""
_STREAM = 99


def chosen(
    setting: Setting, order: Order, route: Policy, share: float, seeds: Sequence[tuple[int, ...]]
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Fly a fixed route in all runs; return the runs to be flown with decisions, how many deliveries each stands for, and the lowest landing of the route in all runs.

    The lowest landing is NaN where the route was not delivered, unless it was stranded, which is below zero.
    """
    flown = deliver(setting, order, route)
    close = np.array([run.ending != DELIVERED or min(run.landings) < CLOSE_SOC for run in flown])
    others = np.flatnonzero(~close)
    draw = np.array([np.random.default_rng((*seeds[run], _STREAM)).random() for run in others.tolist()])
    drawn = others[np.argsort(draw)[: math.ceil(share * len(others))]]
    weight = np.where(close, 1.0, len(others) / max(len(drawn), 1))
    runs = np.sort(np.concatenate((np.flatnonzero(close), drawn)))
    ended = np.array([run.ending in (DELIVERED, STRANDED) for run in flown])
    lowest = np.array([min(run.landings, default=math.nan) for run in flown])
    return runs, weight[runs], np.where(ended, lowest, math.nan)
