"""Files with the load of the pads by other drones.

They give it directly, as rates by hour of the week (`read_load`), or as a record of busy pads (`read_occupancy`).
"""

from __future__ import annotations

import difflib
import math
from datetime import datetime
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.formatting import percent
from skyway.models.base.table import FaultCollector, Problem, read_table
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
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path
    from zoneinfo import ZoneInfo

    from numpy.typing import ArrayLike, NDArray


EVERY_STATION = "*"
"""Station id for all stations without a row of their own."""
CLAMPED_UTILISATION = 0.95
"""Utilisation assumed if a record shows every pad busy, since the number of drones turned away is unknown."""
_NOT_A_CHARGING_TIME = Problem("not a charging time", "minutes, from a second to a week")
_COLUMNS = ("station", "hour_of_week", "arrivals_per_h", "mean_charging_min")


def read_load(
    path: Path, station_ids: Sequence[str], timezone: str, *, pads: ArrayLike | None = None
) -> tuple[PadLoad, list[str]]:
    """Read a CSV table ``station,hour_of_week,arrivals_per_h,mean_charging_min`` (other columns are ignored).

    Rows of station ``*`` hold for every station and hour without a row of its own; hours of the week are those of the
    time zone. Where `pads` are given, shape (stations,), stations without pads need no rows, and those whose mean
    utilisation over the week is above 1, so that their queue grows without end, are warned about.

    An `InputError` carries every fault found (twenty are listed, the others counted): unknown station, hour outside
    0-167, two rows for one hour, a negative or missing number or one out of range, hours without a row, a missing
    column, an empty file, an unknown time zone.
    """
    zone(timezone)
    faults = FaultCollector(str(path))
    default = len(station_ids)
    values = _read_rates(path, {EVERY_STATION: default} | {name: i for i, name in enumerate(station_ids)}, faults)
    faults.raise_if_any()  # a wrong row leaves its hour empty: do not report it twice
    arrivals, charging = np.where(np.isnan(values[:, :default]), values[:, default:], values[:, :default])
    count = None if pads is None else np.broadcast_to(np.asarray(pads, dtype=np.int64), (default,))
    if count is not None:
        padless = (count == 0)[:, None]
        arrivals = np.where(padless & np.isnan(arrivals), 0.0, arrivals)
        charging = np.where(padless & np.isnan(charging), IDLE_CHARGING_S, charging)
    _note_missing_hours(station_ids, np.isnan(arrivals), faults)
    faults.raise_if_any()
    load = PadLoad(arrivals, charging, timezone)
    return load, _overload_warnings(load, station_ids, count)


def read_occupancy(
    path: Path, station_ids: Sequence[str], timezone: str, pads: ArrayLike, mean_charging_min: float
) -> tuple[PadLoad, list[str]]:
    """Derive the load from a record of busy pads: one row per hour, one column per station.

    The first column is the time: local to the time zone, or with an offset. The others are headed by station ids, in
    any order, and hold the mean number of busy pads in that hour (plug-hours per hour). Values are averaged by hour of
    the week (a local hour that comes twice or not at all when the clock changes is averaged over the rows there are),
    and arrivals = busy pads / mean charging time (Little). Empty cells and ``nan`` are gaps.

    Warnings name stations without a column (they get no load), columns that are not stations, gaps, and hours of the week
    in which on average every one of the `pads`, shape (stations,), is busy (counted as `CLAMPED_UTILISATION` of them).
    An `InputError` carries every fault found (twenty are listed, the others counted): times and values that cannot be
    read, negative values, hours of the week without any value, two columns of one name, an empty file, an unknown time
    zone.
    """
    place = zone(timezone)
    charging_s = mean_charging_min * S_PER_MIN
    if not MIN_CHARGING_S <= charging_s <= MAX_CHARGING_S:
        remedy = "minutes, from a second to a week"
        fault = Fault("out of range", field="mean_charging_min", value=mean_charging_min, remedy=remedy)
        raise InputError(fault)
    faults = FaultCollector(str(path))
    header, total, count, gaps = sum_by_hour(path, station_ids, place, faults, _parse_busy)
    faults.raise_if_any()
    columns = [i for i, name in enumerate(station_ids) if name in header]
    for i, hours in zip(columns, np.sum(count == 0, axis=0).tolist(), strict=True):
        if hours:
            problem = f"has no value for {hours} of the 168 hours of the week"
            faults.add(problem, "a record of at least a week", field=station_ids[i])
    faults.raise_if_any()
    busy = np.zeros((len(station_ids), WEEK_H))
    busy[columns] = (total / np.maximum(count, 1)).T
    limit = np.broadcast_to(np.asarray(pads, dtype=np.float64), (len(station_ids),))[:, None]
    full = (busy >= limit) & (limit > 0.0)
    busy = np.where(full, CLAMPED_UTILISATION * limit, np.where(limit > 0.0, busy, 0.0))
    warnings = _occupancy_warnings(faults.file, header, station_ids, full, gaps)
    return PadLoad(busy / charging_s, np.full(busy.shape, charging_s), timezone), warnings


