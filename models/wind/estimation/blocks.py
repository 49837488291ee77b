"""Telemetry averaged over periods: the input of wind measurements.

Telemetry at 10 Hz and more is correlated, so it is averaged to one block a period first. A block is ready when the first
sample of the next period arrives, and does not depend on later samples; so a live flight, a log read in pieces
and a log read at once give the same blocks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.units import GRAVITY_MPS2
from skyway.models.drones.drag import thrust_acceleration

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from skyway.models.drones.telemetry import TelemetryTrack

MIN_SPEED_MPS = 3.0
MIN_SPREAD_DEG = 60.0
"""On courses that differ by less, only take-off and landing separate drag and wind."""
MIN_HEIGHT_M = 2.0
STUCK_S = 5.0
"""A sensor that has reported exactly the same value, and not 0, for this long is stuck; held values are at most 2 s old."""
GAP_PERIODS = 1.5
"""Across a longer pause between samples no acceleration is computed."""
JUMP_MPS, JUMP_MPS2, JUMP_GAP_S, JUMP_HELD_S = 5.0, 30.0, 2.0, 30.0
"""A velocity that changes by more than noise and three times gravity explain is a glitch, and is rejected
for this long; across longer gaps there is no check."""
REPEATS_SAMPLES, REPEATS_MPS = 10, 0.3
"""Samples in motion before an airspeed is accepted, and its least distance from the ground speed (RMS)."""
_VELOCITY, _THRUST, _HEADING = slice(1, 4), slice(4, 6), slice(6, 8)
_AIRSPEED, _AUTOPILOT, _FLAGS, _PLACE, _REPEATS = 8, slice(9, 11), slice(11, 13), slice(13, 16), slice(16, 18)
_COLUMNS = 18


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Telemetry averaged over periods; NaN if a period lacks a quantity."""

    time_s: NDArray[np.float64]
    """Shape (n,). Mean time of the samples of each period."""
    velocity: NDArray[np.float64]
    """Shape (n, 2). Over the ground, (north, east), m/s."""
    drag: NDArray[np.float64]
    """Shape (n, 2). Specific thrust beyond the acceleration, (north, east), m/s2."""
    yaw_rad: NDArray[np.float64]
    airspeed_mps: NDArray[np.float64]
    """Shape (n,) each. Heading, and the sensor's airspeed, less the climb."""
    acceleration: NDArray[np.float64]
    """Shape (n, 2). Over the ground, (north, east), m/s2; NaN at the ends of the stream and beside gaps."""
    autopilot: NDArray[np.float64]
    """Shape (n, 2). The autopilot's own wind."""
    flying: NDArray[np.bool_]
    winged: NDArray[np.bool_]
    """Shape (n,) each. In the air; on wings."""
    place: NDArray[np.float64]
    """Shape (n, 3). Latitude, longitude, degrees, and height above the take-off site, m."""

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def turn_rad_s(self) -> NDArray[np.float64]:
        """Turn rate of the course over the ground, clockwise, shape (n,); NaN if the acceleration is unknown."""
        (north, east), change = self.velocity.T, self.acceleration
        return np.asarray((north * change[:, 1] - east * change[:, 0]) / np.maximum(north**2 + east**2, 1.0))

    def part(self, chosen: NDArray[np.bool_] | NDArray[np.int64] | slice) -> Blocks:
        """Return some of the blocks."""
        return Blocks(*(getattr(self, item.name)[chosen] for item in fields(self)))

    @classmethod
    def joined(cls, parts: Iterable[Blocks]) -> Blocks:
        """Return blocks one after the other."""
        kept = list(parts) or [_NONE()]
        return cls(*(np.concatenate([getattr(part, item.name) for part in kept]) for item in fields(cls)))


def _NONE() -> Blocks:  # noqa: N802  an empty value, not a verb
    pair, one, flag = np.empty((0, 2)), np.empty(0), np.empty(0, dtype=np.bool_)
    return Blocks(one, pair, pair, one, one, pair, pair, flag, flag, np.empty((0, 3)))


def is_flying(track: TelemetryTrack) -> NDArray[np.bool_]:
    """Whether the vehicle is in the air, shape (samples,): as it reports, else by height and speed."""
    high = track["height_m"] > MIN_HEIGHT_M
    known = np.isfinite(track["height_m"])
    fast = np.hypot(track["vel_north_mps"], track["vel_east_mps"]) > 2.0
    guess = np.where(known, high, np.ones(len(track), dtype=bool)) | fast
    landed = track["landed"]
    return np.asarray(np.where(np.isfinite(landed), landed == 0.0, guess) & (track["armed"] != 0.0), dtype=np.bool_)


def is_trusted(track: TelemetryTrack) -> NDArray[np.bool_]:
    """Whether the vehicle does not report a wrong position or velocity, shape (samples,)."""
    return np.asarray((track["gps_ok"] != 0.0) & (track["ekf_ok"] != 0.0), dtype=np.bool_)


