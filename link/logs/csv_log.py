"""CSV logs (``.csv``, ``.csv.gz``), by a mapping of columns to telemetry quantities.

Columns that carry the names of `models.drones.telemetry.TelemetrySample`, in any case, need no mapping, nor do ``lat`` and ``lon``; `skyway replay --csv` writes such
a table. A mapping is a TOML file (``schema = "skyway.log-columns/1"``), see ``docs/how-to/replay.md``.
"""

from __future__ import annotations

import csv
import gzip
import itertools
import math
import zlib
from collections import Counter
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, TextIO, cast

import numpy as np

from skyway.link.logs.common.log import LogSummary
from skyway.link.logs.common.messages import euler
from skyway.link.logs.common.vehicle_kind import KINDS, Vehicle
from skyway.link.logs.csv_units import TIME_UNITS, UnitCheck
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.fields import Table, finite, read_toml
from skyway.models.base.files import AS_UTF8, file_error, is_utf16
from skyway.models.base.table import TableReader
from skyway.models.base.views import counted
from skyway.models.drones.telemetry import QUANTITIES, TelemetryTrack, TimeBase, believable

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from skyway.link.logs.common.vehicle_kind import Kind

SCHEMA = "skyway.log-columns/1"
PIECE_ROWS = 10_000
MAX_LINE = 1_000_000
EPOCH_1990_S = 631_152_000.0
"""Times below this are not POSIX seconds."""
_TIME_NAMES = {"time_utc": "iso", "time_s": "s", "time_ms": "ms", "time_us": "us", "time": "s", "timestamp": "s"}
"""Unit by the name of the column; `time` and `timestamp` may also be text, ISO 8601."""
_OTHER_NAMES = {"lat": "lat_deg", "latitude": "lat_deg", "lon": "lon_deg", "lng": "lon_deg", "longitude": "lon_deg"}


@dataclass(frozen=True, slots=True)
class ColumnOf:
    """Source of a quantity: ``column * factor + offset``."""

    column: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class LogColumns:
    """Meaning of the columns of a table."""

    time: str
    time_unit: str
    """`time`, `time_unit`: column of the time, and ``iso``, ``s``, ``ms`` or ``us``; numbers count from the log's own
    zero unless they are clearly POSIX seconds."""
    quantities: dict[str, ColumnOf] = field(default_factory=dict)
    """By the names of `TelemetrySample`."""
    quaternion_ned_frd: tuple[str, ...] = ()
    """Columns w, x, y, z of the attitude that turns the body (forward, right, down) into north-east-down."""
    quaternion_enu_flu: tuple[str, ...] = ()
    """Columns x, y, z, w of the attitude that turns the body (forward, left, up) into east-north-up."""
    velocity_flu: tuple[str, ...] = ()
    """Columns of the velocity in that body frame (forward, left, up)."""
    payload: ColumnOf | None = None
    """Mass of the package, kg."""
    vehicle: Kind = "unknown"
    """Kind of the vehicle (`link.logs.common.vehicle_kind.KINDS`), if the table's author states it."""


M100 = LogColumns(
    time="time",
    time_unit="s",
    quantities={
        "lat_deg": ColumnOf("position_y"),
        "lon_deg": ColumnOf("position_x"),
        "height_m": ColumnOf("position_z"),
        "power_w": ColumnOf("y"),
    },
    quaternion_enu_flu=("orientation_x", "orientation_y", "orientation_z", "orientation_w"),
    velocity_flu=("twist_linear_x", "twist_linear_y", "twist_linear_z"),
    payload=ColumnOf("payload", 1e-3),
    vehicle="multirotor",
)
"""The DJI Matrice 100 flights of Rodrigues et al. (2021), recognised by their header."""


def read_columns(path: Path) -> LogColumns:
    """Read a mapping; an `InputError` lists every fault in the file."""
    faults: list[Fault] = []
    top = Table(read_toml(path), str(path), "", faults)
    top.text("schema", SCHEMA, choices=(SCHEMA,))
    quantities = {}
    part = top.table("columns")
    for name in (*QUANTITIES, "payload_kg"):
        if name in part:
            one = part.table(name)
            factor, offset = one.number("factor", 1.0), one.number("offset", 0.0)
            quantities[name] = ColumnOf(one.text("column"), factor, offset)
            one.finish()
    part.finish()
    columns = LogColumns(
        time=top.text("time"),
        time_unit=top.text("time_unit", "s", choices=("iso", *TIME_UNITS)),
        payload=quantities.pop("payload_kg", None),
        quantities=quantities,
        quaternion_ned_frd=_several(top, "quaternion_ned_frd", 4),
        quaternion_enu_flu=_several(top, "quaternion_enu_flu", 4),
        velocity_flu=_several(top, "velocity_flu", 3),
        vehicle=cast("Kind", top.text("vehicle", "unknown", choices=KINDS)),
    )
    top.finish()
    if columns.velocity_flu and not columns.quaternion_enu_flu:
        top.fault("velocity_flu", "needs quaternion_enu_flu")
    if faults:
        raise InputError(faults)
    return columns


