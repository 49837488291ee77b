"""Measured wind: hourly vectors of several sites, read from a record, with gaps filled.

A record is converted to hourly vectors (north, east) TOWARDS which the air moves: directions cannot be
averaged, vectors can.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.formatting import date_clock, speed_text
from skyway.models.base.geodesy import coordinate_faults
from skyway.models.base.units import iso
from skyway.models.wind.columns import read_rows
from skyway.models.wind.triangle import vector

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from skyway.models.wind.columns import WindColumns, WindRows

SLOT_S = 3600
GAP_SLOTS = 3
"""A gap of at most this many hours is filled from the hours around it."""
MAX_YEARS = 60
MAX_CELLS = 30_000_000
"""Most hours times sites that a record may span."""
SUSPECT_MEDIAN_MPS = 15.0
"""Hardly any inhabited place on Earth has a median wind above this: the unit is probably another."""


@dataclass(frozen=True, slots=True)
class WindSite:
    """Site at which wind is measured or forecast."""

    id: str
    """Its name in the record."""
    lat: float
    lon: float
    """Degrees, WGS-84."""
    icao: str = ""
    """Its identifier in METARs; without one, its id, or that with a letter before it (EWR: KEWR)."""


def station_places(sites: Sequence[WindSite]) -> dict[str, tuple[float, float]]:
    """Places of sites by all their names in bulletins: the id, the identifier in METARs, or ``K`` and the id."""
    found = {
        name: (site.lat, site.lon) for site in sites if not site.icao and len(site.id) == 3 for name in (f"K{site.id}",)
    }
    for site in sites:
        found.update({name: (site.lat, site.lon) for name in (site.icao, site.id) if name})
    return found


@dataclass(frozen=True, slots=True)
class RowCounts:
    """Counts of a record's rows by how they were used."""

    rows: int
    calm: int
    variable: int
    missing: int
    absurd: int
    """Rows with speed 0; with a speed and no direction; without a speed; with an impossible speed, dropped."""
    directions_filled: int
    """Hours of a site with a measured speed whose direction came from the hours around or the other sites."""
    hours_interpolated: int
    hours_borrowed: int
    """Hours of a site without wind that were filled from the hours around, and from the other sites."""
    hours_empty: int
    """Hours of a site that stay without wind."""