class BlockMaker:
    """Makes blocks of one period each from the telemetry of one vehicle; the chunks of the stream do not matter.

    Periods begin at whole multiples of `period_s`.
    """

    def __init__(self, period_s: float = 1.0) -> None:
        self.period_s = period_s
        self._rows = np.empty((0, _COLUMNS))
        self._before: NDArray[np.float64] | None = None
        self._velocity_watch, self._attitude_watch = _StuckWatch(), _StuckWatch()
        self._jump_watch = _JumpWatch()
        self._repeats = np.zeros(2)

    def feed(self, track: TelemetryTrack) -> Blocks:
        """Take samples not older than the earlier ones; return the blocks of the completed periods."""
        if not len(track):
            return _NONE()
        self._rows = np.concatenate([self._rows, self._derived(track)])
        number = np.floor(self._rows[:, 0] / self.period_s)
        open_row = int(np.searchsorted(number, number[-1], side="left"))
        if open_row == 0:
            return _NONE()
        starts = np.flatnonzero(np.diff(number[:open_row], prepend=-np.inf))
        found = self._blocks(self._rows[:open_row], starts, self._rows[open_row])
        self._before = self._rows[open_row - 1]
        self._rows = self._rows[open_row:]
        return found

    @property
    def stuck(self) -> tuple[str, ...]:
        """Sensors whose value has not changed for too long and is rejected."""
        watched = {"the attitude": self._attitude_watch, "the velocity": self._velocity_watch}
        return tuple(name for name, watch in watched.items() if watch.now)

    def flush(self) -> Blocks:
        """Return the block of the current period, whose acceleration cannot be known, at the end of the stream."""
        if not len(self._rows):
            return _NONE()
        found = self._blocks(self._rows, np.zeros(1, dtype=np.int64), None)
        self._rows, self._before = self._rows[:0], None
        return found

    def _derived(self, track: TelemetryTrack) -> NDArray[np.float64]:
        """Return the averaged quantities of each sample, shape (samples, columns)."""
        time_s = track.time_s
        rows = np.empty((len(track), _COLUMNS))
        rows[:, 0] = time_s
        velocity = np.stack([track["vel_north_mps"], track["vel_east_mps"], track["vel_down_mps"]], axis=1)
        stuck = self._velocity_watch.stuck(time_s, velocity[:, :2])
        doubted = stuck | ~is_trusted(track)
        doubted |= self._jump_watch.jumped(time_s, np.where(doubted[:, None], np.nan, velocity[:, :2]))
        rows[:, _VELOCITY] = np.where(doubted[:, None], np.nan, velocity)
        attitude = np.stack([track["roll_rad"], track["pitch_rad"]], axis=1)
        attitude = np.where(self._attitude_watch.stuck(time_s, attitude)[:, None], np.nan, attitude)
        yaw = track["yaw_rad"]
        on_rotors = (track["fixed_wing"] == 0.0) | np.isnan(track["fixed_wing"])
        thrust = thrust_acceleration(attitude[:, 0], attitude[:, 1], yaw)
        rows[:, _THRUST] = np.where(on_rotors[:, None], thrust, np.nan)
        rows[:, _HEADING] = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        climb = np.nan_to_num(track["vel_down_mps"])
        rows[:, _AIRSPEED] = np.sqrt(np.maximum(track["airspeed_mps"] ** 2 - climb**2, 0.0))
        own = np.stack([track["wind_north_mps"], track["wind_east_mps"]], axis=1)
        rows[:, _AUTOPILOT] = np.where(doubted[:, None], np.nan, own)
        rows[:, _FLAGS] = np.stack([is_flying(track), track["fixed_wing"] == 1.0], axis=1)
        rows[:, _PLACE] = np.stack([track["lat_deg"], track["lon_deg"], track["height_m"]], axis=1)
        ground = np.hypot(track["vel_north_mps"], track["vel_east_mps"])
        moving = np.isfinite(track["airspeed_mps"]) & (ground > 2.0)
        apart = np.where(moving, track["airspeed_mps"] - ground, 0.0)
        rows[:, _REPEATS] = np.stack([moving, apart**2], axis=1)
        return rows

    def _blocks(
        self, rows: NDArray[np.float64], starts: NDArray[np.int64], after: NDArray[np.float64] | None
    ) -> Blocks:
        mean = _means(rows, starts)
        change = _accelerations(rows, starts, self._before, after, self.period_s)
        up = 1.0 - np.where(np.isfinite(change[:, 2]), change[:, 2], 0.0) / GRAVITY_MPS2
        seen = self._repeats + np.cumsum(np.add.reduceat(rows[:, _REPEATS], starts, axis=0), axis=0)
        self._repeats = seen[-1]
        sensor = (seen[:, 0] >= REPEATS_SAMPLES) & (seen[:, 1] >= REPEATS_MPS**2 * seen[:, 0])
        return Blocks(
            time_s=mean[:, 0],
            velocity=mean[:, _VELOCITY][:, :2],
            drag=mean[:, _THRUST] * up[:, None] - change[:, :2],
            yaw_rad=np.arctan2(mean[:, 7], mean[:, 6]),
            airspeed_mps=np.where(sensor, mean[:, _AIRSPEED], np.nan),
            acceleration=change[:, :2],
            autopilot=mean[:, _AUTOPILOT],
            flying=mean[:, 11] > 0.99,
            winged=mean[:, 12] > 0.5,
            place=mean[:, _PLACE],
        )