def _several(table: Table, key: str, count: int) -> tuple[str, ...]:
    names = table.texts(key, ())
    if names and len(names) != count:
        table.fault(key, f"must name {count} columns", len(names))
    return names


class CsvLog:
    """A table of telemetry of one vehicle: read once piece by piece to check it, and again for each use.

    The meaning of columns is derived from the header if `columns` does not give it. Raises an `InputError` if there is
    no table, or if a column is missing. `wrong_time` and `wrong_power` are sentences for a person if the values of those
    columns cannot be in their unit.
    """

    def __init__(self, path: Path, columns: LogColumns | None = None) -> None:
        self._path = path
        self._place: dict[str, int] = {}
        self._double: frozenset[str] = frozenset()
        self._untimed: list[str] = []
        self._times_are_text: bool | None = None
        self._columns = columns or LogColumns("", "s")
        self._guessed = columns is None
        self._absolute: bool | None = None
        self._index()

    def tracks(self, from_s: float = -math.inf, to_s: float = math.inf) -> Iterator[TelemetryTrack]:
        """Return the telemetry piece by piece."""
        for kept, _, time_s, _ in self._kept():
            if not kept:
                continue
            if time_s[0] >= to_s:
                return
            whole = TelemetryTrack.of_columns(1, time_s, self._values(kept))
            track = TelemetryTrack(1, time_s, believable(whole.values)).between(from_s, to_s)
            if len(track):
                yield track

    def _index(self) -> None:
        """Read the table once: its times, invalid rows, and the package."""
        count = skipped = back = 0
        first = latest = math.nan
        payloads: list[float] = []
        hangs: set[float] = set()
        check = UnitCheck()
        for kept, lost, held, told in self._kept():
            skipped += sum(len(",".join(row)) + 1 for row in lost)
            if lost and not self._untimed:
                self._untimed = lost[0]
            if not kept:
                continue
            back += int((held != told).sum())
            first, latest = float(held[0]) if math.isnan(first) else first, float(held[-1])
            values = self._values(kept)
            check.add(held, values)
            hanging = values.get("fixed_wing", np.empty(0))
            hangs |= set(np.unique(hanging[np.isfinite(hanging)])[:4].tolist())
            if self._columns.payload is not None:
                known = self._numbers(kept, self._columns.payload)
                payloads += [float(np.nanmedian(known))] if np.isfinite(known).any() else []
            count += len(kept)
        if not count and skipped:
            self._refuse_times()
        self.payload_kg = float(np.median(payloads)) if payloads else math.nan
        doubts: tuple[str, ...] = (
            (f"{counted(back, 'row')} {'is' if back == 1 else 'are'} earlier than the row before, whose time is used",)
            if back
            else ()
        )
        vehicle = self._vehicle(hangs)
        names = {name: one.column for name, one in self._columns.quantities.items()}
        self.wrong_time = check.wrong_time(self._columns.time, self._columns.time_unit)
        self.wrong_power = check.wrong_power(vehicle.kind, names)
        doubts += tuple(one for one in (self.wrong_time, self.wrong_power) if one is not None)
        if not self._absolute:
            doubts += ("the times are relative to the start of the log",)
        self.summary = LogSummary(
            format="csv",
            messages=count,
            by_type={"row": count},
            skipped_bytes=skipped,
            systems=(1,) if count else (),
            others=(),
            time_base=TimeBase("the table's time column", bool(self._absolute), doubts),
            start_s=first,
            end_s=latest,
            vehicles={1: vehicle},
        )

    def _kept(self) -> Iterator[tuple[list[list[str]], list[list[str]], NDArray[np.float64], NDArray[np.float64]]]:
        """Read the rows with a time and those without, the times, made non-decreasing, and as written."""
        latest = -math.inf
        for rows in self._pieces():
            times = self._times(rows)
            good = np.isfinite(times)
            kept, lost = (list(itertools.compress(rows, which)) for which in (good, ~good))
            held = np.maximum.accumulate(np.maximum(times[good], latest))
            latest = float(held[-1]) if len(held) else latest
            yield kept, lost, held, times[good]

    def _vehicle(self, hangs: set[float]) -> Vehicle:
        """Kind of the vehicle: from the mapping, otherwise from its column ``fixed_wing``."""
        if self._columns.vehicle != "unknown":
            return Vehicle(self._columns.vehicle, "its columns")
        if {0.0, 1.0} <= hangs:
            return Vehicle("VTOL", "its column fixed_wing")
        told: dict[float, Kind] = {0.0: "multirotor", 1.0: "fixed wing"}
        kinds = [kind for value, kind in told.items() if value in hangs]
        return Vehicle(kinds[0], "its column fixed_wing") if kinds else Vehicle()

    def _pieces(self) -> Iterator[list[list[str]]]:
        """Read the rows in batches, the header first."""
        try:
            opener = gzip.open if self._path.suffix == ".gz" else open
            with opener(self._path, "rt", encoding="utf-8-sig", newline="") as stream:
                reader = TableReader(_lines(cast("TextIO", stream)), str(self._path))
                header = next(reader, None)
                if header is None:
                    raise InputError(Fault("is empty", str(self._path)))
                self._learn([name.strip() for name in header])
                while rows := list(itertools.islice(reader, PIECE_ROWS)):
                    yield [row for row in rows if row]
        except csv.Error as error:
            raise InputError(Fault(f"is not CSV: {error}", str(self._path))) from error
        except UnicodeDecodeError as error:
            problem = "is UTF-16 text" if is_utf16(error.object) else f"is not UTF-8 text (byte {error.start})"
            raise InputError(Fault(problem, str(self._path), remedy=AS_UTF8)) from error
        except (OSError, EOFError, zlib.error) as error:
            raise file_error("read", self._path, error) from error

    def _learn(self, header: list[str]) -> None:
        self._place = {name: number for number, name in reversed(list(enumerate(header)))}
        self._double = frozenset(name for name, count in Counter(header).items() if count > 1)
        if self._guessed:
            self._columns = self._guess(header)

    def _guess(self, header: list[str]) -> LogColumns:
        if {"twist_linear_x", "orientation_w", "payload", "y"} <= set(header):
            return M100
        named = {name.casefold(): name for name in reversed(header)} | {name: name for name in header}
        known = {ours: ColumnOf(named[other]) for other, ours in _OTHER_NAMES.items() if other in named}
        known |= {name: ColumnOf(named[name]) for name in QUANTITIES if name in named}
        time = next((name for name in _TIME_NAMES if name in named), None)
        if time is None or not known:
            remedy = (
                "name a column as skyway does (docs/how-to/replay.md), or map them on the command line with --columns"
            )
            if len(header) == 1 and "\t" in header[0]:
                remedy = "they are separated by tabs: separate them by commas or semicolons"
            raise InputError(Fault("has no known telemetry columns", str(self._path), 1, remedy=remedy))
        payload = ColumnOf(named["payload_kg"]) if "payload_kg" in named else None
        return LogColumns(named[time], _TIME_NAMES[time], known, payload=payload)

    def _refuse_times(self) -> None:
        """Raise an `InputError` for a table none of whose rows has a time."""
        columns, place = self._columns, self._column(self._columns.time)
        told = self._untimed[place].strip() if place < len(self._untimed) else ""
        problem, remedy = "is not a time", f"a number in {columns.time_unit}"
        if columns.time_unit == "iso" or self._times_are_text:
            remedy = "write it as 2013-07-10T18:00:00Z"
            if math.isfinite(_instant(told, utc=True)):
                problem, remedy = "the time has no UTC offset", f"{remedy}, or name the column time_utc"
        raise InputError(Fault(problem, str(self._path), None, columns.time, told, remedy))

    def _numbers(self, rows: list[list[str]], where: ColumnOf) -> NDArray[np.float64]:
        place = self._column(where.column)
        cells = [finite(row[place]) if place < len(row) else None for row in rows]
        values = np.array([math.nan if cell is None else cell for cell in cells], dtype=np.float64)
        return values * where.factor + where.offset

    def _column(self, name: str) -> int:
        if name in self._double:
            raise InputError(Fault("the column appears twice", str(self._path), 1, name, None, "name it once"))
        if name not in self._place:
            raise InputError(
                Fault("no such column", str(self._path), 1, name, None, "it has: " + ", ".join(self._place))
            )
        return self._place[name]

    def _times(self, rows: list[list[str]]) -> NDArray[np.float64]:
        """Times of rows, NaN if there is none; the first piece determines whether they are instants."""
        columns, place = self._columns, self._column(self._columns.time)
        told = [row[place] if place < len(row) else "" for row in rows]
        if self._times_are_text is None and rows:
            numeric = any(finite(text) is not None for text in told)
            dated = any(math.isfinite(_instant(text, utc=True)) for text in told)
            self._times_are_text = self._guessed and columns.time_unit == "s" and dated and not numeric
        if columns.time_unit == "iso" or self._times_are_text:
            self._absolute = True
            utc = columns.time.casefold().endswith("utc")
            return np.array([_instant(text, utc=utc) for text in told])
        times = self._numbers(rows, ColumnOf(columns.time)) * TIME_UNITS[columns.time_unit]
        finite_times = times[np.isfinite(times)]
        if self._absolute is None and len(finite_times):
            self._absolute = bool(float(np.median(finite_times)) > EPOCH_1990_S)
        return times

    def _values(self, rows: list[list[str]]) -> dict[str, NDArray[np.float64]]:
        columns = self._columns
        values = {name: self._numbers(rows, where) for name, where in columns.quantities.items()}
        ned, enu, velocity = (
            [self._numbers(rows, ColumnOf(name)) for name in names]
            for names in (columns.quaternion_ned_frd, columns.quaternion_enu_flu, columns.velocity_flu)
        )
        if ned:
            values |= euler(*ned)
        if enu:
            x, y, z, w = enu
            values |= _from_enu(x, y, z, w)
            if velocity:
                values |= _turned(velocity, x, y, z, w)
        if "power_w" not in values and {"voltage_v", "current_a"} <= values.keys():
            with np.errstate(over="ignore", invalid="ignore"):  # beyond any battery: withheld as implausible
                values["power_w"] = values["voltage_v"] * values["current_a"]
        if {"lat_deg", "lon_deg"} <= values.keys():
            nowhere = (values["lat_deg"] == 0.0) & (values["lon_deg"] == 0.0)  # no fix
            values |= {name: np.where(nowhere, np.nan, values[name]) for name in ("lat_deg", "lon_deg")}
        return values


