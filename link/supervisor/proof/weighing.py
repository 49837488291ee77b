"""Weighing in flight: how much of a package is aboard, by the power that the drone draws.

Power is compared with that of the same drone under its package, so that its own efficiency cancels. With thrust T = m (g + a) / cos(lean),
airspeed V and climb v the model is

    P = k ((T / W)^kappa F(V) + c max(v, 0) T / W)

where W is the drone's weight without a package, kappa and the power of hover are those of its energy model, F is momentum theory in forward
flight (`models.drones.airspeed_load`) and c what a metre a second of climb takes. Flights under the package give k, and how much F and c are those of this
drone (`own_power`); then power gives m. A drone that hovers before and after the release is weighed by that as well.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from statistics import fmean, median, stdev
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.supervisor.proof.own_power import OwnPower, Terms
from skyway.link.supervisor.proof.power_fall import PowerFall
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
_KAPPA_SIGMA = 0.05
"""Standard deviation of the exponent of mass, relative."""
_SLOW_CLIMB_MPS, _SLOW_MPS, _SLOW_S, _SLOW_SIGMA, _IDLE_SHARE = 1.0, 2.0, 14.0, 0.035, 0.4
_HOVER_SIGMA = 0.012
"""What it weighs before the release: by the last seconds of slow descent, or hover; there power knows the mass to so much, relative. It is idle below that share.
And between two hovers over one place, minutes apart."""

_Flown = tuple[float, float, Terms, float, float]
"""Time, power, its terms by the model, airspeed and climb."""


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
    _own: OwnPower = field(default_factory=OwnPower)
    _learns: bool = True
    _hung: float = math.nan
    """Power before the release, in units of hover."""
    _hovered: Weight | None = None
    _seconds: dict[int, list[_Flown]] = field(default_factory=dict)
    """What is weighed since the take-off, by the second."""
    _was: TelemetrySample | None = None
    _newest_s: float = -math.inf
    _second: list[tuple[float, float, float, float, float, float]] = field(default_factory=list)
    """Of the second under way: time, power, lift, airspeed by the wind, climb and lean."""
    _fall: PowerFall = field(default_factory=PowerFall)

    def take_off(self, time_s: float) -> None:
        """Begin to weigh: it has left the ground."""
        self.took_off_s, self._was = time_s, None
        self._seconds.clear()
        self._fall.clear()
        self._second.clear()
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
        if climb > _DESCENT_MPS and after_s >= BEGIN_S:
            flown = (s.time_s, s.power_w, self._terms(lift, airspeed, climb), airspeed, climb)
            if after_s <= END_S:
                self._seconds.setdefault(int(after_s), []).append(flown)
            else:
                self._learn(flown)
        self._second.append((s.time_s, s.power_w, lift, airspeed, climb, math.acos(lean)))

    def _learn(self, flown: _Flown) -> None:
        """Learn what this drone draws under its package."""
        time_s, power_w, terms, airspeed, climb = flown
        if self._learns and self.gains and power_w > _IDLE_SHARE * fmean(self.gains) * sum(terms):
            self._own.hear(time_s, power_w, terms, (airspeed, climb))

    def may_be_empty(self) -> None:
        """From now on the package may be off: nothing more is learnt of the drone under it."""
        self._learns = False

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
            wanted = 1.0 - (self.drone_kg / (self.drone_kg + self.package_kg)) ** self.kappa
            self._fall.hear((time_s, power_w / self._units(lift, airspeed, climb), airspeed, lean, climb), wanted)
        self._second.clear()

    _last_power: float = math.nan
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
        seconds, units = self._slow_units()
        if seconds < _LEAST_S:
            return None
        self._hung = units
        return self._weight(units / fmean(self.gains), self.kappa, _SLOW_SIGMA, seconds)

    def hovered(self) -> None:
        """It leaves the place over which it has hovered since the package was weighed before its release: that hover weighs it, too."""
        seconds, units = self._slow_units()
        if seconds >= _LEAST_S and math.isfinite(self._hung):
            self._hovered = self._weight(units / self._hung, self.kappa, _HOVER_SIGMA, seconds)

    def _slow_units(self) -> tuple[int, float]:
        """So many of the last seconds were slow descent or hover, and their power, in units of hover."""
        seconds: dict[int, list[float]] = {}
        for time_s, units in self._slow:
            if time_s > self._slow[-1][0] - _SLOW_S:
                seconds.setdefault(int(time_s), []).append(units)
        return len(seconds), median(fmean(found) for found in seconds.values()) if seconds else math.nan

    def _weight(self, ratio: float, exponent: float, relative: float, seconds: int) -> Weight:
        """What is aboard where so much of the power under the package is drawn, known to so much."""
        mass = (self.drone_kg + self.package_kg) * ratio ** (1.0 / exponent)
        sigma = mass * math.hypot(relative, _KAPPA_SIGMA * (1.0 - ratio)) / exponent
        return Weight((mass - self.drone_kg) / self.package_kg, sigma / self.package_kg, seconds)

    def _units(self, lift: float, airspeed_mps: float, climb_mps: float) -> float:
        """Power by the model with the whole package, in units of that of hover without it."""
        return sum(self._terms(lift, airspeed_mps, climb_mps))

    def _terms(self, lift: float, airspeed_mps: float, climb_mps: float) -> Terms:
        """What hover, airspeed and climb take with the whole package, in units of hover without it."""
        load = lift * (self.drone_kg + self.package_kg) / self.drone_kg
        level = load**self.kappa
        factor = 1.0 if self.load is None else float(self.load.factor(airspeed_mps))
        return level, level * (factor - 1.0), _CLIMB * max(climb_mps, 0.0) * load

    def gain(self) -> float | None:
        """Mean of power over the model since the take-off, W; None for too few seconds."""
        shares = [sum(one[1] for one in flown) / sum(sum(one[2]) for one in flown) for flown in self._seconds.values()]
        return fmean(_middle(shares)) if len(_middle(shares)) >= _LEAST_S else None

    def keep(self) -> float | None:
        """Keep what this take-off shows as one under the whole package; returns it, W, or None for too little."""
        found = self.gain()
        if found is not None:
            self.gains.append(found)
            for second in self._seconds.values():
                for flown in second:
                    self._learn(flown)
        return found

    def remember(self, gains: Iterable[float]) -> None:
        """Take what earlier take-offs under the package have shown."""
        self.gains.extend(gains)

    def weigh(self) -> Weight | None:
        """Weigh what is aboard since the take-off, and by the hover before it; None where nothing was flown under the package, or too little now."""
        known = [one for one in (self._risen(), self._hovered) if one is not None]
        return _together(known) if known and self.package_kg > 0.0 else None

    def _risen(self) -> Weight | None:
        """Weigh what is aboard by the power since the take-off."""
        own = self._own.fit(self.gains)
        if own is None or not self.package_kg > 0.0:
            return None
        powers = np.array([fmean(one[1] for one in flown) for flown in self._seconds.values()])
        terms = np.array([np.mean([one[2] for one in flown], axis=0) for flown in self._seconds.values()])
        shares = powers / own.expected_w(terms) if len(powers) else powers
        kept = _middle(shares.tolist())
        if len(kept) < _LEAST_S:
            return None
        ratio = fmean(kept)
        spread = stdev(kept) / ratio / math.sqrt(len(kept) / 2.0)  # neighbours are not independent
        relative = math.hypot(own.error(terms), spread, GAIN_SIGMA, MODEL_SIGMA)
        return self._weight(ratio, self._exponent(), relative, len(kept))

    def _exponent(self) -> float:
        """Exponent of mass in the power as it was flown: that of hover, and 1 for what climbing takes."""
        flown = [one for second in self._seconds.values() for one in second]
        total = sum(sum(one[2]) for one in flown)
        load = (self.drone_kg + self.package_kg) / self.drone_kg
        level = len(flown) * load**self.kappa
        share = min(level / total, 1.0) if total > 0.0 else 1.0
        return share * self.kappa + (1.0 - share)

    def lost(self) -> float | None:
        """Return when the package left on the way, POSIX seconds: power fell at once, and stayed so; None where not."""
        return self._fall.at_s


def _middle(shares: list[float]) -> list[float]:
    """Leave out the quarter of the seconds that is farthest from the median: there the drone ends its climb, or meets a gust."""
    middle = median(shares) if shares else 0.0
    return sorted(shares, key=lambda one: abs(one - middle))[: math.ceil(_KEPT_SHARE * len(shares))]


def _together(known: list[Weight]) -> Weight:
    """One weight of several; known less well where they disagree."""
    precision = [one.sigma**-2 for one in known]
    share = sum(p * one.share for p, one in zip(precision, known, strict=True)) / sum(precision)
    apart = math.sqrt(fmean(((one.share - share) / one.sigma) ** 2 for one in known))
    return Weight(share, max(apart, 1.0) / math.sqrt(sum(precision)), sum(one.seconds for one in known))
