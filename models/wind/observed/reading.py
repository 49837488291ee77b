"""Observed winds in any form: typed, in a table, as METARs, or as the output of ``skyway forecast --json``."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from skyway.models.base.errors import Fault, InputError, one_line
from skyway.models.base.files import read_text
from skyway.models.base.formatting import place_text, speed_text, wind_text
from skyway.models.base.geodesy import coordinate_faults
from skyway.models.base.table import FaultCollector, Problem, read_table
from skyway.models.base.units import MPS_PER_KMH, MPS_PER_KNOT, from_posix, iso, parse_instant
from skyway.models.wind.columns import MAX_SPEED_MPS, check_year, parse_direction, parse_number
from skyway.models.wind.estimation.field import WindObservation
from skyway.models.wind.history import WindSite
from skyway.models.wind.observed.metar import parse_metars
from skyway.models.wind.observed.wrapped import unwrapped
from skyway.models.wind.triangle import speed_from, vector

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.base.table import Chunk

STATION_ERROR_MPS = 1.2
"""Difference of a station's mean over 2 or 10 minutes from the wind of a forecast, a component: least CRPS (decision 83)."""
SEEN_MPS = 35.0
"""Mean wind above this is measured at stations in hurricanes only: a larger one given as m/s is asked about."""
MAX_BYTES = 4 * 1024 * 1024
MAX_REPORTS = 20_000
TYPED = re.compile(r"([^=@/\\]+)=([^=@]+)@([^=@]+)(?:@([^=@]+))?")
JSON_FORMS = "METARs (text, or JSON of avwx or aviationweather.gov), or the output of skyway forecast LOG … --json"
VARIABLE = ("vrb", "variable")
_HAS = ("time", "speed_mps", "from_deg")
_MAY_HAVE = ("site", "lat", "lon", "height_m", "sigma_mps")


@dataclass(frozen=True, slots=True)
class ObservedWind:
    """An observed wind, and its source."""

    place: str
    """The site of the record, or latitude and longitude."""
    source: str
    """The file, or the typed text."""
    speed_mps: float
    from_deg: float | None
    """As reported; None is variable."""
    observation: WindObservation
    corrected: bool = False
    """A correction of an earlier report."""
    drone: bool = False
    """Measured by a drone in flight, averaged over a slot."""
    line: int | None = None
    """Of the file."""

    @property
    def told(self) -> str:
        """The wind for people."""
        return speed_text(self.speed_mps) if self.from_deg is None else wind_text(self.speed_mps, self.from_deg)

    @property
    def stands(self) -> str:
        """Where it was given: the file, with the line where that is known, or the typed text."""
        return self.source if self.line is None else f"{self.source}:{self.line}"


@dataclass(frozen=True, slots=True)
class Observations:
    """All given observations."""

    winds: tuple[ObservedWind, ...] = ()
    notes: tuple[str, ...] = ()
    """Notes for a person on reports without a usable wind."""

    def __add__(self, other: Observations) -> Observations:
        return Observations(self.winds + other.winds, self.notes + other.notes)


def read_observed(
    given: str, sites: Sequence[WindSite], measured_at_m: float, depart_s: float, *, field: str = "--observed"
) -> Observations:
    """Read winds: ``SITE=SPEED@FROM`` (with ``@TIME`` if not at the departure), or a file.

    A file is a table (``time, speed_mps, from_deg`` and ``site`` or ``lat, lon``, with ``height_m`` and ``sigma_mps`` where known), METARs
    as text or in JSON (`models.wind.observed.wrapped`), or the output of ``skyway forecast --json``. An `InputError` has all its faults.
    """
    typed = TYPED.fullmatch(given.strip())
    if typed is not None and not os.path.isfile(given):  # noqa: PTH113  it takes any text
        return Observations((_typed(typed, given, sites, measured_at_m, depart_s, field),))
    path = Path(given)
    bare = not path.suffix and site_named(given, sites) is not None and not os.path.exists(given)  # noqa: PTH110
    if bare or (not path.suffix and ("@" in given or "=" in given)):
        remedy = "write SITE=SPEED@FROM, m/s@degrees FROM, such as EWR=8@270, or name a file"
        raise InputError("not an observed wind", field=field, value=given, remedy=remedy)
    text = read_text(path, max_bytes=MAX_BYTES)
    first = next((line.strip() for line in text.splitlines() if line.strip()), "")
    if not first:
        raise InputError("is empty", str(path), remedy="a table with a header, or METARs, one a line")
    if first.startswith(("{", "[")):
        return _from_json(text, str(path), sites, measured_at_m, depart_s)
    if "speed_mps" in first or ("," in first and "time" in first.lower()):
        return Observations(_Table(path, sites, measured_at_m).read())
    return _from_metars(text, str(path), sites, measured_at_m, depart_s)


