"""A commanded ground speed that is not reached at full lean: its cause, and the wind that follows from it.

A multirotor in steady flight at the maximum lean angle of its autopilot has the drag of that angle: it flies through the
air at one airspeed, in the direction of the lean. The difference to its ground velocity is the wind. If the drag is known
(``--drag``) the wind filter derives this from the tilt; if it is not, the airspeed is that of the drone's maker at
a usual lean, with an uncertainty of a third, and the measured wind has the same uncertainty.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.supervisor.flight.phase import cruises
from skyway.link.supervisor.journal.entries import SpeedLimited
from skyway.models.base.formatting import speed_text, wind_text
from skyway.models.base.units import GRAVITY_MPS2
from skyway.models.drones.drag import lean_acceleration

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context
    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.telemetry import TelemetrySample

WINDOW_S, STEADY_S = 12.0, 8.0
JUDGE_EVERY_S = 0.5
LEAN_SHARE, SPEED_SHARE = 0.93, 0.92
"""Least lean as a share of the limit, and greatest speed as a share of the commanded one, of a limited flight."""
REACHED_SHARE = 0.96
STEADY_MPS2 = 0.15
"""Greatest acceleration of steady flight, m/s2."""
MEASURE_EVERY_S = 30.0
GUSTS_S = 60.0
"""Averaging time of the velocity that bounds the airspeed, s: a drone at its lean limit is carried by gusts."""
USUAL_LEAN_DEG = 25.0
"""Lean angle at which makers state a maximum airspeed, degrees."""
DRAG_EXPONENT = 0.75
"""Airspeed grows with the tangent of the lean to a power between one half (quadratic drag) and one (linear drag)."""
RELATIVE_SIGMA, ACROSS_MPS = 0.35, 1.5
"""Standard deviation of the airspeed at full lean if the drag is unknown, relative; and of the wind across the
lean, whose direction is known, m/s."""


def airspeed_at_lean(drag: DragModel, lean_deg: float) -> float:
    """Airspeed, m/s, whose drag balances a lean in steady level flight."""
    force = GRAVITY_MPS2 * math.tan(math.radians(min(lean_deg, 80.0)))
    return float(np.hypot(*drag.air_velocity(np.array([[force, 0.0]]))[0]))


@dataclass(frozen=True, slots=True)
class WindAtLimit:
    """A measurement of the wind at full lean."""

    north_mps: float
    east_mps: float
    """`north_mps`, `east_mps`: TOWARDS."""
    noise: np.ndarray
    """Covariance, shape (2, 2)."""
    airspeed_mps: float
    """Assumed airspeed."""
    along: tuple[float, float]
    """Unit vector (north, east) of the lean."""


@dataclass(slots=True)
class LeanWatch:
    """Detects whether a flight does not reach its commanded speed, and why."""

    limit_deg: float = math.nan
    """The autopilot's maximum lean; NaN if unknown: then nothing is detected."""
    top_airspeed_mps: float = 20.0
    """Stated by the drone's maker."""
    limited: bool = False
    """The drone leans as far as it may, flies steadily, and is slower than commanded."""
    speed_mps: float = math.nan
    lean_deg: float = math.nan
    """`speed_mps`, `lean_deg`: mean ground speed, and lean of the thrust, while limited."""
    taken: int = 0
    """Number of measurements of this flight."""
    _measured_s: float = -math.inf
    _judged_s: float = -math.inf
    _rows: deque[tuple[float, ...]] = field(default_factory=deque)
    _velocity: np.ndarray | None = None

    def know_limits(self, limit_deg: float, top_airspeed_mps: float) -> None:
        """Set the limits of this vehicle."""
        self.limit_deg, self.top_airspeed_mps = limit_deg, top_airspeed_mps

    def begin(self) -> None:
        """Begin a flight."""
        self.limited, self.taken, self._velocity = False, 0, None
        self._measured_s = self._judged_s = -math.inf
        self._rows.clear()

    def hear(self, s: TelemetrySample, commanded_mps: float) -> bool:
        """Take a sample in the air; return whether the flight became limited, or no longer is, with it."""
        values = (s.time_s, s.vel_north_mps, s.vel_east_mps, s.roll_rad, s.pitch_rad, s.yaw_rad)
        if not math.isfinite(self.limit_deg) or not all(map(math.isfinite, values)):
            return False
        if self._rows and not s.time_s > self._rows[-1][0]:
            return False
        self._rows.append((*values[:3], *lean_acceleration(*values[3:])))
        while self._rows[0][0] < s.time_s - WINDOW_S:
            self._rows.popleft()
        if s.time_s - self._rows[0][0] < STEADY_S or s.time_s < self._judged_s + JUDGE_EVERY_S:
            return False
        before = self.limited
        self._judge(commanded_mps)
        self._judged_s = s.time_s
        return self.limited != before

    def _judge(self, commanded_mps: float) -> None:
        rows = self._rows
        count = len(rows)
        force_north, force_east = sum(row[3] for row in rows) / count, sum(row[4] for row in rows) / count
        lean_deg = math.degrees(math.atan2(math.hypot(force_north, force_east), GRAVITY_MPS2))
        if not self.limited and lean_deg < LEAN_SHARE * self.limit_deg:  # the usual case
            self._velocity = None
            return
        velocity = np.array(rows)[:, 1:3]
        half = count // 2
        first, last = velocity[:half].mean(axis=0), velocity[half:].mean(axis=0)
        gain_mps2 = float(np.hypot(*(last - first))) / max(0.5 * (rows[-1][0] - rows[0][0]), 1e-6)
        speed_mps = float(np.hypot(*velocity.mean(axis=0)))
        if self.limited and speed_mps >= REACHED_SHARE * commanded_mps:
            self.limited = False
        elif lean_deg >= LEAN_SHARE * self.limit_deg and gain_mps2 <= STEADY_MPS2:
            self.limited = self.limited or speed_mps <= SPEED_SHARE * commanded_mps
            self.speed_mps, self.lean_deg = speed_mps, lean_deg
        if not self.limited:
            self._velocity = None
            return
        mean = velocity.mean(axis=0)
        keep = math.exp(-JUDGE_EVERY_S / GUSTS_S)
        self._velocity = mean if self._velocity is None else keep * self._velocity + (1.0 - keep) * mean

    def measure(self) -> WindAtLimit | None:
        """Measure the wind if the flight is limited, long enough after the last time; for an unknown drag.

        The error is that of the airspeed, the same in each measurement, so each further one has less weight.
        """
        if not self.limited or self._rows[-1][0] < self._measured_s + MEASURE_EVERY_S:
            return None
        table = np.array(self._rows)
        force, velocity = table[:, 3:5].mean(axis=0), table[:, 1:3].mean(axis=0)
        if not math.degrees(math.atan2(np.hypot(*force), GRAVITY_MPS2)) >= LEAN_SHARE * self.limit_deg:
            return None
        self._measured_s = self._rows[-1][0]
        self.taken += 1
        along = force / np.hypot(*force)
        share = math.tan(math.radians(self.lean_deg)) / math.tan(math.radians(USUAL_LEAN_DEG))
        airspeed = self.top_airspeed_mps * share**DRAG_EXPONENT
        north, east = velocity - airspeed * along
        across = np.array([-along[1], along[0]])
        noise = (RELATIVE_SIGMA * airspeed) ** 2 * np.outer(along, along) + ACROSS_MPS**2 * np.outer(across, across)
        return WindAtLimit(float(north), float(east), self.taken * noise, airspeed, (float(along[0]), float(along[1])))

    def airspeed_mps(self, wind: tuple[float, float]) -> float:
        """Upper limit of the airspeed, m/s, from ground speed and this wind; infinite if there is none."""
        if not self.limited or self._velocity is None:
            return math.inf
        return float(np.hypot(*(self._velocity - np.array(wind))))

    def said(self, commanded_mps: float) -> str:
        """Describe the limiting factor."""
        return (
            f"speed limited by the lean limit of {self.limit_deg:.0f}°: {speed_text(self.speed_mps)} over ground instead of the "
            f"commanded {speed_text(commanded_mps)}"
        )


def watch_lean(ctx: Context, s: TelemetrySample) -> None:
    """Process a sample of the flight; report when the lean begins or ends to limit it, and use the wind that this measures."""
    leg, watch = ctx.delivery.leg, ctx.lean
    if leg is None or not ctx.in_air or not cruises(ctx, s) or ctx.vehicle.mode != "mission":
        return
    changed = watch.hear(s, leg.commanded_mps)
    found = watch.measure() if ctx.job.drag is None else None
    if found is not None:
        ctx.wind.measure(found, s, leg.home_ground_m)
    if not changed:
        return
    estimate, words = ctx.wind.estimate, watch.said(leg.commanded_mps)
    if not watch.limited:
        words = f"speed no longer limited by the lean limit: the commanded {speed_text(leg.commanded_mps)} over ground are reached"
    elif estimate is not None:
        words += f"; estimated wind {wind_text(estimate.speed_mps, estimate.from_deg, estimate.sigma_mps)}"
    found_limit = SpeedLimited(
        limited=watch.limited,
        lean_deg=watch.lean_deg,
        limit_deg=watch.limit_deg,
        ground_speed_mps=watch.speed_mps,
        commanded_mps=leg.commanded_mps,
    )
    ctx.say(found_limit, words)
