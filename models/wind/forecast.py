"""Wind forecasts: ensembles of analogue days, of one day, of one constant wind, or of a file."""

from __future__ import annotations

import math
from datetime import date, timedelta
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.geodesy import coordinate_faults
from skyway.models.base.ranges import number_faults
from skyway.models.base.units import from_posix, iso, utc
from skyway.models.wind.ensemble import WindEnsemble
from skyway.models.wind.forecast_file import read_forecast_table
from skyway.models.wind.history import check_sites
from skyway.models.wind.triangle import vector

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence
    from datetime import datetime
    from pathlib import Path

    from numpy.typing import NDArray

    from skyway.models.wind.history import WindHistory, WindSite

__all__ = ["WindEnsemble", "analogue_ensemble", "constant_wind", "read_forecast", "truth_series"]

MAX_HOURS = 24 * 14
_DAYS_BEFORE_MONTH = np.array([0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334])


def analogue_ensemble(
    history: WindHistory,
    depart: datetime,
    hours: int,
    season_days: int = 30,
    exclude: Collection[date] = (),
) -> WindEnsemble:
    """Make an ensemble of the days of a record in the same season.

    Each member is the measured series beginning at the same UTC hour as the departure, on a day whose date is at most
    `season_days` from the departure's in the circle of the year (29 February counts as the 28th). All are equally
    probable, none has a gap or overlaps the departure's own, or one of a day to `exclude`, such as the true day of a
    trial. They are for the height of the measurement. Dates are those of the clock of `depart`, so give it with its
    local offset; it lies in slot 0, and may be in the future of the record.

    Raises an `InputError` for an unknown day, a naive time or a length out of range.
    """
    days = _Days(history, depart, hours)
    today = _day_of_year(np.array([days.today]))[0]
    offset = (days.of_year() - today) % 365
    season = np.minimum(offset, 365 - offset) <= season_days
    allowed = season & days.complete
    for closed in (days.today, *(np.datetime64(day, "D") for day in exclude)):
        apart = np.abs((days.dates - closed).astype(np.int64)) * 86_400.0
        allowed &= apart >= days.slots * history.slot_s
    if not allowed.any():
        middle = date(2013, 1, 1) + timedelta(days=int(today))
        begin, end = (middle + timedelta(days=sign * min(season_days, 182)) for sign in (-1, 1))
        wanted = f"{begin:%d %B} to {end:%d %B}"
        whole = season & days.complete
        count = f"{season.sum()} day{'' if season.sum() == 1 else 's'} in that season"
        found = (
            f"{count}, none without a gap"
            if not whole.any()
            else f"{count}, {whole.sum()} without a gap, all of them excluded"
        )
        problem = f"no analogue day for the season {wanted}"
        how = (
            "hold out fewer days, widen the season or give another record"
            if len(exclude) > 1
            else "widen the season or give another record"
        )
        remedy = f"the record covers {history.covers} ({found}); {how}"
        raise InputError(problem, history.source or None, remedy=remedy)
    return days.ensemble(np.flatnonzero(allowed))


def truth_series(history: WindHistory, day: date, depart: datetime, hours: int) -> WindEnsemble:
    """Move the measurements of a day to a departure, as an ensemble of one.

    The series begins at the same UTC hour as the departure; `day` is a date of the clock of `depart`. An `InputError`
    names the nearest day with a complete series if that day has none.
    """
    days = _Days(history, depart, hours)
    wanted = np.datetime64(day, "D")
    hit = np.flatnonzero((days.dates == wanted) & days.complete)
    if len(hit):
        return days.ensemble(hit)
    remedy = f"the record covers {history.covers}"
    whole = days.dates[days.complete]
    if len(whole):
        nearest = whole[np.argmin(np.abs((whole - wanted).astype(np.int64)))]
        remedy += f"; the nearest day without a gap is {nearest}"
    problem = f"the record has no complete {hours} h of wind for the day"
    raise InputError(problem, history.source or None, None, "truth", day.isoformat(), remedy)


def constant_wind(
    speed_mps: float, from_deg: float, depart: datetime, hours: int, lat: float, lon: float, height_m: float
) -> WindEnsemble:
    """Return a constant wind at all places, as an ensemble of one.

    Raises
    ------
    InputError
        A negative or infinite speed, a direction outside 0 to 360, an impossible position or height.
    """
    given = {"speed_mps": speed_mps, "from_deg": from_deg, "lat": lat, "lon": lon, "height_m": height_m}
    refuse([fault for name, value in given.items() for fault in number_faults(name, value)])
    faults = coordinate_faults(lat, lon)
    if not 0.0 <= speed_mps < math.inf:
        faults.append(Fault("not a wind speed", field="wind", value=speed_mps, remedy="0 or more, in m/s"))
    if not 0.0 <= from_deg <= 360.0:
        remedy = "degrees from 0 to 360, where the wind comes from"
        faults.append(Fault("not a direction", field="wind", value=from_deg, remedy=remedy))
    if not 0.0 < height_m < math.inf:
        faults.append(_not_a_height(height_m))
    refuse(faults)
    north, east = (np.full((1, check_hours(hours), 1), part) for part in vector(speed_mps, from_deg))
    start_s = math.floor(utc(depart).timestamp() / 3600.0) * 3600.0
    label = f"{speed_mps:g} m/s from {from_deg:g}°"
    place = np.array([lat]), np.array([lon])
    return WindEnsemble(*place, start_s, 3600.0, north, east, np.ones(1), (label,), height_m)


