"""The online policy in sampled realizations, for `evaluate` and the benchmarks."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

from skyway.models.wind.estimation.field import WindObservation
from skyway.models.wind.estimation.forecast_update import update_forecast
from skyway.planner.online.information import Information
from skyway.planner.online.policy import OnlinePolicy
from skyway.planner.problem.error_model import USUAL_ERRORS, Errors

if TYPE_CHECKING:
    from skyway.models.wind.forecast import WindEnsemble
    from skyway.planner.evaluation.policies import Standing
    from skyway.planner.online.information import Departure
    from skyway.planner.problem.problem import Problem

EXACT = 1e-6
"""Variance of a component of a wind that is known, m2/s2: enough to tell members apart."""
MOST_SEEN = 150
"""Winds that count at once, at most: their covariances are inverted at each decision."""


def with_measured(forecast: WindEnsemble, standing: Standing, variance: float = EXACT) -> WindEnsemble:
    """Bring a forecast up to date with the wind of this hour and of those before it, at the sites and at the height of measurement.

    `variance` is that of a component, m2/s2. A wind counts as measured in the middle of its hour: it is the same all through it, and that of the
    next one is an hour away. Of many sites fewer of the hours before count.
    """
    winds = (standing.wind, *standing.before)[: max(MOST_SEEN // len(forecast.site_lat), 1)]
    slot_s = forecast.slot_s
    middle_s = forecast.start_s + (math.floor((standing.time_s - forecast.start_s) / slot_s) + 0.5) * slot_s
    seen = [
        WindObservation(middle_s - hours * slot_s, lat, lon, north, east, variance)
        for hours, wind in enumerate(winds)
        for lat, lon, north, east in zip(
            forecast.site_lat.tolist(), forecast.site_lon.tolist(), *(one.tolist() for one in wind), strict=True
        )
    ]
    return update_forecast(forecast, seen, slot_s=slot_s)


@dataclass(frozen=True)
class RollingRobust:
    """The online policy as `planner.evaluation.evaluate.fly_policy` flies it: at every stop, and over the stations on its way."""

    start: Problem
    """As at the departure, with a forecast that does not hold the realizations."""
    errors: Errors = USUAL_ERRORS
    """What the truth has beyond the forecast."""
    wind_variance: float = EXACT
    """Of a component of the wind that it is told, m2/s2: realizations tell the wind at the sites as it is."""

    @cached_property
    def policy(self) -> OnlinePolicy:
        """The policy flown."""
        p = self.start
        request = replace(p.request, drone=p.drone.id)
        return OnlinePolicy(p.scenario, request, p.parameters, errors=self.errors)

    def leave(self, standing: Standing) -> Departure | None:
        """Decision how to leave a stop."""
        return self.policy.on_ground(self.information(standing)).departure

    def over(self, flying: Standing, rest: tuple[int, ...]) -> tuple[int, ...]:
        """Segments to continue with over a station."""
        network = self.start.network
        names = [network.stations[int(network.head[one])].id for one in rest]
        info = replace(self.information(flying), via=tuple(names[:-1]), destination=names[-1])
        return self.policy.in_air(info).segments

    def information(self, standing: Standing) -> Information:
        """Information available at a stop, or over a station."""
        belief = self.errors.energy_of(self.start.drone)
        for ratio in standing.energy_ratios:
            belief = belief.learnt(ratio, 1.0, 0.0)
        if standing.under_way is not None:
            belief = belief.in_flight(standing.under_way, 1.0, 0.0)
        return Information(
            time_s=standing.time_s,
            soc=standing.soc,
            forecast=with_measured(self.start.ensemble, standing, self.wind_variance),
            belief=belief,
            measured=True,
            watched=False,
            station=standing.station,
            visited=frozenset(standing.visited),
            left=frozenset(standing.visited) - {standing.station},
            busy_pads=standing.busy,
            behind=standing.behind,
        )
