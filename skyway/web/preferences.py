"""Preferences of a person: colours, units and times, stored by the browser in cookies."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, tzinfo
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from skyway.models.base.formatting import date_clock
from skyway.models.base.units import parse_instant

if TYPE_CHECKING:
    from collections.abc import Mapping
    from datetime import datetime

CHOICES: dict[str, tuple[str, dict[str, str]]] = {
    "speed": ("Speeds", {"mps": "m/s", "kn": "kn", "kmh": "km/h"}),
    "height": ("Heights and lengths", {"m": "m", "ft": "ft"}),
    "time": ("Times", {"local": "local", "utc": "UTC"}),
    "theme": ("Colours", {"auto": "auto", "light": "light", "dark": "dark"}),
}
"""Name of each preference: its label, and its choices; the first is the default."""
_SPEEDS = {"mps": 1.0, "kn": 1.0 / 0.514444, "kmh": 3.6}
_FEET_PER_M = 1.0 / 0.3048
_NUMBER = r"(?<![\w.])-?\d+(?:\.\d+)?"
_MEASURED = re.compile(rf"{_NUMBER}(?: ?(?:±|to|\() ?-?\d+(?:\.\d+)?\)?)* (m/s|m)(?![\w²³/·])")
"""A length or a speed in a sentence, with its range: ``60 m``, ``7.4 ± 0.8 m/s``, ``10 (8 to 12) m/s``."""


@dataclass(frozen=True, slots=True)
class Preferences:
    """Preferences of one person."""

    speed: str = "mps"
    height: str = "m"
    time: str = "local"
    theme: str = "auto"

    @classmethod
    def of(cls, cookies: Mapping[str, str]) -> Preferences:
        """Read them from the cookies of a request; an invalid choice means the default."""
        found = {name: cookies.get(f"skyway_{name}", "") for name in CHOICES}
        return cls(**{name: value for name, value in found.items() if value in CHOICES[name][1]})

    @property
    def speed_factor(self) -> float:
        """Factor for speeds in m/s."""
        return _SPEEDS[self.speed]

    @property
    def height_factor(self) -> float:
        """Factor for heights in metres."""
        return _FEET_PER_M if self.height == "ft" else 1.0

    def zone(self, timezone: str) -> tzinfo:
        """Return the zone of the times shown."""
        return UTC if self.time == "utc" else ZoneInfo(timezone)

    def speed_text(self, mps: float | None, digits: int = 1) -> str:
        """Return a speed with its unit."""
        if mps is None:
            return "unknown"
        return f"{mps * _SPEEDS[self.speed]:.{digits}f} {CHOICES['speed'][1][self.speed]}"

    def height_text(self, metres: float | None, digits: int = 0) -> str:
        """Return a height with its unit."""
        if metres is None:
            return "unknown"
        return f"{metres * self.height_factor:.{digits}f} {self.height}"

    def in_words(self, told: str) -> str:
        """Return a sentence with its speeds, heights and lengths in the preferred units; ``static/flight/words.js`` does the same."""
        return _MEASURED.sub(self._measured, told)

    def _measured(self, found: re.Match[str]) -> str:
        speed = found[1] == "m/s"
        if (self.speed == "mps") if speed else (self.height == "m"):
            return found[0]
        factor = self.speed_factor if speed else self.height_factor
        unit = CHOICES["speed"][1][self.speed] if speed else self.height

        def told(number: re.Match[str]) -> str:
            digits = 1 if speed else len(number[0].partition(".")[2])
            return f"{float(number[0]) * factor:.{digits}f}"

        return f"{re.sub(_NUMBER, told, found[0][: found.start(1) - found.start()])}{unit}"

    def clock(self, instant: datetime, timezone: str) -> str:
        """Return date and time, with the name of their zone."""
        return date_clock(instant, self.zone(timezone), named=True)


def to_instant(typed: str, zone: tzinfo) -> str:
    """Convert ``2013-07-10T14:00`` of a zone to text with its UTC offset; other text is unchanged."""
    from datetime import datetime

    try:
        when = datetime.fromisoformat(typed)
    except ValueError:
        return typed
    return typed if when.tzinfo is not None else when.replace(tzinfo=zone).isoformat(timespec="minutes")


def from_instant(text: str, zone: tzinfo) -> str:
    """Convert an instant to ``2013-07-10T14:00`` of a zone, for a date control; empty if it is not an instant."""
    from skyway.models.base.errors import InputError

    if not text:
        return ""
    try:
        return parse_instant(text).astimezone(zone).replace(tzinfo=None).isoformat(timespec="minutes")
    except InputError:
        return ""
