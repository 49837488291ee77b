"""Faults on demand: kind, start and duration."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

from skyway.models.base.errors import Fault as Wrong
from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


class Kind(NamedTuple):
    """Kind of a fault: its effect, the default, least and greatest value, its default duration, and its words if it takes one."""

    says: str
    values: tuple[float, float, float] | None = None
    lasts_s: float = math.inf
    word: str | None = None


KINDS = {
    "gust": Kind("extra wind of VALUE m/s (8), for 15 s unless a duration is given", (8.0, 0.0, 60.0), 15.0),
    "wind-shift": Kind("extra wind of VALUE m/s (5), permanent", (5.0, 0.0, 60.0)),
    "battery-sag": Kind("internal resistance times VALUE (4)", (4.0, 0.0, 100.0)),
    "battery-drop": Kind("state of charge lower by VALUE (0.2) at once", (0.2, 0.0, 1.0)),
    "battery-weak": Kind("the battery has VALUE (0.9) of its nameplate energy", (0.9, 0.01, 2.0)),
    "battery-swap": Kind(
        "another battery with VALUE (1) of charge, and a restart; on the ground, disarmed", (1.0, 0.0, 1.0)
    ),
    "soc-unknown": Kind("battery percentage reported as -1"),
    "soc-stuck": Kind("battery percentage stays constant"),
    "soc-jump": Kind("battery percentage reported as VALUE (0.5)", (0.5, 0.0, 1.0)),
    "link-loss": Kind("no packet passes in either direction"),
    "gps": Kind("no position"),
    "gps-glitch": Kind(
        "the receiver is off by VALUE m (40), for 20 s unless a duration is given", (40.0, 0.0, 100_000.0), 20.0
    ),
    "rc-loss": Kind("remote control lost"),
    "prearm": Kind("a pre-arm check fails"),
    "reboot": Kind("the autopilot restarts by itself"),
    "pilot": Kind("a pilot switches the mode to VALUE (position)", word="position"),
    "gripper-stuck": Kind(
        "the gripper says that it opens, but VALUE (1) of the package stays on board", (1.0, 0.0, 1.0)
    ),
    "gripper-silent": Kind("the gripper does not move, and its command fails"),
    "winch-jammed": Kind("the winch stops with VALUE m (3) of line out", (3.0, 0.0, 100.0)),
    "place-blind": Kind(
        "a payload place feels no ground, and gives up VALUE m (5) below where it began", (5.0, 0.1, 100.0)
    ),
    "package-lost": Kind("VALUE (1) of the package falls off at once", (1.0, 0.0, 1.0)),
    "aircraft": Kind(
        "an aircraft circles the drone at VALUE m (500), 100 m above, for 60 s unless a duration is given",
        (500.0, 0.0, 50_000.0),
        60.0,
    ),
    "sensor-ill": Kind(
        "a sensor is reported not healthy: VALUE is gyro, accelerometer, compass (usual), barometer, motors",
        word="compass",
    ),
    "motor-ill": Kind("the controller of motor VALUE (1) reports a failure, where it reports at all", (1.0, 1.0, 4.0)),
    "cell-low": Kind(
        "one cell of the battery is VALUE V (0.3) below the others, which are reported individually", (0.3, 0.0, 3.0)
    ),
    "vibration": Kind("accelerations of VALUE m/s² (80) while the motors turn", (80.0, 0.0, 300.0)),
    "remote-id-off": Kind("the Remote ID module sends and broadcasts nothing"),
    "no-ftp": Kind("the vehicle does not support file transfers"),
    "log-stall": Kind("transfers of files and logs stop, and are not answered"),
    "log-gone": Kind("the files on the card are gone"),
    "log-size": Kind("files and logs are reported VALUE (2) times as long as they are", (2.0, 0.0, 1000.0)),
    "log-rot": Kind("some bytes of a file arrive wrong"),
    "pads-taken": Kind(
        "other drones take every pad of station VALUE (all of them), for an hour unless a duration is given",
        lasts_s=3600.0,
        word="",
    ),
}
"""Every fault by name."""
AT_STATIONS = "pads-taken"
"""The fault that befalls stations, not vehicles."""
SENSORS = {"gyro": 0x1, "accelerometer": 0x2, "compass": 0x4, "barometer": 0x8, "motors": 0x8000}
"""Bits of SYS_STATUS by the words of ``sensor-ill``."""
_PILOT_MODES = ("position", "stabilize", "altitude", "hold", "land", "return")
_SCALE_S = {"": 1.0, "s": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}
_TIME = r"(\d+(?:\.\d+)?)(s|min|m|h)?"
_FORM = re.compile(rf"([a-z-]+)(?:=([\w.-]+))?(?:@(T\+)?{_TIME})?(?:\+{_TIME})?(?:#(\d+))?")


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault."""

    kind: str
    """One of `KINDS`."""
    start_s: float = 0.0
    end_s: float = math.inf
    """`start_s`, `end_s`: simulated time, or seconds after the first take-off."""
    value: float = 0.0
    """Its strength."""
    word: str = ""
    """Its value as written, for ``pilot=MODE`` and ``pads-taken=STATION``."""
    system: int | None = None
    """The vehicle it befalls; None is every one."""
    after_take_off: bool = False
    """Whether its times count from the first take-off of the vehicle."""


