"""The region of a service, the same for all its programs: scenario, wind and parameters, from the service's record."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from skyway import typed_values
from skyway.models.base.units import S_PER_H, from_posix
from skyway.models.scenario.air import fleet_in_air
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from skyway.dispatch.records import ServiceRecord
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.parameters.planner import PlannerParameters

RENEWED_S = 6 * S_PER_H
"""Interval of new forecasts, s."""
NEVER_S = 1e6


class Region:
    """Scenario, wind and parameters of a service."""

    def __init__(self, service: ServiceRecord) -> None:
        self.service = service
        self.base: Scenario = load_scenario(None if service.scenario is None else Path(service.scenario))
        self._forecasts = lru_cache(maxsize=4)(self._forecast)
        self._wider = lru_cache(maxsize=512)(self._with_places)

    @cached_property
    def planning(self) -> PlannerParameters:
        """Return the parameters of the fleet's planner."""
        return typed_values.planner_parameters(list(self.service.settings))

    @cached_property
    def flying(self) -> PlannerParameters:
        """Return the parameters of the supervisor: a flight of a fleet's plan does not look for a better station by itself."""
        known = self.planning
        return replace(known, online=replace(known.online, better_every_s=NEVER_S))

    def forecast(self, now_s: float) -> WindEnsemble:
        """Return the forecast known at an instant, POSIX seconds."""
        number = int(max(now_s - self.service.begin_s, 0.0) // RENEWED_S)
        return self._forecasts(number)

    def _forecast(self, number: int) -> WindEnsemble:
        begin = from_posix(self.service.begin_s + number * RENEWED_S)
        return typed_values.wind_forecast(self.base, begin, self.service.wind, None, None, self._day)

    @property
    def _day(self) -> date | None:
        """Return the day of the record whose wind blows; it is in no forecast."""
        try:
            return date.fromisoformat(self.service.actual_wind or "")
        except ValueError:
            return None

    def with_places(self, names: tuple[str, ...]) -> Scenario:
        """Return the scenario with places that are not stations, each named ``lat,lon``."""
        return self._wider(tuple(dict.fromkeys(one for one in names if one not in self.base.network.index)))

    def _with_places(self, names: tuple[str, ...]) -> Scenario:
        scenario = self.base
        for name in names:
            position = typed_values.parse_position(name)
            if position is not None:
                scenario = scenario.with_target(*position, id=name)
        return scenario

    def in_air(self, scenario: Scenario, now_s: float) -> Scenario:
        """Return the scenario with the air density of the forecast, and the battery capacity at its temperature."""
        return fleet_in_air(scenario, self.forecast(now_s), now_s)
