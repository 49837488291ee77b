"""Columns of downloaded wind records: names, units and conventions."""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import cached_property
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

import numpy as np

from skyway.models.base.errors import Fault, refuse
from skyway.models.base.table import FaultCollector, Problem, read_table
from skyway.models.base.units import SPEED_UNITS_MPS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from skyway.models.base.table import Chunk

MAX_SPEED_MPS = 75.0
"""Sustained wind above this is an error: the strongest hurricanes measured had about 85 m/s over one minute."""
CALM_CONVENTIONS = ("direction-0", "speed-0")
_ZERO = timedelta(0)
FIRST_YEAR, LAST_YEAR = 1800, 2200


@dataclass(frozen=True)
class WindColumns:
    """Format of a wind record: the ``[wind]`` table of a scenario.

    An `InputError` lists every unit, zone, convention, format or limit that does not exist.
    """

    time: str = "time"
    site: str | None = "site"
    """Column with the site's id; None if the file has one site."""
    speed: str = "speed_mps"
    from_: str = "from_deg"
    """Where the wind blows FROM, degrees; the name of a column, as `time` and `speed` are."""
    speed_unit: str = "m/s"
    """A key of `models.base.units.SPEED_UNITS_MPS`."""
    time_zone: str | None = None
    """``UTC`` or an IANA name, for times without an offset; None refuses those. An offset in the file rules."""
    missing: tuple[str, ...] = ("", "NA")
    """Texts that stand for no value, capitals ignored."""
    calm: str = "speed-0"
    """``direction-0``: direction 0 means calm and north is 360 (NOAA). ``speed-0``: calm is speed 0 only and direction 0
    is north."""
    variable: tuple[str, ...] = ("VRB",)
    """Directions of a wind with a speed but no direction, such as ``VRB`` or ``990``."""
    time_format: str | None = None
    """`datetime.strptime` format of the times; None is ISO 8601."""
    default_site: str | None = None
    """Site of a file without a site column; None: the only site."""
    max_speed_mps: float = MAX_SPEED_MPS
    """Rows with more wind are dropped, with a warning."""

    def __post_init__(self) -> None:
        faults = []
        if self.speed_unit not in SPEED_UNITS_MPS:
            names = ", ".join(SPEED_UNITS_MPS)
            faults.append(_setting("speed_unit", self.speed_unit, "unknown unit of speed", f"one of {names}"))
        if self.calm not in CALM_CONVENTIONS:
            names = " or ".join(CALM_CONVENTIONS)
            faults.append(_setting("calm", self.calm, "unknown convention for calm", names))
        if not (math.isfinite(self.max_speed_mps) and self.max_speed_mps > 0.0):
            faults.append(_setting("max_speed_mps", self.max_speed_mps, "not a limit of speed", "above 0, in m/s"))
        try:
            self.zone  # noqa: B018  looked up here so that a wrong name is found at once
        except (KeyError, ValueError, OSError):
            example = '"UTC" or an IANA name such as "America/New_York"'
            faults.append(_setting("time_zone", self.time_zone, "no such time zone", example))
        if self.time_format is not None and not _is_time_format(self.time_format):
            example = 'such as "%Y-%m-%d %H:%M"'
            faults.append(_setting("time_format", self.time_format, "not a time format", example))
        refuse(faults)

    @cached_property
    def zone(self) -> ZoneInfo | None:
        """The zone of times without an offset."""
        return None if self.time_zone is None else ZoneInfo(self.time_zone)


def _setting(name: str, value: object, problem: str, remedy: str) -> Fault:
    return Fault(problem, field=f"wind.{name}", value=value, remedy=remedy)


def _is_time_format(text: str) -> bool:
    try:
        stamp = datetime.strptime(datetime(2013, 7, 10, 14, tzinfo=UTC).strftime(text), text)  # noqa: DTZ007
    except (ValueError, re.error):
        return False
    return (stamp.year, stamp.month, stamp.day, stamp.hour) == (2013, 7, 10, 14)