def site_named(name: str, sites: Sequence[WindSite]) -> WindSite | None:
    """Find a site by its id, its identifier in METARs, or that without its first letter (KEWR: EWR)."""
    wanted = name.strip().casefold()
    for site in sites:
        if wanted in (site.id.casefold(), site.icao.casefold() or None):
            return site
    return next((s for s in sites if len(wanted) == 4 and not s.icao and s.id.casefold() == wanted[1:]), None)


def _unknown(name: str, sites: Sequence[WindSite]) -> tuple[str, str]:
    """Problem and remedy of a station that is not a site of the scenario."""
    known = ", ".join(f"{site.id} ({site.icao})" if site.icao else site.id for site in sites) or "none"
    return f"unknown station {one_line(name)[:40]}", f"the scenario's wind sites are {known}"


def _at(
    site: WindSite, source: str, time_s: float, speed: float, degrees: float | None, height_m: float, sigma: float
) -> ObservedWind:
    """Make the observation of a station; a variable wind is 0 on average, with an uncertainty equal to its speed."""
    north, east = (0.0, 0.0) if degrees is None else map(float, vector(speed, degrees))
    variance = sigma**2 + (0.5 * speed**2 if degrees is None else 0.0)
    found = WindObservation(time_s, site.lat, site.lon, north, east, variance, height_m)
    return ObservedWind(site.id, source, speed, degrees, found)


def _typed(
    typed: re.Match[str], given: str, sites: Sequence[WindSite], measured_at_m: float, depart_s: float, field: str
) -> ObservedWind:
    name, speed_text_, from_text, time_text = typed.groups()
    site = site_named(name, sites)
    if site is None:
        problem, remedy = _unknown(name, sites)
        raise InputError(problem, field=field, value=given, remedy=remedy)
    speed, direction = parse_number(speed_text_.strip()), parse_direction(from_text.strip())
    variable = from_text.strip().casefold() in VARIABLE
    if isinstance(speed, Problem) or not 0.0 <= speed < math.inf:
        raise InputError("not a wind speed", field=field, value=given, remedy=f"m/s, from 0 to {SEEN_MPS:g}")
    if speed > SEEN_MPS:
        raise InputError(_unseen(speed), field=field, value=given, remedy=_units(speed))
    if isinstance(direction, Problem):
        if not variable:
            raise InputError("not a direction", field=field, value=given, remedy="degrees FROM, 0 to 360, or VRB")
        direction = math.nan
    time_s = depart_s if time_text is None else parse_instant(time_text, field=field).timestamp()
    degrees = None if variable else direction
    return _at(site, field, time_s, speed, degrees, measured_at_m, STATION_ERROR_MPS)


