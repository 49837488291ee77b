"""Wind measurements from averaged telemetry: by tilt and drag, by airspeed, by the autopilot's estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.drones.airspeed import AirspeedModel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.models.drones.drag import DragModel
    from skyway.models.wind.estimation.blocks import Blocks

LAG_S = 0.3
"""Lag between airspeed, heading and ground velocity, which matters in turns."""
AUTOPILOT_SIGMA_MPS = 1.0
AUTOPILOT_EVERY_S = 10.0
"""The autopilot's estimate is filtered: it is used at this interval."""
SAME_SENSOR_S = 30.0
"""If airspeed gave the wind within this time, the autopilot's estimate is based on the same data and not used."""
PLAIN_SENSOR = AirspeedModel(factor_sigma=0.08, heading_sigma_rad=math.radians(6.0))
"""An uncalibrated sensor."""
MIN_AIRSPEED_MPS = 8.0
"""Below this airspeed a plane does not fly on its wings."""
MAX_WIND_MPS = {"tilt": 25.0, "airspeed": 60.0, "autopilot": 60.0}
"""No such vehicle flies in a stronger wind: the measurement is wrong, and those before it may be, too."""
MEAN_WIND_S = 60.0
"""Averaging time of winds, some five gusts, for the airspeed at which errors are computed."""


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """Winds measured, in the order of time."""

    time_s: NDArray[np.float64]
    """Shape (n,)."""
    wind: NDArray[np.float64]
    """Shape (n, 2). (north, east) TOWARDS, m/s."""
    noise: NDArray[np.float64]
    """Shape (n, 3). Covariance: north-north, north-east, east-east."""
    source: NDArray[np.str_]
    """Shape (n,). ``tilt``, ``airspeed`` or ``autopilot``."""
    velocity: NDArray[np.float64]
    """Shape (n, 2). Over the ground, (north, east), m/s."""
    yaw_rad: NDArray[np.float64]
    """Shape (n,). Heading."""
    air_velocity: NDArray[np.float64]
    """Shape (n, 2). Through the air, (north, east), m/s: for tilt without gusts and noise, because the
    errors are computed at it."""

    def __len__(self) -> int:
        return len(self.time_s)


def tilt_air_velocity(air: Blocks, drag: DragModel) -> NDArray[np.float64]:
    """Air velocity that explains the lean, without the bias of the level, shape (blocks, 2)."""
    cos_yaw, sin_yaw = np.cos(air.yaw_rad), np.sin(air.yaw_rad)
    bias = np.stack(
        [
            drag.bias_forward_mps2 * cos_yaw - drag.bias_right_mps2 * sin_yaw,
            drag.bias_forward_mps2 * sin_yaw + drag.bias_right_mps2 * cos_yaw,
        ],
        axis=1,
    )
    return drag.air_velocity(air.drag - bias)


