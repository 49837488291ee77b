"""Weighing in flight: how much of a package is aboard, by the power that the drone draws.

Power is compared with that of the same drone under its package, so that its own efficiency cancels. With thrust T = m (g + a) / cos(lean),
airspeed V and climb v the model is

    P = k ((T / W)^kappa F(V) + c max(v, 0) T / W)

where W is the drone's weight without a package, kappa and the power of hover are those of its energy model, F is momentum theory in forward
flight (`models.drones.airspeed_load`) and c what a metre a second of climb takes. Flights under the package give k; then power gives m.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from statistics import fmean, median, pstdev
from typing import TYPE_CHECKING

from skyway.models.base.units import GRAVITY_MPS2
from skyway.models.drones.airspeed_load import BLADE_SHARE, INDUCED_FACTOR, INFLOW_MPS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from skyway.link.supervisor.proof.tilt_airspeed import TiltAirspeed
    from skyway.models.drones.airspeed_load import AirspeedLoad
    from skyway.models.drones.telemetry import TelemetrySample

BEGIN_S, END_S = 3.0, 18.0
"""Seconds after a take-off that are weighed: power is uneven before, and within 20 s there is to be an answer."""
_LEAST_S, _KEPT_SHARE = 6, 0.75
_CLIMB = (1.0 - BLADE_SHARE) / (INDUCED_FACTOR * INFLOW_MPS)
_STEADY_MPS2, _DESCENT_MPS = 0.7, -0.4
USUAL_KAPPA = 1.6
GAIN_SIGMA, MODEL_SIGMA = 0.008, 0.008
"""Standard deviations of power, relative: between two take-offs of one drone, and of the model over them."""
STEP_S = 8
"""Seconds before and after a moment that are compared for a package that is lost on the way."""
SHORT_S, BESIDE_S, _CLEAN_SHARE = 4, 3, 0.1
"""A fall between stretches that are as steady as this share of it is one though the wind drifts: then so many seconds before it will do, and the drone
flies alike only in so many on either side."""
_STEP_SHARE, _STEADY_SHARE, _STEP_WAIT_S = 0.6, 0.3, 4.0
_PER_RAD, _PER_MPS = 2.5, 0.03
"""Share of the power that a lean less by a radian, or an airspeed other by a metre a second, may take away at most: the fall must be so much deeper.
A drone that has lost its package leans as before or more; one that brakes, or is pushed by a gust from behind, leans less, and has less drag."""
_LEAST_FALL, _MOST_SHARE, _STEEP_RAD = 0.1, 1.5, 0.35
"""A package whose weight takes less of the power is not told from gusts; a fall of so many times as much is something else; and a drone that leans further
fights the wind: most of its power is drag."""
_SAME_AIRSPEED_MPS, _SAME_CLIMB_MPS = 4.0, 0.5
"""Airspeeds and climbs further apart are not compared: the model knows them too roughly."""
_AIRSPEED, _LEAN, _CLIMB_RATE = 2, 3, 4
_SLOW_CLIMB_MPS, _SLOW_MPS, _SLOW_S, _SLOW_SIGMA, _IDLE_SHARE = 1.0, 2.0, 14.0, 0.035, 0.4
"""What it weighs before the release: by the last seconds of slow descent, or hover; there power knows the mass to so much, relative. It is idle below that share."""

Points = list[tuple[float, float, float, float, float]]
"""Time, power in units of the model, airspeed, lean and climb, a second apart."""


@dataclass(frozen=True, slots=True)
class Weight:
    """How much of the package is aboard, as a share of it."""

    share: float
    sigma: float
    """`share`, `sigma`: 1 is all of it; and its standard deviation."""
    seconds: int
    """So many seconds were weighed."""


@dataclass(slots=True)
class Scale:
    """One drone as its own scale."""

    drone_kg: float
    package_kg: float
    kappa: float = USUAL_KAPPA
    """Exponent of mass in the power of hover."""
    load: AirspeedLoad | None = None
    """Power over airspeed; None takes the power of hover."""
    tilt: TiltAirspeed | None = None
    """Airspeed by the lean, for a package that is lost on the way; None takes that of the wind that is believed."""
    gains: list[float] = field(default_factory=list)
    """Power in units of the model, W, of each take-off under the package."""
    took_off_s: float = math.nan
    _sums: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    _was: TelemetrySample | None = None
    _newest_s: float = -math.inf
    _second: list[tuple[float, float, float, float, float, float]] = field(default_factory=list)
    """Of the second under way: time, power, lift, airspeed by the wind, climb and lean."""
    _steady: deque[tuple[float, float, float, float, float]] = field(default_factory=lambda: deque(maxlen=2 * STEP_S))

    def take_off(self, time_s: float) -> None:
        """Begin to weigh: it has left the ground."""
        self.took_off_s, self._was = time_s, None
        self._sums.clear()
        self._steady.clear()
        self._second.clear()
        self._lost_s = None
        self._slow.clear()

    def hear(self, s: TelemetrySample, wind: tuple[float, float]) -> None:
        """Take a sample in flight, and the wind there, (north, east), m/s."""
        self._end_second(s)
        was, self._was = self._was, s
        if was is None or not math.isfinite(s.power_w) or not s.time_s > was.time_s:
            return
        rise = -(s.vel_down_mps - was.vel_down_mps) / (s.time_s - was.time_s)
        climb = -s.vel_down_mps
        if not abs(rise) < _STEADY_MPS2 or s.power_w == self._last_power:
            return
        airspeed = math.hypot(s.vel_north_mps - wind[0], s.vel_east_mps - wind[1])
        lean = math.cos(s.roll_rad) * math.cos(s.pitch_rad)
        if not (math.isfinite(airspeed) and lean > 0.5):
            return
        self._last_power = s.power_w
        lift = (1.0 + rise / GRAVITY_MPS2) / lean
        self._hear_slow(s, lift, airspeed, climb)
        after_s = s.time_s - self.took_off_s
        if climb > _DESCENT_MPS and BEGIN_S <= after_s <= END_S:
            self._sums.setdefault(int(after_s), []).append((s.power_w, self._units(lift, airspeed, climb)))
        self._second.append((s.time_s, s.power_w, lift, airspeed, climb, math.acos(lean)))

    def _end_second(self, s: TelemetrySample) -> None:
        """Keep the mean of a second that is over, for a package that is lost on the way."""
        by_tilt = None if self.tilt is None else self.tilt.hear(s)
        if by_tilt is None and (self.tilt is not None or s.time_s < self._newest_s + 1.0):
            return
        self._newest_s = s.time_s
        if self._second:
            time_s, power_w, lift, airspeed, climb, lean = map(fmean, zip(*self._second, strict=True))
            if by_tilt is not None and math.isfinite(by_tilt):
                airspeed = by_tilt
            self._steady.append((time_s, power_w / self._units(lift, airspeed, climb), airspeed, lean, climb))
            self._lost_s = self._look()
        self._second.clear()

    _last_power: float = math.nan
    _lost_s: float | None = None
    _slow: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=400))
    """Time, and power in units of hover, of slow descent and hover."""

    def _hear_slow(self, s: TelemetrySample, lift: float, airspeed_mps: float, climb_mps: float) -> None:
        slow = abs(climb_mps) < _SLOW_CLIMB_MPS and math.hypot(s.vel_north_mps, s.vel_east_mps) < _SLOW_MPS
        units = s.power_w / self._units(lift, airspeed_mps, 0.0)
        if slow and self.gains and units > _IDLE_SHARE * fmean(self.gains):
            self._slow.append((s.time_s, units))

    def before_release(self) -> Weight | None:
        """Weigh what is aboard by the last seconds of slow descent or hover; None where there were too few, or nothing was flown under the package."""
        if not self._slow or not self.gains or not self.package_kg > 0.0:
            return None
        seconds: dict[int, list[float]] = {}
        for time_s, units in self._slow:
            if time_s > self._slow[-1][0] - _SLOW_S:
                seconds.setdefault(int(time_s), []).append(units)
        if len(seconds) < _LEAST_S:
            return None
        ratio = median(fmean(found) for found in seconds.values()) / fmean(self.gains)
        mass = (self.drone_kg + self.package_kg) * ratio ** (1.0 / self.kappa)
        sigma = mass * _SLOW_SIGMA / self.kappa
        return Weight((mass - self.drone_kg) / self.package_kg, sigma / self.package_kg, len(seconds))

    def _units(self, lift: float, airspeed_mps: float, climb_mps: float) -> float:
        """Power by the model with the whole package, in units of that of hover without it."""
        load = lift * (self.drone_kg + self.package_kg) / self.drone_kg
        factor = 1.0 if self.load is None else float(self.load.factor(airspeed_mps))
        return float(load**self.kappa * factor + _CLIMB * max(climb_mps, 0.0) * load)

    def gain(self) -> tuple[float, float, int] | None:
        """Mean of power over the model since the take-off, its standard error (relative), and seconds; None for too few.

        The quarter of the seconds that is farthest from the median does not count: there the drone ends its climb, or meets a gust.
        """
        seconds = [sum(power for power, _ in pairs) / sum(units for _, units in pairs) for pairs in self._sums.values()]
        middle = median(seconds) if seconds else 0.0
        seconds = sorted(seconds, key=lambda one: abs(one - middle))[: math.ceil(_KEPT_SHARE * len(seconds))]
        if len(seconds) < _LEAST_S:
            return None
        mean = sum(seconds) / len(seconds)
        spread = math.sqrt(sum((one - mean) ** 2 for one in seconds) / (len(seconds) - 1)) / mean
        return mean, spread / math.sqrt(len(seconds) / 2.0), len(seconds)  # neighbours are not independent

    def keep(self) -> float | None:
        """Keep what this take-off shows as one under the whole package; returns it, W, or None for too little."""
        found = self.gain()
        if found is not None:
            self.gains.append(found[0])
        return None if found is None else found[0]

    def remember(self, gains: Iterable[float]) -> None:
        """Take what earlier take-offs under the package have shown."""
        self.gains.extend(gains)

    def weigh(self) -> Weight | None:
        """Weigh what is aboard since the take-off; None where nothing was flown under the package, or too little now."""
        found = self.gain()
        if found is None or not self.gains or not self.package_kg > 0.0:
            return None
        now, error, seconds = found
        before = sum(self.gains) / len(self.gains)
        ratio = now / before
        full = self.drone_kg + self.package_kg
        exponent = self._exponent()
        mass = full * ratio ** (1.0 / exponent)
        relative = math.hypot(error, MODEL_SIGMA, GAIN_SIGMA * math.sqrt(1.0 + 1.0 / len(self.gains)))
        sigma = mass * math.hypot(relative, 0.1 * (1.0 - ratio)) / exponent
        return Weight((mass - self.drone_kg) / self.package_kg, sigma / self.package_kg, seconds)

    def _exponent(self) -> float:
        """Exponent of mass in the power as it was flown: that of hover, and 1 for what climbing takes."""
        pairs = [one for pairs in self._sums.values() for one in pairs]
        total = sum(units for _, units in pairs)
        load = (self.drone_kg + self.package_kg) / self.drone_kg
        level = len(pairs) * load**self.kappa
        share = min(level / total, 1.0) if total > 0.0 else 1.0
        return share * self.kappa + (1.0 - share)

    def lost(self) -> float | None:
        """Return when the package left on the way, POSIX seconds: power fell at once, and stayed so; None where not."""
        return self._lost_s

    def _look(self) -> float | None:
        """Look for a fall of the power in the middle of the last seconds."""
        points = list(self._steady)
        if len(points) < 2 * STEP_S or not self.package_kg > 0.0:
            return None
        before, after = points[: STEP_S - 1], points[STEP_S + 1 :]
        clean = before[-SHORT_S:], after
        beside = before[-BESIDE_S:], after[:BESIDE_S]
        if self._fell(before, after, _STEADY_SHARE, (before, after)) or self._fell(*clean, _CLEAN_SHARE, beside):
            return points[STEP_S][0]
        return None

    def _fell(self, before: Points, after: Points, steady_share: float, alike: tuple[Points, Points]) -> bool:
        """Whether power fell between two stretches, each as steady as a share of the fall; in `alike` the drone flew alike before and after."""
        if after[-1][0] - before[0][0] > len(before) + len(after) + 2 + _STEP_WAIT_S:
            return False  # not one stretch of steady flight
        for column, most in ((_AIRSPEED, _SAME_AIRSPEED_MPS), (_CLIMB_RATE, _SAME_CLIMB_MPS)):
            found = [point[column] for some in alike for point in some]
            if max(found) - min(found) > most:
                return False
        speeds, leans = ([fmean(point[column] for point in some) for some in alike] for column in (_AIRSPEED, _LEAN))
        explained = max(_PER_RAD * (leans[0] - leans[1]), _PER_MPS * abs(speeds[1] - speeds[0]))
        old, new = (fmean(one for _, one, *_ in some) for some in (before, after))
        wanted = 1.0 - (self.drone_kg / (self.drone_kg + self.package_kg)) ** self.kappa
        fell = 1.0 - new / old
        told = wanted >= _LEAST_FALL and max(leans) < _STEEP_RAD and fell < _MOST_SHARE * wanted
        if not (told and fell - explained > _STEP_SHARE * wanted):
            return False
        spread = max(pstdev(one for _, one, *_ in some) for some in (before, after))
        return spread < steady_share * fell * old
