"""When zones are active: spans of dates, and hours of days of the week in a time zone."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, Any

from skyway.models.base.formatting import date_clock

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from datetime import date

Span = tuple[float, float]
"""Begin and end, POSIX seconds, both included."""
DAY_S = 86_400.0
EVERY_DAY = frozenset(range(7))
SUN_EVENTS = ("BMCT", "SR", "SS", "EECT")
"""Begin of morning civil twilight, sunrise, sunset, end of evening civil twilight, as ED-318 names them."""
SUN_S = 300.0
"""Hours that depend on the sun are extended by this at either end: a zone is wide, and the refraction of the day is unknown."""
_CLOCK = re.compile(r"T?(\d{1,2}):?(\d{2})(?::?(\d{2})(?:[.,]\d+)?)?\s*(Z|UTC|[+-]\d{2}:?\d{2}|[+-]\d{2})?")


@dataclass(frozen=True, slots=True)
class Window:
    """Hours of some days of the week.

    Attributes
    ----------
    begin_s, end_s : float
        Of the clock, seconds after midnight; an end that is not later than the begin is on the day after.
    days : frozenset of int
        On which it begins; Monday is 0.
    zone : tzinfo
        Of the clock and of the days.
    events : (str, str)
        Members of `SUN_EVENTS` that replace the begin or the end; on a day on which the sun does not rise or set, the whole day counts.
    place : (float, float)
        Latitude and longitude, degrees, at which they are computed.
    """

    begin_s: float
    end_s: float
    days: frozenset[int] = EVERY_DAY
    zone: tzinfo = UTC
    events: tuple[str, str] = ("", "")
    place: tuple[float, float] = (0.0, 0.0)

    def _by_sun(self, day: date) -> Span:
        """Begin and end on a day, POSIX seconds."""
        midnight = datetime(day.year, day.month, day.day, tzinfo=self.zone).timestamp()
        begin_s, end_s = midnight + self.begin_s, midnight + self.end_s
        if self.events[0]:
            found = sun_s(self.events[0], day, self.place, self.zone)
            begin_s = midnight if found is None else found - SUN_S
        for later in range(2):  # an end that is not later than the begin is on the day after
            end_s += later * DAY_S
            if self.events[1]:
                found = sun_s(self.events[1], day + timedelta(days=later), self.place, self.zone)
                end_s = midnight + (1 + later) * DAY_S if found is None else found + SUN_S
            if end_s > begin_s:
                break
        return begin_s, end_s

    def spans(self, from_s: float, until_s: float) -> Iterator[Span]:
        """Yield the parts of it between two times."""
        day = datetime.fromtimestamp(from_s, self.zone).date() - timedelta(days=2)
        last = datetime.fromtimestamp(until_s, self.zone).date()
        length = timedelta(days=1) if self.end_s <= self.begin_s else timedelta()
        while day <= last:
            if day.weekday() in self.days and any(self.events):
                begin_s, end_s = self._by_sun(day)
                if begin_s <= until_s and end_s >= from_s:
                    yield begin_s, end_s
            elif day.weekday() in self.days:
                midnight = datetime(day.year, day.month, day.day)  # noqa: DTZ001  the clock of the zone, put to UTC below
                ends = midnight + timedelta(seconds=self.begin_s), midnight + length + timedelta(seconds=self.end_s)
                begin_s, end_s = (end.replace(tzinfo=self.zone).timestamp() for end in ends)
                if begin_s <= until_s and end_s >= from_s:
                    yield begin_s, end_s
            day += timedelta(days=1)


@dataclass(frozen=True, slots=True)
class Period:
    """A span of dates in which, or in whose windows, a zone is active."""

    begin_s: float = -math.inf
    end_s: float = math.inf
    windows: tuple[Window, ...] = ()

    def spans(self, from_s: float, until_s: float) -> Iterator[Span]:
        """Yield the parts of it between two times."""
        begin_s, end_s = max(self.begin_s, from_s), min(self.end_s, until_s)
        if begin_s > end_s:
            return
        if not self.windows:
            yield begin_s, end_s
        for window in self.windows:
            for first, last in window.spans(begin_s, end_s):
                if max(first, begin_s) <= min(last, end_s):
                    yield max(first, begin_s), min(last, end_s)


@dataclass(frozen=True, slots=True)
class Activation:
    """When a zone is active: in any of some periods."""

    periods: tuple[Period, ...] = (Period(),)

    @property
    def is_permanent(self) -> bool:
        """Whether it is active at all times."""
        return any(p.begin_s == -math.inf and p.end_s == math.inf and not p.windows for p in self.periods)

    def spans(self, from_s: float, until_s: float) -> list[Span]:
        """Return when it is active between two finite times, in order, joined where they touch."""
        if self.is_permanent:
            return [(from_s, until_s)]
        joined: list[Span] = []
        for begin_s, end_s in sorted(span for period in self.periods for span in period.spans(from_s, until_s)):
            if joined and begin_s <= joined[-1][1]:
                joined[-1] = joined[-1][0], max(joined[-1][1], end_s)
            else:
                joined.append((begin_s, end_s))
        return joined

    def __str__(self) -> str:
        return "always" if self.is_permanent else "; ".join(_period_text(period) for period in self.periods) or "never"


ALWAYS = Activation()
_DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")


def _period_text(period: Period) -> str:
    dates = [
        f"{word} {date_clock(datetime.fromtimestamp(time_s, UTC))}Z"
        for word, time_s in (("from", period.begin_s), ("until", period.end_s))
        if math.isfinite(time_s)
    ]
    return " ".join([*dates, ", ".join(_window_text(window) for window in period.windows)]).strip()


def _window_text(window: Window) -> str:
    days = "daily" if window.days == EVERY_DAY else " ".join(_DAYS[day] for day in sorted(window.days))
    clock = [
        event or str(timedelta(seconds=time_s % DAY_S))[:-3]
        for event, time_s in zip(window.events, (window.begin_s, window.end_s), strict=True)
    ]
    return f"{days} {clock[0]}-{clock[1]} {window.zone}"


def sun_s(event: str, day: date, place: tuple[float, float], zone: tzinfo) -> float | None:
    """Time of one of `SUN_EVENTS` at a place on a day of a clock, POSIX seconds; None if it does not occur that day.

    Raises a `ModuleNotFoundError` if astral (extra ``weather``) is not installed.
    """
    from astral import Observer
    from astral.sun import dawn, dusk, sunrise, sunset

    find: Any = dict(zip(SUN_EVENTS, (dawn, sunrise, sunset, dusk), strict=True))[event]
    try:
        return float(find(Observer(*place), date=day, tzinfo=zone).timestamp())
    except ValueError:
        return None


def clock_s(text: str) -> tuple[float, tzinfo | None] | None:
    """Read a time of day, ``17:00:00.00+02:00``: seconds after midnight and its zone, None if it has none.

    None if it is not a time of day.
    """
    found = _CLOCK.fullmatch(text.strip())
    if found is None:
        return None
    hours, minutes, seconds = (int(part or 0) for part in found.groups()[:3])
    if hours > 24 or minutes > 59 or seconds > 60 or (hours == 24 and minutes + seconds):
        return None
    zone = found.group(4)
    if zone is None:
        return hours * 3600.0 + minutes * 60.0 + seconds, None
    if zone in ("Z", "UTC"):
        return hours * 3600.0 + minutes * 60.0 + seconds, UTC
    digits = zone[1:].replace(":", "").ljust(4, "0")
    offset = timedelta(hours=int(digits[:2]), minutes=int(digits[2:]))
    if offset >= timedelta(days=1):
        return None
    return hours * 3600.0 + minutes * 60.0 + seconds, timezone(-offset if zone[0] == "-" else offset)


def instant_s(text: str, zone: tzinfo = UTC) -> float | None:
    """Read a date with a time of day, by ISO 8601 or as in e-mails; a time without an offset is in the zone.

    None for any other text.
    """
    for read in (datetime.fromisoformat, parsedate_to_datetime):
        try:
            instant = read(text.strip())
            return (instant if instant.tzinfo else instant.replace(tzinfo=zone)).timestamp()
        except (ValueError, TypeError, OverflowError, IndexError):
            continue
    return None


def days_of(words: Sequence[object]) -> frozenset[int] | None:
    """Read days of the week, ``MON`` or ``ANY``; no word, or an empty one, means any day. None if one is not a day."""
    days: set[int] = set()
    for word in words or ("",):
        name = str(word or "").strip().title()[:3]
        if name in ("", "Any"):
            days |= EVERY_DAY
        elif name in _DAYS:
            days.add(_DAYS.index(name))
        else:
            return None
    return frozenset(days)
