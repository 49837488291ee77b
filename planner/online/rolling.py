"""The robust planner in a rolling horizon: it decides again at every stop with what is known there."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skyway.models.wind.estimation.field import WindObservation
from skyway.models.wind.estimation.forecast_update import update_forecast
from skyway.planner.online.departure import Departure
from skyway.planner.online.hindsight import Hindsight
from skyway.planner.problem.error_model import USUAL_ERRORS, Errors
from skyway.planner.problem.problem import Problem

if TYPE_CHECKING:
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.evaluation.policies import Standing

SITE_VARIANCE = 0.05
"""Of a component of the hourly wind measured at a site, m2/s2."""
LOOK_S = 300.0
"""A drone that waits for a pad, or for room elsewhere, looks again after so long."""


def with_measured(forecast: WindEnsemble, standing: Standing) -> WindEnsemble:
    """Bring a forecast up to date with the wind measured at its sites now, at the height of measurement."""
    north, east = standing.wind
    seen = [
        WindObservation(standing.time_s, lat, lon, float(n), float(e), SITE_VARIANCE)
        for lat, lon, n, e in zip(forecast.site_lat.tolist(), forecast.site_lon.tolist(), north, east, strict=True)
    ]
    return update_forecast(forecast, seen, slot_s=forecast.slot_s)


@dataclass(frozen=True)
class RollingRobust:
    """A policy for `planner.evaluation.evaluate.fly_policy`: decides again at every stop and over the stations on its way.

    Attributes
    ----------
    start : Problem
        As at the departure, with a forecast that does not hold the realizations.
    errors : Errors
        What the truth has beyond the forecast.
    """

    start: Problem
    errors: Errors = USUAL_ERRORS

    def leave(self, standing: Standing) -> Departure | None:
        """The step with the least expected arrival."""
        seen = self._seen(standing, in_flight=False)
        step = seen.choose()
        p = seen.problem
        waits = p.has_pads(p.origin) and standing.busy.get(standing.station, 0) >= p.network.pads[p.origin]
        look_s = standing.time_s + LOOK_S if waits or not seen.roomy_way else math.inf
        if not step.segments:
            return Departure((), 1.0, lambda _: math.inf, look_s)
        sure = step.segments[: step.sure]

        def need(time_s: float) -> float:
            if step.turn_back is None:
                return seen.need(sure, time_s)
            return step.charge if seen.turns.in_time(step.turn_back, step.charge, time_s) else math.inf

        return Departure(step.segments, step.charge, need, look_s, step.turn_back)

    def over(self, flying: Standing, rest: tuple[int, ...]) -> tuple[int, ...]:
        """On to the end while that is safe; else what is best from here."""
        seen = self._seen(flying, in_flight=True)
        p = seen.problem
        end = int(p.network.head[rest[-1]])
        if seen.likely_free_at[end] and seen.need(rest, p.depart_s) <= p.soc:
            return rest
        return seen.choose().segments

    def problem_at(self, standing: Standing) -> Problem:
        """The rest of the delivery, with the forecast of that moment."""
        p = self.start
        request = replace(p.request, state=standing.state())
        return Problem(p.scenario, request, p.drone, with_measured(p.ensemble, standing))

    def _seen(self, standing: Standing, *, in_flight: bool) -> Hindsight:
        now = self.problem_at(standing)
        if in_flight:
            now = now.standing_at(now.origin, standing.time_s, standing.soc, in_flight=True)
        return Hindsight(now, self.errors, energy=standing.energy, behind=standing.behind)