def _from_metars(
    text: str, file: str, sites: Sequence[WindSite], measured_at_m: float, depart_s: float
) -> Observations:
    faults = FaultCollector(file)
    found, notes = [], []
    reports = parse_metars(text, depart_s, faults)
    if len(reports) > MAX_REPORTS:
        raise InputError(f"has more than {MAX_REPORTS:,} reports", file, remedy="cut it to the last hours")
    for one in reports:
        site = site_named(one.station, sites)
        if site is None:
            problem, remedy = _unknown(one.station, sites)
            faults.add(problem, f"{remedy}; give one its identifier with icao, or remove the line", line=one.line)
        elif one.speed_mps is None:
            notes.append(f"{file}:{one.line}: {one.station} reports no wind at {iso(from_posix(one.time_s))}")
        elif one.speed_mps > MAX_SPEED_MPS:
            faults.add("not a wind speed", f"up to {MAX_SPEED_MPS:g} m/s", line=one.line, value=one.group)
        else:
            calm = one.speed_mps == 0.0
            degrees = 0.0 if calm else one.from_deg
            seen = _at(site, file, one.time_s, one.speed_mps, degrees, measured_at_m, STATION_ERROR_MPS)
            found.append(replace(seen, corrected=one.corrected, line=one.line))
    faults.raise_if_any()
    if not reports:
        raise InputError("has no report", file, remedy="a METAR a line, such as KEWR 101851Z 22010KT")
    return Observations(tuple(found), tuple(notes))


class _Table:
    """A table of observed winds; rows name a site, or a place."""

    def __init__(self, path: Path, sites: Sequence[WindSite], measured_at_m: float) -> None:
        self.path, self.sites, self.height_m = path, sites, measured_at_m
        self.faults = FaultCollector(str(path))
        self.count = 0

    def read(self) -> tuple[ObservedWind, ...]:
        """Read every row; an `InputError` has all faults."""
        found = [
            one for chunk in read_table(self.path, _HAS, self.faults, optional=_MAY_HAVE) for one in self._rows(chunk)
        ]
        self.faults.raise_if_any()
        return tuple(found)

    def _rows(self, chunk: Chunk) -> list[ObservedWind]:
        self.count += len(chunk.lines)
        if self.count > MAX_REPORTS:
            raise InputError(f"has more than {MAX_REPORTS:,} rows", str(self.path), remedy="cut it to the last hours")
        time_s = chunk.decode("time", _time, self.faults)
        speed = chunk.decode("speed_mps", _speed, self.faults)
        degrees = chunk.decode("from_deg", _direction, self.faults)
        lat, lon, height, sigma = (self._optional(chunk, name) for name in ("lat", "lon", "height_m", "sigma_mps"))
        names = chunk.columns.get("site", ("",) * len(chunk.lines))
        found = []
        for row, line in enumerate(chunk.lines):
            site = self._place(names[row].strip(), lat[row], lon[row], line)
            if site is None or math.isnan(time_s[row]) or math.isnan(speed[row]):
                continue
            named = bool(names[row].strip())
            at_m = self.height_m if math.isnan(height[row]) else height[row]
            error = STATION_ERROR_MPS if math.isnan(sigma[row]) else sigma[row]
            known = None if math.isnan(degrees[row]) else float(degrees[row])
            seen = _at(site, str(self.path), float(time_s[row]), float(speed[row]), known, float(at_m), float(error))
            found.append(replace(seen, drone=not named, line=line))
        return found

    def _optional(self, chunk: Chunk, name: str) -> Sequence[float]:
        """Read a column that may be missing, or empty in a row: NaN."""
        if name not in chunk.columns:
            return [math.nan] * len(chunk.lines)

        def parse(text: str) -> float | Problem:
            value = math.nan if not text else parse_number(text)
            low, high = {"lat": (-90.0, 90.0), "lon": (-180.0, 180.0), "height_m": (0.1, 10_000.0)}.get(
                name, (0.01, 50.0)
            )
            if isinstance(value, float) and not math.isnan(value) and not low <= value <= high:
                return Problem("out of range", f"{low:g} to {high:g}")
            return value

        values: list[float] = chunk.decode(name, parse, self.faults).tolist()
        return values

    def _place(self, name: str, lat: float, lon: float, line: int) -> WindSite | None:
        if name:
            site = site_named(name, self.sites)
            if site is None:
                problem, remedy = _unknown(name, self.sites)
                self.faults.add(problem, remedy, line=line, field="site")
            return site
        if math.isnan(lat) or math.isnan(lon):
            self.faults.add("has no place", "a site, or lat and lon", line=line)
            return None
        return WindSite(place_text(lat, lon), lat, lon)


