"""The batteries of one vehicle, each by its own reports: the vehicle's state of charge is that of the emptiest one."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.models.base.formatting import percent

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from skyway.link.wire.messages import Message

MESSAGES = frozenset(("SYS_STATUS", "BATTERY_STATUS"))
"""Messages that report a state of charge."""
RECENT = 3
"""Number of reports of each battery that are kept."""
_OF_OTHERS = frozenset((3, 4))
"""MAV_BATTERY_FUNCTION of batteries that do not turn the propellers: avionics, payload."""
_NO_CELL = 0, 65535
"""Voltages of cells that are none."""
_FRESH_S = 30.0
_APART = 0.1
"""Packs that share a load differ by less."""


@dataclass(slots=True)
class Battery:
    """One battery."""

    heard_s: float
    message: Message
    """`heard_s`, `message`: the newest report."""
    recent: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))
    """Its last known states of charge."""

    @property
    def soc(self) -> float:
        """State of charge in its newest report; NaN if that reports none."""
        return _known(self.message["battery_remaining"])

    @property
    def is_there(self) -> bool:
        """Whether there is one: an input of PX4 where none is plugged in is reported with neither a charge nor a voltage."""
        return bool(self.recent) or any(one not in _NO_CELL for one in self.message["voltages"])


class Batteries:
    """Those that a vehicle flies on."""

    def __init__(self) -> None:
        self._told: dict[int, Battery] = {}
        self._status: tuple[float, float] = (-math.inf, math.nan)

    def hear(self, message: Message, now_s: float) -> None:
        """Process a BATTERY_STATUS, or a SYS_STATUS."""
        if message.name == "SYS_STATUS":
            self._status = now_s, _known(message["battery_remaining"])
            return
        number = message["id"]
        if message["battery_function"] in _OF_OTHERS:
            return
        battery = self._told.setdefault(number, Battery(now_s, message))
        battery.heard_s, battery.message = now_s, message
        if math.isfinite(battery.soc):
            battery.recent.append(battery.soc)

    def fresh(self, now_s: float) -> dict[int, Battery]:
        """Return the batteries that have reported recently, by number."""
        return {number: one for number, one in sorted(self._told.items()) if now_s <= one.heard_s + _FRESH_S}

    def reports(self, now_s: float) -> dict[int, Mapping[str, Any]]:
        """Return the newest report of each, by its number; old ones are omitted."""
        return {number: one.message.fields for number, one in self.fresh(now_s).items()}

    def lowest(self, now_s: float) -> tuple[int, float] | None:
        """Return the number and the state of charge of the emptiest one; None where none reports it."""
        known = {number: one.soc for number, one in self.fresh(now_s).items() if math.isfinite(one.soc)}
        return min(known.items(), key=lambda one: one[1]) if known else None

    def soc(self, now_s: float) -> float:
        """Return the vehicle's state of charge: the lowest that is reported, by a battery or in SYS_STATUS; NaN if none is."""
        lowest, (told_s, told) = self.lowest(now_s), self._status
        known = [] if lowest is None else [lowest[1]]
        if now_s <= told_s + _FRESH_S and math.isfinite(told):
            known.append(told)
        return min(known, default=math.nan)

    def unknown(self, now_s: float) -> list[int]:
        """Return the numbers of those, of several, that report no state of charge: that of another battery says nothing of theirs."""
        there = {number: one for number, one in self.fresh(now_s).items() if one.is_there}
        return [number for number, one in there.items() if math.isnan(one.soc)] if len(there) > 1 else []

    def apart(self, now_s: float) -> str:
        """Return in words that one of them is much emptier than another; empty if none is."""
        known = {number: one.soc for number, one in self.fresh(now_s).items() if math.isfinite(one.soc)}
        if not known:
            return ""
        low, high = (one(known.items(), key=lambda item: item[1]) for one in (min, max))
        if not low[1] < high[1] - _APART:
            return ""
        return f"battery {low[0]} reports {percent(low[1])}, battery {high[0]} {percent(high[1])}"


def _known(remaining: int) -> float:
    """State of charge of a percentage; NaN if that is none."""
    return remaining / 100.0 if 0 <= remaining <= 100 else math.nan