def _read_rates(path: Path, stations: Mapping[str, int], faults: FaultCollector) -> NDArray[np.float64]:
    """Arrivals per s and mean charging s, shape (2, stations, 168), NaN if there is no row."""
    parse_known = partial(parse_station, stations=stations)
    parts = []
    for chunk in read_table(path, _COLUMNS, faults):
        station = chunk.decode("station", parse_known, faults, each_text_once=True)
        hour = chunk.decode("hour_of_week", parse_hour, faults)
        arrivals = chunk.decode("arrivals_per_h", _parse_arrivals, faults)
        charging = chunk.decode("mean_charging_min", _parse_charging, faults)
        for row in faults.first(np.flatnonzero((charging == 0.0) & (arrivals != 0.0))):
            text = chunk.columns["mean_charging_min"][row]
            faults.add(*_NOT_A_CHARGING_TIME, line=chunk.lines[row], field="mean_charging_min", value=text)
        charging = np.where(charging > 0.0, charging, np.where(arrivals == 0.0, IDLE_CHARGING_S, np.nan))
        parts.append((np.array(chunk.lines), station, hour, arrivals, charging))
    line, station, hour, arrivals, charging = (np.concatenate(part) for part in zip(*parts, strict=True))
    sound = ~np.isnan(station + hour + arrivals + charging)
    line, place = line[sound], (station[sound].astype(np.int64), hour[sound].astype(np.int64))
    _, first, same = np.unique(place[0] * WEEK_H + place[1], return_index=True, return_inverse=True)
    for row in faults.first(np.flatnonzero(first[same] != np.arange(len(line)))):
        name = list(stations)[[*stations.values()].index(place[0][row])]
        problem = f"second row for station {name}, the first is line {line[first[same[row]]]}"
        remedy = "one row for each station and hour"
        faults.add(problem, remedy, line=int(line[row]), field="hour_of_week", value=int(place[1][row]))
    values = np.full((2, max(stations.values()) + 1, WEEK_H), np.nan)
    values[:, *place] = arrivals[sound], charging[sound]
    return values


def _number(text: str) -> float:
    """Return a float, NaN if the text is not a plain number."""
    try:
        return math.nan if "_" in text else float(text)
    except ValueError:
        return math.nan


def parse_station(name: str, stations: Mapping[str, int]) -> float | Problem:
    """Read a station's id as its number."""
    if name in stations:
        return stations[name]
    close = difflib.get_close_matches(name, stations, n=3)
    return Problem(
        "no such station",
        f"did you mean {' or '.join(close)}?" if close else "give an id of the stations file, or *",
    )


def parse_hour(text: str) -> float | Problem:
    """Read an hour of the week."""
    hour = int(text) if text.isascii() and text.isdigit() and len(text) < 4 else -1
    return (
        hour
        if 0 <= hour < WEEK_H
        else Problem("not an hour of the week", "a whole number from 0 (Monday 00:00) to 167")
    )


def _parse_arrivals(text: str) -> float | Problem:
    per_s = _number(text) / S_PER_H
    return per_s if 0.0 <= per_s <= MAX_ARRIVALS_PER_S else Problem("not a rate per hour", "a number from 0 to 3600")


def _parse_charging(text: str) -> float | Problem:
    """Read a charging time, s; 0 is checked later: it is valid if nobody arrives."""
    charging_s = _number(text) * S_PER_MIN
    return charging_s if charging_s == 0.0 or MIN_CHARGING_S <= charging_s <= MAX_CHARGING_S else _NOT_A_CHARGING_TIME


