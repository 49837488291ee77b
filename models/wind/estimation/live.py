"""Wind of one vehicle estimated from its telemetry, live or in a replay.

Feed samples, read the estimate; to update the forecast, pass on the observations::

    wind = LiveWind(drag=read_drag(path), forecast=forecast_of(ensemble), settings=settings_for(ensemble))
    for sample in telemetry:                      # models.telemetry.TelemetrySample, live or replayed
        if (now := wind.hear(sample)) is not None:  # about once a second
            now.north_mps, now.east_mps, now.sigma_mps, now.source
    updated = update_forecast(ensemble, wind.observations())  # models.forecast_update

Several drones: one `LiveWind` each, and the observations of all of them in one list. The ensemble and the observations
have to be for the same height (`WindEnsemble.at_height`). An estimate depends only on samples received
before it, and is at most one period old.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from copy import deepcopy
from functools import lru_cache
from operator import attrgetter
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.drones.drag import DragModel
from skyway.models.drones.telemetry import COLUMN, QUANTITIES, TelemetryTrack
from skyway.models.wind.estimation.blocks import BlockMaker, Blocks
from skyway.models.wind.estimation.drag_monitor import DragCheck, check_drag
from skyway.models.wind.estimation.field import MIN_PROFILE_M
from skyway.models.wind.estimation.filter import FilteredWind, WindEstimate, WindFilter, WindFilterSettings
from skyway.models.wind.estimation.forecast_update import SlotAverages
from skyway.models.wind.estimation.health import HEALTH_WINDOW
from skyway.models.wind.estimation.measurement import (
    MAX_WIND_MPS,
    PLAIN_SENSOR,
    MeanWind,
    measurements,
    tilt_air_velocity,
)
from skyway.models.wind.estimation.systematic import SteadyVelocity, dependence, prior_sigma
from skyway.models.wind.triangle import height_factor

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from skyway.models.drones.airspeed import AirspeedModel
    from skyway.models.drones.telemetry import TelemetrySample
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.models.wind.estimation.field import WindObservation
    from skyway.models.wind.estimation.measurement import Measurements
    from skyway.models.wind.estimation.systematic import Dependence

    Forecast = Callable[[float, float, float, float], tuple[float, float]]

_TOLD = attrgetter(*QUANTITIES)
_HEIGHT = COLUMN["height_m"]
NOMINAL_DRAG = DragModel(linear_per_s=0.17, relative_sigma=0.5, bias_sigma_mps2=0.15)
"""Drag if none is known: about the middle of the measured multirotors (0.1 to 0.3 per second at 10 m/s), so that the true air
velocity is half to twice the estimated one, and a level that is off by about 1 degree."""
NO_FORECAST = WindFilterSettings(tau_s=1800.0, sigma_mps=5.0)
"""Assumed variation of the wind without a forecast: anything up to a gale, slowly changing."""
DRAG_WINDOW = 300
"""Number of blocks of flight for the check of the drag."""


def forecast_of(ensemble: WindEnsemble, profile_exponent: float | None = None) -> Forecast:
    """Return the mean of a forecast as a function of (POSIX seconds, latitude, longitude, height): (north, east), m/s.

    If a place is unknown (NaN), the first site is used. The power law with `profile_exponent` converts the
    wind to the vehicle's height above the take-off site, never below `MIN_PROFILE_M`; by default the forecast is assumed
    to be for the flown height.
    """

    @lru_cache(maxsize=256)
    def at(slot: int, lat_deg: float, lon_deg: float) -> tuple[float, float]:
        north, east = ensemble.wind_at(lat_deg, lon_deg, slot)
        return float(ensemble.probability @ north), float(ensemble.probability @ east)

    def wind(time_s: float, lat_deg: float, lon_deg: float, height_m: float) -> tuple[float, float]:
        known = math.isfinite(lat_deg) and math.isfinite(lon_deg)
        lat, lon = (lat_deg, lon_deg) if known else (float(ensemble.site_lat[0]), float(ensemble.site_lon[0]))
        north, east = at(ensemble.slot_at(time_s), round(lat, 3), round(lon, 3))
        if profile_exponent is None or not math.isfinite(height_m):
            return north, east
        factor = height_factor(max(height_m, MIN_PROFILE_M), ensemble.height_m, profile_exponent)
        return north * factor, east * factor

    return wind


def settings_for(ensemble: WindEnsemble) -> WindFilterSettings:
    """Return filter settings with the members' deviation from the forecast, at least 1 m/s."""
    weight = ensemble.probability[:, None, None]
    spread = sum(
        float((weight * (values - (weight * values).sum(axis=0)) ** 2).sum(axis=0).mean())
        for values in (ensemble.north, ensemble.east)
    )
    return WindFilterSettings(sigma_mps=max(math.sqrt(0.5 * spread), 1.0))


