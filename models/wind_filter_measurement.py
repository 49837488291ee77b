"""From telemetry to measurements of the wind: by tilt and drag, by an airspeed sensor, by the autopilot's own estimate.

Telemetry at 10 Hz and more is correlated, so it is averaged to one measurement a period first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.drag import thrust_acceleration

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.drag import DragModel
    from models.telemetry import TelemetryTrack

AIRSPEED_SIGMA_MPS = 0.7
"""Of a pitot tube, along the heading."""
SLIP_SIGMA_RAD = math.radians(5.0)
"""Side slip and heading error of a plane."""
AUTOPILOT_SIGMA_MPS = 1.0
AUTOPILOT_EVERY_S = 10.0
"""The autopilot's estimate is a filtered one: it is taken this often and no oftener."""
MIN_AIRSPEED_MPS = 8.0
"""Below this a plane does not fly on its wings."""
MIN_HEIGHT_M = 2.0
STUCK_S = 20.0
"""A sensor that gives exactly the same for so long is stuck."""


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Telemetry averaged over periods; NaN where a period lacks something.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
        Middle of each period.
    velocity : ndarray, shape (n, 2)
        Over the ground, (north, east), m/s.
    drag : ndarray, shape (n, 2)
        What the thrust gives beyond the acceleration, (north, east), m/s2.
    yaw_rad, airspeed_mps : ndarray, shape (n,)
        Heading, and what the sensor says.
    autopilot : ndarray, shape (n, 2)
        The autopilot's own wind.
    flying, winged : ndarray of bool, shape (n,)
        In the air; on wings.
    """

    time_s: NDArray[np.float64]
    velocity: NDArray[np.float64]
    drag: NDArray[np.float64]
    yaw_rad: NDArray[np.float64]
    airspeed_mps: NDArray[np.float64]
    autopilot: NDArray[np.float64]
    flying: NDArray[np.bool_]
    winged: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """Winds measured, in the order of time.

    Attributes
    ----------
    time_s : ndarray, shape (n,)
    wind : ndarray, shape (n, 2)
        (north, east) TOWARDS, m/s.
    noise : ndarray, shape (n, 3)
        Covariance: north-north, north-east, east-east.
    source : ndarray of str, shape (n,)
        ``tilt``, ``airspeed`` or ``autopilot``.
    """

    time_s: NDArray[np.float64]
    wind: NDArray[np.float64]
    noise: NDArray[np.float64]
    source: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.time_s)


def is_flying(track: TelemetryTrack) -> NDArray[np.bool_]:
    """Whether the vehicle is in the air, shape (samples,): what it says, else its height and speed."""
    high = track["height_m"] > MIN_HEIGHT_M
    known = np.isfinite(track["height_m"])
    fast = np.hypot(track["vel_north_mps"], track["vel_east_mps"]) > 2.0
    guess = np.where(known, high, np.ones(len(track), dtype=bool)) | fast
    landed = track["landed"]
    return np.asarray(np.where(np.isfinite(landed), landed == 0.0, guess & (track["armed"] != 0.0)), dtype=np.bool_)


def blocks(track: TelemetryTrack, period_s: float = 1.0) -> Blocks:
    """Average telemetry over periods.

    Acceleration is the change of the velocity from the beginning to the end of the period.
    """
    time_s = track.time_s
    if not len(track):
        empty = np.empty((0, 2))
        return Blocks(np.empty(0), empty, empty, np.empty(0), np.empty(0), empty, np.empty(0, bool), np.empty(0, bool))
    number = np.floor((time_s - time_s[0]) / period_s).astype(np.int64)
    _, starts = np.unique(number, return_index=True)
    velocity = np.stack([track["vel_north_mps"], track["vel_east_mps"], track["vel_down_mps"]], axis=1)
    velocity = np.where(_stuck(time_s, velocity[:, :2])[:, None], np.nan, velocity)
    middle = _means(time_s[:, None], starts)[:, 0]
    mean = _means(velocity, starts)
    change = _accelerations(time_s, velocity, starts, period_s)
    attitude = np.stack([track["roll_rad"], track["pitch_rad"]], axis=1)
    attitude = np.where(_stuck(time_s, attitude)[:, None], np.nan, attitude)
    thrust = thrust_acceleration(attitude[:, 0], attitude[:, 1], track["yaw_rad"])
    up = 1.0 - np.where(np.isfinite(change[:, 2]), change[:, 2], 0.0) / 9.80665
    heading = _means(np.stack([np.cos(track["yaw_rad"]), np.sin(track["yaw_rad"])], axis=1), starts)
    flags = _means(np.stack([is_flying(track), track["fixed_wing"] == 1.0], axis=1).astype(np.float64), starts)
    return Blocks(
        time_s=middle,
        velocity=mean[:, :2],
        drag=_means(thrust, starts) * up[:, None] - change[:, :2],
        yaw_rad=np.arctan2(heading[:, 1], heading[:, 0]),
        airspeed_mps=_means(np.where(_repeats_ground_speed(track), np.nan, track["airspeed_mps"])[:, None], starts)[
            :, 0
        ],
        autopilot=_means(np.stack([track["wind_north_mps"], track["wind_east_mps"]], axis=1), starts),
        flying=flags[:, 0] > 0.99,
        winged=flags[:, 1] > 0.5,
    )


def tilt_air_velocity(air: Blocks, drag: DragModel) -> NDArray[np.float64]:
    """Air velocity that explains the lean, the level's bias taken off, shape (blocks, 2)."""
    cos_yaw, sin_yaw = np.cos(air.yaw_rad), np.sin(air.yaw_rad)
    bias = np.stack(
        [
            drag.bias_forward_mps2 * cos_yaw - drag.bias_right_mps2 * sin_yaw,
            drag.bias_forward_mps2 * sin_yaw + drag.bias_right_mps2 * cos_yaw,
        ],
        axis=1,
    )
    return drag.air_velocity(air.drag - bias)


