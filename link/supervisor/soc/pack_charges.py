"""The charges of several packs: each by its own reports, since the emptiest decides when the vehicle must land.

Packs in parallel have one voltage, which tells nothing about one of them: a report that departs from a pack's line is accepted once it
has persisted. A pack that is first reported in flight counts after several reports; one that falls silent in flight is
assumed to be discharged on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from statistics import median
from typing import TYPE_CHECKING

from skyway.link.supervisor.soc.reported_soc import FLAT_S, ReportedSoc
from skyway.link.telemetry.batteries import RECENT

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.link.telemetry.batteries import Battery

BEGIN_S = 10.0
"""All packs of a vehicle are reported within this time of its first report, s: one that comes later is news."""


@dataclass(slots=True)
class PackCharges:
    """The packs of one vehicle; none if it reports a single one."""

    _lines: dict[int, ReportedSoc] = field(default_factory=dict)
    _begun_s: float = math.nan

    def __bool__(self) -> bool:
        return bool(self._lines)

    def hear(self, time_s: float, packs: Mapping[int, Battery], rate_per_s: float, *, flies: bool) -> bool:
        """Take the newest report of each; return whether the charge of one changed suddenly, other than by its use."""
        if math.isnan(self._begun_s):
            self._begun_s = time_s
        if not flies:
            self._lines = {number: line for number, line in self._lines.items() if number in packs}
        if len(packs) < 2 and not self._lines:
            return False
        news = False
        for number, pack in packs.items():
            if number not in self._lines:
                news |= self._begin(number, pack, time_s, flies=flies)
            else:
                fell = self._lines[number].hear(time_s, pack.soc, math.nan, rate_per_s, flies=flies)
                news |= fell != 0.0
        return news

    def _begin(self, number: int, pack: Battery, time_s: float, *, flies: bool) -> bool:
        """Begin the line of a pack; return whether the vehicle had been known before without it."""
        if not pack.recent or (flies and len(pack.recent) < RECENT):
            return False
        line = self._lines[number] = ReportedSoc(blind_s=FLAT_S)
        first = median(pack.recent) if flies else pack.recent[-1]
        line.hear(time_s, first, math.nan, 0.0, flies=flies)
        return flies and time_s > self._begun_s + BEGIN_S

    def emptiest(self, time_s: float, rate_per_s: float) -> tuple[int, float]:
        """Return the number and the state of charge now of the emptiest pack; infinity without packs."""
        found = ((number, line.line(time_s, rate_per_s)) for number, line in self._lines.items())
        return min(found, key=lambda one: one[1], default=(0, math.inf))

    def forget(self) -> None:
        """Reset: the batteries were measured, or replaced."""
        self._lines.clear()
        self._begun_s = math.nan
