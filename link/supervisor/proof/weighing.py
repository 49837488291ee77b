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
from statistics import fmean, pstdev
from typing import TYPE_CHECKING

from skyway.models.base.units import GRAVITY_MPS2
from skyway.models.drones.airspeed_load import BLADE_SHARE, INDUCED_FACTOR, INFLOW_MPS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from skyway.models.drones.airspeed_load import AirspeedLoad
    from skyway.models.drones.telemetry import TelemetrySample

BEGIN_S, END_S = 3.0, 18.0
"""Seconds after a take-off that are weighed: power is uneven before, and within 20 s there is to be an answer."""
_LEAST_S = 6
_CLIMB = (1.0 - BLADE_SHARE) / (INDUCED_FACTOR * INFLOW_MPS)
_STEADY_MPS2, _DESCENT_MPS = 0.7, -0.4
_KAPPA = 1.6
GAIN_SIGMA, MODEL_SIGMA = 0.012, 0.012
"""Standard deviations of power, relative: between two take-offs of one drone, and of the model over them."""
STEP_S = 8
"""Seconds before and after a moment that are compared for a package that is lost on the way."""
SHORT_S, BESIDE_S, _CLEAN_SHARE = 4, 3, 0.1
"""A fall between stretches that are as steady as this share of it is one though the wind drifts: then so many seconds before it will do, and the drone
flies alike only in so many on either side."""
_STEP_SHARE, _STEADY_SHARE, _STEP_WAIT_S = 0.6, 0.3, 4.0
_SAME_LEAN_RAD = 0.01
"""A drone that has lost its package leans as before or more; one that leans less has less drag: a gust from behind takes power away, too."""
_SAME_AIRSPEED_MPS = 1.5
"""Airspeeds further apart are not compared: braking and hastening change the power by more than a package, and the model knows it too roughly."""

Points = list[tuple[float, float, float, float]]
"""Time, power in units of the model, airspeed and lean, a second apart."""


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
    kappa: float = _KAPPA
    """Exponent of mass in the power of hover."""
    load: AirspeedLoad | None = None
    """Power over airspeed; None takes the power of hover."""
    gains: list[float] = field(default_factory=list)
    """Power in units of the model, W, of each take-off under the package."""
    took_off_s: float = math.nan
    _sums: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    _was: TelemetrySample | None = None
    _newest_s: float = -math.inf
    _steady: deque[tuple[float, float, float, float]] = field(default_factory=lambda: deque(maxlen=2 * STEP_S))

    def take_off(self, time_s: float) -> None:
        """Begin to weigh: it has left the ground."""
        self.took_off_s, self._was = time_s, None
        self._sums.clear()
        self._steady.clear()

    def hear(self, s: TelemetrySample, wind: tuple[float, float]) -> None:
        """Take a sample in flight, and the wind there, (north, east), m/s."""
        was, self._was = self._was, s
        if was is None or not math.isfinite(s.power_w) or not s.time_s > was.time_s:
            return
        rise = -(s.vel_down_mps - was.vel_down_mps) / (s.time_s - was.time_s)
        climb = -s.vel_down_mps
        if not abs(rise) < _STEADY_MPS2 or not climb > _DESCENT_MPS or s.power_w == self._last_power:
            return
        airspeed = math.hypot(s.vel_north_mps - wind[0], s.vel_east_mps - wind[1])
        lean = math.cos(s.roll_rad) * math.cos(s.pitch_rad)
        if not (math.isfinite(airspeed) and lean > 0.5):
            return
        self._last_power = s.power_w
        lift = (1.0 + rise / GRAVITY_MPS2) / lean
        after_s = s.time_s - self.took_off_s
        if BEGIN_S <= after_s <= END_S:
            self._sums.setdefault(int(after_s), []).append((s.power_w, self._units(lift, airspeed, climb)))
        if s.time_s >= self._newest_s + 1.0 and abs(climb) < 0.5:
            self._newest_s = s.time_s
            self._steady.append((s.time_s, s.power_w / self._units(lift, airspeed, climb), airspeed, math.acos(lean)))

    _last_power: float = math.nan

    def _units(self, lift: float, airspeed_mps: float, climb_mps: float) -> float:
        """Power by the model with the whole package, in units of that of hover without it."""
        load = lift * (self.drone_kg + self.package_kg) / self.drone_kg
        factor = 1.0 if self.load is None else float(self.load.factor(airspeed_mps))
        return float(load**self.kappa * factor + _CLIMB * max(climb_mps, 0.0) * load)

    def gain(self) -> tuple[float, float, int] | None:
        """Mean of power over the model since the take-off, its standard error (relative), and seconds; None for too few."""
        seconds = [sum(power for power, _ in pairs) / sum(units for _, units in pairs) for pairs in self._sums.values()]
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
        """Return when the package left in level flight, POSIX seconds: power fell at once, and stayed so; None where not."""
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
            return False  # not one stretch of level flight
        airspeeds = [airspeed for some in alike for _, _, airspeed, _ in some]
        if max(airspeeds) - min(airspeeds) > _SAME_AIRSPEED_MPS:
            return False
        leans = [fmean(lean for *_, lean in some) for some in alike]
        if leans[1] < leans[0] - _SAME_LEAN_RAD:
            return False
        old, new = (fmean(one for _, one, _, _ in some) for some in (before, after))
        spread = max(pstdev(one for _, one, _, _ in some) for some in (before, after))
        wanted = 1.0 - (self.drone_kg / (self.drone_kg + self.package_kg)) ** self.kappa
        fell = 1.0 - new / old
        return fell > _STEP_SHARE * wanted and spread < steady_share * fell * old
