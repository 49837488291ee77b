"""Faults on demand: what goes wrong, when, and for how long."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from models.errors import Fault as Wrong
from models.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

KINDS = {
    "gust": "extra wind of VALUE m/s (8), for 15 s unless it says how long",
    "wind-shift": "extra wind of VALUE m/s (5), for good",
    "battery-sag": "internal resistance times VALUE (4)",
    "battery-drop": "state of charge lower by VALUE (0.2) at once",
    "soc-unknown": "battery percentage reported as -1",
    "soc-stuck": "battery percentage stays where it is",
    "soc-jump": "battery percentage reported as VALUE (0.5)",
    "link-loss": "no packet passes in either direction",
    "gps": "no position",
    "rc-loss": "remote control lost",
    "prearm": "a pre-arm check fails",
    "reboot": "the autopilot restarts by itself",
    "pilot": "a pilot switches the mode to VALUE (position)",
}
"""Every fault with what it does and its default value."""
_DEFAULTS = {"gust": 8.0, "wind-shift": 5.0, "battery-sag": 4.0, "battery-drop": 0.2, "soc-jump": 0.5}
_LASTS_S = {"gust": 15.0}
_SCALE_S = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}
_TIME = r"(\d+(?:\.\d+)?)(s|min|m|h)?"
_FORM = re.compile(rf"([a-z-]+)(?:=([\w.-]+))?(?:@{_TIME})?(?:\+{_TIME})?(?:#(\d+))?")


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    start_s, end_s : float
        Simulated time.
    value : float
        Its strength.
    word : str
        Its value as written, for ``pilot=MODE``.
    system : int or None
        The vehicle it befalls; None is every one.
    """

    kind: str
    start_s: float = 0.0
    end_s: float = math.inf
    value: float = 0.0
    word: str = ""
    system: int | None = None


def parse_fault(text: str) -> Fault:
    """Read ``KIND[=VALUE][@START][+DURATION][#SYSTEM]``, for example ``link-loss@60s+20s``.

    Raises
    ------
    InputError
        Unknown kind, or not of that form.
    """
    found = _FORM.fullmatch(text.strip())
    remedy = "KIND[=VALUE][@START][+DURATION][#SYSTEM], for example gust=8@120s+15s or link-loss@60s+20s"
    if found is None:
        raise InputError(Wrong("not a fault", field="--fault", value=text, remedy=remedy))
    kind, word, start, start_unit, length, length_unit, system = found.groups()
    if kind not in KINDS:
        remedy = "one of " + ", ".join(KINDS)
        raise InputError(Wrong("no such fault", field="--fault", value=kind, remedy=remedy))
    start_s = float(start) * _SCALE_S[start_unit or ""] if start else 0.0
    lasts_s = float(length) * _SCALE_S[length_unit or ""] if length else _LASTS_S.get(kind, math.inf)
    value = _DEFAULTS.get(kind, 0.0)
    if word is not None and kind != "pilot":
        try:
            value = float(word)
        except ValueError:
            raise InputError(Wrong("not a number", field="--fault", value=text, remedy=remedy)) from None
        if not math.isfinite(value):
            raise InputError(Wrong("not a finite number", field="--fault", value=text, remedy=remedy))
    return Fault(kind, start_s, start_s + lasts_s, value, word or "", int(system) if system else None)


@dataclass(slots=True)
class FaultState:
    """The faults of one vehicle, and which are in force now.

    Attributes
    ----------
    faults : tuple of Fault
        All that befall it.
    next_change_s : float
        When the next one begins or ends.
    """

    faults: tuple[Fault, ...] = ()
    active: dict[str, Fault] = field(default_factory=dict)
    next_change_s: float = math.inf
    _begun: set[int] = field(default_factory=set)
    _stuck_percent: int | None = None

    @classmethod
    def of(cls, faults: Iterable[Fault], system: int) -> FaultState:
        """Those faults that befall one vehicle."""
        mine = tuple(f for f in faults if f.system in (None, system))
        return cls(mine, next_change_s=min((f.start_s for f in mine), default=math.inf))

    def update(self, sim_s: float) -> Sequence[Fault]:
        """Bring up to date; returns the faults that have just begun."""
        begun = []
        self.active = {}
        following = math.inf
        for number, fault in enumerate(self.faults):
            if sim_s < fault.start_s:
                following = min(following, fault.start_s)
                continue
            if number not in self._begun:
                self._begun.add(number)
                begun.append(fault)
            if sim_s < fault.end_s:
                self.active[fault.kind] = fault
                following = min(following, fault.end_s)
        if "soc-stuck" not in self.active:
            self._stuck_percent = None
        self.next_change_s = following
        return begun

    @property
    def positioning(self) -> bool:
        """Whether there is a position."""
        return "gps" not in self.active

    @property
    def remote_control(self) -> bool:
        """Whether the remote control is heard."""
        return "rc-loss" not in self.active

    @property
    def link(self) -> bool:
        """Whether packets pass."""
        return "link-loss" not in self.active

    def extra_wind_mps(self) -> float:
        """Strength of gusts and shifts in force."""
        return sum(self.active[kind].value for kind in ("gust", "wind-shift") if kind in self.active)

    def resistance_factor(self) -> float:
        """How much the battery's resistance has grown."""
        return self.active["battery-sag"].value if "battery-sag" in self.active else 1.0

    def soc_override(self, soc: float) -> int | None:
        """Battery percentage to report instead of the estimate, or None."""
        if "soc-unknown" in self.active:
            return -1
        if "soc-jump" in self.active:
            return max(0, min(100, int(self.active["soc-jump"].value * 100.0)))
        if "soc-stuck" in self.active:
            if self._stuck_percent is None:
                self._stuck_percent = int(soc * 100.0)
            return self._stuck_percent
        return None

    def arming_faults(self) -> list[str]:
        """Pre-arm checks that fail."""
        reasons = [] if self.positioning else ["GPS 1: Bad fix"]
        return [*reasons, "Compass not healthy"] if "prearm" in self.active else reasons
