"""Systematic errors of wind measurements, which stay constant through a flight.

A drag that is 10 % off, a level that is off by half a degree, an airspeed sensor or compass with an error, the bias of the
autopilot's own filter: each affects all its measurements equally. On one course such an error looks like wind. After a turn it
does not, because it turns with the vehicle. So the filter has a state for each, with a standard deviation before the flight, and
each measurement has a *sensitivity* to them; the covariance of the wind then stays correct on one course, and a
turn determines both.

A scale k and an offset o of the heading multiply the air velocity. With g the velocity over the ground, w the wind and R(o) a turn by
o, the measurement is ``z = g - k R(o) (g - w)``. A filter that took the air velocity from z itself would explain the noise of z by
its own scale (errors in variables). With ``s = k R(o) w``, the wind as the sensor scales it, ``z = s + g - k R(o) g`` is linear in s,
k and o, with known coefficients: the filter keeps s, and the reported wind is ``R(-o) s / k`` with the covariance that follows.

For the same reason g is taken without the sway of the vehicle (`SteadyVelocity`). A gust from ahead pushes a vehicle back before its controller answers: g and z
rise together, by a tenth of a metre a second, and the filter would explain gusts by a scale that drifts on a straight leg, by 3 % a minute.

For the same reason the level is never weighted by the momentary airspeed. A level that is off by b looks like a wind of b times the slope of the
curve from drag to airspeed, which is steep where the air is slow; taken at the measured airspeed, it would be steepest in each gust from
behind, and the filter would explain gusts by a level that drifts on a straight leg. It is taken at the airspeed without gusts
(`models.wind.estimation.measurement.MeanWind`).

Source: Y. Bar-Shalom et al. (2001), section 11.9 (augmented states); S. F. Schmidt, "Application of state-space methods to navigation
problems", Advances in Control Systems 3 (1966).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.drones.airspeed import AirspeedModel
    from skyway.models.drones.drag import DragModel
    from skyway.models.wind.estimation.measurement import Measurements

DRAG_SCALE, LEVEL_FORWARD, LEVEL_RIGHT, AIRSPEED_SCALE, HEADING_OFFSET, AUTOPILOT_NORTH, AUTOPILOT_EAST = range(7)
COUNT = 7
SWAY_MPS = 1.5
"""A drone that hovers sways with its own control, which leans with it; such slow motion does not determine scales."""
STEADY_S = 60.0
"""Time constant with which the steady ground velocity follows changes that are smaller than `SWAY_MPS`."""
MIN_SCALE = 0.2
"""A scale below this is invalid: air velocities would be five times the sensor's."""
"""Systematic errors: relative, m/s2, m/s2, relative, rad, m/s, m/s."""
TAU_S = 3600.0
"""Their rate of change: the compass error with the heading, the drag with the battery's temperature and the air density."""
AUTOPILOT_BIAS_MPS = 1.5
"""Of an autopilot's own wind, each component: the two that were compared with the truth were 0.7 and 11 m/s off."""


def prior_sigma(drag: DragModel | None, sensor: AirspeedModel) -> NDArray[np.float64]:
    """Return the standard deviation of each systematic error before the flight, shape (COUNT,)."""
    sigma = np.zeros(COUNT)
    if drag is not None:
        sigma[DRAG_SCALE] = drag.relative_sigma
        sigma[LEVEL_FORWARD] = sigma[LEVEL_RIGHT] = drag.bias_sigma_mps2
    sigma[AIRSPEED_SCALE] = sensor.factor_sigma
    sigma[HEADING_OFFSET] = sensor.heading_sigma_rad
    sigma[AUTOPILOT_NORTH] = sigma[AUTOPILOT_EAST] = AUTOPILOT_BIAS_MPS
    return sigma


SCALED = {"tilt": (DRAG_SCALE, -1), "airspeed": (AIRSPEED_SCALE, HEADING_OFFSET)}
"""Errors that scale and turn the wind of each source; -1 is none."""


@dataclass(frozen=True, slots=True, eq=False)
class Dependence:
    """How measurements depend on the systematic errors."""

    sensitivity: NDArray[np.float64]
    """Shape (n, 2, COUNT). Change of the measured wind (north, east) per unit of each error."""
    scale: NDArray[np.int64]
    turn: NDArray[np.int64]
    """Shape (n,) each. The error that scales, and the one that turns, the air velocity behind each measurement; -1 is
    none."""

    @classmethod
    def none(cls, count: int, errors: int = COUNT) -> Dependence:
        """Return measurements that depend on no such error."""
        nothing = np.full(count, -1, dtype=np.int64)
        return cls(np.zeros((count, 2, errors)), nothing, nothing.copy())


class SteadyVelocity:
    """The ground velocity as commanded: it follows turns and changes of speed at once, and what gusts make of it slowly."""

    def __init__(self) -> None:
        self._steady: NDArray[np.float64] | None = None
        self._time_s = 0.0

    def of(self, time_s: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the steady part of velocities in the order of their times, shape (n, 2); it continues from those before."""
        steady = velocity.copy()
        for row in np.flatnonzero(np.isfinite(velocity).all(axis=1)):
            if self._steady is None or math.hypot(*(velocity[row] - self._steady)) > SWAY_MPS:
                self._steady = velocity[row].copy()
            else:
                share = -math.expm1(-max(float(time_s[row]) - self._time_s, 0.0) / STEADY_S)
                self._steady = self._steady + share * (velocity[row] - self._steady)
            self._time_s = float(time_s[row])
            steady[row] = self._steady
        return steady


def dependence(found: Measurements, drag: DragModel | None, steady: SteadyVelocity | None = None) -> Dependence:
    """Return how measurements depend on the systematic errors; `drag` is the one used for the lean, `steady` continues from earlier ones."""
    given = Dependence.none(len(found))
    velocity = (steady or SteadyVelocity()).of(found.time_s, found.velocity)
    for source in set(found.source.tolist()):
        rows = np.flatnonzero(found.source == source)
        square = (velocity[rows] ** 2).sum(axis=1)
        north, east = velocity[rows].T * square / (square + SWAY_MPS**2)
        given.scale[rows], given.turn[rows] = SCALED.get(source, (-1, -1))
        if source == "autopilot":
            given.sensitivity[rows, 0, AUTOPILOT_NORTH] = given.sensitivity[rows, 1, AUTOPILOT_EAST] = 1.0
        elif source == "airspeed":
            given.sensitivity[rows, :, AIRSPEED_SCALE] = np.stack([-north, -east], axis=1)
            given.sensitivity[rows, :, HEADING_OFFSET] = np.stack([east, -north], axis=1)
        elif drag is not None:
            given.sensitivity[rows, :, DRAG_SCALE] = np.stack([-north, -east], axis=1)
            slope = drag.slope(found.air_velocity[rows])
            cos_yaw, sin_yaw = np.cos(found.yaw_rad[rows]), np.sin(found.yaw_rad[rows])
            forward, right = np.stack([cos_yaw, sin_yaw], axis=1), np.stack([-sin_yaw, cos_yaw], axis=1)
            given.sensitivity[rows, :, LEVEL_FORWARD] = -(slope @ forward[:, :, None])[:, :, 0]
            given.sensitivity[rows, :, LEVEL_RIGHT] = -(slope @ right[:, :, None])[:, :, 0]
    return given
