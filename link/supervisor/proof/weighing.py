"""Weighing in flight: the share of a package on board, from the power of the drone.

Power is compared with that of the same drone with its package, so that its own efficiency cancels: all flights so far, in stretches of similar airspeed and
climb (`stretches`), each relative to the model of `power_units`; `balance` estimates what the model leaves open. Airspeed is that of the drone's own lean: the estimated
wind is that of the cruise height, and is weaker near the ground.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from statistics import fmean
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.supervisor.proof.balance import Balance
from skyway.link.supervisor.proof.power_fall import PowerFall
from skyway.link.supervisor.proof.power_units import USUAL_KAPPA, PowerUnits
from skyway.link.supervisor.proof.stretches import Aboard, Second, Stretch, Stretches
from skyway.models.base.units import GRAVITY_MPS2

if TYPE_CHECKING:
    from collections.abc import Iterable

    from skyway.link.supervisor.proof.tilt_airspeed import TiltAirspeed
    from skyway.models.drones.airspeed_load import AirspeedLoad
    from skyway.models.drones.telemetry import TelemetrySample

BEGIN_S, END_S = 3.0, 18.0
"""Begin and end of the weighing, seconds after a take-off: power is uneven before, and a result is required within
20 s."""
_LEAST_S, _STEADY_MPS2, _SLOW_S, _IDLE_SHARE = 5, 0.7, 14.0, 0.4
"""Least number of seconds; greatest acceleration of a steady climb; time of slow descent or hover that is weighed before the release; and share
of the power so far below which motors idle."""
_KAPPA_SIGMA = 0.05
"""Standard deviation of the exponent of mass, relative."""
_BORROWED_S, _BORROWED_CLIMB_MPS = 1, 2.5
"""A take-off of which only the ratio to the model is known counts as this many seconds of such a climb."""
_CHANGE_SIGMAS, _CHANGE = 3.5, 0.5
"""A fall of more than the second share of the package's power, by the first number of standard deviations, at any
moment of the flights so far, is its loss."""


@dataclass(frozen=True, slots=True)
class Weight:
    """Share of the package on board."""

    share: float
    sigma: float
    """`share`, `sigma`: 1 is the whole package; and its standard deviation."""
    seconds: int
    """Number of seconds weighed."""
    since_s: float | None = None
    """Approximate time of a loss, POSIX seconds; None if there was none, or its time is unknown."""


@dataclass(slots=True)
class Scale:
    """One drone as its own scale."""

    drone_kg: float
    package_kg: float
    kappa: float = USUAL_KAPPA
    """Exponent of mass in the power of hover."""
    load: AirspeedLoad | None = None
    """Power over airspeed; None uses the power of hover."""
    tilt: TiltAirspeed | None = None
    """Airspeed from the lean; None uses that of the estimated wind."""
    took_off_s: float = math.nan
    _flown: Stretches = field(default_factory=Stretches)
    _may_be_empty: bool = False
    _was: TelemetrySample | None = None
    _newest_s: float = -math.inf
    _last_power: float = math.nan
    _second: list[tuple[float, ...]] = field(default_factory=list)
    """Samples of the present second: time, power, lift, airspeed by the wind, climb, lean, and velocity north and
    east."""
    _fall: PowerFall = field(default_factory=PowerFall)
    _model: PowerUnits = field(init=False)

    def __post_init__(self) -> None:
        self._model = PowerUnits(self.drone_kg, self.package_kg, self.kappa, self.load)

    def take_off(self, time_s: float) -> None:
        """Begin to weigh: the drone has taken off."""
        self._begin(time_s, Aboard.RELEASED if self._may_be_empty else Aboard.PACKAGE, taken_off=True)

    def leave(self, time_s: float, *, hovered: bool) -> None:
        """Begin to weigh: the drone leaves the place of the release; the end of its hover there is weighed, too, if it only hovered."""
        if hovered:
            self._flown.mark(self._flown.recent(_SLOW_S), Aboard.RELEASED)
        self._begin(time_s, Aboard.RELEASED, taken_off=False)

    def _begin(self, time_s: float, aboard: Aboard, *, taken_off: bool) -> None:
        self._flown.begin(aboard, taken_off=taken_off)
        self.took_off_s, self._was = time_s, None
        self._fall.clear()
        self._second.clear()

    def hear(self, s: TelemetrySample, wind: tuple[float, float]) -> None:
        """Take a sample in flight, and the estimated wind there, (north, east), m/s."""
        self._end_second(s)
        was, self._was = self._was, s
        if s.fixed_wing > 0.0 or s.fixed_wing < 0.0:
            return  # the model does not apply to wings and transition
        if was is None or not 0.0 < s.power_w < math.inf or not s.time_s > was.time_s:
            return
        rise = -(s.vel_down_mps - was.vel_down_mps) / (s.time_s - was.time_s)
        if not abs(rise) < _STEADY_MPS2 or s.power_w == self._last_power:
            return
        airspeed = math.hypot(s.vel_north_mps - wind[0], s.vel_east_mps - wind[1])
        lean = math.cos(s.roll_rad) * math.cos(s.pitch_rad)
        if not (math.isfinite(airspeed) and lean > 0.5):
            return
        self._last_power = s.power_w
        lift = (1.0 + rise / GRAVITY_MPS2) / lean
        velocity = s.vel_north_mps, s.vel_east_mps
        self._second.append((s.time_s, s.power_w, lift, airspeed, -s.vel_down_mps, math.acos(lean), *velocity))

    def _end_second(self, s: TelemetrySample) -> None:
        """End a second: take its means."""
        by_tilt = None if self.tilt is None else self.tilt.hear(s)
        if by_tilt is None and (self.tilt is not None or s.time_s < self._newest_s + 1.0):
            return
        self._newest_s = s.time_s
        if self._second:
            time_s, power_w, lift, airspeed, climb, lean, north, east = map(fmean, zip(*self._second, strict=True))
            if by_tilt is not None and math.isfinite(by_tilt):
                airspeed = by_tilt
            wanted = 1.0 - self._model.laden**-self.kappa
            units = self._model.units(lift, airspeed, climb)
            self._fall.hear((time_s, power_w / units, airspeed, lean, climb), wanted)
            if time_s >= self.took_off_s + BEGIN_S and not any(self._idle(one[1] / units) for one in self._second):
                model = self._model.of(lift, airspeed, climb)
                second = Second(
                    time_s, math.log(power_w) - model.log_units, *model[1:], airspeed, climb, math.hypot(north, east)
                )
                self._flown.hear(second, self._second[-1][6:8])  # type: ignore[arg-type]
        self._second.clear()

    def _idle(self, ratio: float) -> bool:
        """Whether the drone stands with idling motors: power far below that in flight."""
        closed = self._flown.closed
        return bool(closed) and ratio < _IDLE_SHARE * math.exp(fmean(one.mean.log_ratio for one in closed))

    def may_be_empty(self) -> None:
        """Record that the package may be off from now on."""
        self._may_be_empty = True
        self._flown.begin(Aboard.UNKNOWN, taken_off=False)

    def may_hang(self) -> None:
        """Stop weighing: until the drone departs it is unknown whether the package still hangs on it."""
        self._flown.begin(Aboard.UNKNOWN, taken_off=False)

    def before_release(self, lost_s: float | None = None) -> Weight | None:
        """Weigh the package on board by the last seconds of slow descent or hover; None after too few, or too little flight with the package.

        If power fell as if it were lost, at `lost_s` or at any moment that is now clear, the whole flight since then is weighed against that before.
        """
        last = self._flown.recent(_SLOW_S)
        place = [self._flown.closed[k] for k in last]
        known = self._of(Aboard.PACKAGE)
        self._flown.begin(Aboard.UNKNOWN, taken_off=False)
        since = (
            None if lost_s is None else self._compare(known, [one.begin_s + one.end_s > 2 * lost_s for one in known])
        )
        found = self._compare(known, [one in place for one in known])
        return since or (found and self._changed(known)) or found

    def _changed(self, known: list[Stretch]) -> Weight | None:
        """Weigh the package since its loss on the way; None if there was none."""
        drops, sigmas = Balance(known).drops(np.tri(len(known), dtype=bool)[:, 1:])
        first = int(np.argmax(drops / sigmas))
        if not (drops[first] > _CHANGE_SIGMAS * sigmas[first] and drops[first] > _CHANGE):
            return None
        found = self._weight(drops[first], sigmas[first], sum(one.seconds for one in known[first + 1 :]))
        return replace(found, since_s=known[first + 1].begin_s)

    def gain(self) -> float | None:
        """Return the mean of power over the model since the take-off, W; None for too few seconds."""
        self._flown.close()
        found = [one for one in self._flown.closed if one.begin_s > self.took_off_s]
        seconds = sum(one.seconds for one in found)
        if seconds < _LEAST_S:
            return None
        return math.exp(sum(one.seconds * one.mean.log_ratio for one in found) / seconds)

    def remember(self, gains: Iterable[float]) -> None:
        """Take the results of earlier take-offs with the package."""
        model = self._model.of(1.0, 0.0, _BORROWED_CLIMB_MPS)
        for gain in gains:
            mean = Second(-math.inf, math.log(gain), *model[1:], 0.0, _BORROWED_CLIMB_MPS, 0.0)
            self._flown.borrow(mean, _BORROWED_S)

    def weigh(self) -> Weight | None:
        """Weigh the package on board since the release; None without flight with the package, or too little since."""
        self._flown.close()
        known = self._of(Aboard.PACKAGE, Aboard.RELEASED)
        return self._compare(known, [one.aboard is Aboard.RELEASED for one in known])

    def _of(self, *aboard: Aboard) -> list[Stretch]:
        return [one for one in self._flown.closed if one.aboard in aboard]

    def _compare(self, known: list[Stretch], where: list[bool]) -> Weight | None:
        """Weigh the package in some stretches against all others."""
        seconds = sum(one.seconds for one, there in zip(known, where, strict=True) if there)
        if seconds < _LEAST_S or all(where) or not self.package_kg > 0.0:
            return None
        (drop,), (sigma,) = Balance(known).drops(np.array(where)[:, None])
        return self._weight(drop, sigma, seconds)

    def _weight(self, drop: float, sigma: float, seconds: int) -> Weight:
        sigma = math.hypot(sigma, _KAPPA_SIGMA * drop) * self._model.share_slope(drop)
        return Weight(self._model.share(float(drop)), float(sigma), seconds)

    def lost(self) -> float | None:
        """Return the time of a loss on the way, POSIX seconds: a sudden and lasting fall of the power; None if there was none."""
        return self._fall.at_s