class MeanWind:
    """The mean of the winds measured by tilt during the last minute or so: the wind without gusts and noise."""

    def __init__(self) -> None:
        self._mean = np.zeros(2)
        self._weight = 0.0
        self._heard_s = 0.0

    def before(self, time_s: NDArray[np.float64], wind: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean before each measurement, shape (n, 2); for the first, and impossible winds, the measurement itself."""
        mean = wind.copy()
        believed = np.hypot(wind[:, 0], wind[:, 1]) <= MAX_WIND_MPS["tilt"]
        for row in np.flatnonzero(believed):
            self._weight *= (
                math.exp(-max(float(time_s[row]) - self._heard_s, 0.0) / MEAN_WIND_S) if self._weight else 0.0
            )
            self._heard_s = float(time_s[row])
            if self._weight > 0.0:
                mean[row] = self._mean
            self._weight += 1.0
            self._mean = self._mean + (wind[row] - self._mean) / self._weight
        return mean


def tilt_wind(air: Blocks, drag: DragModel, mean: MeanWind | None = None) -> Measurements:
    """Wind by tilt and drag: ground velocity minus the air velocity that explains the lean. Multirotors only.

    `mean` continues from the blocks before these.
    """
    through_air = tilt_air_velocity(air, drag)
    known = air.flying & ~air.winged & np.isfinite(through_air).all(axis=1) & np.isfinite(air.velocity).all(axis=1)
    air, through_air = air.part(known), through_air[known]
    wind = air.velocity - through_air
    calm = air.velocity - (mean or MeanWind()).before(air.time_s, wind)
    return _chosen(air, wind, drag.noise(through_air, air.acceleration), air.flying, "tilt", calm)


def airspeed_wind(air: Blocks, sensor: AirspeedModel = PLAIN_SENSOR) -> Measurements:
    """Wind by an airspeed sensor: ground velocity minus airspeed along the heading, both corrected by the calibration.

    On wings only: a multirotor without a sensor reports an invented airspeed, and one with a sensor measures only air from ahead.
    """
    towards = air.yaw_rad + sensor.heading_offset_rad
    cos_yaw, sin_yaw = np.cos(towards), np.sin(towards)
    speed = sensor.factor * air.airspeed_mps
    wind = air.velocity - speed[:, None] * np.stack([cos_yaw, sin_yaw], axis=1)
    along = sensor.sigma_mps**2
    turned = LAG_S * np.where(np.isfinite(air.turn_rad_s), air.turn_rad_s, 0.0)
    across = (sensor.slip_sigma_rad**2 + turned**2) * speed**2 + along
    noise = np.stack(
        [
            along * cos_yaw**2 + across * sin_yaw**2,
            (along - across) * cos_yaw * sin_yaw,
            along * sin_yaw**2 + across * cos_yaw**2,
        ],
        axis=1,
    )
    fast = air.airspeed_mps > MIN_AIRSPEED_MPS
    return _chosen(air, wind, noise, air.flying & air.winged & fast, "airspeed")


def autopilot_wind(air: Blocks, after_s: float = -math.inf, told_s: NDArray[np.float64] | None = None) -> Measurements:
    """Return the autopilot's own estimate, used rarely because it is already filtered.

    It was used last at `after_s`, in blocks before these; airspeed gave the wind at `told_s`, in order.
    """
    noise = np.broadcast_to(np.array([AUTOPILOT_SIGMA_MPS**2, 0.0, AUTOPILOT_SIGMA_MPS**2]), (len(air), 3))
    airspeed_s = np.concatenate([[-np.inf], np.empty(0) if told_s is None else told_s])
    since = air.time_s - airspeed_s[np.searchsorted(airspeed_s, air.time_s, side="right") - 1]
    alive = np.flatnonzero(np.isfinite(air.autopilot).all(axis=1) & air.flying & (since > SAME_SENSOR_S))
    slot = np.floor(air.time_s[alive] / AUTOPILOT_EVERY_S)
    fresh = np.diff(slot, prepend=math.floor(after_s / AUTOPILOT_EVERY_S) if math.isfinite(after_s) else -np.inf) > 0.0
    first = np.zeros(len(air), dtype=bool)
    first[alive[fresh]] = True
    return _chosen(air, air.autopilot, noise, first, "autopilot")


def measurements(
    air: Blocks,
    drag: DragModel | None,
    sensor: AirspeedModel = PLAIN_SENSOR,
    *,
    autopilot_s: float = -math.inf,
    airspeed_s: float = -math.inf,
    mean: MeanWind | None = None,
) -> Measurements:
    """Every measurement of the wind from telemetry, in the order of time.

    Without a drag tilt is not usable. The autopilot's estimate was used last, and airspeed gave the wind, at
    `autopilot_s` and `airspeed_s` in blocks before these, from which `mean` continues.
    """
    by_airspeed = airspeed_wind(air, sensor)
    parts = [by_airspeed, autopilot_wind(air, autopilot_s, np.append(airspeed_s, by_airspeed.time_s))]
    if drag is not None:
        parts.insert(0, tilt_wind(air, drag, mean))
    order = np.argsort(np.concatenate([part.time_s for part in parts]), kind="stable")
    columns = (np.concatenate([getattr(part, one.name) for part in parts])[order] for one in fields(Measurements))
    return Measurements(*columns)


def _chosen(
    air: Blocks,
    wind: NDArray[np.float64],
    noise: NDArray[np.float64],
    where: NDArray[np.bool_],
    source: str,
    air_velocity: NDArray[np.float64] | None = None,
) -> Measurements:
    through_air = air.velocity - wind if air_velocity is None else air_velocity
    good = where & np.isfinite(wind).all(axis=1) & np.isfinite(noise).all(axis=1)
    named = np.full(int(good.sum()), source)
    return Measurements(
        air.time_s[good], wind[good], noise[good], named, air.velocity[good], air.yaw_rad[good], through_air[good]
    )
