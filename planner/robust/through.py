"""Routes with required stops: composed piece by piece, from each to the next, in the given order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from skyway.planner.schedule.itinerary import fly_true
from skyway.planner.schedule.schedule_kernels import SOC_LANDING, TOUCH_DOWN

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from skyway.models.queues.paths import QueuePath
    from skyway.planner.problem.problem import Problem
    from skyway.planner.schedule.itinerary import Itinerary


def compose_through(
    problem: Problem,
    queues: Mapping[int, QueuePath],
    find: Callable[[Problem], tuple[Itinerary | None, float]],
) -> Itinerary | None:
    """Compose to each stop of ``problem.must_stop`` and on to the destination; None where a piece has no way.

    `find` composes a piece and returns its arrival, POSIX seconds. The next piece begins then, with the charge on landing
    in the first member; if that wind never permits the flight, with the reserve. Each piece is optimal by itself: that a
    later arrival at a stop could shorten the rest is not examined.
    """
    legs: Itinerary = ()
    here = problem
    for node in (*problem.must_stop, problem.destination):
        part = here.bound_for(node)
        found, arrive_s = find(part)
        if found is None:
            return None
        legs += found
        landed = fly_true(part, found, queues)[0, -1]
        soc = float(landed[SOC_LANDING]) if math.isfinite(landed[TOUCH_DOWN]) else problem.reserve
        here = problem.standing_at(node, arrive_s, min(max(soc, problem.reserve), 1.0))
    return legs
