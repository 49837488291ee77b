"""The rest of a cut mission, replanned: from a pad after the work done so far, or from a flight under way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.fixed_route.charging_stops import charging_stops
from skyway.recharge.cutting import cuts_of
from skyway.recharge.problem import problem_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.missions.recharge.spans import Cut, Done
    from skyway.missions.recharge.work import Work
    from skyway.planner.fixed_route.charging_stops import ChargingPlan, FixedRoute
    from skyway.recharge.problem import RechargeOptions, RechargeProblem

NEVER_SOC = 10.0
"""More than any battery: a way that must not be flown."""
AHEAD = 1e-6
"""Points of the work closer than this share of a leg count as passed."""


@dataclass(frozen=True, slots=True)
class RestPlan:
    """Plan of the remaining work: where it is left again, and time and charge at the start of the first flight."""

    cuts: tuple[Cut, ...]
    depart_s: float
    """On the clock of the problem."""
    soc_leave: float
    plan: ChargingPlan
    """The following stops; positions are points of the work."""


def with_known(problem: RechargeProblem, options: RechargeOptions) -> RechargeProblem:
    """Return the same work with other winds, another belief, or another charge."""
    return problem_of(problem.work, problem.ways, options)


def from_pad(
    problem: RechargeProblem, begin: tuple[int, int], soc: float, ratios: tuple[float, float]
) -> RestPlan | None:
    """Plan from a pad, with the work done up to a point; None if no stops let it end.

    It may charge there first. `ratios`: mean and required charge of flights, over the model's.
    """
    point, pad = begin[0], _usable_now(problem, begin[1])
    if pad is None:
        return None
    whole = problem.route(ratios[1])
    hops = whole.hops
    pads = hops.to_s.shape[2]

    def shut(values: NDArray[np.float64], none: float) -> NDArray[np.float64]:
        """Put a position first that is connected only to this pad."""
        row = np.full((len(values), 1, pads), none)
        row[:, 0, pad] = 0.0
        return np.ascontiguousarray(np.concatenate((row, values[:, point:]), axis=1))

    slots = len(hops.work_s)
    never = np.full((slots, 1), NEVER_SOC)
    count = hops.to_s.shape[1] - point
    here = hops._replace(
        work_s=np.ascontiguousarray(np.concatenate((np.zeros((slots, 1)), hops.work_s[:, point:]), axis=1)),
        work_soc=np.ascontiguousarray(np.concatenate((never, hops.work_soc[:, point:]), axis=1)),
        to_s=shut(hops.to_s, np.inf),
        to_soc=shut(hops.to_soc, 0.0),
        from_s=np.ascontiguousarray(
            np.concatenate((hops.from_s[:, point : point + 1], hops.from_s[:, point:]), axis=1)
        ),
        from_soc=np.ascontiguousarray(
            np.concatenate((hops.from_soc[:, point : point + 1], hops.from_soc[:, point:]), axis=1)
        ),
        resume=np.concatenate(([1], np.arange(1, count + 1))),
    )
    can_leave = np.concatenate(([True, False], whole.can_leave[point + 1 :]))
    start = max(soc, whole.reserve_soc)
    plan = charging_stops(
        replace(
            whole,
            hops=here,
            can_leave=can_leave,
            start_s=0.0,
            soc_start=start,
            mean_ratio=ratios[0],
            sure_ratio=ratios[1],
        )
    )
    if plan is None or not plan.stops:
        return None
    stops = problem.told(plan, point - 1).stops
    first, *others = (replace(stop, position=max(stop.position, point)) for stop in stops)
    rest = replace(plan, stops=tuple(others), depart_s=first.leave_s)
    return RestPlan(cuts_of(rest), first.leave_s, first.soc_leave, rest)


def from_start(problem: RechargeProblem, soc: float, ratios: tuple[float, float]) -> RestPlan | None:
    """Plan the complete rest with the present charge."""
    plan = charging_stops(replace(problem.route(ratios[1]), soc_start=soc, mean_ratio=ratios[0]))
    if plan is None:
        return None
    plan = problem.told(plan)
    return RestPlan(cuts_of(plan), plan.depart_s, soc, plan)


def in_air(
    problem: RechargeProblem, following: int, left: tuple[float, float], soc: float, ratios: tuple[float, float]
) -> RestPlan | None:
    """Plan from the air: where this flight leaves the work; None if no pad is reached with the reserve.

    `following`: the next point of the work; `left`: seconds and charge, by the model, from here to there.
    """
    whole: FixedRoute = problem.route(ratios[1])
    hops, pads = whole.hops, whole.hops.to_s.shape[2]
    slots = len(hops.work_s)

    def before(values: NDArray[np.float64], row: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.ascontiguousarray(np.concatenate((row, values[:, following:]), axis=1))

    nowhere, nothing = np.full((slots, 1, pads), np.inf), np.zeros((slots, 1, pads))
    count = hops.to_s.shape[1] - following
    here = hops._replace(
        work_s=before(hops.work_s, np.full((slots, 1), left[0])),
        work_soc=before(hops.work_soc, np.full((slots, 1), left[1])),
        to_s=before(hops.to_s, nowhere),
        to_soc=before(hops.to_soc, nothing),
        from_s=before(hops.from_s, nowhere),
        from_soc=before(hops.from_soc, nothing),
        resume=np.arange(count + 1),
    )
    can_leave = np.concatenate(([False], whole.can_leave[following:]))
    plan = charging_stops(
        replace(whole, hops=here, can_leave=can_leave, soc_start=soc, mean_ratio=ratios[0], sure_ratio=ratios[1])
    )
    if plan is None:
        return None
    plan = problem.told(plan, following - 1)
    return RestPlan(cuts_of(plan), 0.0, soc, plan)


def _usable_now(problem: RechargeProblem, pad: int) -> int | None:
    """Return the number of a pad in the route, in the window that is open now; None if it has none."""
    return next(
        (row for row, (number, (begin, end)) in enumerate(problem.usable) if number == pad and begin <= 0.0 <= end),
        None,
    )


def next_point(work: Work, done: Done) -> int | None:
    """Return the first point of the work that is still ahead; None if there is none."""
    for number, point in enumerate(work.points):
        if (point.step, point.share) > (done[0], done[1] + AHEAD):
            return number
    return None