def blocks(track: TelemetryTrack, period_s: float = 1.0) -> Blocks:
    """Average a whole track over periods.

    Acceleration is the change of the velocity from the beginning to the end of the period.
    """
    maker = BlockMaker(period_s)
    return Blocks.joined([maker.feed(track), maker.flush()])


class _StuckWatch:
    """Returns where all columns have been exactly the same, and not 0, for more than `STUCK_S`."""

    def __init__(self) -> None:
        self.now = False
        self._last: NDArray[np.float64] | None = None
        self._since_s = math.inf

    def stuck(self, time_s: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.bool_]:
        before = np.full((1, values.shape[1]), np.nan) if self._last is None else self._last[None]
        changed = np.any(np.diff(values, axis=0, prepend=before) != 0.0, axis=1) | (values == 0.0).all(axis=1)
        since = np.where(changed, time_s, -math.inf)
        since[0] = time_s[0] if changed[0] else self._since_s
        since = np.maximum.accumulate(since)
        self._last, self._since_s = values[-1], float(since[-1])
        found = time_s - since > STUCK_S
        self.now = bool(found[-1])
        return np.asarray(found)


class _JumpWatch:
    """Returns where the velocity has jumped impossibly, and for `JUMP_HELD_S` after."""

    def __init__(self) -> None:
        self._last = (-math.inf, np.full(2, np.nan))
        self._until_s = -math.inf

    def jumped(self, time_s: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.bool_]:
        known = np.flatnonzero(np.isfinite(velocity).all(axis=1))
        until = np.full(len(time_s), self._until_s)
        if len(known):
            when = np.concatenate([[self._last[0]], time_s[known]])
            step = np.diff(when)
            change = np.hypot(*np.diff(np.concatenate([[self._last[1]], velocity[known]]), axis=0).T)
            jumps = (step < JUMP_GAP_S) & (change > JUMP_MPS + JUMP_MPS2 * step)  # false for NaN, the first
            until[known[jumps]] = time_s[known[jumps]] + JUMP_HELD_S
            self._last = float(time_s[known[-1]]), velocity[known[-1]]
        until = np.maximum.accumulate(until)
        self._until_s = float(until[-1])
        return np.asarray(time_s < until)


def _means(rows: NDArray[np.float64], starts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Mean of the known values in each period; NaN if less than half is known."""
    known = np.isfinite(rows)
    total = np.add.reduceat(np.where(known, rows, 0.0), starts, axis=0)
    count = np.add.reduceat(known.astype(np.float64), starts, axis=0)
    size = np.diff(np.append(starts, len(rows)))[:, None]
    return np.asarray(np.where(2.0 * count >= size, total / np.maximum(count, 1.0), np.nan))


def _accelerations(
    rows: NDArray[np.float64],
    starts: NDArray[np.int64],
    before: NDArray[np.float64] | None,
    after: NDArray[np.float64] | None,
    period_s: float,
) -> NDArray[np.float64]:
    """Mean acceleration in each period, shape (periods, 3); NaN at the ends of the stream and beside gaps."""
    unknown = np.full(_COLUMNS, np.nan)
    left = np.concatenate([[unknown if before is None else before], rows[starts[1:] - 1], rows[-1:]])
    right = np.concatenate([rows[starts], [unknown if after is None else after]])
    edge = 0.5 * (left[:, _VELOCITY] + right[:, _VELOCITY])
    edge_s = 0.5 * (left[:, 0] + right[:, 0])
    joined = right[:, 0] - left[:, 0] < GAP_PERIODS * period_s  # false for NaN
    span = np.diff(edge_s)
    whole = joined[1:] & joined[:-1] & (span > 0.0)
    return np.where(whole[:, None], np.diff(edge, axis=0) / np.where(whole, span, 1.0)[:, None], np.nan)


def course_spread_deg(velocity: NDArray[np.float64]) -> float:
    """Spread of the courses flown above `MIN_SPEED_MPS`, 0 to 180 degrees, ignoring the outermost 5 %."""
    fast = np.hypot(*velocity.T) > MIN_SPEED_MPS
    if fast.sum() < 5:
        return 0.0
    course = np.degrees(np.arctan2(velocity[fast, 1], velocity[fast, 0]))
    apart = np.abs((course[:, None] - course[None, :: max(1, len(course) // 200)] + 180.0) % 360.0 - 180.0)
    return float(np.percentile(apart, 95))
