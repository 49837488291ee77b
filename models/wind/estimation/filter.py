"""Kalman filter of the wind at a drone.

The wind is the sum of a slow wind, which varies about the forecast, and gusts about that, whose size depends on its speed; both are
Ornstein-Uhlenbeck processes (north, east). Over a step of any length these have an exact solution, so that irregular telemetry
needs no small steps. Measurements are winds with a covariance, from any source (`models.wind.estimation.measurement`).
The estimate is the present wind, gust included; `WindFilter.steady` is the slow part, which lasts.

Sources: R. E. Kalman (1960); Y. Bar-Shalom, X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and
Navigation" (2001), sections 5.4 (consistency: NEES, NIS) and 2.9 (gating).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.parameters import Parameters, parameter
from skyway.models.wind.estimation import systematic
from skyway.models.wind.estimation.health import HEALTH_CORRELATION, HEALTH_WINDOW, ConsistencyMonitor
from skyway.models.wind.triangle import speed_from

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike, NDArray

    from skyway.models.wind.estimation.systematic import Dependence

GATE_99 = 9.21034037197618
"""99 % quantile of chi-squared with 2 degrees of freedom: -2 ln 0.01."""
STATES = 4 + systematic.COUNT
"""Slow wind (north, east), gust (north, east), and the systematic errors of the measurements."""
WIND = np.concatenate([np.eye(2), np.eye(2), np.zeros((2, systematic.COUNT))], axis=1)
"""The wind of a state: slow part and gust, shape (2, STATES)."""
HELD_AFTER_S = 30.0
"""An estimate without a measurement for this long is called held."""


@dataclass(frozen=True)
class WindFilterSettings(Parameters):
    """Variation of the wind, and the limits for rejecting a measurement."""

    tau_s: float = parameter(
        600.0, "time constant with which the wind returns to the forecast", 1e-3, 1e9, unit="s"
    )  # fmt: skip
    sigma_mps: float = parameter(
        2.5, "standard deviation of the slow wind about the forecast, each component", 1e-3, 100, unit="m/s",
    )  # fmt: skip
    gust_tau_s: float = parameter(
        12.0,
        "time constant of gusts at a moving drone: their length, some 200 m, over its airspeed",
        1e-3,
        1e6,
        unit="s",
    )
    gust_intensity: float = parameter(
        0.13,
        "standard deviation of gusts, each component and averaged over a second, as a share of the slow wind",
        0,
        10,
    )
    gust_floor_mps: float = parameter(0.15, "minimum of the same", 0, 100, unit="m/s")
    gate: float = parameter(
        GATE_99, "a measurement whose normalised innovation squared is above this is not used", 1e-3, 1e6,
        measured="99 % quantile of chi-squared with 2 degrees of freedom",
    )  # fmt: skip
    patience_s: float = parameter(
        3.0, "when measurements are rejected for this time, and `patience_count` times in a row, the filter widens its covariance", 0, 1e6, unit="s",
    )  # fmt: skip
    patience_count: int = parameter(5, "see `patience_s`", 1, 10**6)


@dataclass(frozen=True, slots=True)
class WindEstimate:
    """Estimate of the filter."""

    time_s: float
    """POSIX seconds."""
    north_mps: float
    east_mps: float
    """TOWARDS."""
    var_north: float
    cov_north_east: float
    var_east: float
    """Covariance, m2/s2."""
    source: str = "measured"
    """``measured`` in the air, ``held`` after `HELD_AFTER_S` without a measurement (for example after landing), ``forecast``
    before the first measurement, ``inconsistent`` if the innovations are larger than the filter's covariance predicts,
    so that the values must not be used."""

    @property
    def speed_mps(self) -> float:
        """Speed of the wind."""
        return math.hypot(self.north_mps, self.east_mps)

    @property
    def from_deg(self) -> float:
        """Direction FROM which it blows, [0, 360)."""
        return float(speed_from(self.north_mps, self.east_mps)[1])

    @property
    def sigma_mps(self) -> float:
        """Standard deviation of one component, the two taken together."""
        return math.sqrt(0.5 * (self.var_north + self.var_east))


class WindFilter:
    """A Kalman filter of the wind, fed one measurement at a time.

    It begins at a time, POSIX seconds, with the forecast there, TOWARDS. `systematic_sigma`, shape (systematic.COUNT,),
    is the standard deviation of each error that stays the same through the flight
    (`models.wind.estimation.systematic`); by default the measurements have none.
    """

    def __init__(
        self,
        start_s: float,
        north_mps: float,
        east_mps: float,
        settings: WindFilterSettings | None = None,
        systematic_sigma: ArrayLike | None = None,
    ) -> None:
        from filterpy.kalman import KalmanFilter

        self.settings = settings or WindFilterSettings()
        self.time_s = start_s
        self.health = ConsistencyMonitor(HEALTH_WINDOW, HEALTH_CORRELATION)
        """Whether the innovations are as large as the filter's covariance predicts."""
        self.last_nis = math.nan
        """Normalised innovation squared of the last measurement, before the gate."""
        self._forecast = (north_mps, east_mps)
        self._last_used_s: float | None = None
        self._scaled_by = (-1, -1)
        self._rejected: list[tuple[float, NDArray[np.float64]]] = []
        sigma = (
            np.zeros(systematic.COUNT) if systematic_sigma is None else np.asarray(systematic_sigma, dtype=np.float64)
        )
        self._systematic_variance = sigma**2
        self._filter: Any = KalmanFilter(dim_x=STATES, dim_z=2, dim_u=STATES)
        self._filter.x = np.zeros((STATES, 1))
        self._filter.x[:2, 0] = north_mps, east_mps
        self._filter.P = np.diag(self._variances())
        self._filter.H = WIND

    def predict(self, time_s: float, forecast: tuple[float, float] | None = None) -> WindEstimate:
        """Advance the time, under the forecast for that time where it is given; ignores time that runs backwards."""
        self.advance(time_s, forecast)
        return self.estimate

    def advance(self, time_s: float, forecast: tuple[float, float] | None = None) -> None:
        """Do the work of `predict` without returning an estimate."""
        self._forecast = forecast or self._forecast
        step_s = max(time_s - self.time_s, 0.0)
        taus = (self.settings.tau_s, self.settings.gust_tau_s, systematic.TAU_S)
        keep = np.repeat([math.exp(-step_s / tau_s) for tau_s in taus], (2, 2, systematic.COUNT))
        noise = np.diag((1.0 - keep**2) * self._variances())
        target = np.zeros((STATES, 1))
        target[:2, 0] = self._scale() @ self._forecast
        self._filter.predict(u=target, B=np.diag(1.0 - keep), F=np.diag(keep), Q=noise)
        self.time_s = max(time_s, self.time_s)

    def _variances(self) -> NDArray[np.float64]:
        """Stationary variances of the slow wind, of the gusts that go with it, and of systematic errors, shape (STATES,)."""
        given = self.settings
        speed = math.hypot(float(self._filter.x[0, 0]), float(self._filter.x[1, 0]))
        gust = max(given.gust_intensity * speed, given.gust_floor_mps)
        wind = [given.sigma_mps**2, given.sigma_mps**2, gust**2, gust**2]
        return np.concatenate([wind, self._systematic_variance])

    def update(
        self, wind: tuple[float, float], noise: ArrayLike, depends: Dependence | None = None, row: int = 0
    ) -> bool:
        """Process a measurement for the present time; returns whether it was used.

        The wind is (north, east) TOWARDS, m/s; a value that is not finite is ignored. `noise` is the covariance of its independent
        error, m2/s2, shape (2, 2) or scalar. It depends on the systematic errors by that row of `depends`; by
        default it does not.
        """
        measured = np.array([[wind[0]], [wind[1]]])
        covariance = np.asarray(noise, dtype=np.float64)
        if not (np.isfinite(measured).all() and np.isfinite(covariance).all()):
            return False
        covariance = np.eye(2) * covariance if covariance.ndim == 0 else covariance
        seen = WIND.copy()
        if depends is not None:
            seen[:, 4:] = depends.sensitivity[row]
        innovation = measured - seen @ self._filter.x
        spread = seen @ self._filter.P @ seen.T + covariance
        nis = (innovation.T @ np.linalg.solve(spread, innovation)).item()
        self.health.add(min(nis, self.settings.gate))
        self.last_nis = nis
        if nis > self.settings.gate:
            if not self._persuaded(innovation):
                return False
            self.health.restart()
        self._rejected.clear()
        self._filter.update(measured, R=covariance, H=seen)
        self._last_used_s = self.time_s
        if depends is not None and depends.scale[row] >= 0:
            self._scaled_by = int(depends.scale[row]), int(depends.turn[row])
        return True

    def _scale(self) -> NDArray[np.float64]:
        """Return the matrix k R(o) by which the most recently used sensor scales and turns the wind, shape (2, 2)."""
        scale, turn = self._scaled_by
        errors = self._filter.x[4:, 0]
        size = max(1.0 + float(errors[scale]), systematic.MIN_SCALE) if scale >= 0 else 1.0
        angle = float(errors[turn]) if turn >= 0 else 0.0
        return size * np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])

    def widen(self, variance: ArrayLike) -> None:
        """Add to the covariance of the slow wind, (2, 2), m2/s2: its measurements so far are not consistent with a new finding."""
        self._filter.P[:2, :2] += np.asarray(variance, dtype=np.float64)

    def _persuaded(self, innovation: NDArray[np.float64]) -> bool:
        """Count a rejection; after too many of them in a row widen the covariance of the slow wind."""
        self._rejected.append((self.time_s, innovation))
        enough = len(self._rejected) >= self.settings.patience_count
        if not enough or self.time_s - self._rejected[0][0] < self.settings.patience_s:
            return False
        mean = np.mean([one for _, one in self._rejected], axis=0)
        self._filter.P[:2, :2] += mean @ mean.T
        return True

    @property
    def estimate(self) -> WindEstimate:
        """The present wind, gust included."""
        return self._estimate(WIND)

    @property
    def steady(self) -> WindEstimate:
        """The slow part of the wind, which lasts when the gust is over."""
        return self._estimate(np.eye(2, STATES))

    def _estimate(self, seen: NDArray[np.float64]) -> WindEstimate:
        """Compute the wind R(-o) s / k of a part s of the state; the covariance follows from its derivative."""
        scale, turn = self._scaled_by
        unscale = np.linalg.inv(self._scale())
        north, east = (unscale @ seen @ self._filter.x)[:, 0].tolist()
        slope = unscale @ seen
        if scale >= 0:
            slope[:, 4 + scale] -= np.array([north, east]) * math.hypot(*unscale[:, 0].tolist())
        if turn >= 0:
            slope[:, 4 + turn] -= np.array([-east, north])
        (var_north, covariance), (_, var_east) = (slope @ self._filter.P @ slope.T).tolist()
        source = "forecast"
        if self._last_used_s is not None:
            source = "measured" if self.time_s - self._last_used_s <= HELD_AFTER_S else "held"
            if self.health.verdict == "overconfident":
                source = "inconsistent"
        return WindEstimate(self.time_s, north, east, var_north, covariance, var_east, source)


