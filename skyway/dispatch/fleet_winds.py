"""Winds measured by drones, shared with neighbouring drones and with the dispatcher."""

from __future__ import annotations

import math
import threading
from typing import TYPE_CHECKING

from skyway.models.base.units import from_posix
from skyway.models.wind.estimation.field import ResidualModel, WindObservation
from skyway.models.wind.estimation.forecast_update import update_forecast
from skyway.planner.dispatch.departure_margin import DepartureMargin, departure_margin

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from skyway.dispatch.records import FlightRecord
    from skyway.dispatch.region import Region
    from skyway.models.wind.ensemble import WindEnsemble

KEPT_S = 3600.0
"""Greatest age of a measurement used by others, s."""
RENEWED_S = 600.0
"""Interval of forecast updates of the dispatcher, s."""
EXPECTED_VARIANCE = 0.25
"""Variance of a wind component that a drone of known drag measures over some minutes, m2/s2."""
NOBODY = -1
WindRecord = tuple[float, float, float, float, float, float]


def last_of(measured: Sequence[WindObservation]) -> WindRecord | None:
    """Return the last of some measurements in the form of a record."""
    if not measured:
        return None
    one = max(measured, key=lambda each: each.time_s)
    return one.time_s, one.lat_deg, one.lon_deg, one.north_mps, one.east_mps, one.variance


class FleetWinds:
    """Last measurement of each drone; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._last: dict[int, WindObservation] = {}

    def tell(self, system: int, measured: Sequence[WindObservation]) -> None:
        """Take the measurements of a drone; the last one counts."""
        if measured:
            with self._lock:
                known = [self._last[system]] if system in self._last else []
                self._last[system] = max([*known, *measured], key=lambda one: one.time_s)

    def hear(self, flights: Iterable[FlightRecord]) -> None:
        """Take the measurements in flight records."""
        for one in flights:
            if one.progress is not None and one.progress.wind is not None:
                self.tell(one.system, [WindObservation(*one.progress.wind)])

    def at(self, at_s: float) -> tuple[WindObservation, ...]:
        """Return the measurements of all drones up to an instant, POSIX seconds, and at most `KEPT_S` old."""
        return self.of_others(NOBODY, at_s)

    def of_others(self, system: int, at_s: float, own_until_s: float = -math.inf) -> tuple[WindObservation, ...]:
        """Return the measurements of the other drones up to an instant, POSIX seconds, at most `KEPT_S` old; and of this one before its flight began."""
        with self._lock:
            last = sorted(self._last.items())
        return tuple(
            one
            for name, one in last
            if at_s - KEPT_S < one.time_s <= at_s and (name != system or one.time_s <= own_until_s)
        )


class FleetForecast:
    """The dispatcher's forecast: updated with its drones' measurements, and with the departure margins that it implies."""

    def __init__(self, region: Region) -> None:
        self._region, self._winds = region, FleetWinds()
        self._made_s, self._measured = -math.inf, False
        self._known: tuple[WindEnsemble, dict[str, DepartureMargin]] | None = None

    def hear(self, flights: Iterable[FlightRecord]) -> None:
        """Take the measurements in flight records."""
        self._winds.hear(flights)

    def at(self, now_s: float) -> tuple[WindEnsemble, dict[str, DepartureMargin]]:
        """Return the forecast known at an instant, POSIX seconds, and the margin of each type of drone.

        The margin is that of flights that begin after a drone has measured the wind, soon after the first take-off; until then the
        expected wind replaces the future measurement.
        """
        forecast = self._region.forecast(now_s)
        measured = [one for one in self._winds.at(now_s) if one.time_s >= forecast.start_s]
        first = bool(measured) and not self._measured
        if self._known is None or first or now_s >= self._made_s + RENEWED_S:
            self._made_s, self._measured = now_s, bool(measured)
            known = self._updated(forecast, measured)
            then = known if measured else self._updated(forecast, [_as_expected(known, now_s)])
            self._known = known, self._margins(then, now_s)
        return self._known

    def _updated(self, forecast: WindEnsemble, measured: Sequence[WindObservation]) -> WindEnsemble:
        scenario, online = self._region.base, self._region.planning.online
        base = forecast.at_height(scenario.rules.cruise_height_m, scenario.rules.wind_profile_exponent)
        return update_forecast(
            base, measured, ResidualModel(tau_s=online.residual_tau_s), slot_s=base.slot_s, least_members=online.least_members,
            field=scenario.field_error,
        )  # fmt: skip

    def _margins(self, forecast: WindEnsemble, now_s: float) -> dict[str, DepartureMargin]:
        region = self._region
        scenario = region.in_air(region.base, now_s)
        found = {
            name: departure_margin(
                scenario, forecast, from_posix(now_s), name, region.flying, drag=drag, reserve=region.service.reserve
            )
            for name, drag in region.service.drags.items()
        }
        return {name: one for name, one in found.items() if one is not None}


def _as_expected(forecast: WindEnsemble, now_s: float) -> WindObservation:
    """Return the mean of a forecast at the centre of its sites in the form of a measurement."""
    lat, lon = float(forecast.site_lat.mean()), float(forecast.site_lon.mean())
    north, east = forecast.wind_at(lat, lon, forecast.slot_at(now_s))
    mean = float(forecast.probability @ north), float(forecast.probability @ east)
    return WindObservation(now_s, lat, lon, *mean, EXPECTED_VARIANCE)