class LiveWind:
    """The wind of one vehicle, estimated from its incoming telemetry.

    The drag is that of this drone (`models.drones.drag_file.read_drag`), `NOMINAL_DRAG` where it is unknown, None
    where tilt tells nothing; the airspeed model is that of a plane. The forecast takes POSIX seconds, latitude,
    longitude and the height above take-off, m, and returns the (north, east) that is expected, m/s; by default nothing
    is. Samples that are heard one by one are worked out every `every_s` seconds, and when `catch_up` asks for it: the estimates are the same,
    and many at once take less time.
    """

    def __init__(
        self,
        *,
        drag: DragModel | None = NOMINAL_DRAG,
        airspeed: AirspeedModel = PLAIN_SENSOR,
        forecast: Forecast | None = None,
        settings: WindFilterSettings | None = None,
        every_s: float = 1.0,
    ) -> None:
        self.drag = drag
        self.airspeed = airspeed
        self.settings = settings or (NO_FORECAST if forecast is None else WindFilterSettings())
        self.filter: WindFilter | None = None
        """None before the first average."""
        self.estimate: WindEstimate | None = None
        """The filter's latest; None before the first."""
        self.expected = (math.nan, math.nan)
        """The newest forecast that it was given, (north, east), m/s."""
        self.measured: Counter[str] = Counter()
        """Measurements of each kind: ``tilt``, ``airspeed``, ``autopilot``, ``limit``."""
        self.rejected = 0
        """Measurements rejected by the gate."""
        self._forecast = forecast or (lambda *_: (0.0, 0.0))
        self._maker = BlockMaker()
        self._every_s = every_s
        self._waiting: list[tuple[float, ...]] = []
        self._heard_s = -math.inf
        self._flying = False
        self._taken_s = {"autopilot": -math.inf, "airspeed": -math.inf}
        self._mean_wind = MeanWind()
        self._steady = SteadyVelocity()
        self._flown: deque[tuple[float, ...]] = deque(maxlen=DRAG_WINDOW)
        self._slots = SlotAverages()
        self._pending: deque[tuple[WindEstimate, tuple[float, ...]]] = deque()
        self.autopilot_doubt = np.zeros((2, 2))
        """Added to the covariance of the autopilot's wind."""

    def hear(self, sample: TelemetrySample, height_m: float | None = None) -> WindEstimate | None:
        """Take a sample, where wanted at another height; returns an estimate when it completes one. Older samples are ignored."""
        if not sample.time_s >= self._heard_s:
            return None
        period = math.floor(sample.time_s / self._every_s)
        over = bool(self._waiting) and period != math.floor(self._heard_s / self._every_s)
        self._heard_s = sample.time_s
        told = _TOLD(sample)
        self._waiting.append(
            (sample.time_s, *told)
            if height_m is None
            else (sample.time_s, *told[:_HEIGHT], height_m, *told[_HEIGHT + 1 :])
        )
        return self.estimate if over and self.catch_up() else None

    def catch_up(self) -> int:
        """Work out what was heard; returns the number of periods that were completed."""
        if not self._waiting:
            return 0
        table = np.array(self._waiting)
        self._waiting.clear()
        return len(self.feed(TelemetryTrack(1, table[:, 0], table[:, 1:])))

    def measure(
        self,
        wind: tuple[float, float],
        noise: NDArray[np.float64],
        place: tuple[float, float, float],
        doubt: NDArray[np.float64],
        same_error: float = 1.0,
    ) -> bool:
        """Take an external measurement of the wind at the current time; returns whether it was used.

        The wind is (north, east) TOWARDS, m/s, with its covariance, at (latitude, longitude, height). `doubt` is the additional
        uncertainty of the estimate from the autopilot's reports, m2/s2, shape (2, 2), of whose further reports that
        many count as one.
        """
        if self.filter is None:
            return False
        if self.measured["autopilot"] and not self.autopilot_doubt.any():
            self.filter.widen(doubt)
        self.autopilot_doubt = same_error * doubt
        used = self.filter.update(wind, noise)
        self.measured["limit"] += 1
        self.rejected += not used
        self.estimate = self.filter.estimate
        if used:
            self._pending.append((self.estimate, place))
        return used

    def feed(self, track: TelemetryTrack) -> FilteredWind:
        """Take many samples in order of time; returns the filter's estimates for the completed periods."""
        return self._follow(self._maker.feed(track))

    def close(self) -> FilteredWind:
        """Complete the last period."""
        return self._follow(self._maker.flush())

    def observations(self) -> tuple[WindObservation, ...]:
        """Averages of all measurements over slots, each counted once, for `models.wind.estimation.forecast_update.update_forecast`.

        Estimates rejected by the filter's health check, and the measurements behind that verdict, are omitted.
        """
        slots = deepcopy(self._slots)
        for now, place in self._pending:
            slots.add(now, *place)
        return slots.observations()

    @property
    def stuck(self) -> tuple[str, ...]:
        """Sensors whose value is stuck in flight and is rejected: ``the attitude``, ``the velocity``."""
        return self._maker.stuck if self._flying else ()

    def check_drag(self) -> DragCheck:
        """Return whether the drag in use fits the last minutes."""
        table = np.array(self._flown).reshape(-1, 4)
        return check_drag(table[:, :2], table[:, 2:])

    def _follow(self, air: Blocks) -> FilteredWind:
        """Run the filter over blocks."""
        course = FilteredWind.empty(len(air))
        self._flying = bool(air.flying[-1]) if len(air) else self._flying
        found = measurements(
            air,
            self.drag,
            self.airspeed,
            autopilot_s=self._taken_s["autopilot"],
            airspeed_s=self._taken_s["airspeed"],
            mean=self._mean_wind,
        )
        self.measured.update(found.source.tolist())
        depends = dependence(found, self.drag, self._steady)
        for source in self._taken_s:
            times = found.time_s[found.source == source]
            self._taken_s[source] = float(times[-1]) if len(times) else self._taken_s[source]
        if self.drag is not None:
            seen = air.flying & ~air.winged & np.isfinite(air.drag).all(axis=1)
            pairs = np.concatenate([air.velocity, tilt_air_velocity(air, self.drag)], axis=1)
            self._flown.extend(map(tuple, pairs[seen][-DRAG_WINDOW:].tolist()))
        begins = np.searchsorted(found.time_s, air.time_s, side="left")
        ends = np.searchsorted(found.time_s, air.time_s, side="right")
        for row, (time_s, place) in enumerate(zip(air.time_s.tolist(), air.place.tolist(), strict=True)):
            self.expected = self._forecast(time_s, *place)
            if self.filter is None:
                sigma = prior_sigma(self.drag, self.airspeed)
                self.filter = WindFilter(time_s, *self.expected, self.settings, sigma)
            self.filter.advance(time_s, self.expected)
            for number in range(begins[row], ends[row]):
                used = self._take(found, number, depends)
                self.rejected += not used
                course.accepted[row] |= used
                course.nis[row] = self.filter.last_nis
            now = self.estimate = self.filter.estimate
            course.put(row, now, self.expected)
            self._keep(now, place, accepted=bool(course.accepted[row]))
        return course

    def _keep(self, now: WindEstimate, place: tuple[float, ...], *, accepted: bool) -> None:
        """Store an estimate for the averages, once no window of innovations that contains it can become inconsistent."""
        if now.source == "inconsistent":
            self._pending.clear()
        elif accepted:
            self._pending.append((now, place))
            if len(self._pending) > HEALTH_WINDOW:
                settled, where = self._pending.popleft()
                self._slots.add(settled, *where)

    def _take(self, found: Measurements, number: int, depends: Dependence) -> bool:
        """Pass one measurement to the filter."""
        nn, ne, ee = found.noise[number].tolist()
        north, east = found.wind[number].tolist()
        if self.filter is None:
            return False
        if math.hypot(north, east) > MAX_WIND_MPS[str(found.source[number])]:
            self.filter.health.restart()
            return False
        noise = np.array([[nn, ne], [ne, ee]])
        if found.source[number] == "autopilot":
            noise = noise + self.autopilot_doubt
        return self.filter.update((north, east), noise, depends, number)
