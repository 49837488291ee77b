"""Parameters of the search for tours."""

from __future__ import annotations

from dataclasses import dataclass

from skyway.models.base.parameters import Parameters, parameter


@dataclass(frozen=True)
class ToursParameters(Parameters):
    """Of the search of `planner.tours`."""

    removed: float = parameter(10.0, "customers that are taken out at once, on average", 1, 1000)
    longest: int = parameter(10, "customers that are taken out of one tour at once, at most", 1, 1000)
    warm: float = parameter(
        0.15,
        "at the beginning a change that costs this share of the mean tour with one customer is accepted with 1/e",
        1e-6,
        100,
        measured="annealings of 40,000 iterations: from 0.07 rc208_21 does not leave its first valley (3.7 %), from 0.15 it does (1.5 %; decision 128)",
    )
    cool: float = parameter(
        0.01,
        "the same at the end",
        1e-6,
        100,
        measured="annealings of r201_21, r208_21, rc201_21 and rc208_21: below 0.015 the plan hardly changes, so that most iterations of a cooling to 0.0024 had no effect (decision 128)",
    )
    fleet_share: float = parameter(0.3, "share of the time for fewer vehicles, at most", 0, 1)
    rounds: int = parameter(
        4, "how often it cools and then chooses the best of all tours seen; the last time from less warmth", 1, 100
    )
    pooled: float = parameter(1.03, "tours are kept of plans that cost less than so many times the best", 1, 10)
    pool: int = parameter(40_000, "tours that are kept, at most", 100, 10_000_000)
    choice_share: float = parameter(0.2, "share of the time for each choice of the best, at most", 0, 1)
    choice_s: float = parameter(10.0, "time for each choice of the best, at most", 0, 1e6, unit="s")
    level: float = parameter(
        0.8, "stations charge drones up to this, where charging is about as fast as from empty", 0.3, 1
    )
    absent: float = parameter(
        0.5, "what an order that is in no tour costs when the search begins, in mean tours with one customer", 1e-6, 1e6
    )
    late: float = parameter(
        0.1, "what a unit of lateness costs when the search begins, in mean tours with one customer", 1e-6, 1e6
    )
