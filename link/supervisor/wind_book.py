"""Knowledge of the wind in a delivery: the initial forecast, and all measurements since."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import asdict

from skyway.models.base import geodesy
from skyway.models.flight.heights import wind_factors
from skyway.models.wind.estimation.field import WindObservation
from skyway.models.wind.estimation.forecast_update import SLOT_S, update_forecast
from skyway.models.wind.estimation.live import LiveWind, forecast_of, settings_for
from skyway.models.wind.estimation.roughness import roughness
from skyway.models.wind.field_error import EXACT_FIELD
from skyway.models.wind.summary import Passage, WindSummary, summarise_wind

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from skyway.link.supervisor.flight.lean import WindAtLimit
    from skyway.link.supervisor.journal.parts import Observation
    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.telemetry import TelemetrySample
    from skyway.models.flight.rules import FlightRules
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.field import ResidualModel
    from skyway.models.wind.estimation.filter import WindEstimate
    from skyway.models.wind.field_error import FieldError

UPDATE_EVERY_S = 30.0
FOLLOW_EVERY_S = 5.0
"""Interval at which the estimate processes the telemetry, s; a decision and a journal entry use the newest
(`WindBook.catch_up`)."""
SAME_ERROR = 100.0
"""Number of reports of an autopilot's wind that count as one: its error is the same in each."""
MIN_HEIGHT_SHARE = 0.6
"""Below this share of the cruise height the wind is not that of the forecast."""


