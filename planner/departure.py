"""The best departure within a window."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import timedelta
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InfeasibleError, InputError, NoRouteError
from skyway.models.base.formatting import duration
from skyway.planner.parameters.planner import USUAL
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.registry import ROBUST

if TYPE_CHECKING:
    from collections.abc import Callable
    from datetime import datetime

    from skyway.models.base.statistics import Figure
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.parameters.planner import PlannerParameters
    from skyway.planner.problem.request import Request
    from skyway.planner.result import PlanResult


@dataclass(frozen=True)
class Departure:
    """A departure that was tried."""

    depart: datetime
    """Time of departure."""
    delivery: Figure | None
    """Mean delivery time from then, s; None where there is no route."""
    p_on_time: float
    """Probability to keep the deadline, 1 without one."""

    @property
    def delivery_s(self) -> float:
        """Mean delivery time from a departure; infinite where there is no route."""
        return math.inf if self.delivery is None else self.delivery.value


def plan_within(
    scenario: Scenario,
    request: Request,
    window_s: float,
    *,
    planner: str = ROBUST,
    forecast: Callable[[datetime], WindEnsemble] | None = None,
    progress: Callable[[int, int], None] | None = None,
    parameters: PlannerParameters = USUAL,
) -> tuple[PlanResult, list[Departure]]:
    """Plan for the departure within a window that takes the least time, or that best meets the deadline.

    The drone waits at its origin until then, and is charged there. The window begins at the time of the request and
    lasts up to a day. `forecast` gives the forecast for a departure, by default the scenario's; `progress` is called with how
    many of how many departures have been tried. Returns the plan for the best departure, and all departures tried, in
    order; none from the deadline on.

    An `InputError` refuses another window and a drone in the air; where no departure has a route, the `InfeasibleError`
    is the first's.
    """
    schedule = parameters.schedule
    if not schedule.min_window_s <= window_s <= 86_400.0:
        remedy = "from 1 min to 24 h, such as 2h"
        raise InputError(Fault("out of range", field="depart-window", value=duration(window_s), remedy=remedy))
    if request.state.position is not None:
        raise InputError(Fault("a drone in the air cannot wait for its departure", field="depart-window"))
    step, most = schedule.departure_step_s, max(schedule.max_departures, 2)
    count = min(max(math.floor(window_s / step + 1e-9), 1) + 1, most)
    step = min(window_s / (count - 1), step) if count < most else window_s / (count - 1)
    best: PlanResult | None = None
    best_loss: tuple[float, ...] = (math.inf,)
    first_error: InfeasibleError | None = None
    tried = []
    for number in range(count):
        depart = request.state.time + timedelta(seconds=number * step)
        if number and request.objective.deadline is not None and depart >= request.objective.deadline:
            if progress is not None:
                progress(count, count)
            break  # who leaves then is late
        moved = replace(request, state=replace(request.state, time=depart))
        wind = forecast(depart) if forecast is not None else scenario.forecast(depart, HORIZON_H)
        try:
            result = plan(scenario, moved, planner=planner, forecast=wind, parameters=parameters)
        except InfeasibleError as error:
            first_error = first_error or error
            tried.append(Departure(depart, None, 0.0))
        else:
            on_time = request.objective.on_time(result.outcome)
            tried.append(Departure(depart, result.outcome.delivery, on_time))
            loss = request.objective.loss(result.outcome, depart.timestamp())
            if loss < best_loss:
                best, best_loss = result, loss
        if progress is not None:
            progress(number + 1, count)
    if best is None:
        raise first_error or NoRouteError("no departure in the window has a route", constraint="energy")
    return best, tried
