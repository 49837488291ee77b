"""ArduPilot DataFlash logs (``.bin``).

The log describes itself: FMT messages define the types of message, their fields and their packing.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.logs.common.log import LogEvent, LogSummary
from skyway.link.logs.common.pieces import HOLD_S, WARM_UP_S, InOrder, read_pieces
from skyway.link.logs.common.stamps import SteadyTimes
from skyway.link.logs.common.table_kernels import table_of
from skyway.link.logs.common.vehicle_kind import WATCHED, KindEvidence
from skyway.link.logs.dataflash import dataflash_kernels as kernels
from skyway.link.logs.dataflash.events import EVENT_TYPES, DataFlashEvents
from skyway.link.logs.dataflash.messages import ESTIMATES, SPOKEN, doubting, hovering, quantities
from skyway.models.base.views import counted
from skyway.models.drones.telemetry import TimeBase

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from skyway.link.logs.common.pieces import Reports
    from skyway.link.logs.dataflash.events import Stamped
    from skyway.link.logs.dataflash.messages import Fields
    from skyway.models.drones.telemetry import TelemetryTrack

PACKED = {
    "a": ("32<i2", 1.0),
    "b": ("i1", 1.0),
    "B": ("u1", 1.0),
    "g": ("<f2", 1.0),
    "h": ("<i2", 1.0),
    "H": ("<u2", 1.0),
    "i": ("<i4", 1.0),
    "I": ("<u4", 1.0),
    "f": ("<f4", 1.0),
    "d": ("<f8", 1.0),
    "n": ("S4", 1.0),
    "N": ("S16", 1.0),
    "Z": ("S64", 1.0),
    "c": ("<i2", 0.01),
    "C": ("<u2", 0.01),
    "e": ("<i4", 0.01),
    "E": ("<u4", 0.01),
    "L": ("<i4", 1e-7),
    "M": ("u1", 1.0),
    "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
}
"""Type and factor of each letter of a format."""
GPS_EPOCH_S = 315_964_800.0
LEAP_S = 18.0
"""GPS time has been ahead of UTC by this since 2017."""
LASTING = frozenset(("armed", "landed", "mode", "fixed_wing"))
"""Quantities reported only when they change."""


@dataclass(frozen=True, slots=True)
class MessageFormat:
    """Packing of one type of message."""

    name: str
    layout: np.dtype[np.void]
    factor: dict[str, float]


_WATCHED = np.array([name.encode() for name in sorted(WATCHED)])
_SIZES = np.full(256, -1, dtype=np.int64)
for _letter, (_kind, _) in PACKED.items():
    _SIZES[ord(_letter)] = np.dtype(_kind).itemsize


def _text(part: bytes) -> str:
    return part.split(b"\0")[0].decode("ascii", "replace")


def _format(body: bytes) -> tuple[int, MessageFormat] | None:
    """Read a FMT message; None if it is invalid."""
    length = body[1]
    name, letters, columns = (_text(part) for part in (body[2:6], body[6:22], body[22:86]))
    names = columns.split(",") if columns else []
    if len(names) != len(letters) or len(set(names)) != len(names) or not set(letters) <= PACKED.keys():
        return None
    layout = np.dtype([(field, PACKED[letter][0]) for field, letter in zip(names, letters, strict=True)])
    if layout.itemsize != length - 3:
        return None
    factor = {field: PACKED[letter][1] for field, letter in zip(names, letters, strict=True)}
    return body[0], MessageFormat(name, layout, factor)


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """The messages of a piece of a log: position of each in it and type, shape (messages,), bytes outside messages, counts by type."""

    offset: NDArray[np.int64]
    kind: NDArray[np.uint8]
    skipped: int
    counts: NDArray[np.int64]


@dataclass(slots=True)
class _Piece:
    """State at the begin of a piece of the log: its position, the latest time before it, and lasting values."""

    place: int
    latest_s: float
    lasting: dict[str, float] = field(default_factory=dict)


class DataFlash:
    """An ArduPilot DataFlash log: read once piece by piece to index it, and again for each use.

    Raises an `InputError` if the file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._length = np.zeros(256, dtype=np.int64)
        self._packed = np.zeros(256, dtype=np.int64)
        self._length[kernels.FORMAT_TYPE] = kernels.FORMAT_LENGTH
        self._packed[kernels.FORMAT_TYPE] = kernels.FORMAT_LENGTH - 3
        self._named: dict[int, str] = {}
        self._formats: dict[int, MessageFormat] = {}
        self._counts = np.zeros(256, dtype=np.int64)
        self._skipped = 0
        self._zero_s: float | None = None
        self._range_s = (math.inf, -math.inf)
        self._pieces: list[_Piece] = []
        self._evidence = KindEvidence()
        self._events = DataFlashEvents()
        self._index()
        self.summary = self._summary()

    def tracks(self, from_s: float = -math.inf, to_s: float = math.inf) -> Iterator[TelemetryTrack]:
        """Return the telemetry piece by piece."""
        steady, begin = SteadyTimes(), self._begin(from_s)
        pieces = read_pieces(self.path, self._find, begin=begin.place)
        reports = (self._reports(data, found, steady) for _, data, found in pieces)
        known_s = begin.latest_s + (self._zero_s or 0.0)
        return InOrder(1, LASTING, known_s, begin.lasting).tracks(reports, from_s, to_s)

    def _reports(self, data: NDArray[np.uint8], found: Messages, steady: SteadyTimes) -> Reports:
        """Telemetry in the messages of a piece, with times of the log."""
        zero_s = self._zero_s or 0.0
        stamped = self._stamped(data, found, SPOKEN, steady)
        reports = {}
        for name, (_, times, fields) in stamped.items():
            with contextlib.suppress(KeyError):  # another generation of the log, without such a field
                for series, (when, columns) in quantities(name, fields, times + zero_s).items():
                    if name == "MODE" and self._vtol:
                        columns["fixed_wing"] = hovering(columns["mode"])
                    left_out = "vel_" if name == "GPS" and self._estimates else "-"
                    reports[series] = (
                        when,
                        {key: values for key, values in columns.items() if not key.startswith(left_out)},
                    )
        accuracy = reports.pop("GPA", None)
        if accuracy is not None and "GPS" in reports:
            reports["GPS"] = doubting(reports["GPS"], accuracy)
        return reports

    @property
    def _estimates(self) -> bool:
        """Whether the autopilot's filter reports the velocity."""
        return any(name in self.summary.by_type for name in ESTIMATES)

    @property
    def _vtol(self) -> bool:
        return self.summary.vehicle(1).kind == "VTOL"

    def _begin(self, from_s: float) -> _Piece:
        """Return a piece from which everything from a time on, with the values known by then, can be read."""
        wanted_s = from_s - WARM_UP_S - HOLD_S - (self._zero_s or 0.0)
        before = [piece for piece in self._pieces if piece.latest_s <= wanted_s]
        return before[-1] if before else _Piece(0, -math.inf)

    def _find(self, data: NDArray[np.uint8], *, final: bool) -> tuple[Messages, int]:
        most = len(data) // 3 + 1
        offset, kind = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.uint8)
        count, used, skipped = kernels.find_messages(data, final, self._length, self._packed, _SIZES, offset, kind)
        return Messages(offset[:count], kind[:count], skipped, np.bincount(kind[:count], minlength=256)), used

    def _fields(self, name: str, data: NDArray[np.uint8], found: Messages) -> tuple[NDArray[np.int64], Fields]:
        """Messages of one type in a piece: their positions, and columns in the units of the log; empty if there are none."""
        for number, form in self._formats.items():
            if form.name == name and found.counts[number]:
                rows = found.offset[found.kind == number]
                table = table_of(data, rows + 3, form.layout)
                return rows, {
                    field: table[field] * factor if factor != 1.0 else table[field]
                    for field, factor in form.factor.items()
                }
        return np.empty(0, dtype=np.int64), {}

    def _stamped(
        self, data: NDArray[np.uint8], found: Messages, names: Iterable[str], steady: SteadyTimes
    ) -> dict[str, Stamped]:
        """Positions, times since the start (NaN: implausible) and fields of messages of some types.

        A message without a time of its own has that of the preceding one.
        """
        tables = {name: self._fields(name, data, found) for name in names}
        boots = {name: _boot_s(fields) for name, (_, fields) in tables.items() if fields}
        timed = {name: times for name, times in boots.items() if times is not None}
        places = [tables[name][0] for name in timed]
        good = steady.of_tables(places, list(timed.values()))
        own = {name: np.where(fine, timed[name], np.nan) for name, fine in zip(timed, good, strict=True)}
        place, times = np.concatenate([np.empty(0, np.int64), *places]), np.concatenate([np.empty(0), *own.values()])
        order = np.argsort(place, kind="stable")
        order = order[np.isfinite(times[order])]
        for name in boots.keys() - timed.keys():
            before = np.searchsorted(place[order], tables[name][0]) - 1
            known = times[order]
            own[name] = np.where(before >= 0, known[np.maximum(before, 0)], known[0]) if len(known) else before * np.nan
        return {name: (tables[name][0], own[name], tables[name][1]) for name in boots}

    def _index(self) -> None:
        """Read the log once."""
        steady = SteadyTimes()
        names = dict.fromkeys((*SPOKEN, *EVENT_TYPES, "PARM"))
        for base, data, found in read_pieces(self.path, self._find):
            self._pieces.append(_Piece(base, self._range_s[1], self._events.lasting()))
            self._skipped += found.skipped
            self._counts += found.counts
            for at in found.offset[found.kind == kernels.FORMAT_TYPE]:
                body = data[at + 3 : at + kernels.FORMAT_LENGTH].tobytes()
                self._named[body[0]] = _text(body[2:6])
                form = _format(body)
                if form is not None:
                    self._formats[form[0]] = form[1]
            stamped = self._stamped(data, found, names, steady)
            for name, (_, times, _) in stamped.items():
                if name in SPOKEN and np.isfinite(times).any():
                    low, high = self._range_s
                    self._range_s = min(low, float(np.nanmin(times))), max(high, float(np.nanmax(times)))
            if self._zero_s is None and "GPS" in stamped:
                self._zero_s = _utc_zero(stamped["GPS"][2], stamped["GPS"][1])
            for name, value in _parameters(stamped.get("PARM")):
                self._evidence.parameter(name, value)
            self._events.see(stamped, self._evidence)
        self._odd_stamps = steady.odd

    def _names(self) -> dict[str, int]:
        named: dict[str, int] = {}
        for number in np.flatnonzero(self._counts):
            known = self._named.get(int(number), f"UNKNOWN_{number}")
            name = "FMT" if number == kernels.FORMAT_TYPE else known
            named[name] = named.get(name, 0) + int(self._counts[number])
        return named

    def _summary(self) -> LogSummary:
        by_type = self._names()
        doubts: tuple[str, ...] = ()
        if self._odd_stamps:
            doubts += (f"{counted(self._odd_stamps, 'message')} ignored: the time is far from the neighbours'",)
        base = TimeBase("the autopilot's clock, set by GPS", doubts=doubts)
        if self._zero_s is None:
            doubts = ("no GPS time was logged: times count from the start of the autopilot", *doubts)
            base = TimeBase("the autopilot's clock since its start", absolute=False, doubts=doubts)
        zero_s, (first_s, last_s) = self._zero_s or 0.0, self._range_s
        known = math.isfinite(first_s)
        if "QTUN" in by_type:
            self._evidence.hovers = "messages QTUN"
        vehicle = self._evidence.vehicle()
        return LogSummary(
            format="dataflash",
            messages=int(self._counts.sum()),
            by_type=by_type,
            skipped_bytes=int(self._skipped),
            systems=(1,) if "ATT" in by_type or "GPS" in by_type else (),
            others=(),
            time_base=base,
            start_s=first_s + zero_s if known else math.nan,
            end_s=last_s + zero_s if known else math.nan,
            events=tuple(
                LogEvent((first_s if math.isnan(time_s) else time_s) + zero_s, 1, text)
                for time_s, text in self._events.texts(vehicle.kind)
            ),
            vehicles={1: vehicle},
            doubted={1: tuple((begin + zero_s, end + zero_s) for begin, end in self._events.doubted())},
        )


