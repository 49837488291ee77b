"""Opening hours of pads: their notation, and the times at which a station is closed.

A small part of OpenStreetMap's notation: ``Mo-Fr 07:00-19:00; Sa 08:00-12:00,13:00-17:00; Su off``. Days without
a rule are closed; a later rule for a day overrides an earlier one; a rule without days holds for every day. Times are local;
a span whose end is not after its beginning ends on the next day (``22:00-06:00``).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.queues.load import zone
from skyway.models.queues.paths import QueuePath

if TYPE_CHECKING:
    from numpy.typing import NDArray

ALWAYS = "24/7"
DAYS = ("Mo", "Tu", "We", "Th", "Fr", "Sa", "Su")
DAY_MIN = 24 * 60
EDGE_S = 1e-6
"""A time this long after the edge of a closure is on its other side."""
EXAMPLE = "such as 'Mo-Fr 07:00-19:00; Sa 08:00-12:00', '22:00-06:00' or 24/7"
_RULE = re.compile(r"(?:(?P<days>[A-Z][a-z](?:[-,][A-Z][a-z])*)\s*)?(?P<spans>off|closed|[\d:,\- ]+)?")
_SPAN = re.compile(r"(\d\d?):(\d\d)\s*-\s*(\d\d?):(\d\d)")


@dataclass(frozen=True, slots=True)
class OpeningHours:
    """Weekly opening times of a station.

    Attributes
    ----------
    spans : tuple of (int, int)
        Minutes of the local week, from Monday 00:00 on, at which it opens and closes; ascending, apart from each other. The last
        may end in the week after. All of the week is one span of its length.
    """

    spans: tuple[tuple[int, int], ...]

    @classmethod
    def parse(cls, text: str) -> OpeningHours:
        """Read opening hours. Raises an `InputError` with the problem."""
        if text.strip() == ALWAYS:
            return cls(((0, 7 * DAY_MIN),))
        of_day: dict[int, list[tuple[int, int]]] = {}
        for rule in text.split(";"):
            found = _RULE.fullmatch(rule.strip())
            if not rule.strip() or found is None or not (found["days"] or found["spans"]):
                raise _wrong(text, rule)
            spans = () if found["spans"] in ("off", "closed") else _spans(found["spans"], text)
            of_day |= {day: list(spans) for day in _days(found["days"], text)}
        minutes = [
            (day * DAY_MIN + begin, day * DAY_MIN + (end if end > begin else end + DAY_MIN))
            for day, spans in of_day.items()
            for begin, end in spans
        ]
        if not minutes:
            raise InputError(
                Fault("is never open", field="open_hours", value=text, remedy="pads 0 says that nobody charges there")
            )
        return cls(_joined(sorted(minutes)))

    @property
    def always(self) -> bool:
        """Whether it never closes."""
        return sum(end - begin for begin, end in self.spans) >= 7 * DAY_MIN

    def closed_between(self, timezone: str, start_s: float, end_s: float) -> NDArray[np.float64]:
        """Times at which it is closed, cut to those between two, POSIX seconds, shape (closures, 2), ascending.

        Where the clock changes, hours are those on the clock: a time that does not exist is as long after midnight as
        before the change, one that comes twice is the first.
        """
        if self.always:
            return np.empty((0, 2))
        place = zone(timezone)
        first = datetime.fromtimestamp(start_s, UTC).astimezone(place).replace(tzinfo=None)
        midnight = first.replace(hour=0, minute=0, second=0, microsecond=0)
        monday = midnight - timedelta(days=first.weekday() + 7)
        weeks = int((end_s - start_s) // (7 * 86400.0)) + 4

        def posix(week: int, minute: int) -> float:
            local = monday + timedelta(days=7 * week, minutes=minute)
            return local.replace(tzinfo=place).timestamp()

        open_ = [(posix(week, a), posix(week, b)) for week in range(weeks) for a, b in self.spans]
        closed = []
        for (_, ends), (begins, _) in pairwise(open_):
            begin, end = max(ends, start_s), min(begins, end_s)
            if end > begin:
                closed.append((begin, end))
        return np.array(closed, dtype=np.float64).reshape(-1, 2)


@lru_cache(maxsize=1024)
def opening_hours(text: str) -> OpeningHours:
    """Return opening hours as written, each text parsed once; an empty text means always open."""
    return OpeningHours.parse(text or ALWAYS)


def closed_path(path: QueuePath, closed_s: NDArray[np.float64], *, spots: int) -> QueuePath:
    """Return the queue of a station that closes at times, shape (closures, 2).

    A drone that would get a pad while the station is closed gets it when the station opens; without holding spots, the same holds for landing.
    """
    if not len(closed_s):
        return path
    begin, end = closed_s.T
    closures = Closures(closed_s)
    # Within an interval a pad is available at max(arrival + delay, pad): the rule changes where arrival + delay begins or ends a closure.
    low = np.concatenate(([-np.inf], path.arrival_s))
    high = np.concatenate((path.arrival_s, [np.inf]))
    delays = (path.delay_s, np.zeros(1)) if spots == 0 else (path.delay_s,)
    cuts = []
    for delay in delays:
        for edges in (begin, end):
            at = edges[None] - np.broadcast_to(delay, path.delay_s.shape)[:, None]
            cuts.append(at[(at > low[:, None]) & (at < high[:, None])])
    added = np.unique(np.concatenate(cuts))
    arrival = np.sort(np.concatenate((path.arrival_s, added)))
    # Each interval of the new path lies within one of the old.
    begins = np.concatenate(([-np.inf], arrival))
    old = np.searchsorted(path.arrival_s, begins, side="right")
    delay, pad_s, land_s = path.delay_s[old], path.pad_s[old], path.land_s[old]
    pad_s = closures.put_off(pad_s, begins + delay)
    if spots == 0:
        land_s = closures.put_off(land_s, begins)
    left = np.sort(np.concatenate((path.left_s, added)))  # no arrival there
    return QueuePath(arrival, pad_s, land_s, delay, path.present, left)


@dataclass(frozen=True, eq=False)
class Closures:
    """Times at which a station is closed.

    Attributes
    ----------
    closed_s : ndarray, shape (closures, 2)
        POSIX seconds, ascending, apart from each other.
    """

    closed_s: NDArray[np.float64]

    def put_off(self, time_s: NDArray[np.float64], least_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Move times that fall into a closure, or whose other times given do, to the opening."""
        begin, end = self.closed_s.T
        reached = np.maximum(time_s, least_s + EDGE_S)
        number = np.searchsorted(begin, reached, side="right") - 1
        shut = (number >= 0) & (reached < end[np.maximum(number, 0)])
        return np.where(shut, end[np.maximum(number, 0)], time_s)

    def within(self, begin_s: NDArray[np.float64], end_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Closed time between two times, s."""
        total = np.zeros(np.broadcast(begin_s, end_s).shape)
        for begin, end in self.closed_s.tolist():
            total += np.maximum(np.minimum(end_s, end) - np.maximum(begin_s, begin), 0.0)
        return total

    def past(self, begin_s: NDArray[np.float64], end_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Time by which it has been open for the span between two times, starting from other ones."""
        found = np.broadcast_to(end_s, np.broadcast(begin_s, end_s).shape).astype(np.float64)
        for begin, end in self.closed_s.tolist():
            inside = (end > begin_s) & (begin < found)
            found = np.where(inside, found + (end - np.maximum(begin, begin_s)), found)
        return found


def _wrong(text: str, part: str) -> InputError:
    return InputError(
        Fault(f"are not opening hours at {part.strip()!r}", field="open_hours", value=text, remedy=EXAMPLE)
    )


def _days(text: str | None, whole: str) -> list[int]:
    if text is None:
        return list(range(7))
    found: list[int] = []
    for part in text.split(","):
        first, _, last = part.partition("-")
        if first not in DAYS or (last or first) not in DAYS:
            raise _wrong(whole, part)
        begin, count = DAYS.index(first), (DAYS.index(last or first) - DAYS.index(first)) % 7 + 1
        found += [(begin + day) % 7 for day in range(count)]
    return found


def _spans(text: str | None, whole: str) -> tuple[tuple[int, int], ...]:
    found = []
    for part in (text or "00:00-24:00").split(","):
        span = _SPAN.fullmatch(part.strip())
        if span is None:
            raise _wrong(whole, part)
        begin, end = (60 * int(span[n]) + int(span[n + 1]) for n in (1, 3))
        if begin >= DAY_MIN or end > DAY_MIN or int(span[2]) > 59 or int(span[4]) > 59:
            raise _wrong(whole, part)
        found.append((begin, end))
    return tuple(found)


def _joined(spans: list[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    """Join spans that touch or overlap, around the end of the week, too."""
    found = [spans[0]]
    for begin, end in spans[1:]:
        if begin <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], end))
        else:
            found.append((begin, end))
    week = 7 * DAY_MIN
    while len(found) > 1 and found[-1][1] >= found[0][0] + week:
        first, *found = found
        found[-1] = (found[-1][0], max(found[-1][1], first[1] + week))
    if found[-1][1] - found[0][0] >= week:
        return ((0, week),)
    return tuple(found)