def _time(text: str) -> float | Problem:
    try:
        instant = parse_instant(text)
    except InputError as error:
        return Problem(error.faults[0].problem, error.faults[0].remedy or "")
    return check_year(instant) or instant.timestamp()


def _speed(text: str) -> float | Problem:
    value = parse_number(text)
    if isinstance(value, float) and not 0.0 <= value < math.inf:
        return Problem("not a wind speed", f"metres per second, from 0 to {SEEN_MPS:g}")
    return Problem(_unseen(value), _units(value)) if isinstance(value, float) and value > SEEN_MPS else value


def _unseen(speed: float) -> str:
    return f"{speed:g} m/s is more than stations measure (up to {SEEN_MPS:g})"


def _units(speed: float) -> str:
    """Remedy for a speed that is probably in another unit."""
    return f"write m/s; {speed:g} km/h are {speed * MPS_PER_KMH:.1f}, {speed:g} knots {speed * MPS_PER_KNOT:.1f}"


def _direction(text: str) -> float | Problem:
    return math.nan if text.casefold() in ("", *VARIABLE) else parse_direction(text, "variable")


class _Measured(msgspec.Struct):
    """A wind measured by drones, in the form of ``skyway forecast --json``."""

    t: str
    lat: float
    lon: float
    north_mps: float
    east_mps: float
    sigma_mps: float


class _Update(msgspec.Struct):
    schema: str
    height_m: float
    observations: list[_Measured]


def _from_json(text: str, file: str, sites: Sequence[WindSite], measured_at_m: float, depart_s: float) -> Observations:
    """Read METARs in JSON, of the month that this tells, or the output of ``skyway forecast --json``."""
    try:
        value = msgspec.json.decode(text)
    except (msgspec.DecodeError, RecursionError) as error:
        raise InputError(f"is damaged JSON: {error}", file, remedy=JSON_FORMS) from error
    if isinstance(value, dict) and "schema" in value:
        return Observations(_from_update(text, file))
    bulletin = unwrapped(value, depart_s)
    if bulletin is None:
        raise InputError("is JSON, but no observed winds", file, remedy=JSON_FORMS)
    try:
        told = _from_metars(bulletin[0], file, sites, measured_at_m, bulletin[1])
    except InputError as error:  # lines are those of the reports, not of the file
        raise InputError([replace(fault, line=None) for fault in error.faults]) from error
    return Observations(tuple(replace(one, line=None) for one in told.winds), told.notes)


def _from_update(text: str, file: str) -> tuple[ObservedWind, ...]:
    remedy = "write one with skyway forecast LOG … --json"
    try:
        read = msgspec.json.decode(text, type=_Update)
    except (msgspec.ValidationError, msgspec.DecodeError) as error:
        raise InputError(f"is not what skyway forecast --json prints: {error}", file, remedy=remedy) from error
    if read.schema != "skyway.forecast-update/1":
        raise InputError("unknown schema", file, field="schema", value=read.schema, remedy=remedy)
    found, faults = [], []
    for number, one in enumerate(read.observations):
        field = f"observations[{number}]"
        time_s = parse_instant(one.t, field=f"{field}.t", file=file).timestamp()
        speed, degrees = map(float, speed_from(one.north_mps, one.east_mps))
        good = 0.0 <= speed <= MAX_SPEED_MPS and 0.0 < one.sigma_mps <= 50.0 and 0.0 < read.height_m <= 10_000.0
        if coordinate_faults(one.lat, one.lon) or not good:
            faults.append(Fault("is not a wind that was measured", file, field=field, remedy=remedy))
            continue
        seen = WindObservation(time_s, one.lat, one.lon, one.north_mps, one.east_mps, one.sigma_mps**2, read.height_m)
        found.append(ObservedWind(place_text(one.lat, one.lon), file, speed, degrees, seen, drone=True))
    if faults:
        raise InputError(faults)
    return tuple(found)
