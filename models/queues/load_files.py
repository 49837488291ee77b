"""Files with the load of the pads by other drones.

They say it directly, as rates by hour of the week (`read_load`), or as a record of busy pads (`read_occupancy`).
"""

from __future__ import annotations

import csv
import difflib
import io
import math
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.files import read_text
from skyway.models.base.formatting import percent
from skyway.models.base.units import S_PER_H, S_PER_MIN
from skyway.models.queues.load import (
    IDLE_CHARGING_S,
    MAX_ARRIVALS_PER_S,
    MAX_CHARGING_S,
    MIN_CHARGING_S,
    WEEK_H,
    PadLoad,
    zone,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path
    from zoneinfo import ZoneInfo

    from numpy.typing import ArrayLike, NDArray

EVERY_STATION = "*"
"""Station id that stands for every station without a row of its own."""
CLAMPED_UTILISATION = 0.95
"""Utilisation assumed where a record shows every pad busy, which does not tell how many were turned away."""
MAX_FILE_BYTES = 100_000_000
_COLUMNS = ("station", "hour_of_week", "arrivals_per_h", "mean_charging_min")
_FAULTS_SHOWN = 100


def read_load(
    path: Path, station_ids: Sequence[str], timezone: str, *, pads: ArrayLike | None = None
) -> tuple[PadLoad, list[str]]:
    """Read a table ``station,hour_of_week,arrivals_per_h,mean_charging_min`` (other columns are ignored).

    Rows of station ``*`` hold for every station and hour without a row of its own.

    Parameters
    ----------
    path : Path
        CSV, UTF-8; ``.gz`` is unpacked.
    station_ids : sequence of str
        In the order of the network's nodes.
    timezone : str
        IANA name, of the hours of the week.
    pads : array_like of int, shape (stations,), optional
        Pads of each station. Where given, stations without pads need no rows, and stations with more load
        than pads are warned about.

    Returns
    -------
    load : PadLoad
        Rows in the order of `station_ids`.
    warnings : list of str
        Stations whose mean utilisation over the week is above 1: their queue grows without end.

    Raises
    ------
    InputError
        Carries every fault found (the first hundred of them): unknown station, hour outside 0-167, two rows
        for one hour, a negative or missing number or one out of range, hours without a row, a missing
        column, an empty file, an unknown time zone.
    """
    zone(timezone)
    table = _Table(path)
    faults = [
        Fault("missing column", table.file, 1, name, remedy=f"the columns are {','.join(_COLUMNS)}")
        for name in _COLUMNS
        if name not in table.header
    ]
    if faults:
        raise InputError(faults)
    known = {name: number for number, name in enumerate(station_ids)}
    default = len(known)
    values = np.full((2, default + 1, WEEK_H), np.nan)
    if not _read_sound_rows(table, known, values):
        seen: dict[tuple[int, int], int] = {}
        for line, row in table.rows(faults):
            _read_load_row(dict(zip(table.header, row, strict=True)), known, values, seen, (table.file, line, faults))
    arrivals, charging = np.where(np.isnan(values[:, :default]), values[:, default:], values[:, :default])
    count = None if pads is None else np.broadcast_to(np.asarray(pads, dtype=np.int64), (default,))
    if count is not None:
        padless = (count == 0)[:, None]
        arrivals = np.where(padless & np.isnan(arrivals), 0.0, arrivals)
        charging = np.where(padless & np.isnan(charging), IDLE_CHARGING_S, charging)
    if not faults:  # a wrong row leaves its hour empty: do not report it twice
        faults += _missing_hours(table.file, station_ids, np.isnan(arrivals))
    _raise(faults, table.file)
    load = PadLoad(arrivals, charging, timezone)
    return load, _overload_warnings(load, station_ids, count)


def read_occupancy(
    path: Path, station_ids: Sequence[str], timezone: str, pads: ArrayLike, mean_charging_min: float
) -> tuple[PadLoad, list[str]]:
    """Derive the load from a record of busy pads: one row per hour, one column per station.

    The first column is the time: local, or with an offset. The others are headed by station ids, in any
    order, and hold the mean number of busy pads in that hour (plug-hours per hour). Values are averaged by
    hour of the week (a local hour that comes twice or not at all when the clock changes is averaged over
    the rows there are), and arrivals = busy pads / mean charging time (Little). Empty cells and ``nan`` are
    gaps.

    Parameters
    ----------
    path : Path
        CSV, UTF-8; ``.gz`` is unpacked.
    station_ids : sequence of str
        In the order of the network's nodes.
    timezone : str
        IANA name, of the times without an offset.
    pads : array_like of int, shape (stations,)
        Pads of each station.
    mean_charging_min : float
        Minutes: the record does not tell it.

    Returns
    -------
    load : PadLoad
        Rows in the order of `station_ids`.
    warnings : list of str
        Stations without a column (they get no load), columns that are no station, gaps, and hours of the
        week in which on average every pad is busy (counted as `CLAMPED_UTILISATION` of the pads).

    Raises
    ------
    InputError
        Carries every fault found (the first hundred of them): times and values that cannot be read,
        negative values, hours of the week without any value, two columns of one name, an empty file, an
        unknown time zone.
    """
    place = zone(timezone)
    charging_s = mean_charging_min * S_PER_MIN
    if not MIN_CHARGING_S <= charging_s <= MAX_CHARGING_S:
        remedy = "minutes, from a second to a week"
        fault = Fault("out of range", field="mean_charging_min", value=mean_charging_min, remedy=remedy)
        raise InputError(fault)
    table = _Table(path)
    faults: list[Fault] = []
    columns = [i for i, name in enumerate(station_ids) if name in table.header[1:]]
    places = [table.header.index(station_ids[i], 1) for i in columns]
    total, count, gaps = _sum_by_hour(table, places, place, faults)
    empty = [(station_ids[i], int(np.sum(count[:, j] == 0))) for j, i in enumerate(columns)]
    if not faults:
        problem, remedy = "has no value for {} of the 168 hours of the week", "a record of at least a week"
        faults = [Fault(problem.format(n), table.file, None, name, remedy=remedy) for name, n in empty if n]
    _raise(faults, table.file)
    busy = np.zeros((len(station_ids), WEEK_H))
    busy[columns] = (total / np.maximum(count, 1)).T
    limit = np.broadcast_to(np.asarray(pads, dtype=np.float64), (len(station_ids),))[:, None]
    full = (busy >= limit) & (limit > 0.0)
    busy = np.where(full, CLAMPED_UTILISATION * limit, np.where(limit > 0.0, busy, 0.0))
    warnings = _occupancy_warnings(table, station_ids, full, gaps)
    return PadLoad(busy / charging_s, np.full(busy.shape, charging_s), timezone), warnings


class _Table:
    """A CSV file with a header, read whole; `rows` reports every line that does not fit it."""

    def __init__(self, path: Path) -> None:
        self.file = str(path)
        self._text = read_text(path, max_bytes=MAX_FILE_BYTES)
        faults: list[Fault] = []
        _, header = next(self._lines(faults), (0, []))
        if not header:
            raise InputError(faults or Fault("is empty", self.file))
        self.header = [name.strip() for name in header]
        twice = sorted({name for name in self.header if self.header.count(name) > 1})
        if twice:
            raise InputError([Fault("two columns have this name", self.file, 1, name) for name in twice])

    def _lines(self, faults: list[Fault]) -> Iterator[tuple[int, list[str]]]:
        reader = csv.reader(io.StringIO(self._text, newline=""))
        try:
            for row in reader:
                if row:
                    yield reader.line_num, row
        except csv.Error as error:
            faults.append(Fault(f"is not a CSV table: {error}", self.file, reader.line_num))

    def rows(self, faults: list[Fault]) -> Iterator[tuple[int, list[str]]]:
        """(line, cells) of each row after the header; there is at least one, else a fault."""
        lines = self._lines(faults)
        next(lines)
        found = False
        for line, row in lines:
            found = True
            if len(row) != len(self.header):
                problem = f"has {len(row)} cells, the header has {len(self.header)}"
                faults.append(Fault(problem, self.file, line))
            else:
                yield line, [cell.strip() for cell in row]
        if not found and not faults:
            faults.append(Fault("has a header but no rows", self.file))

    def sound_rows(self) -> list[list[str]]:
        """Cells of each row after the header as they are written; none where a line does not fit."""
        try:
            rows = [row for row in csv.reader(io.StringIO(self._text, newline="")) if row][1:]
        except csv.Error:
            return []
        return rows if set(map(len, rows)) == {len(self.header)} else []


def _number(text: str) -> float:
    """Return a float, NaN where the text is no plain number."""
    try:
        return math.nan if "_" in text else float(text)
    except ValueError:
        return math.nan


def _read_sound_rows(table: _Table, known: dict[str, int], values: NDArray[np.float64]) -> bool:
    """Put all rows into `values` at once; false, and nothing is put there, where one looks as if it had a fault.

    Whether it has one, and which, is `_read_load_row`'s to say.
    """
    rows = table.sound_rows()
    if not rows:
        return False
    cells = dict(zip(table.header, zip(*rows, strict=True), strict=True))
    stations = {EVERY_STATION: len(known)} | known
    hours = {str(hour): hour for hour in range(WEEK_H)}
    try:
        station = np.array([stations[name] for name in cells["station"]])
        hour = np.array([hours[text] for text in cells["hour_of_week"]])
    except KeyError:
        return False
    arrivals = np.array(list(map(_number, cells["arrivals_per_h"]))) / S_PER_H
    charging = np.array(list(map(_number, cells["mean_charging_min"]))) * S_PER_MIN
    sound = (
        (arrivals >= 0.0)
        & (arrivals <= MAX_ARRIVALS_PER_S)
        & (charging >= MIN_CHARGING_S)
        & (charging <= MAX_CHARGING_S)
    )
    if not sound.all() or len(np.unique(station * WEEK_H + hour)) < len(rows):
        return False
    values[:, station, hour] = arrivals, charging
    return True


def _read_load_row(
    cells: dict[str, str],
    known: dict[str, int],
    values: NDArray[np.float64],
    seen: dict[tuple[int, int], int],
    report: tuple[str, int, list[Fault]],
) -> None:
    """Put one row into `values`, shape (2, stations + 1, 168), or its faults into the report."""
    file, line, faults = report
    before = len(faults)
    name, hour_text = cells["station"], cells["hour_of_week"]
    station = len(known) if name == EVERY_STATION and name not in known else known.get(name)
    if station is None:
        close = difflib.get_close_matches(name, known, n=3)
        remedy = f"did you mean {' or '.join(close)}?" if close else "give an id of the stations file, or *"
        faults.append(Fault("no such station", file, line, "station", name, remedy))
    hour = int(hour_text) if hour_text.isascii() and hour_text.isdigit() and len(hour_text) < 4 else -1
    if not 0 <= hour < WEEK_H:
        remedy = "a whole number from 0 (Monday 00:00) to 167"
        faults.append(Fault("not an hour of the week", file, line, "hour_of_week", hour_text, remedy))
    arrivals_per_s = _number(cells["arrivals_per_h"]) / S_PER_H
    if not 0.0 <= arrivals_per_s <= MAX_ARRIVALS_PER_S:
        remedy = "a number from 0 to 3600"
        faults.append(Fault("not a rate per hour", file, line, "arrivals_per_h", cells["arrivals_per_h"], remedy))
    charging_s = _number(cells["mean_charging_min"]) * S_PER_MIN
    if charging_s == 0.0 and arrivals_per_s == 0.0:
        charging_s = IDLE_CHARGING_S
    if not MIN_CHARGING_S <= charging_s <= MAX_CHARGING_S:
        text, remedy = cells["mean_charging_min"], "minutes, from a second to a week"
        faults.append(Fault("not a charging time", file, line, "mean_charging_min", text, remedy))
    if len(faults) > before or station is None:
        return
    first = seen.setdefault((station, hour), line)
    if first != line:
        problem = f"second row for station {name}, the first is line {first}"
        faults.append(Fault(problem, file, line, "hour_of_week", hour_text))
        return
    values[:, station, hour] = arrivals_per_s, charging_s


def _missing_hours(file: str, station_ids: Sequence[str], missing: NDArray[np.bool_]) -> list[Fault]:
    remedy = "give all hours 0 to 167, or rows of station * for the rest"
    absent = [name for name, row in zip(station_ids, missing, strict=True) if row.all()]
    faults = [Fault(f"no rows for {_listed(absent)}", file, remedy=remedy)] if absent else []
    for name, row in zip(station_ids, missing, strict=True):
        if row.any() and not row.all():
            hours = _listed([str(hour) for hour in np.flatnonzero(row)], shown=24)
            faults.append(Fault(f"station {name} has no row for hours {hours}", file, remedy=remedy))
    return faults


def _overload_warnings(load: PadLoad, station_ids: Sequence[str], pads: NDArray[np.int64] | None) -> list[str]:
    if pads is None:
        return []
    mean = load.utilisation(pads).mean(axis=1)
    over = np.flatnonzero(mean > 1.0).tolist()
    if not over:
        return []
    names = _listed([f"{station_ids[i]} ({mean[i]:.2f})" for i in over])
    return [f"more load than the pads can serve, so that queues grow all week (utilisation): {names}"]


def _sum_by_hour(
    table: _Table, places: list[int], place: ZoneInfo, faults: list[Fault]
) -> tuple[NDArray[np.float64], NDArray[np.int64], int]:
    """Sum and number of values, shape (168, columns), and how many cells are gaps."""
    total = np.zeros((WEEK_H, len(places)))
    count = np.zeros((WEEK_H, len(places)), dtype=np.int64)
    gaps = 0
    for line, row in table.rows(faults):
        try:
            stamp = datetime.fromisoformat(row[0])
        except ValueError:
            remedy = "local time such as 2023-04-01 00:00:00"
            faults.append(Fault("not a time", table.file, line, table.header[0] or "time", row[0], remedy))
            continue
        if stamp.tzinfo is not None:
            stamp = stamp.astimezone(place)
        values = np.empty(len(places))
        for j, column in enumerate(places):
            text = row[column]
            gap = not text or text.lower() == "nan"
            values[j] = math.nan if gap else _number(text)
            if not gap and not 0.0 <= values[j] < math.inf:
                remedy = "mean busy pads, a number from 0 up; empty where unknown"
                faults.append(Fault("not an occupancy", table.file, line, table.header[column], text, remedy))
        there = ~np.isnan(values)
        gaps += int(np.sum(~there))
        hour = 24 * stamp.weekday() + stamp.hour
        total[hour] += np.where(there, values, 0.0)
        count[hour] += there
    return total, count, gaps


def _occupancy_warnings(table: _Table, station_ids: Sequence[str], full: NDArray[np.bool_], gaps: int) -> list[str]:
    warnings = []
    without = [name for name in station_ids if name not in table.header[1:]]
    if without:
        warnings.append(f"{table.file}: no column, so no load, for {_listed(without)}")
    wanted = set(station_ids)
    strangers = [name for name in table.header[1:] if name not in wanted]
    if strangers:
        warnings.append(f"{table.file}: {len(strangers)} columns are not stations of the network: {_listed(strangers)}")
    if gaps:
        warnings.append(f"{table.file}: {gaps} values are missing and were left out of the averages")
    if full.any():
        names = _listed([station_ids[i] for i in np.flatnonzero(full.any(axis=1)).tolist()])
        warnings.append(
            f"{table.file}: all pads busy on average in {int(full.sum())} hours of the week, "
            f"counted as {percent(CLAMPED_UTILISATION)} of the pads, at {names}"
        )
    return warnings


def _raise(faults: list[Fault], file: str) -> None:
    if len(faults) > _FAULTS_SHOWN:
        more = Fault(f"and {len(faults) - _FAULTS_SHOWN} more faults", file)
        faults = [*faults[:_FAULTS_SHOWN], more]
    if faults:
        raise InputError(faults)


def _listed(names: Sequence[str], shown: int = 6) -> str:
    text = ", ".join(names[:shown])
    return text if len(names) <= shown else f"{text}, … ({len(names)} in all)"
