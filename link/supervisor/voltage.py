"""Charge that is lost without being counted: an autopilot that counts what flows out does not see a pack that fails.

The voltage does. What the current lets it sag is taken off, the step at the take-off tells how much that is; when the rest falls by
more in half a minute than any flight takes out of a battery, the charge is read from a discharge curve of lithium-polymer cells that
is laid through what was known before the fall. Such a curve is flat in its middle: what it says is good to a tenth or two, and
is meant to be used for one thing, to land while there is charge.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from enum import StrEnum
from statistics import median, quantiles

_SOC = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
_CELL_V = (3.20, 3.56, 3.655, 3.71, 3.75, 3.785, 3.83, 3.87, 3.94, 4.02, 4.12, 4.25)
"""Open voltage of a cell: midway between charts of common (4.20 V) and high-voltage (4.35 V) lithium-polymer cells."""
FALL = 0.025
"""A voltage that falls by this share within `BACK_S`, and stays there for `NOW_S`, has lost charge."""
NOW_S, BACK_S = 4.0, 30.0
"""What is compared: medians of the last seconds, and of as many from so long ago at most."""
LEAST_LOST_SOC = 0.1
"""Less is not told apart from a gust, or from a cold battery."""
NOTICED_SOC = 0.05
REST_A, FLIGHT_A = 5.0, 10.0
SURE, DOUBTED_S = 16, 130.0
"""So many measurements, two a second, tell whether the power fell with the voltage; so long a loss is doubted for that."""
HALF, TOO_MUCH = 0.5, 1.5
"""Shares of the voltage's fall: a power that fell by less was not measured with it, one that fell by more changed for another reason."""
AGAIN, AGAIN_S = 6, 300.0
"""A loss is taken back where so many voltages in a row, so long after it at most, are as before."""
REST_S = 180.0
"""A voltage at rest so long ago still tells what the current lets it sag."""


def open_voltage(soc: float) -> float:
    """Voltage of a cell without load at a state of charge."""
    return _between(soc, _SOC, _CELL_V)


def soc_of(cell_v: float) -> float:
    """State of charge of a cell with some voltage without load."""
    return _between(cell_v, _CELL_V, _SOC)


def _between(value: float, given: tuple[float, ...], wanted: tuple[float, ...]) -> float:
    for k in range(1, len(given)):
        if value <= given[k] or k == len(given) - 1:
            share = min(max((value - given[k - 1]) / (given[k] - given[k - 1]), 0.0), 1.0)
            return wanted[k - 1] + share * (wanted[k] - wanted[k - 1])
    return wanted[-1]


class Witness(StrEnum):
    """What the power says of a voltage that fell: motors that carry a vehicle draw more current from a weaker battery."""

    AWAITED = "awaited"
    LOST = "lost"
    UNCLEAR = "unclear"
    MISMEASURED = "mismeasured"


@dataclass(slots=True)
class _Fall:
    """A loss found, and what became of voltage and power since.

    Attributes
    ----------
    lost, told : float
        Charge, and what the vehicle said of it then.
    volts, watts : float
        When, and what was there before.
    spread : float
        By what share of itself the power varied before: between its quartiles.
    after : deque of (volts, watts)
        Since then.
    second : bool
        A loss was certain before: a battery that has failed is not doubted when it fails again.
    witness : Witness
        Told by the first `SURE` measurements, before a turn to another station changes the power.
    fell_to : float
        What the voltage was in them.
    """

    lost: float
    told: float
    found_s: float
    volts: float
    watts: float
    spread: float
    after: deque[tuple[float, float]]
    second: bool
    witness: Witness = Witness.AWAITED
    fell_to: float = math.nan

    def compare(self) -> None:
        """Ask the power, once there are measurements enough."""
        if self.witness is not Witness.AWAITED or len(self.after) < SURE:
            return
        self.fell_to = median(volts for volts, _ in self.after)
        watts = [watts for _, watts in self.after if math.isfinite(watts)]
        if len(watts) < SURE or not math.isfinite(self.watts):
            self.witness = Witness.LOST
            return
        fell = 1.0 - self.fell_to / self.volts
        share = (1.0 - median(watts) / self.watts) / fell
        if share < HALF:
            self.witness = Witness.LOST
        elif share < TOO_MUCH and max(self.spread, _spread(watts)) < fell:
            self.witness = Witness.MISMEASURED
        else:
            self.witness = Witness.UNCLEAR


def _spread(values: list[float]) -> float:
    low, middle, high = quantiles(values, n=4)
    return (high - low) / middle