def tilt_wind(air: Blocks, drag: DragModel) -> Measurements:
    """Wind by tilt and drag: ground velocity minus the air velocity that explains the lean. Multirotors only."""
    through_air = tilt_air_velocity(air, drag)
    wind = air.velocity - through_air
    return _chosen(air, wind, drag.noise(through_air), air.flying & ~air.winged, "tilt")


def airspeed_wind(air: Blocks) -> Measurements:
    """Wind by an airspeed sensor: ground velocity minus airspeed along the heading.

    On wings only: a multirotor without a sensor reports a made-up airspeed, and one with a sensor feels the air from ahead only.
    """
    cos_yaw, sin_yaw = np.cos(air.yaw_rad), np.sin(air.yaw_rad)
    wind = air.velocity - air.airspeed_mps[:, None] * np.stack([cos_yaw, sin_yaw], axis=1)
    along = AIRSPEED_SIGMA_MPS**2
    across = (SLIP_SIGMA_RAD * air.airspeed_mps) ** 2 + along
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


def autopilot_wind(air: Blocks) -> Measurements:
    """Return the autopilot's own estimate, taken seldom because it is filtered already."""
    noise = np.broadcast_to(np.array([AUTOPILOT_SIGMA_MPS**2, 0.0, AUTOPILOT_SIGMA_MPS**2]), (len(air), 3))
    slot = np.floor(air.time_s / AUTOPILOT_EVERY_S)
    alive = np.isfinite(air.autopilot).all(axis=1) & air.flying
    first = np.zeros(len(air), dtype=bool)
    first[np.flatnonzero(alive)[np.unique(slot[alive], return_index=True)[1]]] = True
    return _chosen(air, air.autopilot, noise, first, "autopilot")


def measurements(air: Blocks, drag: DragModel | None) -> Measurements:
    """Every measurement of the wind that telemetry gives, in the order of time.

    Parameters
    ----------
    air : Blocks
        From `blocks`.
    drag : DragModel or None
        None: the drag is not known, so tilt tells nothing.
    """
    parts = [airspeed_wind(air), autopilot_wind(air)]
    if drag is not None:
        parts.insert(0, tilt_wind(air, drag))
    time_s = np.concatenate([part.time_s for part in parts])
    order = np.argsort(time_s, kind="stable")
    return Measurements(
        time_s[order],
        np.concatenate([part.wind for part in parts])[order],
        np.concatenate([part.noise for part in parts])[order],
        np.concatenate([part.source for part in parts])[order],
    )


def _chosen(
    air: Blocks, wind: NDArray[np.float64], noise: NDArray[np.float64], where: NDArray[np.bool_], source: str
) -> Measurements:
    good = where & np.isfinite(wind).all(axis=1) & np.isfinite(noise).all(axis=1)
    return Measurements(air.time_s[good], wind[good], noise[good], np.full(int(good.sum()), source))


def _means(values: NDArray[np.float64], starts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Mean of what is known in each period; NaN where less than half of it is."""
    known = np.isfinite(values)
    total = np.add.reduceat(np.where(known, values, 0.0), starts, axis=0)
    count = np.add.reduceat(known.astype(np.float64), starts, axis=0)
    size = np.diff(np.append(starts, len(values)))[:, None]
    return np.asarray(np.where(2.0 * count >= size, total / np.maximum(count, 1.0), np.nan))


def _accelerations(
    time_s: NDArray[np.float64], velocity: NDArray[np.float64], starts: NDArray[np.int64], period_s: float
) -> NDArray[np.float64]:
    """Mean acceleration in each period, shape (periods, 3); NaN at the ends of the log and beside gaps."""
    change = np.full((len(starts), velocity.shape[1]), np.nan)
    if len(starts) > 2:
        first, before = starts[1:], starts[1:] - 1
        edge = 0.5 * (velocity[first] + velocity[before])
        edge_s = 0.5 * (time_s[first] + time_s[before])
        span = np.diff(edge_s)
        whole = (span > 0.0) & (span < 1.5 * period_s) & (np.diff(time_s)[before].reshape(-1)[:-1] < period_s)
        change[1:-1] = np.where(whole[:, None], np.diff(edge, axis=0) / np.where(whole, span, 1.0)[:, None], np.nan)
    return change


def _stuck(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Where all columns have been exactly the same, and not 0, for `STUCK_S` and more, shape (samples,)."""
    changed = np.any(np.diff(values, axis=0, prepend=np.nan) != 0.0, axis=1)
    run = np.cumsum(changed) - 1
    begin = time_s[np.flatnonzero(changed)] if changed.any() else time_s[:1]
    last = np.append(np.flatnonzero(changed)[1:] - 1, len(time_s) - 1)
    long = (time_s[last] - begin > STUCK_S) if len(begin) == len(last) else np.zeros(len(begin), dtype=bool)
    return np.asarray(long[np.maximum(run, 0)])


def _repeats_ground_speed(track: TelemetryTrack) -> bool:
    """Whether the airspeed is only the ground speed again, as bridges without a sensor tell it."""
    ground = np.hypot(track["vel_north_mps"], track["vel_east_mps"])
    moving = np.isfinite(track["airspeed_mps"]) & (ground > 2.0)
    if moving.sum() < 10:
        return False
    difference = (track["airspeed_mps"] - ground)[moving]
    return bool(np.sqrt(np.mean(difference**2)) < 0.3)
