"""Other ground stations on the link, including other supervisors, and the vehicles that they supervise."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from skyway.link.wire.messages import Message

ANNOUNCEMENT = "NAMED_VALUE_INT"
"""Broadcast by every supervisor once a second: `NAME`, with the system of its vehicle, plus `UNDER_WAY` once it has commanded."""
NAME = "skyway"
UNDER_WAY = 256
_SILENT_S = 5.0
_GROUND_STATION = 6
_MAX_STATIONS = 64
Who = tuple[int, int]
"""System and component."""


@dataclass(frozen=True, slots=True)
class Supervisor:
    """Another supervisor of a vehicle."""

    system: int
    component: int
    """`system`, `component`: of the supervisor itself."""
    under_way: bool
    """Whether it has already commanded the vehicle."""

    def __str__(self) -> str:
        return f"another skyway (system {self.system}, component {self.component})"


@dataclass(slots=True)
class Stations:
    """The stations received on a connection."""

    heard_s: dict[Who, float] = field(default_factory=dict)
    """Time of each one's latest packet."""
    _supervises: dict[Who, tuple[int, bool, float]] = field(default_factory=dict)

    def hear(self, message: Message, now_s: float) -> bool:
        """Process a message; returns whether it reveals a station."""
        who = message.system, message.component
        if message.name == "HEARTBEAT" and message["type"] == _GROUND_STATION:
            if who in self.heard_s or len(self.heard_s) < _MAX_STATIONS:
                self.heard_s[who] = now_s
            return True
        if message.name != ANNOUNCEMENT or message["name"] != NAME:
            return False
        if who in self._supervises or len(self._supervises) < _MAX_STATIONS:
            value = int(message["value"])
            self._supervises[who] = (value & 0xFF, bool(value & UNDER_WAY), now_s)
        return True

    def supervisor_of(self, vehicle: int, now_s: float) -> Supervisor | None:
        """Return the other stations that supervise a vehicle at present; those that have commanded it come first."""
        found = [
            Supervisor(*who, under_way)
            for who, (system, under_way, at_s) in self._supervises.items()
            if system == vehicle and now_s <= at_s + _SILENT_S
        ]
        return min(found, key=lambda one: (not one.under_way, one.system, one.component), default=None)


def announcement(vehicle: int, *, under_way: bool) -> dict[str, Any]:
    """Fields of our own announcement."""
    return {"name": NAME, "value": vehicle | (UNDER_WAY if under_way else 0)}
