"""Uncounted losses of charge: an autopilot that counts the current does not see a failing pack.

The voltage shows it. Its sag under current is subtracted, with the resistance from the step at the take-off; if the rest falls by
more in half a minute than in any flight, the charge is read from a discharge curve of lithium-polymer cells that
is fitted to the state before the fall. Such a curve is flat in its middle: its result is accurate to a tenth or two, and
serves one purpose, to land while there is charge.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from itertools import takewhile
from statistics import median, quantiles
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterable

_SOC = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_CELL_V = (3.20, 3.56, 3.655, 3.71, 3.75, 3.785, 3.83, 3.87, 3.94, 4.02, 4.12, 4.25)
"""Open-circuit voltage of a cell: midway between charts of common (4.20 V) and high-voltage (4.35 V)
lithium-polymer cells."""
FALL = 0.025
"""A voltage that falls by this share within `BACK_S`, and stays there for `NOW_S`, indicates lost charge."""
NOW_S, BACK_S = 4.0, 90.0
"""Compared are medians of the last seconds, and of as many from at most this time before, s."""
MIN_LOST_SOC = 0.1
"""A smaller loss is not distinguished from a gust, or from a cold battery."""
NOTICED_SOC = 0.05
REST_A, FLIGHT_A = 5.0, 10.0
SURE = 16
"""Number of measurements, at two per second, that decide whether the power fell with the voltage."""
DOUBTED_S = 130.0
"""A voltage that stays low for longer is no burst of wrong values, s."""
WITNESS_S, AFTER_S = 30.0, 60.0
"""Time after a fall within which the power is compared, s, since later it differs for other reasons; and duration
of the measurements that are kept, s."""
HALF, TOO_MUCH = 0.5, 1.5
"""Ratios of the fall of power to that of the voltage: below the first, power was not measured with it; above the
second, it changed for another reason."""
SIGMAS = 1.5
"""Number of standard deviations by which a ratio must differ from `HALF` to be significant."""
POWER_ERROR, LOAD_ERROR, YOUNG_ERROR = 0.03, 0.4, 0.05
"""Relative error of a power compared with an earlier one: always; per change of the load; with few earlier values."""
SAME_GUST = 0.5
"""Share of the spread by gusts that remains in a median over half a minute."""
AGAIN, AGAIN_S = 6, 300.0
"""A loss is undone if this number of successive voltages, within this time after it, s, are as before. A fall within this time after a rise in flight,
to no less than before that rise, is none."""
FALLS_ON, FALLS_ON_BLIND, CURVE_ERROR = 0.006, 0.018, 0.35
"""Excess fall of the voltage against a sound battery that indicates a nearly empty one; the same with unknown resistance; and relative error of
the explanation by charge used and change of the sag."""
FALLS_ON_S, SURE_NOW, STEADY = 8.0, 8, 0.015
"""Earliest decision after a loss, s; number of voltages; and their greatest spread."""
REST_S = 180.0
"""Greatest age of a voltage at rest that still gives the resistance, s."""
MAX_SAG = 0.15
"""Share of the voltage: a greater sag is a measurement error at rest or after."""
RAW_SHARE = 0.4
"""Share of a fall that must be seen before the sag is subtracted: otherwise the current was wrong."""


def open_voltage(soc: float) -> float:
    """Return the voltage of a cell without load at a state of charge."""
    return float(np.interp(soc, _SOC, _CELL_V))


def soc_of(cell_v: float) -> float:
    """Return the state of charge of a cell with an open-circuit voltage."""
    return float(np.interp(cell_v, _CELL_V, _SOC))


class _Measurement(NamedTuple):
    """One measurement in flight."""

    time_s: float
    volts: float
    """Without the sag."""
    raw_v: float
    """As measured."""
    reported: float
    """State of charge reported by the vehicle."""
    watts: float
    """Power."""
    load: float
    """Power of this airspeed and climb relative to hover, NaN if unknown."""
    sag_v: float
    """Subtracted sag."""


def _power(measurements: Iterable[_Measurement]) -> tuple[float, float, float] | None:
    """Median of power over its load, its spread as a share (between quartiles), and the median load; None for too few."""
    known = [one for one in measurements if math.isfinite(one.watts) and one.load > 0.0]
    if len(known) < AGAIN:
        return None
    low, middle, high = quantiles([one.watts / one.load for one in known], n=4)
    young = YOUNG_ERROR if len(known) < SURE else 0.0
    return middle, (high - low) / middle + young / SAME_GUST, median(one.load for one in known)


@dataclass(slots=True)
class _Fall:
    """A loss found, and voltage and power since."""

    lost: float
    reported: float
    """`lost`, `reported`: charge lost, and the vehicle's report before."""
    found_s: float
    """Time of detection."""
    volts: float
    """The voltage before."""
    before: tuple[float, float, float] | None
    """Power before, as returned by `_power`."""
    after: deque[_Measurement]
    """Measurements since."""
    mismeasured: bool = False
    """In the first half minute the power fell with the voltage: motors that carry a vehicle draw more current from a
    weaker battery."""

    def hear(self, one: _Measurement) -> None:
        """Take a measurement, and compare the power once there are enough."""
        self.after.append(one)
        if not self.mismeasured and len(self.after) >= SURE and one.time_s < self.found_s + WITNESS_S:
            self.mismeasured = self.power_fell(list(self.after))

    def power_fell(self, after: list[_Measurement]) -> bool:
        """Whether the power, relative to its load, clearly fell with the voltage; False if it cannot be compared."""
        now = _power(after)
        fell = 1.0 - median(one.volts for one in after) / self.volts
        if now is None or self.before is None or not fell > 0.0:
            return False
        watts, spread, load = now
        watts_before, spread_before, load_before = self.before
        other = LOAD_ERROR * abs(load / load_before - 1.0)
        error = SIGMAS * math.hypot(POWER_ERROR + other, SAME_GUST * spread, SAME_GUST * spread_before) / fell
        share = (1.0 - watts / watts_before) / fell
        return share - error > HALF and share < TOO_MUCH

    def sound(self, volts: float, reported: float) -> float:
        """Return the present voltage of a sound battery that had `volts` when this loss was found."""
        return volts * open_voltage(reported) / open_voltage(self.reported)

    def falls_on(self, *, blind: bool) -> bool:
        """Whether the voltage keeps falling like that of a nearly empty battery, unlike under a measurement error.

        A voltage that continues to fall together with the measured power is a growing measurement error.
        """
        measurements = list(self.after)
        then, now = measurements[:SURE_NOW], measurements[-SURE_NOW:]
        volts, before = median(one.volts for one in now), median(one.volts for one in then)
        if now[-1].time_s < self.found_s + FALLS_ON_S or max(one.volts for one in now) - volts > STEADY * before:
            return False
        sag = abs(median(one.sag_v for one in now) - median(one.sag_v for one in then)) / before
        usual = open_voltage(now[-1].reported) / open_voltage(then[0].reported)
        least = (FALLS_ON_BLIND if blind else FALLS_ON) + CURVE_ERROR * (1.0 - usual + sag)
        if not volts < before * usual * (1.0 - least):
            return False
        return not (self.mismeasured and self.power_fell(measurements[-SURE:]))


