"""Calibration of an airspeed sensor and a heading offset from a log of fixed-wing flight.

The length of the velocity through the air, ``|ground velocity - wind|``, is the airspeed, independent of the heading; on several
courses this suffices to determine wind and factor. The direction of the same velocity then gives the offset of the heading.

Source: A. Cho et al., "Wind estimation and airspeed calibration using a UAV with a single-antenna GPS receiver and pitot tube",
IEEE TAES 47(1), 2011.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.formatting import percent
from skyway.models.drones.airspeed import AirspeedModel
from skyway.models.wind.estimation.blocks import MIN_SPREAD_DEG, course_spread_deg
from skyway.models.wind.estimation.measurement import MIN_AIRSPEED_MPS

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.wind.estimation.blocks import Blocks

MIN_BLOCKS = 30
MAX_BLOCKS = 1800
KNOT_S = 120.0
"""Distance of the knots between which the wind of the fit is linear."""
KNOT_SIGMA_MPS = 1.5
"""Standard deviation of its change from knot to knot."""
SIGMA_MPS = 0.7
MAX_FACTOR_SIGMA = 0.03
ALIKE = 10.0
"""Number of neighbouring seconds of side slip that count as one independent value."""
STEADY_RAD_S = math.radians(8.0)
"""The heading is compared where the course turns no faster than this."""


@dataclass(frozen=True, slots=True)
class AirspeedFit:
    """Airspeed calibration found from one flight."""

    reason: str
    """The reason why it was not identified, or the data that it was found from."""
    model: AirspeedModel | None = None
    """None if it was not identified."""
    factor_sigma: float = math.inf
    """Standard deviation of the factor; infinite if nothing was fitted."""
    wind_north_mps: float = math.nan
    wind_east_mps: float = math.nan
    """Mean wind, TOWARDS, found along with it; NaN if nothing was fitted."""


def identify_airspeed(air: Blocks) -> AirspeedFit:
    """Find the factor of the airspeed sensor and the offset of the heading in one flight."""
    good = air.flying & air.winged & (air.airspeed_mps > MIN_AIRSPEED_MPS) & np.isfinite(air.velocity).all(axis=1)
    count = int(good.sum())
    if count < MIN_BLOCKS:
        return AirspeedFit(f"only {count} s on wings with airspeed and velocity, at least {MIN_BLOCKS} are needed")
    part = air.part(np.flatnonzero(good)[-MAX_BLOCKS:])
    spread = course_spread_deg(part.velocity)
    if spread < MIN_SPREAD_DEG:
        return AirspeedFit(f"the courses flown differ by {spread:.0f}° only: fly out and back, or a circle")
    factor, sigma, wind, scatter = _fit(part)
    north, east = (float(value) for value in wind.mean(axis=0))
    if sigma > MAX_FACTOR_SIGMA:
        reason = f"the factor of the airspeed is uncertain by {percent(sigma)} (limit {percent(MAX_FACTOR_SIGMA)})"
        return AirspeedFit(reason, None, sigma, north, east)
    through = part.velocity - wind
    slip = np.arctan2(through[:, 1], through[:, 0]) - part.yaw_rad
    steady = np.isfinite(slip) & (np.abs(part.turn_rad_s) < STEADY_RAD_S)
    offset, slip_sigma = 0.0, AirspeedModel().slip_sigma_rad
    if steady.sum() >= MIN_BLOCKS // 3:
        turns = slip[steady]
        offset = math.atan2(float(np.sin(turns).mean()), float(np.cos(turns).mean()))
        apart = np.angle(np.exp(1j * (turns - offset)))
        slip_sigma = float(np.clip(apart.std(), math.radians(1.0), math.radians(20.0)))
    model = AirspeedModel(
        factor=factor,
        heading_offset_rad=offset,
        sigma_mps=float(np.clip(scatter, 0.2, 3.0)),
        slip_sigma_rad=slip_sigma,
        factor_sigma=sigma,
        heading_sigma_rad=slip_sigma / math.sqrt(max(float(steady.sum()) / ALIKE, 1.0)),
    )
    reason = f"found from {len(part)} s on wings on courses that differ by {spread:.0f}°"
    return AirspeedFit(reason, model, sigma, north, east)


def _fit(part: Blocks) -> tuple[float, float, NDArray[np.float64], float]:
    """Factor, its standard deviation, wind at each block (n, 2), scatter of the airspeed, m/s."""
    from scipy.optimize import least_squares

    flown_s = np.cumsum(np.minimum(np.diff(part.time_s, prepend=part.time_s[0]), KNOT_S))
    place = np.linspace(0.0, flown_s[-1], max(2, math.ceil(flown_s[-1] / KNOT_S) + 1))
    hats = np.stack([np.interp(flown_s, place, row) for row in np.eye(len(place))], axis=1)

    def wind(x: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(hats @ x[1:].reshape(2, -1).T)

    def misses(x: NDArray[np.float64]) -> NDArray[np.float64]:
        length = np.hypot(*(part.velocity - wind(x)).T)
        steps = np.diff(x[1:].reshape(2, -1), axis=1)
        return np.concatenate([(length - x[0] * part.airspeed_mps) / SIGMA_MPS, (steps / KNOT_SIGMA_MPS).ravel()])

    start = np.concatenate([[1.0], np.zeros(2 * len(place))])
    answer = least_squares(misses, start, loss="soft_l1", max_nfev=200)
    left = misses(answer.x)[: len(part)]
    rho = float(np.clip((left[1:] * left[:-1]).sum() / max(float((left**2).sum()), 1e-12), 0.0, 0.95))
    inflation = max(float((left**2).mean()), 0.05) * (1.0 + rho) / (1.0 - rho)
    slopes = np.asarray(answer.jac, dtype=np.float64)
    covariance = np.linalg.pinv(slopes.T @ slopes) * inflation
    sigma = math.sqrt(max(float(covariance[0, 0]), 0.0))
    return float(answer.x[0]), sigma, wind(answer.x), SIGMA_MPS * math.sqrt(inflation)