@dataclass(frozen=True, slots=True, eq=False)
class WindHistory:
    """Hourly wind of several sites."""

    sites: tuple[WindSite, ...]
    """Column ``j`` of the arrays is ``sites[j]``."""
    start_s: float
    """POSIX seconds at which slot 0 begins, a whole hour."""
    north: NDArray[np.float64]
    east: NDArray[np.float64]
    """Shape (slots, sites) each. m/s TOWARDS, at the height of the measurement; NaN if nothing is known."""
    measured_at_m: float
    """Height of the instruments above ground."""
    source: str = ""
    counts: RowCounts | None = None
    """Counts of the rows of the record."""
    warnings: tuple[str, ...] = ()
    slot_s: float = SLOT_S

    def __len__(self) -> int:
        return len(self.north)

    def __repr__(self) -> str:
        sites = ", ".join(site.id for site in self.sites)
        days = len(self) * self.slot_s / 86400.0
        return f"WindHistory({sites}: {days:.0f} days from {iso(datetime.fromtimestamp(self.start_s, UTC))})"

    @property
    def end_s(self) -> float:
        """POSIX seconds at which the last slot ends."""
        return self.start_s + len(self.north) * self.slot_s

    @property
    def covers(self) -> str:
        """The time it covers, for people."""
        first, last = (datetime.fromtimestamp(t, UTC) for t in (self.start_s, self.end_s))
        return f"{date_clock(first)} to {date_clock(last, named=True)}"

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Whether a slot has the wind of every site, shape (slots,)."""
        return np.asarray(np.isfinite(self.north).all(axis=1))


def read_history(path: Path, columns: WindColumns, sites: Sequence[WindSite], measured_at_m: float) -> WindHistory:
    """Read a record of wind into hourly slots and fill its gaps.

    Several rows of a site within an hour are averaged as vectors. If only the direction is missing, it is taken from
    the hours around (gaps up to 3 h), otherwise from the other sites, and the speed is kept; if both are missing, the wind
    is filled in the same way. Other sites are weighted by the inverse square of their distance. Instruments stand `measured_at_m` above
    ground, usually 10.

    The CSV has at most 64 MB and 5 million rows; ``.gz`` is unpacked. An `InputError` has all its faults: values,
    times, sites or columns that cannot be read, no wind at all, or a span of more than 60 years.
    """
    _check_request(sites, columns, measured_at_m)
    rows = read_rows(path, columns, [site.id for site in sites])
    first, slots = _span(rows, len(sites), str(path))
    north, east, speed_only = _into_slots(rows, first, slots, len(sites))
    if not np.isfinite(north).any():
        remedy = "are the columns and the missing values the right ones?"
        raise InputError("has no row with both a speed and a direction", str(path), remedy=remedy)
    filled = _fill(north, east, speed_only, _closeness(sites))
    silent = [site.id for number, site in enumerate(sites) if not (rows.site == number).any()]
    counts = RowCounts(
        rows=len(rows.time_s),
        calm=int((rows.speed_mps == 0.0).sum()),
        variable=int(((rows.speed_mps > 0.0) & np.isnan(rows.from_deg)).sum()),
        missing=int(np.isnan(rows.speed_mps).sum()) - rows.absurd,
        absurd=rows.absurd,
        directions_filled=filled[0],
        hours_interpolated=filled[1],
        hours_borrowed=filled[2],
        hours_empty=int(np.isnan(north).sum()),
    )
    warnings = (*rows.warnings, *_warnings(rows, counts, silent, str(path), columns.speed_unit))
    return WindHistory(
        sites=tuple(sites),
        start_s=float(first * SLOT_S),
        north=north,
        east=east,
        measured_at_m=float(measured_at_m),
        source=str(path),
        counts=counts,
        warnings=warnings,
    )


def _check_request(sites: Sequence[WindSite], columns: WindColumns, measured_at_m: float) -> None:
    faults = check_sites(sites)
    if not (math.isfinite(measured_at_m) and measured_at_m > 0.0):
        remedy = "metres above ground, usually 10"
        faults.append(Fault("not a height", field="wind.measured_at_m", value=measured_at_m, remedy=remedy))
    ids = [site.id for site in sites]
    if columns.site is None and columns.default_site is None and len(ids) > 1:
        remedy = "name the column of the site, or default_site = one of " + ", ".join(ids)
        faults.append(Fault("the record does not name its site", field="wind.site", remedy=remedy))
    if columns.site is None and columns.default_site is not None and columns.default_site not in ids:
        remedy = "one of " + ", ".join(ids)
        faults.append(Fault("unknown site", field="wind.default_site", value=columns.default_site, remedy=remedy))
    refuse(faults)


def check_sites(sites: Sequence[WindSite]) -> list[Fault]:
    """Return the problem with the sites: none at all, two of one name, or a position out of range."""
    if not sites:
        return [Fault("there is no wind site", field="wind.sites", remedy="give id, lat and lon of each")]
    ids = [site.id for site in sites]
    faults = [
        Fault("two wind sites have the same id", field="wind.sites", value=name)
        for name in dict.fromkeys(ids)
        if ids.count(name) > 1
    ]
    for site in sites:
        faults += coordinate_faults(site.lat, site.lon, file=f"wind site {site.id}")
    return faults


def _span(rows: WindRows, sites: int, file: str) -> tuple[int, int]:
    """Return the hour since 1970 of slot 0, and the number of slots."""
    first, last = float(rows.time_s.min()), float(rows.time_s.max())
    slots = math.floor(last / SLOT_S) - math.floor(first / SLOT_S) + 1
    if slots > MAX_YEARS * 8766 or slots * sites > MAX_CELLS:
        span = " to ".join(datetime.fromtimestamp(t, UTC).date().isoformat() for t in (first, last))
        limit = f"at most {min(MAX_YEARS, MAX_CELLS // (8766 * sites))} years for {sites} sites"
        raise InputError("covers too long a time", file, field="time", value=span, remedy=limit)
    return math.floor(first / SLOT_S), slots


def _into_slots(
    rows: WindRows, first: int, slots: int, sites: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Average the rows of each hour and site: north, east, and the speed where no direction is known."""
    cell = (np.floor(rows.time_s / SLOT_S).astype(np.int64) - first) * sites + rows.site

    def mean(values: NDArray[np.float64], chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
        number = np.bincount(cell[chosen], minlength=slots * sites)
        total = np.bincount(cell[chosen], weights=values[chosen], minlength=slots * sites)
        average = np.full(slots * sites, np.nan)
        np.divide(total, number, out=average, where=number > 0)
        return average.reshape(slots, sites)

    blows = np.isfinite(rows.speed_mps)
    has_vector = blows & (np.isfinite(rows.from_deg) | (rows.speed_mps == 0.0))
    north, east = vector(rows.speed_mps, np.where(np.isnan(rows.from_deg), 0.0, rows.from_deg))
    north_mean, east_mean = mean(north, has_vector), mean(east, has_vector)
    speed_only = mean(rows.speed_mps, blows & ~has_vector)
    speed_only[np.isfinite(north_mean)] = np.nan
    return north_mean, east_mean, speed_only


def _closeness(sites: Sequence[WindSite]) -> NDArray[np.float64]:
    """Inverse squared distance between sites (sites, sites), 0 to itself; a metre is the nearest."""
    lat = np.array([site.lat for site in sites])
    lon = np.array([site.lon for site in sites])
    distance, _ = geodesy.inverse(lat[:, None], lon[:, None], lat[None, :], lon[None, :])
    closeness: NDArray[np.float64] = np.maximum(distance, 1.0) ** -2.0
    np.fill_diagonal(closeness, 0.0)
    return closeness


def _fill(
    north: NDArray[np.float64],
    east: NDArray[np.float64],
    speed_only: NDArray[np.float64],
    closeness: NDArray[np.float64],
) -> tuple[int, int, int]:
    """Fill gaps in place; return the numbers of directions completed, hours interpolated and hours filled from other sites."""
    completed = 0
    for around_n, around_e in (_from_time(north, east), _from_sites(north, east, closeness)):
        speed = np.hypot(around_n, around_e)
        known = np.isnan(north) & np.isfinite(speed_only) & (speed > 1e-9)
        north[known] = (around_n[known] / speed[known]) * speed_only[known]
        east[known] = (around_e[known] / speed[known]) * speed_only[known]
        completed += int(known.sum())
    filled = []
    for source in (_from_time, lambda n, e: _from_sites(n, e, closeness)):
        around_n, around_e = source(north, east)
        known = np.isnan(north) & np.isfinite(around_n)
        north[known], east[known] = around_n[known], around_e[known]
        filled.append(int(known.sum()))
    return completed, filled[0], filled[1]


def _from_time(
    north: NDArray[np.float64], east: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Interpolate linearly in the gaps of at most three hours; NaN elsewhere, shape (slots, sites)."""
    filled = np.full_like(north, np.nan), np.full_like(east, np.nan)
    for site in range(north.shape[1]):
        known = np.flatnonzero(np.isfinite(north[:, site]))
        empty = np.flatnonzero(np.isnan(north[:, site]))
        place = np.searchsorted(known, empty)
        inside = (place > 0) & (place < len(known))
        empty, place = empty[inside], place[inside]
        before, after = known[place - 1], known[place]
        short = after - before - 1 <= GAP_SLOTS
        empty, before, after = empty[short], before[short], after[short]
        part = (empty - before) / (after - before)
        for values, target in zip((north, east), filled, strict=True):
            target[empty, site] = (1.0 - part) * values[before, site] + part * values[after, site]
    return filled


def _from_sites(
    north: NDArray[np.float64], east: NDArray[np.float64], closeness: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean of the other sites of the same hour by inverse square of distance; NaN if none is known."""
    known = np.isfinite(north)
    weight = known.astype(np.float64) @ closeness
    means = []
    for values in (north, east):
        mean = np.full_like(values, np.nan)
        np.divide(np.where(known, values, 0.0) @ closeness, weight, out=mean, where=weight > 0.0)
        means.append(mean)
    return means[0], means[1]


def _warnings(rows: WindRows, counts: RowCounts, silent: list[str], file: str, speed_unit: str) -> tuple[str, ...]:
    said = []
    median = float(np.nanmedian(rows.speed_mps))
    if median > SUSPECT_MEDIAN_MPS:
        said.append(f"{file}: the median speed is {speed_text(median)}; is {speed_unit} really the unit?")
    if silent:
        said.append(f"{file}: no row of {', '.join(silent)}; their wind is taken from the other sites")
    if counts.hours_empty:
        said.append(f"{file}: hours of a site that stay without wind: {counts.hours_empty:,}")
    return tuple(said)
