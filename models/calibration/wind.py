"""Drag and level bias of a drone, fitted to a log of its flight.

Flown on one course only, or standing in the wind, a drone leans by an amount that a strong wind and little drag explain
as well as a weak wind and much drag. On two courses the wind stays and the course turns, which separates them. So the fit
determines drag, bias and a slowly changing wind together, with their uncertainty.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.formatting import duration, percent, speed_text, wind_text
from skyway.models.drones.drag import DragModel
from skyway.models.wind.estimation.blocks import MIN_SPEED_MPS, MIN_SPREAD_DEG, course_spread_deg
from skyway.models.wind.estimation.filter import WindFilterSettings
from skyway.models.wind.observed.reading import STATION_ERROR_MPS
from skyway.models.wind.triangle import speed_from

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.wind.estimation.blocks import Blocks

KNOT_S = 120.0
"""Distance of the knots between which the wind of the fit is linear."""
KNOT_SIGMA_MPS = 1.5
"""Standard deviation of its change from knot to knot."""
MAX_BLOCKS = 1800
"""Of a longer flight the last part is fitted."""
BIAS_SIGMA_MPS2 = 0.15
"""A level that is off by about 1 degree."""
FAST_MPS = 8.0
"""Quadratic drag is fitted where airspeeds differ by more than this."""
MIN_BLOCKS = 60
SMOOTH = 10
"""Blocks averaged before a fit to a known wind: eddies at the mast are not those at the drone."""
CONTRADICTS = math.sqrt(-2.0 * math.log(0.01))
"""Winds that differ by more standard deviations than this, of a component, do so in 1 % of all cases."""
MAX_RELATIVE_SIGMA = 0.20
"""A drag with a larger relative uncertainty is not identified."""

_GIVE = "give the speed in m/s and where the wind comes FROM"


@dataclass(frozen=True, slots=True)
class DragFit:
    """Drag found from one flight."""

    reason: str
    """The reason why it was not identified, or the data that it was found from."""
    drag: DragModel | None = None
    """Uncertainty for this flight; `models.drones.drag.DragModel.another_flight` for the next. None if the
    flight does not determine it."""
    relative_sigma: float = math.inf
    """Relative standard deviation of the drag at the typical airspeed; infinite if nothing was fitted."""
    wind_north_mps: float = math.nan
    wind_east_mps: float = math.nan
    """Mean wind of the flight, TOWARDS, found along with it; NaN if nothing was fitted."""
    wind_sigma_mps: float = math.inf
    """Standard deviation of a component of this wind, with the gusts that the flight happened to meet."""
    course_spread_deg: float = 0.0
    """How far the courses flown differ, 0 to 180."""


def identify_drag(air: Blocks, period_s: float = 1.0) -> DragFit:
    """Find drag, level bias and wind in one flight."""
    good = air.flying & ~air.winged & np.isfinite(air.drag).all(axis=1) & np.isfinite(air.velocity).all(axis=1)
    count = int(good.sum())
    if air.flying.any() and air.winged[air.flying].mean() > 0.5:
        return DragFit("the vehicle flies on wings: its tilt does not measure the wind")
    if count < MIN_BLOCKS:
        flown = duration(count * period_s)
        return DragFit(f"only {flown} of flight with attitude and velocity, at least {MIN_BLOCKS} are needed")
    velocity, drag, yaw, time_s = (
        values[good][-MAX_BLOCKS:] for values in (air.velocity, air.drag, air.yaw_rad, air.time_s)
    )
    spread = course_spread_deg(velocity)
    speed = float(np.percentile(np.hypot(*velocity.T), 90))
    if speed < MIN_SPEED_MPS:
        reason = (
            f"the drone hovers (ground speed up to {speed_text(speed)}): drag and wind cannot be distinguished; "
            "fly out and back, or a circle, at cruise speed, or give the wind with --wind"
        )
        return DragFit(reason, course_spread_deg=spread)
    fit = _Fit(time_s, velocity, drag, yaw, quadratic=_spread(velocity) > FAST_MPS)
    model, relative, wind, wind_sigma = fit.solve(period_s)
    found = DragFit("", model, relative, *wind, wind_sigma, spread)
    one_course = spread < MIN_SPREAD_DEG
    if relative > MAX_RELATIVE_SIGMA or model is None or one_course:
        turn = f"the courses flown differ by {spread:.0f}° only: fly out and back, or a circle"
        unsure = f"the drag is uncertain by {percent(relative)} (limit {percent(MAX_RELATIVE_SIGMA)})"
        reason = "; ".join([unsure] * (relative > MAX_RELATIVE_SIGMA) + [turn] * one_course)
        return replace(found, drag=None, reason=reason)
    reason = f"found from {duration(count * period_s)} of flight on courses that differ by {spread:.0f}°"
    return replace(found, reason=reason)


def fit_known_wind(air: Blocks, wind: NDArray[np.float64], period_s: float = 1.0) -> DragModel:
    """Find the linear drag of a flight, hover included, in a wind that was measured nearby.

    The wind is (north, east) TOWARDS, m/s, shape (blocks, 2). The uncertainty of the drag is the scatter of observed about expected
    values. An `InputError` means that too little was flown on rotors, or that the flight contradicts the wind: where the flight alone
    tells its mean wind (`identify_drag`), the given one must be within the error of both.
    """
    good = air.flying & np.isfinite(air.drag).all(axis=1) & np.isfinite(wind).all(axis=1)
    if good.sum() < MIN_BLOCKS:
        flown = duration(int(good.sum()) * period_s)
        winged = air.flying.any() and air.winged[air.flying].mean() > 0.5
        remedy = (
            "on wings the flight alone tells the airspeed sensor: omit the wind" if winged else "take a longer flight"
        )
        problem = f"only {flown} of flight on rotors with attitude and velocity, at least {duration(MIN_BLOCKS * period_s)} are needed"
        raise InputError(Fault(problem, remedy=remedy))
    _refuse_other_wind(identify_drag(air, period_s), wind[good].mean(axis=0))
    through = _running(air.velocity[good] - wind[good], SMOOTH)
    seen = _running(air.drag[good], SMOOTH)
    linear = float((seen * through).sum() / (through**2).sum())
    if linear <= 0.0:
        raise InputError(Fault("the drone does not lean against the given wind", remedy=_GIVE))
    residual = air.drag[good] - linear * (air.velocity - wind)[good]
    return DragModel(
        linear_per_s=linear,
        sigma_mps2=float(np.sqrt((residual**2).mean())),
        period_s=period_s,
    )


def _refuse_other_wind(alone: DragFit, given: NDArray[np.float64]) -> None:
    """Refuse a mean wind that a flight which tells its own wind contradicts."""
    if alone.drag is None:
        return
    north, east = alone.wind_north_mps, alone.wind_east_mps
    limit_mps = CONTRADICTS * math.hypot(alone.wind_sigma_mps, STATION_ERROR_MPS)
    if math.hypot(given[0] - north, given[1] - east) > limit_mps:
        speed, degrees = (float(value) for value in speed_from(north, east))
        problem = f"the flight contradicts the given wind: alone it tells {wind_text(speed, degrees)} on average"
        raise InputError(Fault(problem, remedy=f"{_GIVE}, or omit it"))


class _Fit:
    """Least squares over (drag, bias, wind at knots)."""

    def __init__(
        self,
        time_s: NDArray[np.float64],
        velocity: NDArray[np.float64],
        drag: NDArray[np.float64],
        yaw: NDArray[np.float64],
        *,
        quadratic: bool,
    ) -> None:
        self.velocity, self.drag, self.quadratic = velocity, drag, quadratic
        self.cos, self.sin = np.cos(yaw), np.sin(yaw)
        flown_s = np.cumsum(np.minimum(np.diff(time_s, prepend=time_s[0]), KNOT_S))
        knots = max(2, math.ceil(flown_s[-1] / KNOT_S) + 1)
        place = np.linspace(0.0, flown_s[-1], knots)
        self.hats = np.stack([np.interp(flown_s, place, row) for row in np.eye(knots)], axis=1)
        self.sigma = 0.25

    def solve(self, period_s: float) -> tuple[DragModel | None, float, tuple[float, float], float]:
        """Return the drag, its relative error, the mean wind, and the standard deviation of a component of it."""
        from scipy.optimize import least_squares

        knots = self.hats.shape[1]
        start = np.concatenate([[0.3, 0.005 if self.quadratic else 0.0, 0.0, 0.0], np.zeros(2 * knots)])
        low = np.concatenate([[1e-3, 0.0 if self.quadratic else -1e-9, -2.0, -2.0], np.full(2 * knots, -40.0)])
        high = np.concatenate([[5.0, 1.0 if self.quadratic else 1e-9, 2.0, 2.0], np.full(2 * knots, 40.0)])
        answer = least_squares(self._residuals, start, bounds=(low, high), loss="soft_l1", max_nfev=200)
        c1, c2, forward, right = answer.x[:4]
        wind = self._wind(answer.x)
        through = self.velocity - wind
        left = self._residuals(answer.x)[: 2 * len(self.drag)].reshape(2, -1)
        scale = float(np.mean(left**2))
        rho = max(0.0, min(0.98, float(np.mean([np.corrcoef(row[1:], row[:-1])[0, 1] for row in left]))))
        inflation = scale * (1.0 + rho) / (1.0 - rho)
        free = np.array([True, self.quadratic] + [True] * (len(answer.x) - 2))
        free &= (answer.active_mask == 0) | (np.arange(len(answer.x)) != 1)
        slopes = np.asarray(answer.jac, dtype=np.float64)[:, free]
        information = slopes.T @ slopes / max(inflation, 1e-6)
        covariance = np.linalg.pinv(information)
        typical = max(float(np.median(np.hypot(*through.T))), 1.0)
        slope = np.array([1.0, typical] + [0.0] * (len(answer.x) - 2))[free]
        value = float(c1 + c2 * typical)
        relative = math.sqrt(max(float(slope @ covariance @ slope), 0.0)) / value
        mean = wind.mean(axis=0)
        number = int(free[:2].sum())  # positions of the two biases among the free parameters
        level = math.sqrt(max(0.5 * float(np.trace(covariance[number : number + 2, number : number + 2])), 0.0))
        model = DragModel(
            linear_per_s=float(c1),
            quadratic_per_m=float(max(c2, 0.0)),
            bias_forward_mps2=float(forward),
            bias_right_mps2=float(right),
            sigma_mps2=float(np.clip(_white(left, period_s) * self.sigma, 0.05, 3.0)),
            period_s=period_s,
            relative_sigma=float(min(relative, 1.0)),
            bias_sigma_mps2=float(min(level, 5.0)),
        )
        share = self.hats.mean(axis=0)
        winds = covariance[number + 2 :, number + 2 :].reshape(2, knots, 2, knots)
        variance = 0.5 * sum(float(share @ winds[part, :, part] @ share) for part in (0, 1))
        known = model if math.isfinite(relative) else None
        return known, relative, (float(mean[0]), float(mean[1])), math.sqrt(max(variance, 0.0))

    def _wind(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        return self.hats @ x[4:].reshape(2, -1).T

    def _residuals(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        through = self.velocity - self._wind(x)
        speed = np.hypot(*through.T)[:, None]
        expected = through * (x[0] + x[1] * speed)
        expected[:, 0] += x[2] * self.cos - x[3] * self.sin
        expected[:, 1] += x[2] * self.sin + x[3] * self.cos
        misses = ((self.drag - expected) / self.sigma).T.ravel()
        knots = x[4:].reshape(2, -1)
        return np.concatenate([misses, x[2:4] / BIAS_SIGMA_MPS2, (np.diff(knots, axis=1) / KNOT_SIGMA_MPS).ravel()])


def _white(left: NDArray[np.float64], period_s: float) -> float:
    """Standard deviation of residuals, shape (2, n), without the part common to consecutive residuals: that part is gusts, not noise."""
    alike = float(np.mean(left[:, 1:] * left[:, :-1])) * math.exp(period_s / WindFilterSettings().gust_tau_s)
    return math.sqrt(max(float(np.mean(left**2)) - max(alike, 0.0), 0.0))


def _spread(velocity: NDArray[np.float64]) -> float:
    low, high = np.percentile(np.hypot(*velocity.T), (5, 95))
    return float(high - low)


def _running(values: NDArray[np.float64], count: int) -> NDArray[np.float64]:
    """Running means over `count` rows, where they are whole."""
    total = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), values]), axis=0)
    return np.asarray((total[count:] - total[:-count]) / count)