def _lines(stream: TextIO) -> Iterator[str]:
    """Lines of a table, of limited length."""
    while line := stream.readline(MAX_LINE):
        if len(line) == MAX_LINE and not line.endswith("\n"):
            raise csv.Error(f"a line is longer than {MAX_LINE} characters")
        yield line


def _instant(text: str, *, utc: bool) -> float:
    """POSIX seconds of an ISO 8601 text, NaN if it is none; `utc`: a time without an offset is in UTC, else it is none."""
    try:
        instant = datetime.fromisoformat(text.strip())
    except ValueError:
        return math.nan
    if instant.tzinfo is None:
        return instant.replace(tzinfo=UTC).timestamp() if utc else math.nan
    return instant.timestamp()


def _from_enu(x: Any, y: Any, z: Any, w: Any) -> dict[str, NDArray[np.float64]]:
    """Attitude in north-east-down of one in east-north-up with the body forward, left, up."""
    turned = euler(w, x, -y, -z)
    yaw = np.mod(math.pi / 2.0 + turned["yaw_rad"] + math.pi, 2.0 * math.pi) - math.pi
    return {"roll_rad": turned["roll_rad"], "pitch_rad": turned["pitch_rad"], "yaw_rad": yaw}


def _turned(velocity: list[NDArray[np.float64]], x: Any, y: Any, z: Any, w: Any) -> dict[str, NDArray[np.float64]]:
    """Velocity in north-east-down of one in the body frame (forward, left, up)."""
    forward, left, up = velocity
    east = (1 - 2 * (y * y + z * z)) * forward + 2 * (x * y - w * z) * left + 2 * (x * z + w * y) * up
    north = 2 * (x * y + w * z) * forward + (1 - 2 * (x * x + z * z)) * left + 2 * (y * z - w * x) * up
    rise = 2 * (x * z - w * y) * forward + 2 * (y * z + w * x) * left + (1 - 2 * (x * x + y * y)) * up
    return {"vel_north_mps": north, "vel_east_mps": east, "vel_down_mps": -rise}