@dataclass(frozen=True, slots=True)
class WindRows:
    """The rows of a wind record, in SI units."""

    time_s: NDArray[np.float64]
    """Shape (rows,). POSIX seconds."""
    site: NDArray[np.int64]
    """Shape (rows,). Index among the requested sites."""
    speed_mps: NDArray[np.float64]
    """Shape (rows,). NaN is missing, or absurd and dropped."""
    from_deg: NDArray[np.float64]
    """Shape (rows,). NaN is missing or variable."""
    absurd: int
    """Rows dropped because of their speed."""
    warnings: tuple[str, ...]


def read_rows(path: Path, columns: WindColumns, site_ids: Sequence[str]) -> WindRows:
    """Read every row of a wind record; an `InputError` has its first twenty faults, and how many more there are."""
    reader = _RowReader(str(path), columns, site_ids)
    wanted = [columns.time, columns.speed, columns.from_]
    if columns.site is not None:
        wanted.append(columns.site)
    parts = [reader.read(chunk) for chunk in read_table(path, wanted, reader.faults)]
    reader.faults.raise_if_any()
    time_s, site, speed, direction = (np.concatenate(part) for part in zip(*parts, strict=True))
    return WindRows(time_s, site.astype(np.int64), speed, direction, reader.absurd, reader.warnings())


class _RowReader:
    """Reads one record; collects the data for warnings from chunk to chunk."""

    def __init__(self, file: str, columns: WindColumns, site_ids: Sequence[str]) -> None:
        self.faults = FaultCollector(file)
        self.absurd = 0
        self._columns = columns
        self._sites = {site: float(number) for number, site in enumerate(site_ids)}
        self._missing = {text.strip().casefold() for text in columns.missing}
        self._no_direction = self._missing | {text.strip().casefold() for text in columns.variable}
        self._times: dict[str, float] = {}
        self._first_absurd = ""
        self._zero_with_speed = 0
        self._repeated: dict[str, float] = {}
        self._skipped: set[str] = set()
        self._seen: Counter[tuple[float, str]] = Counter()
        self._repeated_rows = self._skipped_rows = 0

    def read(self, chunk: Chunk) -> tuple[NDArray[np.float64], ...]:
        """Return time, site, speed and direction of the rows, shape (rows,) each."""
        columns = self._columns
        if columns.site is None:
            site = np.full(len(chunk.lines), self._sites[columns.default_site or next(iter(self._sites))])
        else:
            site = chunk.decode(columns.site, self._parse_site, self.faults, each_text_once=True)
        time_s = chunk.decode(columns.time, self._parse_time, self.faults, known=self._times)
        if self._repeated or self._skipped:
            self._settle_clock_changes(chunk.columns[columns.time], site, time_s)
        speed = chunk.decode(columns.speed, self._parse_speed, self.faults)
        direction = chunk.decode(columns.from_, self._parse_direction, self.faults)
        self._drop_absurd(chunk, speed)
        if columns.calm == "direction-0":
            odd = (direction == 0.0) & (speed > 0.0)
            direction[odd] = np.nan
            self._zero_with_speed += int(odd.sum())
        return time_s, site, speed, direction

    def warnings(self) -> tuple[str, ...]:
        """Return warnings on the rows for the operator."""
        zone, file = self._columns.time_zone, self.faults.file
        said = []
        if self.absurd:
            limit = f"a speed above {self._columns.max_speed_mps:g} m/s"
            said.append(f"{file}: rows dropped for {limit}: {self.absurd:,}, first {self._first_absurd}")
        if self._zero_with_speed:
            said.append(
                f"{file}: rows with direction 0 and a speed, read as variable: {self._zero_with_speed:,}; "
                'if 0 is north in this file, say calm = "speed-0"'
            )
        if self._repeated_rows:
            said.append(
                f"{file}: rows in an hour that the clock repeats in {zone}: {self._repeated_rows:,}; the "
                "first of a time is taken as summer time, the second as standard time"
            )
        if self._skipped_rows:
            said.append(
                f"{file}: rows in an hour that the clock skips in {zone}: {self._skipped_rows:,}, taken as "
                "the hour after; does the record keep standard time all year?"
            )
        return tuple(said)

    def _parse_site(self, text: str) -> float | Problem:
        known = ", ".join(self._sites)
        return self._sites.get(text, Problem("unknown site", f"the sites are {known}"))

    def _parse_speed(self, text: str) -> float | Problem:
        if text.casefold() in self._missing:
            return math.nan
        value = parse_number(text, "list the text under missing")
        if isinstance(value, Problem):
            return value
        if value < 0.0:
            return Problem("negative speed", "0 or more; if it marks a missing value, list it under missing")
        return value * SPEED_UNITS_MPS[self._columns.speed_unit]

    def _parse_direction(self, text: str) -> float | Problem:
        if text.casefold() in self._no_direction:
            return math.nan
        return parse_direction(text, "list the text under variable")

    def _parse_time(self, text: str) -> float | Problem:
        pattern, zone = self._columns.time_format, self._columns.zone
        try:
            stamp = datetime.fromisoformat(text) if pattern is None else datetime.strptime(text, pattern)  # noqa: DTZ007
        except ValueError:
            if pattern is None:
                return Problem("not an ISO 8601 time", "such as 2013-07-10T18:00Z, or give time_format")
            return Problem("the time does not fit time_format", f"written like {pattern}")
        if problem := check_year(stamp):
            return problem
        if stamp.tzinfo is not None:
            return stamp.timestamp()
        if zone is None:
            remedy = 'give time_zone = "UTC", or the zone of the clock such as "America/New_York"'
            return Problem("the time has no UTC offset", remedy)
        first, second = stamp.replace(tzinfo=zone), stamp.replace(tzinfo=zone, fold=1)
        ahead = (first.utcoffset() or _ZERO) - (second.utcoffset() or _ZERO)
        if ahead > _ZERO:
            self._repeated[text] = second.timestamp()
        elif ahead < _ZERO:
            self._skipped.add(text)
        return first.timestamp()

    def _settle_clock_changes(
        self, texts: Sequence[str], site: NDArray[np.float64], time_s: NDArray[np.float64]
    ) -> None:
        for row, raw in enumerate(texts):
            text = raw.strip()
            if text in self._repeated:
                self._repeated_rows += 1
                key = (float(site[row]), text)
                if self._seen[key] % 2:
                    time_s[row] = self._repeated[text]
                self._seen[key] += 1
            elif text in self._skipped:
                self._skipped_rows += 1

    def _drop_absurd(self, chunk: Chunk, speed: NDArray[np.float64]) -> None:
        rows = np.flatnonzero(speed > self._columns.max_speed_mps)
        if len(rows) and not self.absurd:
            value = chunk.columns[self._columns.speed][rows[0]].strip()
            self._first_absurd = f"in line {chunk.lines[rows[0]]}: {value} {self._columns.speed_unit}"
        self.absurd += len(rows)
        speed[rows] = np.nan


