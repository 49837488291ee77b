"""The robust planner anew at every stop, with what is known there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from models.errors import InfeasibleError
from models.forecast_update import update_forecast
from models.wind_field import WindObservation
from planner.evaluation_truths import USUAL_ERRORS, Errors
from planner.problem import Problem
from planner.robust import RobustSearch

if TYPE_CHECKING:
    from models.wind_forecast import WindEnsemble
    from planner.charge_policy import ChargePolicy
    from planner.evaluation_flights import Standing

SITE_VARIANCE = 0.05
"""Of a component of the hourly wind measured at a site, m2/s2."""

SWITCH_S = 900.0
"""What it costs to give up a route for another, about: a landing more, and the wait for a pad."""


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
    """A policy for `planner.evaluate.fly_policy`: plans anew at every stop, and charges by what is known until it leaves.

    Attributes
    ----------
    start : Problem
        As at the departure, with a forecast that does not hold the truths.
    errors : Errors
        What the truth has beyond the forecast.
    """

    start: Problem
    errors: Errors = USUAL_ERRORS

    def rule(self, standing: Standing) -> ChargePolicy | None:
        """The best policy from here; its first flight is flown."""
        p = self.start
        request = replace(p.request, state=standing.state())
        forecast = with_measured(p.ensemble, standing)
        problem = Problem(p.scenario, request, p.drone, forecast)
        try:
            return RobustSearch(problem, errors=self.errors, switch_s=SWITCH_S).candidates()[0].policy
        except InfeasibleError:
            return None