@dataclass(frozen=True, slots=True, eq=False)
class FilteredWind:
    """The filter's estimates over a log."""

    time_s: NDArray[np.float64]
    """Shape (n,)."""
    wind: NDArray[np.float64]
    """Shape (n, 2). (north, east) TOWARDS, m/s."""
    covariance: NDArray[np.float64]
    """Shape (n, 3). North-north, north-east, east-east, m2/s2."""
    nis: NDArray[np.float64]
    """Shape (n,). Before the gate; NaN without a measurement."""
    accepted: NDArray[np.bool_]
    """Shape (n,)."""
    forecast: NDArray[np.float64]
    """Shape (n, 2). The forecast that it was given, (north, east), m/s."""
    trusted: NDArray[np.bool_]
    """Shape (n,). Whether the filter's health check accepts the estimate."""

    def __len__(self) -> int:
        return len(self.time_s)

    @classmethod
    def empty(cls, count: int) -> FilteredWind:
        """Return a course of `count` steps to be filled."""
        unknown = np.full(count, np.nan)
        pairs = np.full((count, 2), np.nan)
        triples, no = np.full((count, 3), np.nan), np.zeros(count, dtype=np.bool_)
        return cls(unknown, pairs, triples, unknown.copy(), no, pairs.copy(), np.ones(count, dtype=np.bool_))

    @classmethod
    def joined(cls, parts: Iterable[FilteredWind]) -> FilteredWind:
        """Return courses one after the other."""
        kept = list(parts) or [cls.empty(0)]
        return cls(*(np.concatenate([getattr(part, item.name) for part in kept]) for item in fields(cls)))

    def part(self, chosen: NDArray[np.bool_] | NDArray[np.int64] | slice) -> FilteredWind:
        """Return some of the steps."""
        return FilteredWind(*(getattr(self, item.name)[chosen] for item in fields(self)))

    def put(self, row: int, now: WindEstimate, forecast: tuple[float, float]) -> None:
        """Fill in the time, wind, covariance and forecast of a step."""
        self.forecast[row] = forecast
        self.time_s[row] = now.time_s
        self.wind[row] = now.north_mps, now.east_mps
        self.covariance[row] = now.var_north, now.cov_north_east, now.var_east
        self.trusted[row] = now.source != "inconsistent"

    @property
    def sigma_mps(self) -> NDArray[np.float64]:
        """Standard deviation of one component, shape (n,)."""
        return np.asarray(np.sqrt(0.5 * (self.covariance[:, 0] + self.covariance[:, 2])))
