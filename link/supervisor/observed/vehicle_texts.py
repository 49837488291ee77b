"""Texts of the vehicle (STATUSTEXT): shown when new, counted when repeated."""

from __future__ import annotations

import math
import re
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import TextHeard

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from skyway.link.supervisor.context import Context

NOTICE = 5
"""Least severe MAV_SEVERITY that is shown: emergency 0 to notice 5; info 6 and debug 7 are journaled."""
SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")
AGAIN_S = 30.0
"""Time after which a persistent text is shown again, s; the interval then doubles each time."""
_QUIET_S = 600.0
"""A text not repeated for this time counts as new, s."""
_MAX_TEXTS = 500
_ABOUT_MISSION = re.compile(r"waypoint|mission|geofence", re.IGNORECASE)
_OLD_MISSION = " (checked against the fence of the next leg: the mission of the last one, on board until the next one is uploaded and verified)"
_FIGURE = re.compile(r"[-+]?\d+\.\d+")


@dataclass(slots=True)
class Said:
    """One text, received once or more."""

    text: str
    """Its last version."""
    severity: int
    """MAV_SEVERITY."""
    count: int = 0
    """Number of times."""
    received_s: float = -math.inf
    shown_s: float = -math.inf
    shown_count: int = 0
    wait_s: float = AGAIN_S

    def __str__(self) -> str:
        times = f" ({self.count} times)" if self.count > 1 else ""
        return f"{self.text}{times}"


@dataclass(slots=True)
class TextLog:
    """The texts of one vehicle.

    Texts that differ only in a figure with a decimal point count as the same one.
    """

    latest: Said | None = None
    _said: dict[str, Said] = field(default_factory=dict)
    _last_mission: bool = False

    @contextmanager
    def of_last_mission(self, *, on_board: bool) -> Iterator[None]:
        """Meanwhile the next leg is uploaded; where the mission of the last one is on board, the vehicle checks that against the new fence."""
        self._last_mission = on_board
        try:
            yield
        finally:
            self._last_mission = False

    def explained(self, said: Said) -> str:
        """Return a message, with the mission that it is about where that is not the next one."""
        old = self._last_mission and _ABOUT_MISSION.search(said.text)
        return f"{said}{_OLD_MISSION if old else ''}"

    def hear(self, texts: Iterable[tuple[int, str]], now_s: float) -> list[Said]:
        """Process new messages; return those to be shown or journaled now."""
        for severity, text in texts:
            key = _FIGURE.sub("#", text)
            said = self._said.get(key)
            if said is None or now_s > said.received_s + _QUIET_S:
                said = self._said[key] = Said(text, severity)
            said.text, said.severity, said.received_s = text, severity, now_s
            said.count += 1
            self.latest = said
        while len(self._said) > _MAX_TEXTS:
            del self._said[next(iter(self._said))]
        return list(self._due(now_s))

    def saying(self, words: re.Pattern[str], since_s: float) -> str:
        """Return the last message since an instant that contains some words; empty if there is none."""
        found = [said for said in self._said.values() if said.received_s >= since_s and words.search(said.text)]
        return max(found, key=lambda said: said.received_s).text if found else ""

    def _due(self, now_s: float) -> Iterator[Said]:
        for said in self._said.values():
            if said.count == said.shown_count or now_s < said.shown_s + (said.wait_s if said.shown_count else 0.0):
                continue
            if said.shown_count:
                said.wait_s *= 2.0
            said.shown_s, said.shown_count = now_s, said.count
            yield said


def tell_texts(ctx: Context) -> None:
    """Report the vehicle's messages: a refusal that is repeated 200 times is one line, with its count."""
    for said in ctx.texts.hear(ctx.vehicle.new_texts(), ctx.clock.now_s()):
        word = SEVERITIES[min(max(said.severity, 0), len(SEVERITIES) - 1)]
        ctx.note(TextHeard(text=said.text, severity=word, count=said.count), str(said))
        if said.severity <= NOTICE:
            ctx.tell(f"the drone reports: {ctx.texts.explained(said)}")