def read_forecast(
    path: Path, sites: Sequence[WindSite], depart: datetime, hours: int, measured_at_m: float
) -> WindEnsemble:
    """Read an external forecast, for a height above ground.

    The CSV has time (ISO 8601 with offset), site, member, speed_mps, from_deg [, probability]. The times are evenly
    spaced, at most 6 h apart; every member has every one of the sites at every time. Without the last column all
    members are equally probable. The departure lies in slot 0 of the answer; after the end of the file the last wind
    continues.

    An `InputError` has all faults of the file, or the range it covers where the departure is outside.
    """
    faults = check_sites(sites)
    if not 0.0 < measured_at_m < math.inf:
        faults.append(_not_a_height(measured_at_m))
    refuse(faults)
    table = read_forecast_table(path, [site.id for site in sites])
    start_s, slot_s = float(table.times_s[0]), table.slot_s
    depart_s, given = utc(depart).timestamp(), len(table.times_s)
    first = math.floor((depart_s - start_s) / slot_s)
    if not 0 <= first < given:
        begin, end = iso(from_posix(start_s)), iso(from_posix(start_s + given * slot_s))
        problem = f"the forecast does not cover the departure, only {begin} to {end}"
        raise InputError(problem, str(path), None, "depart", iso(depart))
    end_s = depart_s + check_hours(hours) * 3600.0
    last = math.ceil((end_s - start_s) / slot_s)
    chosen = np.minimum(np.arange(first, last), given - 1)
    return WindEnsemble(
        site_lat=np.array([site.lat for site in sites]),
        site_lon=np.array([site.lon for site in sites]),
        start_s=start_s + first * slot_s,
        slot_s=slot_s,
        north=table.north[:, chosen],
        east=table.east[:, chosen],
        probability=table.probability,
        labels=table.members,
        height_m=measured_at_m,
    )


def _not_a_height(value: float) -> Fault:
    return Fault("not a height", field="height", value=value, remedy="metres above ground, above 0")


def check_hours(hours: int) -> int:
    """Return a number of hours that a forecast may have, or raise `InputError`."""
    if not 1 <= hours <= MAX_HOURS:
        raise InputError("not a length of forecast", field="hours", value=hours, remedy=f"from 1 to {MAX_HOURS}")
    return hours


class _Days:
    """The days of a record, each as the series that begins at the hour of a departure."""

    def __init__(self, history: WindHistory, depart: datetime, hours: int) -> None:
        self._history = history
        self.slots = math.ceil(check_hours(hours) * 3600.0 / history.slot_s)
        instant = utc(depart)
        own = math.floor((instant.timestamp() - history.start_s) / history.slot_s)
        self._start_s = history.start_s + own * history.slot_s
        self.today = np.datetime64(depart.date(), "D")
        """Date of the departure on its own clock."""
        per_day = round(86_400.0 / history.slot_s)
        number = np.arange(own % per_day, max(len(history), 1), per_day)
        self._first = number
        self.dates = self.today + ((number - own) // per_day).astype("m8[D]")
        """Date of each series, shape (days,)."""
        gaps = np.concatenate(([0], np.cumsum(~history.complete)))
        last = np.minimum(number + self.slots, len(history))
        self.complete = (number + self.slots <= len(history)) & (gaps[last] == gaps[np.minimum(number, last)])
        """Whether a series lies within the record and has no gap, shape (days,)."""

    def of_year(self) -> NDArray[np.int64]:
        """Day of the year of each series, 0 to 364."""
        return _day_of_year(self.dates)

    def ensemble(self, chosen: NDArray[np.int64]) -> WindEnsemble:
        """Return the chosen series, equally probable."""
        history = self._history
        rows = self._first[chosen][:, None] + np.arange(self.slots)
        return WindEnsemble(
            site_lat=np.array([site.lat for site in history.sites]),
            site_lon=np.array([site.lon for site in history.sites]),
            start_s=self._start_s,
            slot_s=history.slot_s,
            north=history.north[rows],
            east=history.east[rows],
            probability=np.full(len(chosen), 1.0 / len(chosen)),
            labels=tuple(str(day) for day in self.dates[chosen]),
            height_m=history.measured_at_m,
        )


def _day_of_year(dates: NDArray[np.datetime64]) -> NDArray[np.int64]:
    """Day of a year of 365 days, 0 to 364; 29 February is the 28th."""
    months = dates.astype("M8[M]")
    month = months.astype(np.int64) % 12
    day = (dates - months.astype("M8[D]")).astype(np.int64)
    return np.asarray(_DAYS_BEFORE_MONTH[month] + np.where(month == 1, np.minimum(day, 27), day))