def parse_fault(text: str) -> Fault:
    """Read ``KIND[=VALUE][@START][+DURATION][#SYSTEM]``, for example ``link-loss@60s+20s``.

    START counts from the beginning of the simulation; written ``T+60s``, from the first take-off of the vehicle. An
    `InputError` refuses an unknown kind, and another form.
    """
    found = _FORM.fullmatch(text.strip())
    remedy = (
        "KIND[=VALUE][@START][+DURATION][#SYSTEM], for example gust=8@120s+15s, or link-loss@T+60s+20s after take-off"
    )
    if found is None:
        raise InputError(Wrong("not a fault", field="--fault", value=text, remedy=remedy))
    kind, word, take_off, start, start_unit, length, length_unit, system = found.groups()
    if kind not in KINDS:
        remedy = "one of " + ", ".join(KINDS)
        raise InputError(Wrong("no such fault", field="--fault", value=kind, remedy=remedy))
    start_s = float(start) * _SCALE_S[start_unit or ""] if start else 0.0
    lasts_s = float(length) * _SCALE_S[length_unit or ""] if length else KINDS[kind].lasts_s
    befalls = int(system) if system else None
    if take_off and kind == AT_STATIONS:
        remedy = f"{kind}@60s: from the beginning of the simulation"
        raise InputError(Wrong("concerns stations, which do not take off", field="--fault", value=text, remedy=remedy))
    takes_word = KINDS[kind].word is not None
    told, value = (_word(kind, word, text), 0.0) if takes_word else ("", _value(kind, word, text))
    return Fault(kind, start_s, start_s + lasts_s, value, told, befalls, after_take_off=bool(take_off))


def _word(kind: str, word: str | None, text: str) -> str:
    """Value of a fault that takes a word."""
    if kind == "pilot" and word is not None and word not in _PILOT_MODES:
        remedy = "pilot=MODE with MODE one of " + ", ".join(_PILOT_MODES)
        raise InputError(Wrong("no such mode", field="--fault", value=text, remedy=remedy))
    if kind == "sensor-ill" and word is not None and word not in SENSORS:
        remedy = "sensor-ill=NAME with NAME one of " + ", ".join(SENSORS)
        raise InputError(Wrong("no such sensor", field="--fault", value=text, remedy=remedy))
    return (KINDS[kind].word or "") if word is None else word


def _value(kind: str, word: str | None, text: str) -> float:
    """Value of a fault that takes a number, or none."""
    limits = KINDS[kind].values
    if limits is None:
        if word is not None:
            raise InputError(Wrong("this fault takes no value", field="--fault", value=text, remedy=kind))
        return 0.0
    if word is None:
        return limits[0]
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not limits[1] <= value <= limits[2]:
        remedy = f"{kind}=VALUE with a number from {limits[1]:g} to {limits[2]:g}"
        raise InputError(Wrong("not a value of this fault", field="--fault", value=text, remedy=remedy))
    return value


@dataclass(slots=True)
class FaultState:
    """The faults of one vehicle, and which are in force now."""

    faults: tuple[Fault, ...] = ()
    """All that befall it."""
    active: dict[str, Fault] = field(default_factory=dict)
    next_change_s: float = math.inf
    """When the next one begins or ends."""
    _took_off_s: float = math.inf
    _begun: set[int] = field(default_factory=set)
    _stuck_percent: int | None = None

    @classmethod
    def of(cls, faults: Iterable[Fault], system: int) -> FaultState:
        """Those faults that befall one vehicle."""
        mine = tuple(f for f in faults if f.system in (None, system) and f.kind != AT_STATIONS)
        return cls(mine, next_change_s=min((f.start_s for f in mine if not f.after_take_off), default=math.inf))

    def took_off(self, sim_s: float) -> None:
        """From the first take-off on it is known when the faults that count from there begin."""
        if math.isfinite(self._took_off_s):
            return
        self._took_off_s = sim_s
        self.faults = tuple(self._dated(fault) for fault in self.faults)
        self.next_change_s = sim_s

    def _dated(self, fault: Fault) -> Fault:
        """Return the fault with simulated times, where they are known already."""
        if not fault.after_take_off or not math.isfinite(self._took_off_s):
            return fault
        start_s, end_s = fault.start_s + self._took_off_s, fault.end_s + self._took_off_s
        return replace(fault, start_s=start_s, end_s=end_s, after_take_off=False)

    def add(self, fault: Fault, sim_s: float) -> None:
        """One more, which begins at its time, or now where that is past."""
        fault = self._dated(fault)
        self.faults = (*self.faults, fault)
        if fault.after_take_off:
            return
        self.next_change_s = min(self.next_change_s, max(fault.start_s, sim_s))

    def update(self, sim_s: float) -> Sequence[Fault]:
        """Bring up to date; returns the faults that have just started."""
        begun = []
        self.active = {}
        following = math.inf
        for number, fault in enumerate(self.faults):
            if fault.after_take_off:
                continue
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

    def value(self, kind: str, otherwise: float = 0.0) -> float:
        """Strength of a fault in force."""
        return self.active[kind].value if kind in self.active else otherwise

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
