"""ArduPilot DataFlash logs (``.bin``).

The log describes itself: FMT messages name the types of message, their fields and how these are packed.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from link.logs import dataflash_kernels as kernels
from link.logs.log import MAX_EVENTS, LogEvent, LogSummary
from link.logs.pieces import HOLD_S, WARM_UP_S, InOrder, read_pieces
from models.errors import one_line
from models.telemetry import TimeBase

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from models.telemetry import TelemetryTrack

PACKED = {
    "a": ("<i2", 32, 1.0),
    "b": ("i1", 1, 1.0),
    "B": ("u1", 1, 1.0),
    "g": ("<f2", 1, 1.0),
    "h": ("<i2", 1, 1.0),
    "H": ("<u2", 1, 1.0),
    "i": ("<i4", 1, 1.0),
    "I": ("<u4", 1, 1.0),
    "f": ("<f4", 1, 1.0),
    "d": ("<f8", 1, 1.0),
    "n": ("S4", 1, 1.0),
    "N": ("S16", 1, 1.0),
    "Z": ("S64", 1, 1.0),
    "c": ("<i2", 1, 0.01),
    "C": ("<u2", 1, 0.01),
    "e": ("<i4", 1, 0.01),
    "E": ("<u4", 1, 0.01),
    "L": ("<i4", 1, 1e-7),
    "M": ("u1", 1, 1.0),
    "q": ("<i8", 1, 1.0),
    "Q": ("<u8", 1, 1.0),
}
"""Type and factor of each letter of a format."""
GPS_EPOCH_S = 315_964_800.0
LEAP_S = 18.0
"""GPS time is ahead of UTC by so much since 2017."""


@dataclass(frozen=True, slots=True)
class MessageFormat:
    """How one type of message is packed."""

    name: str
    layout: np.dtype[np.void]
    factor: dict[str, float]


def _format(body: bytes) -> tuple[int, MessageFormat] | None:
    """Read a FMT message; None where it makes no sense."""
    length = body[1]
    name, letters, columns = (
        part.split(b"\0")[0].decode("ascii", "replace") for part in (body[2:6], body[6:22], body[22:86])
    )
    names = columns.split(",") if columns else []
    if len(names) != len(letters) or len(set(names)) != len(names) or not set(letters) <= PACKED.keys():
        return None
    parts: list[Any] = [
        (field, PACKED[letter][0], PACKED[letter][1]) if PACKED[letter][1] > 1 else (field, PACKED[letter][0])
        for field, letter in zip(names, letters, strict=True)
    ]
    layout = np.dtype(parts) if parts else np.dtype([])
    if layout.itemsize != length - 3:
        return None
    factor = {field: PACKED[letter][2] for field, letter in zip(names, letters, strict=True)}
    return body[0], MessageFormat(name, layout, factor)


@dataclass(frozen=True, slots=True, eq=False)
class Messages:
    """The messages of a piece of a log: place of each in it and type, shape (messages,), and bytes that belong to none."""

    offset: NDArray[np.int64]
    kind: NDArray[np.uint8]
    skipped: int


class DataFlash:
    """An ArduPilot DataFlash log.

    Parameters
    ----------
    path : Path
        Read once piece by piece to index it; again for each use.

    Raises
    ------
    InputError
        The file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._length = np.zeros(256, dtype=np.int64)
        self._length[kernels.FORMAT_TYPE] = kernels.FORMAT_LENGTH
        self._formats: dict[int, MessageFormat] = {}
        self._counts = np.zeros(256, dtype=np.int64)
        self._skipped = 0
        self._zero_s: float | None = None
        self._range_s = (math.inf, -math.inf)
        self._pieces: list[tuple[float, int]] = []
        self._texts: list[tuple[float, str]] = []
        self._index()
        self.summary = self._summary()

    def tracks(self, from_s: float = -math.inf, to_s: float = math.inf) -> Iterator[TelemetryTrack]:
        """Return the telemetry piece by piece."""
        samples = InOrder(1)
        zero_s = self._zero_s or 0.0
        for _, data, found in read_pieces(self.path, self._find, begin=self._begin(from_s)):
            reports = {}
            for name, speak in SPOKEN.items():
                fields = self._fields(name, data, found)
                times = _boot_s(fields)
                with contextlib.suppress(KeyError):  # another generation of the log, without such a field
                    if times is not None:
                        reports[name] = times + zero_s, speak(fields)
            track = samples.feed(reports)
            if len(track) and track.time_s[0] >= to_s:
                return
            part = track.between(from_s, to_s)
            if len(part):
                yield part
        part = samples.flush().between(from_s, to_s)
        if len(part):
            yield part

    def _begin(self, from_s: float) -> int:
        """Return a place from which everything from a time on, and what has to be known by then, can be read."""
        wanted_s = from_s - WARM_UP_S - HOLD_S - (self._zero_s or 0.0)
        before = [place for latest_s, place in self._pieces if latest_s <= wanted_s]
        return before[-1] if before else 0

    def _find(self, data: NDArray[np.uint8], *, final: bool) -> tuple[Messages, int]:
        most = len(data) // 3 + 1
        offset, kind = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.uint8)
        count, used, skipped = kernels.find_messages(data, final, self._length, offset, kind)
        return Messages(offset[:count], kind[:count], skipped), used

    def _fields(self, name: str, data: NDArray[np.uint8], found: Messages) -> dict[str, NDArray[Any]]:
        """Messages of one type in a piece: columns in the units of the log, shape (messages,); empty where there is none."""
        for number, form in self._formats.items():
            if form.name == name:
                rows = found.offset[found.kind == number]
                if not len(rows):
                    continue
                place = rows[:, None] + np.arange(3, 3 + form.layout.itemsize)
                table = np.ascontiguousarray(data[place]).view(form.layout)[:, 0]
                return {
                    field: table[field] * factor if factor != 1.0 else table[field]
                    for field, factor in form.factor.items()
                }
        return {}

    def _index(self) -> None:
        """Go through the log once."""
        for base, data, found in read_pieces(self.path, self._find):
            self._pieces.append((self._range_s[1], base))
            self._skipped += found.skipped
            self._counts += np.bincount(found.kind, minlength=256)
            for at in found.offset[found.kind == kernels.FORMAT_TYPE]:
                form = _format(data[at + 3 : at + kernels.FORMAT_LENGTH].tobytes())
                if form is not None:
                    self._formats[form[0]] = form[1]
            for name in SPOKEN:
                times = _boot_s(self._fields(name, data, found))
                if times is not None and len(times):
                    low, high = self._range_s
                    self._range_s = min(low, float(times.min())), max(high, float(times.max()))
            if self._zero_s is None:
                self._zero_s = _utc_zero(self._fields("GPS", data, found))
            if len(self._texts) < MAX_EVENTS:
                self._read_texts(self._fields("MSG", data, found))

    def _read_texts(self, fields: dict[str, NDArray[Any]]) -> None:
        times = _boot_s(fields)
        texts = fields.get("Message", np.empty(0, dtype="S1"))
        stamps = times if times is not None else np.full(len(texts), self._range_s[0])
        for time_s, text in zip(stamps.tolist(), texts, strict=False):
            self._texts.append((time_s, one_line(bytes(text).decode("utf-8", "replace"))))

    def _names(self) -> dict[str, int]:
        named: dict[str, int] = {}
        for number in np.flatnonzero(self._counts):
            form = self._formats.get(int(number))
            name = "FMT" if number == kernels.FORMAT_TYPE else f"UNKNOWN_{number}" if form is None else form.name
            named[name] = named.get(name, 0) + int(self._counts[number])
        return named

    def _summary(self) -> LogSummary:
        by_type = self._names()
        doubt = "no GPS time was logged: times count from the start of the autopilot"
        base = TimeBase("the autopilot's clock, set by GPS")
        if self._zero_s is None:
            base = TimeBase("the autopilot's clock since its start", absolute=False, doubts=(doubt,))
        zero_s, (first_s, last_s) = self._zero_s or 0.0, self._range_s
        known = math.isfinite(first_s)
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
            events=tuple(LogEvent(time_s + zero_s, 1, text) for time_s, text in self._texts[:MAX_EVENTS]),
        )