@dataclass(slots=True)
class VoltageWatch:
    """Watches one vehicle's voltage.

    Attributes
    ----------
    lost : float
        Charge that was lost and that the vehicle does not count.
    ohm : float
        Resistance of the battery, as the last take-off showed it; 0 until then.
    """

    lost: float = 0.0
    ohm: float = 0.0
    _rest: tuple[float, float, float] = (-math.inf, 0.0, 0.0)
    _seen: deque[tuple[float, float, float, float]] = field(default_factory=deque)
    _heard_s: float = -math.inf
    _fall: _Fall | None = None

    def hear(self, time_s: float, volts: float, amperes: float, told_soc: float, *, level: bool = True) -> float:
        """Take what the vehicle tells; returns charge found lost just now, usually 0; less than 0 where it is there again."""
        if not all(map(math.isfinite, (volts, amperes, told_soc))) or time_s < self._heard_s + 0.5:
            return 0.0
        self._heard_s = time_s
        if amperes < FLIGHT_A:
            self._seen.clear()  # on the ground, or landing: nothing that is compared with flight
            if amperes < REST_A:
                self._rest = (time_s, volts, amperes)
            return 0.0
        rest_s, rest_v, rest_a = self._rest
        if not self._seen and time_s < rest_s + REST_S:
            self.ohm = max(rest_v - volts, 0.0) / (amperes - rest_a)
            self._rest = (-math.inf, 0.0, 0.0)
        if self._seen and told_soc < self._seen[-1][2] - NOTICED_SOC:
            self._seen.clear()  # the vehicle has noticed it itself
        self._seen.append((time_s, volts + amperes * self.ohm, told_soc, volts * amperes if level else math.nan))
        while self._seen[0][0] < time_s - BACK_S:
            self._seen.popleft()
        return self._again(time_s) or self._fallen(time_s)

    def _again(self, time_s: float) -> float:
        """Take a loss back whose voltage is there again: a battery does not mend."""
        fall = self._fall
        if fall is None:
            return 0.0
        fall.after.append((self._seen[-1][1], self._seen[-1][3]))
        fall.compare()
        now = [volts for volts, _ in list(fall.after)[-AGAIN:]]
        if len(now) < AGAIN or time_s > fall.found_s + AGAIN_S:
            return 0.0
        sound = fall.volts * open_voltage(self._seen[-1][2]) / open_voltage(fall.told)
        if median(now) < sound * (1.0 - 0.5 * FALL):
            return 0.0
        back = min(fall.lost, self.lost)
        self.lost, self._fall = self.lost - back, None
        self._seen.clear()
        return -back

    def doubtful(self, *, affordable: bool = True) -> bool:
        """Whether it may be the measurement that fell; true also until that can be told.

        Parameters
        ----------
        affordable : bool
            If the loss is true, there is still charge for more than the landing. Where there is not, only a power that clearly
            fell with the voltage is a reason to doubt.
        """
        fall = self._fall
        if fall is None or fall.second or self._heard_s >= fall.found_s + DOUBTED_S or self._falls_on(fall):
            return False
        return fall.witness in (Witness.AWAITED, Witness.MISMEASURED) or (
            fall.witness is Witness.UNCLEAR and affordable
        )

    def _falls_on(self, fall: _Fall) -> bool:
        """Whether the voltage goes on falling as that of a battery that is nearly empty, which an error of measurement does not."""
        if not (self.ohm > 0.0 and self._seen and math.isfinite(fall.fell_to)):
            return False
        now = median([volts for volts, _ in fall.after][-AGAIN:])
        sound = fall.fell_to * open_voltage(self._seen[-1][2]) / open_voltage(fall.told)
        return now < sound * (1.0 - 0.5 * FALL)

    def _fallen(self, time_s: float) -> float:
        new = [one for one in self._seen if one[0] > time_s - NOW_S]
        old = [one for one in self._seen if one[0] <= self._seen[0][0] + NOW_S]
        if len(new) < 3 or len(old) < 3 or new[0][0] <= old[-1][0]:
            return 0.0
        before, now = median(one[1] for one in old), median(one[1] for one in new)
        if max(one[1] for one in new) > before * (1.0 - FALL):
            return 0.0
        believed = max(old[-1][2] - self.lost, 0.02)
        found = soc_of(now * open_voltage(believed) / before)
        lost = new[-1][2] - self.lost - found
        if lost < LEAST_LOST_SOC:
            return 0.0
        self.lost += lost
        level = [one[3] for one in self._seen if one not in new and math.isfinite(one[3])]
        watts = median(level) if len(level) >= SURE else math.nan
        spread = _spread(level) if len(level) >= SURE else math.nan
        after = deque(((one[1], one[3]) for one in new), maxlen=int(2.0 * BACK_S))
        second = self._fall is not None and (self._fall.second or self._fall.witness is Witness.LOST)
        self._fall = _Fall(lost, old[-1][2], time_s, before, watts, spread, after, second)
        self._seen.clear()
        return lost

    def forget(self) -> None:
        """Begin anew: the battery was measured, or another one put in."""
        self.lost, self._fall = 0.0, None
        self._seen.clear()