def check_year(stamp: datetime) -> Problem | None:
    """Return the problem with a time that cannot be in a wind record."""
    if FIRST_YEAR <= stamp.year <= LAST_YEAR:
        return None
    return Problem("the time is out of range", f"a year from {FIRST_YEAR} to {LAST_YEAR}")


def parse_number(text: str, otherwise: str = "") -> float | Problem:
    """Read a finite decimal number; `otherwise` is what else helps if it is none, such as where texts without a number are listed."""
    try:
        value = float(text) if "_" not in text else math.nan
    except ValueError:
        hint = "write the decimals after a point" if re.fullmatch(r"[-+]?\d+,\d+", text) else "a number"
        return Problem("not a number", f"{hint}, or {otherwise}" if otherwise else hint)
    return value if math.isfinite(value) else Problem("not a finite number", otherwise or "a number, or omit the row")


def parse_direction(text: str, otherwise: str = "") -> float | Problem:
    """Read a direction in degrees, 0 to 360; `otherwise` as for `parse_number`."""
    value = parse_number(text, otherwise)
    if isinstance(value, float) and not 0.0 <= value <= 360.0:
        remedy = "degrees from 0 to 360"
        return Problem("direction out of range", f"{remedy}, or {otherwise}" if otherwise else remedy)
    return value