def _boot_s(fields: dict[str, NDArray[Any]]) -> NDArray[np.float64] | None:
    """Seconds since the autopilot's start; None where the messages do not say."""
    for name, scale in (
        ("TimeUS", 1e-6),
        ("T", 1e-3),
        ("TimeMS", 1e-3),
    ):  # a receiver's own TimeMS, beside T, is of the week
        if name in fields:
            return np.asarray(fields[name], dtype=np.float64) * scale
    return None


def _utc_zero(fields: dict[str, NDArray[Any]]) -> float | None:
    """POSIX seconds of the autopilot's start, through the GPS week, where one was logged."""
    boot = _boot_s(fields)
    week = fields.get("GWk", fields.get("Week"))
    of_week = fields.get("GMS", fields.get("TimeMS") if "T" in fields else None)
    if boot is None or week is None or of_week is None:
        return None
    fixed = np.flatnonzero((np.asarray(week) > 1000) & (np.asarray(week) < 5000))
    if not len(fixed):
        return None
    row = fixed[0]
    utc = GPS_EPOCH_S + float(week[row]) * 604_800.0 + float(of_week[row]) * 1e-3
    leap = LEAP_S if utc > 1_483_228_800.0 else LEAP_S - 1.0
    return utc - leap - float(boot[row])