def _parameters(stamped: Stamped | None) -> Iterator[tuple[str, float]]:
    """Names and values of those messages PARM that are relevant to the kind of vehicle."""
    fields: Fields = {} if stamped is None else stamped[2]
    if {"Name", "Value"} <= fields.keys():
        for row in np.flatnonzero(np.isin(fields["Name"], _WATCHED)).tolist():
            yield fields["Name"][row].decode("ascii"), float(fields["Value"][row])


def _boot_s(fields: Fields) -> NDArray[np.float64] | None:
    """Seconds since the autopilot's start; None if the messages have no time."""
    for name, scale in (
        ("TimeUS", 1e-6),
        ("T", 1e-3),
        ("TimeMS", 1e-3),
    ):  # a receiver's own TimeMS, beside T, is of the week
        if name in fields:
            return np.asarray(fields[name], dtype=np.float64) * scale
    return None


def _utc_zero(fields: Fields, boot: NDArray[np.float64]) -> float | None:
    """POSIX seconds of the autopilot's start, from the GPS week, if one was logged."""
    week = fields.get("GWk", fields.get("Week"))
    of_week = fields.get("GMS", fields.get("TimeMS") if "T" in fields else None)
    if week is None or of_week is None:
        return None
    status = np.asarray(fields.get("Status", np.full(len(week), 3)))
    fixed = np.flatnonzero((np.asarray(week) > 1000) & (np.asarray(week) < 5000) & (status >= 2) & np.isfinite(boot))
    if not len(fixed):
        return None
    row = fixed[0]
    utc = GPS_EPOCH_S + float(week[row]) * 604_800.0 + float(of_week[row]) * 1e-3
    leap = LEAP_S if utc > 1_483_228_800.0 else LEAP_S - 1.0
    return utc - leap - float(boot[row])