class WindBook:
    """The wind of one delivery, from a forecast at any height.

    The rules say how wind grows with height. Where the drag of the drone is unknown, its tilt does not measure the
    wind, and only an estimate of the autopilot itself counts. `ground_m` gives the ground above sea level at a latitude
    and longitude; by default it is unknown. Between the sites the wind is off by the error `field`, at cruise height. `at_stations` says which winds others have observed by an instant, POSIX seconds. For the others
    see `update_forecast`.
    """

    def __init__(
        self,
        forecast: WindEnsemble,
        rules: FlightRules,
        *,
        drag: DragModel | None = None,
        ground_m: Callable[[float, float], float] = lambda *_: math.nan,
        residual: ResidualModel | None = None,
        least_members: float = 1.0,
        field: FieldError = EXACT_FIELD,
        at_stations: Callable[[float], Sequence[WindObservation]] = lambda _: (),
    ) -> None:
        self._rules, self.cruise_height_m, self.exponent = rules, rules.cruise_height_m, rules.wind_profile_exponent
        self.base = forecast.at_height(self.cruise_height_m, self.exponent)
        self._residual, self._least_members, self._field = residual, least_members, field
        self._measured_at: tuple[float, float] | None = None
        self._ask_stations, self._at_stations = at_stations, tuple[WindObservation, ...]()
        self._ground_m = lru_cache(maxsize=256)(ground_m)
        self.earlier: tuple[WindObservation, ...] = ()
        self._expected = forecast_of(self.base, self.exponent)
        self.live = LiveWind(
            drag=drag, forecast=self._expected, settings=settings_for(self.base), every_s=FOLLOW_EVERY_S
        )
        self._updated: WindEnsemble = self.base
        self._updated_s = -math.inf
        self._gap_mps = 0.0

    def expected(self, time_s: float, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        """Return the wind of the first forecast at cruise height: (north, east), m/s."""
        return self._expected(time_s, lat_deg, lon_deg, self.cruise_height_m)

    def hear(self, sample: TelemetrySample, home_ground_m: float = math.nan) -> None:
        """Take a sample in the air, near cruise height, of a flight that began on ground of a height above sea level."""
        above_m = self._above_ground_m(sample, home_ground_m) if sample.landed == 0.0 else math.nan
        if above_m > MIN_HEIGHT_SHARE * self.cruise_height_m:
            self.live.hear(sample, above_m)
            if math.isfinite(sample.lat_deg) and math.isfinite(sample.lon_deg):
                self._measured_at = sample.lat_deg, sample.lon_deg

    def catch_up(self) -> None:
        """Process the newest sample."""
        self.live.catch_up()

    def _above_ground_m(self, sample: TelemetrySample, home_ground_m: float) -> float:
        """Height above the ground below; above the take-off point if the ground is unknown."""
        if not (math.isfinite(sample.lat_deg) and math.isfinite(sample.lon_deg)):
            return sample.height_m
        below_m = home_ground_m - self._ground_m(round(sample.lat_deg, 3), round(sample.lon_deg, 3))
        return sample.height_m + (below_m if math.isfinite(below_m) else 0.0)

    def measure(self, found: WindAtLimit, sample: TelemetrySample, home_ground_m: float = math.nan) -> bool:
        """Use the wind measured at full lean; its difference from the autopilot's along the lean is added to the latter's uncertainty."""
        self.catch_up()
        now = self.estimate
        if now is None:
            return False
        apart = np.array([found.north_mps - now.north_mps, found.east_mps - now.east_mps])
        along = np.array(found.along)
        gap = max(abs(float(apart @ along)), self._gap_mps)
        self._gap_mps = gap
        place = (sample.lat_deg, sample.lon_deg, self._above_ground_m(sample, home_ground_m))
        return self.live.measure(
            (found.north_mps, found.east_mps), found.noise, place, gap * gap * np.outer(along, along), SAME_ERROR
        )

    def restore(self, stored: Sequence[Observation]) -> None:
        """Restore measured winds from a journal."""
        numbers = ({name: math.nan if x is None else x for name, x in asdict(one).items()} for one in stored)
        self.earlier = tuple(WindObservation(**one) for one in numbers)

    def here(self, sample: TelemetrySample) -> tuple[float, float]:
        """Return the wind at the vehicle, (north, east), m/s: measured if available, else that of the first forecast."""
        now = self.estimate
        if now is not None:
            return now.north_mps, now.east_mps
        return self.expected(sample.time_s, sample.lat_deg, sample.lon_deg)

    @property
    def estimate(self) -> WindEstimate | None:
        """Return the newest estimate of the wind at the vehicle; None before the first, and if it is not reliable."""
        now = self.live.estimate
        return None if now is None or now.source == "inconsistent" else now

    @property
    def observations(self) -> tuple[WindObservation, ...]:
        """Return all measurements, each averaged over a slot, converted to cruise height."""
        return (*self.earlier, *self.measured)

    @property
    def measured(self) -> tuple[WindObservation, ...]:
        """Return the measurements since the supervisor began, converted to cruise height."""
        self.catch_up()
        return tuple(one.at_height(self.cruise_height_m, self.exponent) for one in self.live.observations())

    @property
    def measured_s(self) -> float:
        """Return the time of the last wind measurement in flight, POSIX seconds; NaN if there is none."""
        return max((one.time_s for one in self.observations), default=math.nan)

    @property
    def measures(self) -> bool:
        """Return whether the drone measures the wind on its way: by its tilt, or once its autopilot has reported it."""
        return self.live.drag is not None or math.isfinite(self.measured_s)

    @property
    def roughness(self) -> float:
        """Return the variation of the wind along the flights so far: see `models.wind.estimation.roughness`."""
        return roughness(self.observations, self._field)

    def forecast_at(self, time_s: float, lat_deg: float, lon_deg: float, *, updated: bool) -> WindSummary:
        """Summarise the first, or the updated, forecast at cruise height at a place and an instant."""
        ensemble = self.forecast(time_s) if updated else self.base
        here = (Passage(lat_deg, lon_deg, time_s, time_s),)
        return summarise_wind(ensemble, here, self.cruise_height_m, self.exponent)

    def on_way(self, way: Sequence[tuple[float, float]], begin_s: float, duration_s: float) -> WindSummary:
        """Summarise the winds along a way that is flown from an instant on, by the updated forecast."""
        points = np.array(way)
        length, bearing = geodesy.inverse(points[:-1, 0], points[:-1, 1], points[1:, 0], points[1:, 1])
        ends = begin_s + duration_s * np.concatenate(([0.0], np.cumsum(length))) / max(float(length.sum()), 1.0)
        lat, lon = geodesy.midpoint(points[:-1, 0], points[:-1, 1], bearing, length)
        ground_m = np.array([self._ground_m(*point) for point in way])
        factors = wind_factors(self._rules, (ground_m[:-1], ground_m[1:]))
        passages = [Passage(*map(float, one)) for one in zip(lat, lon, ends[:-1], ends[1:], factors, strict=True)]
        return summarise_wind(self.forecast(begin_s), passages, self.cruise_height_m, self.exponent)

    @property
    def origin(self) -> str:
        """Return the source of the wind in a briefing before take-off, in words: it is never measured on the spot."""
        if self.observations:
            return "forecast updated with measurements of earlier legs"
        return "forecast updated with the observed winds" if self._at_stations else "forecast"

    @property
    def source(self) -> str:
        """Source of the wind in use: ``measured``, ``held`` or ``forecast``."""
        now = self.estimate
        if now is not None:
            return now.source
        return "held" if self.earlier else "forecast"

    def forecast(self, time_s: float, *, now: bool = False) -> WindEnsemble:
        """Return the updated forecast, at cruise height; computed at most every half minute."""
        if now or time_s >= self._updated_s + UPDATE_EVERY_S:
            self._updated_s = time_s
            self._updated = self._update(slot_s=SLOT_S, here=self._measured_at)
        return self._updated

    def forecast_by_hour(self) -> WindEnsemble:
        """Return the updated forecast, at cruise height, in its own slots."""
        return self._update(slot_s=self.base.slot_s, here=self._measured_at)

    def _update(self, *, slot_s: float, here: tuple[float, float] | None) -> WindEnsemble:
        """Update the forecast, with a site at the place of the last measurement."""
        received = self._ask_stations(max(self._updated_s, self.base.start_s))
        self._at_stations = tuple(one.at_height(self.cruise_height_m, self.exponent) for one in received)
        return update_forecast(
            self.base,
            (*self._at_stations, *self.observations),
            self._residual,
            slot_s=slot_s,
            least_members=self._least_members,
            field=self._field,
            here=here,
        )