def _note_missing_hours(station_ids: Sequence[str], missing: NDArray[np.bool_], faults: FaultCollector) -> None:
    remedy = "give all hours 0 to 167, or rows of station * for the rest"
    absent = [name for name, row in zip(station_ids, missing, strict=True) if row.all()]
    problems = [f"no rows for {_listed(absent)}"] if absent else []
    for name, row in zip(station_ids, missing, strict=True):
        if row.any() and not row.all():
            hours = _listed([str(hour) for hour in np.flatnonzero(row)], shown=24)
            problems.append(f"station {name} has no row for hours {hours}")
    for problem in problems:
        faults.add(problem, remedy)


def _overload_warnings(load: PadLoad, station_ids: Sequence[str], pads: NDArray[np.int64] | None) -> list[str]:
    if pads is None:
        return []
    mean = load.utilisation(pads).mean(axis=1)
    over = np.flatnonzero(mean > 1.0).tolist()
    if not over:
        return []
    names = _listed([f"{station_ids[i]} ({mean[i]:.2f})" for i in over])
    return [f"more load than the pads can serve, so that queues grow all week (utilisation): {names}"]


def sum_by_hour(
    path: Path,
    station_ids: Sequence[str],
    place: ZoneInfo,
    faults: FaultCollector,
    parse: Callable[[str], float | Problem],
) -> tuple[list[str], NDArray[np.float64], NDArray[np.int64], int]:
    """Ids in the header, sum and number of values of the stations among them, shape (168, columns), and gaps.

    `parse` reads a value, NaN if it is a gap.
    """
    parse_time = partial(_parse_local_hour, place=place)
    total, count, gaps = np.zeros((WEEK_H, 0)), np.zeros((WEEK_H, 0), dtype=np.int64), 0
    header: list[str] = []
    for chunk in read_table(path, None, faults):
        time, *header = chunk.columns
        names = [name for name in station_ids if name in chunk.columns and name != time]
        if not total.size:
            total, count = np.zeros((WEEK_H, len(names))), np.zeros((WEEK_H, len(names)), dtype=np.int64)
        hour = chunk.decode(time, parse_time, faults)
        values = [chunk.decode(name, parse, faults) for name in names]
        rows = ~np.isnan(hour)
        busy = np.array(values).reshape(len(names), len(rows)).T[rows]
        there = ~np.isnan(busy)
        np.add.at(total, hour[rows].astype(np.int64), np.where(there, busy, 0.0))
        np.add.at(count, hour[rows].astype(np.int64), there)
        gaps += int(np.sum(~there))
    return header, total, count, gaps


def _parse_local_hour(text: str, place: ZoneInfo) -> float | Problem:
    """Read a time as its hour of the local week."""
    try:
        stamp = datetime.fromisoformat(text)
    except ValueError:
        return Problem("not a time", "local time such as 2023-04-01 00:00:00")
    if stamp.tzinfo is not None:
        stamp = stamp.astimezone(place)
    return 24.0 * stamp.weekday() + stamp.hour


def _parse_busy(text: str) -> float | Problem:
    """Read a mean number of busy pads; NaN is a gap."""
    busy = _number(text)
    if not text or text.lower() == "nan" or 0.0 <= busy < math.inf:
        return busy
    return Problem("not an occupancy", "mean busy pads, a number from 0 up; empty where unknown")


def _occupancy_warnings(
    file: str, header: list[str], station_ids: Sequence[str], full: NDArray[np.bool_], gaps: int
) -> list[str]:
    warnings = []
    without = [name for name in station_ids if name not in header]
    if without:
        warnings.append(f"{file}: no column, so no load, for {_listed(without)}")
    wanted = set(station_ids)
    strangers = [name for name in header if name not in wanted]
    if strangers:
        warnings.append(f"{file}: {len(strangers)} columns are not stations of the network: {_listed(strangers)}")
    if gaps:
        warnings.append(f"{file}: {gaps} values are missing and were ignored in the averages")
    if full.any():
        names = _listed([station_ids[i] for i in np.flatnonzero(full.any(axis=1)).tolist()])
        warnings.append(
            f"{file}: all pads busy on average in {int(full.sum())} hours of the week, "
            f"counted as {percent(CLAMPED_UTILISATION)} of the pads, at {names}"
        )
    return warnings


def _listed(names: Sequence[str], shown: int = 6) -> str:
    text = ", ".join(names[:shown])
    return text if len(names) <= shown else f"{text}, … ({len(names)} in all)"
