"""All monitors of one vehicle, fed piece by piece in bounded memory."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, Protocol, Self, TypeVar

import numpy as np

from skyway.link.replay.known_wind import KnownWind, KnownWindWatch
from skyway.link.replay.monitors import CHECK_EVERY_S, BatteryWatch, LegWatch, Notice, Seconds, TrustWatch, WindWatch
from skyway.models.drones.telemetry import TelemetryTrack
from skyway.models.wind.estimation.filter import FilteredWind

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from skyway.models.wind.estimation.live import LiveWind

    Listener = Callable[[TelemetryTrack, FilteredWind], None]

MAX_ROWS = 20_000
"""Rows kept of a log for pictures; of a longer one every second, fourth, … second is kept."""
MAX_PARTS = 256


class _Rows(Protocol):
    """What can be cut into parts and joined again: a track of telemetry, a course of the wind."""

    def __len__(self) -> int: ...
    def part(self, rows: Any) -> Self: ...
    @classmethod
    def joined(cls, parts: Any) -> Self: ...


Rows = TypeVar("Rows", bound=_Rows)


class Thinned(Generic[Rows]):
    """Rows of a long stream, evenly spaced, at most `most` of them; copies, so that the stream can be forgotten."""

    def __init__(self, kind: type[Rows], most: int = MAX_ROWS) -> None:
        self._kind, self._most = kind, most
        self._parts: list[Rows] = []
        self._seen, self._kept, self._stride = 0, 0, 1

    def add(self, rows: Rows) -> None:
        """Take the next piece."""
        first = -self._seen % self._stride
        self._seen += len(rows)
        if first < len(rows):
            part = rows.part(np.arange(first, len(rows), self._stride))
            self._parts.append(part)
            self._kept += len(part)
        if len(self._parts) > MAX_PARTS:
            self._parts = [self._kind.joined(self._parts)]
        while self._kept > self._most:
            whole = self._kind.joined(self._parts)
            whole = whole.part(np.arange(0, len(whole), 2))
            self._parts, self._kept, self._stride = [whole], len(whole), 2 * self._stride

    def rows(self) -> Rows:
        """The rows kept."""
        return self._kind.joined(self._parts)


@dataclass(slots=True)
class WindTally:
    """Sums over all estimates to which something was measured."""

    count: int = 0
    doubted: int = 0
    """Estimates that the filter's own health called inconsistent, which count nowhere else."""
    north: float = 0.0
    east: float = 0.0
    """`north`, `east`: sums of the wind, m/s."""
    nis: float = 0.0
    """Sum of the normalised innovations squared."""
    off_north: float = 0.0
    off_east: float = 0.0
    off_squared: float = 0.0
    expected_north: float = 0.0
    expected_east: float = 0.0
    """`off_north`, `off_east`, `off_squared`, `expected_north`, `expected_east`: sums of estimate minus forecast, of
    its square, and of the forecast."""

    def add(self, course: FilteredWind) -> None:
        """Add a piece of the course."""
        off = course.wind - course.forecast
        self.count += len(course)
        self.nis += float(course.nis.sum())
        self.north, self.east = self.north + float(course.wind[:, 0].sum()), self.east + float(course.wind[:, 1].sum())
        self.off_north += float(off[:, 0].sum())
        self.off_east += float(off[:, 1].sum())
        self.off_squared += float((off**2).sum())
        self.expected_north += float(course.forecast[:, 0].sum())
        self.expected_east += float(course.forecast[:, 1].sum())

    def mean(self, total: float) -> float:
        """A sum as a mean; NaN of nothing."""
        return total / self.count if self.count else math.nan


class FlightMonitor:
    """Watches one vehicle, and the wind by a filter that has its drag and forecast.

    `listener` is called each whole second: telemetry rows, and the filter's course over the same seconds.
    """

    def __init__(self, wind: LiveWind, listener: Listener | None = None) -> None:
        self.wind = wind
        self.legs, self.battery, self.tally = LegWatch(), BatteryWatch(), WindTally()
        self.end_s = math.nan
        """Time of the newest sample."""
        self._seconds = Seconds()
        self._known = KnownWindWatch()
        self._wind_watch, self._trust_watch = WindWatch(wind), TrustWatch()
        self._window = math.nan
        self._listener = listener
        self._rows = Thinned(TelemetryTrack)
        self._course = Thinned(FilteredWind)

    def feed(self, track: TelemetryTrack) -> list[Notice]:
        """Take samples not older than those before; return what was noticed, in the order of time."""
        found: list[Notice] = []
        for part in pieces(track, CHECK_EVERY_S):
            window = math.floor(float(part.time_s[0]) / CHECK_EVERY_S)
            if window != self._window:
                self._window = window
                found += self._wind_watch.check(self.end_s)
            self.end_s = float(part.time_s[-1])
            found += self._take(self._seconds.feed(part), self.wind.feed(part))
        return sorted(found, key=lambda notice: notice.time_s)

    def close(self) -> list[Notice]:
        """The stream has ended; return what is noticed at its end."""
        found = self._take(self._seconds.flush(), self.wind.close())
        found += self._wind_watch.check(self.end_s)
        found += self.legs.close(self.end_s)
        return sorted(found, key=lambda notice: notice.time_s)

    def seconds(self) -> TelemetryTrack:
        """A row a second, thinned where the log is very long."""
        return self._rows.rows()

    def course(self) -> FilteredWind:
        """The estimates to which something was measured, and which are consistent, thinned likewise."""
        return self._course.rows()

    def known(self) -> KnownWind:
        """What is known of the wind of the flights so far."""
        airborne_s = sum(phase.time_s for phase in self.legs.phases().values())
        end_s = self.legs.legs[-1].end_s if self.legs.legs else self.end_s
        return self._known.found(FilteredWind.empty(0), airborne_s, end_s)

    def _take(self, rows: TelemetryTrack, course: FilteredWind) -> list[Notice]:
        seen = course.part(np.isfinite(course.nis))
        measured = seen.part(seen.trusted)
        self.tally.doubted += len(seen) - len(measured)
        self.tally.add(measured)
        self._known.add(seen)
        self._rows.add(rows)
        self._course.add(measured)
        if self._listener is not None and len(rows):
            self._listener(rows, course)
        noticed = self.legs.feed(rows) + self.battery.feed(rows) + self._trust_watch.feed(rows)
        return noticed + self._wind_watch.feed(course)


def pieces(track: TelemetryTrack, length_s: float) -> Iterator[TelemetryTrack]:
    """Cut a track at whole multiples of a length of time."""
    number = np.floor(track.time_s / length_s)
    edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(track)]
    for begin, end in itertools.pairwise(edges):
        if end > begin:
            yield track.part(slice(begin, end))
