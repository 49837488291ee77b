"""ArduPilot DataFlash logs (``.bin``).

The log describes itself: FMT messages name the types of message, their fields and how these are packed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from link.logs import dataflash_kernels as kernels
from link.logs.assembly import Assembler, Stretch
from link.logs.log import MAX_EVENTS, LogEvent, LogSummary
from models.errors import Fault, InputError, one_line
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


class DataFlash:
    """An ArduPilot DataFlash log.

    Parameters
    ----------
    path : Path
        Mapped into memory, not read into it.

    Raises
    ------
    InputError
        The file cannot be read.
    """

    def __init__(self, path: Path) -> None:
        try:
            size = path.stat().st_size
            self._data = np.memmap(path, dtype=np.uint8, mode="r") if size else np.empty(0, dtype=np.uint8)
        except OSError as error:
            raise InputError(Fault(f"cannot be read: {error.strerror or error}", str(path))) from None
        self._find()
        self._time_base, self._zero_s = self._clock()
        self.summary = self._summary()

    def fields(self, name: str) -> dict[str, NDArray[Any]]:
        """Every message of one type: columns in the units of the log, shape (messages,); empty where there is none."""
        for number, form in self._formats.items():
            if form.name == name:
                rows = self._offset[self._kind == number]
                if not len(rows):
                    continue
                place = rows[:, None] + np.arange(3, 3 + form.layout.itemsize)
                table = np.ascontiguousarray(self._data[place]).view(form.layout)[:, 0]
                return {
                    field: table[field] * factor if factor != 1.0 else table[field]
                    for field, factor in form.factor.items()
                }
        return {}

    def tracks(self, from_s: float = -math.inf, to_s: float = math.inf) -> Iterator[TelemetryTrack]:
        """Return the telemetry in one piece."""
        stretch = Stretch()
        for times, columns in self._reports():
            order = np.argsort(times, kind="stable")
            stretch.add(times[order], {name: values[order] for name, values in columns.items()})
        track = Assembler(1).feed(stretch).between(from_s, to_s)
        if len(track):
            yield track

    def _find(self) -> None:
        length = np.zeros(256, dtype=np.int64)
        length[kernels.FORMAT_TYPE] = kernels.FORMAT_LENGTH
        most = len(self._data) // 3 + 1
        offset, kind = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.uint8)
        count, self._skipped = kernels.find_messages(self._data, length, offset, kind)
        self._offset, self._kind = offset[:count].copy(), kind[:count].copy()
        self._formats: dict[int, MessageFormat] = {}
        for at in self._offset[self._kind == kernels.FORMAT_TYPE]:
            form = _format(self._data[at + 3 : at + kernels.FORMAT_LENGTH].tobytes())
            if form is not None:
                self._formats[form[0]] = form[1]

    def _names(self) -> dict[str, int]:
        counts = np.bincount(self._kind, minlength=256)
        named: dict[str, int] = {}
        for number in np.flatnonzero(counts):
            form = self._formats.get(int(number))
            name = "FMT" if number == kernels.FORMAT_TYPE else f"UNKNOWN_{number}" if form is None else form.name
            named[name] = named.get(name, 0) + int(counts[number])
        return named

    def _times(self, fields: dict[str, NDArray[Any]]) -> NDArray[np.float64] | None:
        if "TimeUS" in fields:
            return np.asarray(fields["TimeUS"], dtype=np.float64) * 1e-6 + self._zero_s
        if "T" in fields:  # the receiver's own TimeMS is of the GPS week
            return np.asarray(fields["T"], dtype=np.float64) * 1e-3 + self._zero_s
        if "TimeMS" in fields:
            return np.asarray(fields["TimeMS"], dtype=np.float64) * 1e-3 + self._zero_s
        return None

    def _clock(self) -> tuple[TimeBase, float]:
        """Find UTC through the GPS week, where one was logged."""
        self._zero_s = 0.0
        fields = self.fields("GPS")
        boot = self._times(fields)
        week = fields.get("GWk", fields.get("Week"))
        of_week = fields.get("GMS", fields.get("TimeMS") if "T" in fields else None)
        if boot is not None and week is not None and of_week is not None:
            fixed = np.flatnonzero((np.asarray(week) > 1000) & (np.asarray(week) < 5000))
            if len(fixed):
                row = fixed[0]
                utc = GPS_EPOCH_S + float(week[row]) * 604_800.0 + float(of_week[row]) * 1e-3
                leap = LEAP_S if utc > 1_483_228_800.0 else LEAP_S - 1.0
                return TimeBase("the autopilot's clock, set by GPS"), utc - leap - float(boot[row])
        doubt = "no GPS time was logged: times count from the start of the autopilot"
        return TimeBase("the autopilot's clock since its start", absolute=False, doubts=(doubt,)), 0.0

    def _reports(self) -> Iterator[tuple[NDArray[np.float64], dict[str, NDArray[np.float64]]]]:
        """What the messages say, in the words of telemetry."""
        for name, speak in SPOKEN.items():
            fields = self.fields(name)
            times = self._times(fields) if fields else None
            if times is None:
                continue
            try:
                yield times, speak(fields)
            except KeyError:
                continue  # another generation of the log, without such a field

    def _summary(self) -> LogSummary:
        lengths = [times for name in SPOKEN if (times := self._times(self.fields(name))) is not None and len(times)]
        first = min((float(times.min()) for times in lengths), default=math.nan)
        last = max((float(times.max()) for times in lengths), default=math.nan)
        by_type = self._names()
        return LogSummary(
            format="dataflash",
            messages=len(self._offset),
            by_type=by_type,
            skipped_bytes=int(self._skipped),
            systems=(1,) if "ATT" in by_type or "GPS" in by_type else (),
            others=(),
            time_base=self._time_base,
            start_s=first,
            end_s=last,
            events=self._events(first),
        )

    def _events(self, first_s: float) -> tuple[LogEvent, ...]:
        fields = self.fields("MSG")
        texts = fields.get("Message", np.empty(0, dtype="S1"))[:MAX_EVENTS]
        times = self._times(fields)
        stamps = times if times is not None else np.full(len(texts), first_s)
        return tuple(
            LogEvent(float(time_s), 1, one_line(bytes(text).decode("utf-8", "replace")))
            for time_s, text in zip(stamps, texts, strict=False)
        )


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