class _Rise(NamedTuple):
    """A rise of the voltage in flight, impossible for a battery: a measurement error, then or before."""

    found_s: float
    volts: float
    """The voltage before."""
    reported: float
    """State of charge reported by the vehicle before."""


@dataclass(slots=True)
class VoltageWatch:
    """Watches one vehicle's voltage."""

    lost: float = 0.0
    """Charge that was lost and that the vehicle does not count."""
    ohm: float = 0.0
    """Resistance of the battery, from the last take-off; 0 until then."""
    _rest: tuple[float, float, float] = (-math.inf, 0.0, 0.0)
    _seen: deque[_Measurement] = field(default_factory=deque)
    _received_s: float = -math.inf
    _falls: list[_Fall] = field(default_factory=list)
    _rise: _Rise | None = None

    def hear(
        self,
        time_s: float,
        volts: float,
        amperes: float,
        reported_soc: float,
        *,
        load: float = 1.0,
        flies: bool = False,
    ) -> float:
        """Take the vehicle's report; return the newly found loss of charge, usually 0; negative if a loss is undone.

        `load` is the power at the present airspeed and climb over that of hover, NaN if unknown. `flies`: the vehicle
        is known to be in the air, whatever the current.
        """
        if not all(map(math.isfinite, (volts, amperes, reported_soc))) or time_s < self._received_s + 0.5:
            return 0.0
        self._received_s = time_s
        if amperes < FLIGHT_A:
            if not flies:
                self._seen.clear()  # on the ground: not comparable with flight
                self._rise = None
            if amperes < REST_A and not flies:
                self._rest = (time_s, volts, amperes)
            return 0.0
        rest_s, rest_v, rest_a = self._rest
        if not self._seen and time_s < rest_s + REST_S:
            sag_v = max(rest_v - volts, 0.0)
            self.ohm = sag_v / (amperes - rest_a) if sag_v < MAX_SAG * rest_v else 0.0
            self._rest = (-math.inf, 0.0, 0.0)
        if self._seen and reported_soc < self._seen[-1].reported - NOTICED_SOC:
            self._seen.clear()  # the vehicle has noticed it itself
        one = _Measurement(
            time_s, volts + amperes * self.ohm, volts, reported_soc, volts * amperes, load, amperes * self.ohm
        )
        self._seen.append(one)
        while self._seen[0].time_s < time_s - BACK_S:
            self._seen.popleft()
        for fall in self._falls:
            fall.hear(one)
        return self._again(time_s) or self._fallen(time_s)

    def _again(self, time_s: float) -> float:
        """Undo losses whose voltage has come back: a battery does not recover."""
        for number, fall in enumerate(self._falls):
            now = [one.volts for one in list(fall.after)[-AGAIN:]]
            if len(now) < AGAIN or time_s > fall.found_s + AGAIN_S:
                continue
            if median(now) >= fall.sound(fall.volts, self._seen[-1].reported) * (1.0 - 0.5 * FALL):
                back = min(sum(one.lost for one in self._falls[number:]), self.lost)
                self.lost -= back
                del self._falls[number:]
                self._seen.clear()
                return -back
        return 0.0

    def doubtful(self, *, affordable: bool = True) -> bool:
        """Whether only a momentary voltage indicates lost charge.

        The voltage of a battery that has lost charge continues to fall faster than a sound one's, as near empty. A voltage
        that stays low for longer than any burst of wrong values is accepted without that if there is no time to wait:
        if the charge after the loss is not `affordable`, not sufficient for more than a landing.
        """
        blind = self.ohm == 0.0
        late_s = -math.inf if affordable else self._received_s - DOUBTED_S
        believed = [(one.found_s <= late_s and not one.mismeasured) or one.falls_on(blind=blind) for one in self._falls]
        return bool(self._falls) and not any(believed)

    def _fallen(self, time_s: float) -> float:
        new = [*takewhile(lambda one: one.time_s > time_s - NOW_S, reversed(self._seen))][::-1]
        old = [*takewhile(lambda one: one.time_s <= self._seen[0].time_s + NOW_S, self._seen)]
        if len(new) < 3 or len(old) < 3 or new[0].time_s <= old[-1].time_s:
            return 0.0
        before, now = median(one.volts for one in old), median(one.volts for one in new)
        noted = self._rise is not None and time_s <= self._rise.found_s + AGAIN_S
        if now > before * (1.0 + FALL) and self.ohm > 0.0 and not noted and not self._falls:
            self._rise = _Rise(time_s, before, old[-1].reported)
        fell_v = before - now
        if max(one.volts for one in new) > before * (1.0 - FALL):
            return 0.0
        if median(one.raw_v for one in old) - median(one.raw_v for one in new) < RAW_SHARE * fell_v:
            return 0.0
        if self._fell_back(now, new[-1].reported):
            self._seen = deque(new)
            return 0.0
        believed = max(old[-1].reported - self.lost, 0.02)
        found = soc_of(now * open_voltage(believed) / before)
        lost = new[-1].reported - self.lost - found
        if lost < MIN_LOST_SOC:
            return 0.0
        self.lost += lost
        earlier = [one for one in self._seen if one not in new and one.volts > before - 0.5 * fell_v]
        after = deque(new, maxlen=int(2.0 * AFTER_S))
        self._falls.append(_Fall(lost, old[-1].reported, time_s, before, _power(earlier), after))
        self._seen.clear()
        return lost

    def _fell_back(self, volts: float, reported: float) -> bool:
        """Whether a voltage is no lower than a sound battery's after a wrong measurement that was too high."""
        rise, self._rise = self._rise, None
        if rise is None or self._received_s > rise.found_s + AGAIN_S:
            return False
        return volts >= rise.volts * open_voltage(reported) / open_voltage(rise.reported) * (1.0 - 0.5 * FALL)

    def restore(self, lost: float) -> None:
        """Restore the losses found before the program restarted."""
        self.lost = lost

    def forget(self) -> None:
        """Reset: the battery was measured, or replaced."""
        self.lost = 0.0
        self._rise = None
        self._falls.clear()
        self._seen.clear()