def _attitude(fields: Any) -> dict[str, NDArray[np.float64]]:
    return {
        "roll_rad": np.radians(fields["Roll"]),
        "pitch_rad": np.radians(fields["Pitch"]),
        "yaw_rad": np.radians(fields["Yaw"]),
    }


def _gps(fields: Any) -> dict[str, NDArray[np.float64]]:
    fixed = np.asarray(fields["Status"]) >= 3
    course = np.radians(fields["GCrs"])
    columns = {
        "lat_deg": fields["Lat"],
        "lon_deg": fields["Lng"],
        "alt_msl_m": fields["Alt"],
        "vel_north_mps": fields["Spd"] * np.cos(course),
        "vel_east_mps": fields["Spd"] * np.sin(course),
        "vel_down_mps": fields["VZ"],
    }
    if "RelAlt" in fields:
        columns["height_m"] = fields["RelAlt"]
    return {name: np.where(fixed, values, np.nan) for name, values in columns.items()}


def _estimate(fields: Any) -> dict[str, NDArray[np.float64]]:
    core = np.asarray(fields["C"]) == 0 if "C" in fields else np.ones(len(fields["VN"]), dtype=bool)
    return {
        f"vel_{name}_mps": np.where(core, fields[key], np.nan)
        for name, key in (("north", "VN"), ("east", "VE"), ("down", "VD"))
    }


def _wind(fields: Any) -> dict[str, NDArray[np.float64]]:
    north, east = (np.asarray(fields[key], dtype=np.float64) for key in ("VWN", "VWE"))
    alive = (north != 0.0) | (east != 0.0)
    return {"wind_north_mps": np.where(alive, north, np.nan), "wind_east_mps": np.where(alive, east, np.nan)}


def _battery(fields: Any) -> dict[str, NDArray[np.float64]]:
    volts, amperes = (np.asarray(fields[key], dtype=np.float64) for key in ("Volt", "Curr"))
    if "Vcc" in fields:  # the CURR message of old logs counts in hundredths
        volts, amperes = volts * 0.01, amperes * 0.01
    columns = {"voltage_v": volts, "current_a": amperes}
    connected = bool((volts > 1.0).any()) and bool((amperes != 0.0).any())
    soc = {"soc": np.asarray(fields["RemPct"], dtype=np.float64) / 100.0} if "RemPct" in fields else {}
    return (
        {name: np.where(volts > 1.0, values, np.nan) for name, values in (columns | soc).items()} if connected else {}
    )


def _airspeed(fields: Any) -> dict[str, NDArray[np.float64]]:
    return {"airspeed_mps": np.where(fields["Airspeed"] > 0.0, fields["Airspeed"], np.nan)}


SPOKEN = {
    "ATT": _attitude,
    "GPS": _gps,
    "EKF1": _estimate,
    "NKF1": _estimate,
    "XKF1": _estimate,
    "EKF2": _wind,
    "NKF2": _wind,
    "XKF2": _wind,
    "CURR": _battery,
    "BAT": _battery,
    "ARSP": _airspeed,
}
"""Messages that telemetry is made of, and what each says."""
