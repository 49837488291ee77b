"""The state of charge that a vehicle reports, accepted as far as it is physically possible.

Charge falls at the rate at which it is drawn. A report far from that line is held, and the line continues, until the voltage
has confirmed it: a battery that has lost charge has lost voltage. A report that the voltage contradicts is not accepted, however often it is
repeated; where the curve is too flat to decide, or no voltage is known, a report must persist for some time. In the air charge never comes
back, except after the acceptance of a loss that did not happen.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from statistics import median

from skyway.link.supervisor.soc.voltage import open_voltage

NEAR_SOC, NEAR_SHARE = 0.04, 0.5
"""Greatest deviation of a report from the line: the step of a percentage, and the relative error of the rate."""
HEARD, BEFORE_S = 3, 20.0
"""Voltages that are compared: this number after a fall, with those of this time before it, s."""
TELLING = 0.008
"""A loss that lowers the open-circuit voltage by less than this share cannot be detected by it."""
CONFIRMED = 0.5
"""Share of the expected fall of the voltage that confirms a loss."""
FLAT_S, BLIND_S, GROUND_FALL_S, GROUND_RISE_S = 30.0, 130.0, 15.0, 120.0
"""Time for which a report must persist, s: if the voltage cannot decide; if it is unknown, longer than wrong values
last; for a fall, and for a rise, on the ground."""
FALLING_S = 15.0
"""Time after a loss during which a filter of the vehicle may still be falling, s."""
YOUNG_S = 120.0
"""A line younger than this may itself begin with a wrong report, s."""
_CELLS = (3, 4, 6, 8, 10, 12, 14)


@dataclass(slots=True)
class ReportedSoc:
    """The accepted part of one vehicle's reports."""

    soc: float = math.nan
    """Last accepted value, at `at_s`; the line begins there."""
    at_s: float = -math.inf
    held_s: float = math.nan
    """Time since which reports deviate from the line; NaN if they do not."""
    contradicted: bool = False
    """They deviate, and the voltage contradicts them."""
    blind_s: float = BLIND_S
    """Time for which a report must persist if no voltage is known, s."""
    _met_s: float = -math.inf
    _fell: tuple[float, float] = (math.nan, -math.inf)
    _volts: deque[tuple[float, float]] = field(default_factory=deque)
    _before: list[float] = field(default_factory=list)
    _held_soc: float = math.nan

    def line(self, time_s: float, rate_per_s: float) -> float:
        """Return the charge now, from the last accepted report and the rate of use."""
        return max(self.soc - rate_per_s * max(time_s - self.at_s, 0.0), 0.0)

    def forget(self) -> None:
        """Reset: the battery was measured, or replaced."""
        self.soc, self.at_s, self.held_s, self.contradicted = math.nan, -math.inf, math.nan, False
        self._met_s, self._fell = -math.inf, (math.nan, -math.inf)

    def measured(self, time_s: float, soc: float) -> None:
        """Reset to a measured charge: later reports of an earlier state are held, not accepted."""
        self.forget()
        self._met_s = time_s
        self._believe(time_s, soc)

    def hear(self, time_s: float, reported: float, open_v: float, rate_per_s: float, *, flies: bool) -> float:
        """Take a report with the open-circuit voltage of the battery; return charge lost suddenly, usually 0.

        The state of charge `reported` and the voltage are NaN where they are unknown.
        """
        if math.isfinite(open_v):
            self._volts.append((time_s, open_v))
            while self._volts[0][0] < time_s - BEFORE_S - BLIND_S:
                self._volts.popleft()
        if not math.isfinite(reported):
            return 0.0
        if not math.isfinite(self.soc):
            self._met_s = time_s
            return self._believe(time_s, reported)
        line = self.line(time_s, rate_per_s)
        near = NEAR_SOC + NEAR_SHARE * rate_per_s * max(time_s - self.at_s, 0.0)
        if abs(reported - line) <= near:
            return self._believe(time_s, reported)
        if math.isnan(self.held_s):
            self.held_s = time_s
            self._held_soc = line
            self._before = [volts for at_s, volts in self._volts if time_s - BEFORE_S <= at_s < time_s]
        if not flies:
            stays_s = GROUND_FALL_S if reported < line else GROUND_RISE_S
            return self._believe(time_s, reported) if time_s >= self.held_s + stays_s else 0.0
        if reported > line:
            return self._restored(time_s, reported, rate_per_s)
        falling = time_s < self._fell[1] + FALLING_S
        if falling or self._confirmed(time_s, line, reported):
            if not falling:
                self._fell = line, time_s
            self._believe(time_s, reported)
            return line - reported
        return 0.0

    def _believe(self, time_s: float, reported: float) -> float:
        self.soc, self.at_s, self.held_s, self.contradicted = reported, time_s, math.nan, False
        return 0.0

    def _restored(self, time_s: float, reported: float, rate_per_s: float) -> float:
        """Undo a loss that did not happen: the report is again on the line before it."""
        before, at_s = self._fell
        if not math.isfinite(before) or abs(reported - (before - rate_per_s * (time_s - at_s))) > 2.0 * NEAR_SOC:
            return 0.0
        back = self.line(time_s, rate_per_s) - reported
        self._fell = math.nan, -math.inf
        self._believe(time_s, reported)
        return back

    def _confirmed(self, time_s: float, line: float, reported: float) -> bool:
        """Whether a fall is confirmed by now."""
        now = [volts for at_s, volts in self._volts if at_s >= self.held_s]
        if len(now) < HEARD or len(self._before) < HEARD:
            return time_s >= self.held_s + self.blind_s
        used, lost = (open_voltage(soc) / open_voltage(self._held_soc) for soc in (line, reported))
        expected, found = used - lost, used - median(now[-2 * HEARD :]) / median(self._before)
        if expected < TELLING:  # once distinguished, it stays so although the line has come nearer
            return not self.contradicted and time_s >= self.held_s + FLAT_S
        young = time_s < self._met_s + YOUNG_S and _misfit(reported, median(now)) < _misfit(line, median(now)) - TELLING
        self.contradicted = found < CONFIRMED * expected and not young
        return not self.contradicted


def _misfit(soc: float, volts: float) -> float:
    """Misfit of a voltage to a charge, with the number of cells that fits best."""
    return min(abs(volts / (cells * open_voltage(soc)) - 1.0) for cells in _CELLS)
