"""A wind ensemble over a region, made from weather files, for planners.

Members keep their courses over time and place. Between the points of a grid, and from one time to the next, components are interpolated; the wind is
converted to the height of flight by the heights in the forecast (`profile`). Of one model only the newest issue counts. Different models
share the probability equally.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.formatting import duration, speed_text
from skyway.models.base.geodesy import inverse
from skyway.models.base.units import from_posix, iso
from skyway.models.weather.hourly import hourly_weather
from skyway.models.weather.lags import lags
from skyway.models.weather.lead_error import PUBLISHED, with_errors
from skyway.models.weather.placing import Placing
from skyway.models.weather.profile import wind_at_height
from skyway.models.weather.weather import EAST, NORTH, Box, FieldKey
from skyway.models.wind.ensemble import WindEnsemble
from skyway.models.wind.triangle import height_factor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.weather.lead_error import LeadError
    from skyway.models.weather.region import Region
    from skyway.models.weather.weather import Weather

MOST_NODES = 4
"""Nodes of the lattice over the region, along each side."""
SHORTEST_SLOT_S, LONGEST_SLOT_S = 900.0, 3600.0
MAX_GAP_S = 6.5 * 3600.0
"""Between two times of a forecast: interpolation over a longer gap would invent the wind."""
MOST_MPS = 150.0
"""Stronger than any wind near the ground: 113 m/s is the strongest gust ever measured outside of a tornado."""
OLD_S = 24 * 3600.0
"""A forecast issued longer before the departure is old."""
MEMBERS = 60
"""Number of courses made of a forecast with one."""
FADE_S = 6 * 3600.0
"""Time in which the forecast's last deviation from the record fades, after its end."""


def forecast_ensemble(weathers: Sequence[Weather], region: Region, error: LeadError = PUBLISHED) -> WindEnsemble:
    """Make the wind over a region from all usable weather files. Raises an `InputError` if that is impossible."""
    used, notes = _newest(weathers, region)
    slot_s = min(
        min(max(one.step_s if one.step_s == one.step_s else 3600.0, SHORTEST_SLOT_S), LONGEST_SLOT_S) for one in used
    )
    start_s = math.floor(region.depart_s / slot_s) * slot_s
    slots = math.ceil((region.depart_s + region.hours * 3600.0 - start_s) / slot_s)
    lat, lon, shape = _lattice(used, region)
    until_s = min(
        float(one.times_s[-1]) + (one.step_s if one.holds and one.step_s == one.step_s else 0.0) for one in used
    )
    middle_s = start_s + slot_s * np.arange(0.5, slots, dtype=np.float64)
    distance_m, _ = inverse(lat[:, None], lon[:, None], lat[None], lon[None])
    parts: list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], tuple[str, ...]]] = []
    for number, one in enumerate(used):
        north, east, kept, left = _courses(one, region, lat, lon, middle_s)
        if left:
            heights = " and ".join(f"{height:g}" for height in left)
            notes.append(f"{one.model}: its wind at {heights} m has gaps and is not used")
        weight = (
            np.full(len(kept), 1.0 / len(kept))
            if one.probability is None
            else one.probability[kept] / one.probability[kept].sum()
        )
        if len(kept) < len(one.members):
            notes.append(f"{len(one.members) - len(kept)} members of {one.model} have no wind here and are ignored")
        labels = tuple(one.members[member] for member in kept)
        if one.form != "CSV":
            issued_s = one.issued_s if math.isfinite(one.issued_s) else float(one.times_s[0])
            lead_s = np.maximum(middle_s - issued_s, 0.0)
            factor = float(height_factor(region.height_m, error.height_m, region.exponent))
            courses = with_errors(
                north,
                east,
                lead_s,
                distance_m,
                error,
                factor=factor,
                slot_s=slot_s,
                members=MEMBERS,
                seed=region.seed + number,
                lattice=shape,
            )
            notes.append(f"{one.model}: {courses.note}")
            if courses.each > 1:
                labels = tuple(
                    f"{name}.{number}".lstrip(".") for name in labels for number in range(1, courses.each + 1)
                )
                weight = np.repeat(weight / courses.each, courses.each)
            north, east = courses.north, courses.east
        parts.append(
            (
                north,
                east,
                weight / len(used),
                tuple(f"{one.model} {name}".strip() if len(used) > 1 else name or one.model for name in labels),
            )
        )
    found = WindEnsemble(
        site_lat=lat, site_lon=lon, start_s=start_s, slot_s=slot_s,
        north=np.concatenate([part[0] for part in parts]), east=np.concatenate([part[1] for part in parts]),
        probability=np.concatenate([part[2] for part in parts]), labels=tuple(name for part in parts for name in part[3]),
        height_m=region.height_m, lattice=shape, known_until_s=until_s, notes=tuple(dict.fromkeys(notes)),
        weather=hourly_weather(used, region, lat, lon, start_s, slot_s, slots),
    )  # fmt: skip
    return _continued(found, region)


def _newest(weathers: Sequence[Weather], region: Region) -> tuple[list[Weather], list[str]]:
    """The series that count: of each model the newest issue that is out and covers the departure; and notes on the rest."""
    notes: list[str] = []
    usable: list[Weather] = []
    faults: list[InputError] = []
    for one in weathers:
        try:
            _check(one, region)
        except InputError as error:
            faults.append(error)
        else:
            usable.append(one)
    if not usable:
        raise (
            InputError([fault for error in faults for fault in error.faults])
            if faults
            else InputError("no forecast was given")
        )
    newest: dict[str, Weather] = {}
    for one in sorted(usable, key=lambda each: each.issued_s if math.isfinite(each.issued_s) else -math.inf):
        newest[one.model] = one
    notes += [f"ignored: {error.faults[0]}" for error in faults]
    for lag in lags(usable):
        notes.append(
            f"{lag.model}: from the issue of {iso(from_posix(lag.earlier_s))} to the next, the wind at {lag.height_m:g} m changed by {speed_text(lag.rms_mps)}"
        )
    for one in newest.values():
        age_s = region.depart_s - one.issued_s
        if age_s > OLD_S:
            notes.append(
                f"the forecast of {one.model} was issued {duration(age_s)} before the departure: fetch a newer one"
            )
        begun_s = region.depart_s - float(one.times_s[0])
        if not math.isfinite(one.issued_s) and begun_s > OLD_S:
            notes.append(
                f"the forecast of {one.model} does not state its issue time; it begins {duration(begun_s)} before the departure and may be that old: fetch a newer one"
            )
        issued = f"issued {iso(from_posix(one.issued_s))}" if math.isfinite(one.issued_s) else "unknown issue time"
        heights = " and ".join(f"{height:g}" for height in one.wind_heights_m)
        count = "single forecast" if len(one.members) == 1 else f"{len(one.members)} members"
        notes.append(f"wind of {one.name}: {one.model}, {issued}, {count}, at {heights} m")
        notes += [f"{one.model}: {note}" for note in one.notes]
    return list(newest.values()), notes


def check_place(one: Weather, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> None:
    """Raise an `InputError` where a series cannot be used for planning at some places, at any time."""
    if one.form == "METAR":
        raise InputError(
            "is an observation, not a forecast",
            one.name,
            remedy="hand it over with --observed, and a forecast with --forecast",
        )
    if not len(one.places):
        raise InputError(
            f"does not cover the region ({Box.around(lat, lon)}): its grid ({one.places.kind}) lies elsewhere", one.name,
            remedy="ask for a forecast of this region, or see whether its lat and lon are swapped",
        )  # fmt: skip
    one.needs_wind()
    for height_m in one.wind_heights_m:
        speed = np.hypot(*(one.fields[FieldKey(part, height_m)] for part in (NORTH, EAST)))
        strongest = float(np.nanmax(speed, initial=0.0))
        if strongest > MOST_MPS:
            problem = f"has a wind of {strongest:.6g} m/s at {height_m:g} m: no wind is so strong"
            raise InputError(problem, one.name, remedy="check its unit, and its marker of missing values")


def _check(one: Weather, region: Region) -> None:
    """Raise an `InputError` where a series cannot be planned with."""
    check_place(one, region.lat, region.lon)
    first, last = float(one.times_s[0]), float(one.times_s[-1])
    step = one.step_s if math.isfinite(one.step_s) else LONGEST_SLOT_S
    if not first - min(step, LONGEST_SLOT_S) <= region.depart_s <= last + (step if one.holds or first == last else 0.0):
        begin, end = iso(from_posix(first)), iso(from_posix(last))
        ended = region.depart_s > last
        problem = f"does not cover the departure at {iso(from_posix(region.depart_s))}, only {begin} to {end}"
        if ended and math.isfinite(one.issued_s):
            problem += f" (issued {duration(region.depart_s - one.issued_s)} before it)"
        raise InputError(
            problem, one.name, remedy="fetch a newer forecast" if ended else "fetch the forecast that covers it"
        )


def _lattice(
    used: Sequence[Weather], region: Region
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[int, int]]:
    """Nodes over the region, as fine as the finest grid, up to `MOST_NODES` along a side."""
    box = Box.around(region.lat, region.lon)
    middle = 0.5 * (box.south + box.north)
    high_m = 111_195.0 * (box.north - box.south)
    wide_m = 111_195.0 * (box.east - box.west) * math.cos(math.radians(middle))
    several = [one for one in used if len(one.places) > 1]
    spacings = [
        one.places.spacing_m if math.isfinite(one.places.spacing_m) else 0.25 * max(high_m, wide_m, 1.0)
        for one in several
    ]

    def count(length_m: float) -> int:
        return min(math.ceil(length_m / max(min(spacings), 1.0)) + 1, MOST_NODES) if spacings and length_m > 1.0 else 1

    rows, columns = count(high_m), count(wide_m)
    lats = np.linspace(box.south, box.north, rows) if rows > 1 else np.array([middle])
    lons = np.linspace(box.west, box.east, columns) if columns > 1 else np.array([0.5 * (box.west + box.east)])
    grid = np.meshgrid(lats, lons, indexing="ij")
    return grid[0].ravel(), grid[1].ravel(), (rows, columns)


def _courses(
    one: Weather, region: Region, lat: NDArray[np.float64], lon: NDArray[np.float64], at_s: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], tuple[float, ...]]:
    """(north, east) at places and times, shape (members kept, times, places) each, which members they are, and heights with gaps, m."""
    placing = Placing(one, lat, lon, Box.around(region.lat, region.lon))
    heights, levels = [], []
    for height in one.wind_heights_m:
        parts = [placing(one.fields[FieldKey(part, height)]) for part in (NORTH, EAST)]
        if np.isfinite(parts[0]).any() and np.isfinite(parts[1]).any():
            heights.append(height)
            levels.append(np.stack(parts))
    if not heights:
        raise InputError("has no wind in the region, only gaps", one.name, remedy="ask for a forecast of this region")
    stack = np.stack(levels, axis=1)  # (component, height, member, time, place)
    gaps = np.isnan(stack).sum(axis=(0, 2, 3, 4))
    whole = np.flatnonzero(gaps == gaps.min())
    north, east = wind_at_height(
        [heights[k] for k in whole], stack[0, whole], stack[1, whole], region.height_m, region.exponent
    )
    used = {heights[k] for k in whole}
    known = np.asarray(np.isfinite(north + east).all(axis=-1))  # (member, time)
    kept = np.flatnonzero(known.any(axis=1))
    found = np.empty((2, len(kept), len(at_s), len(lat)))
    for row, member in enumerate(kept):
        times = np.flatnonzero(known[member])
        _check_gaps(one, one.times_s[times], at_s)
        for part, values in enumerate((north[member, times], east[member, times])):
            found[part, row] = _in_time(one.times_s[times], values, at_s, holds=one.holds)
    return found[0], found[1], kept, tuple(height for height in one.wind_heights_m if height not in used)


def _check_gaps(one: Weather, times_s: NDArray[np.float64], at_s: NDArray[np.float64]) -> None:
    steps = np.diff(times_s)
    for number in np.flatnonzero(steps > MAX_GAP_S):
        if times_s[number + 1] > at_s[0] and times_s[number] < at_s[-1]:
            begin, end = (iso(from_posix(float(times_s[k]))) for k in (number, number + 1))
            problem = f"has no wind between {begin} and {end}"
            raise InputError(
                problem,
                one.name,
                remedy=f"add the hours between: at most {duration(MAX_GAP_S)} may lie between two times",
            )


def _in_time(
    times_s: NDArray[np.float64], values: NDArray[np.float64], at_s: NDArray[np.float64], *, holds: bool
) -> NDArray[np.float64]:
    """Values, shape (times, places), at instants; beyond the ends the nearest one."""
    if len(times_s) == 1:
        return np.repeat(values, len(at_s), axis=0)
    if holds:
        return np.asarray(values[np.clip(np.searchsorted(times_s, at_s, side="right") - 1, 0, len(times_s) - 1)])
    after = np.clip(np.searchsorted(times_s, at_s), 1, len(times_s) - 1)
    share = np.clip((at_s - times_s[after - 1]) / (times_s[after] - times_s[after - 1]), 0.0, 1.0)[:, None]
    return np.asarray((1.0 - share) * values[after - 1] + share * values[after])


def _continued(found: WindEnsemble, region: Region) -> WindEnsemble:
    """Continue the wind with the record after the end of the forecast: each member by a day of it, from the member's last wind to the day's."""
    from dataclasses import replace

    end_s = found.start_s + found.slots * found.slot_s
    if found.known_until_s >= end_s:
        return found
    holds = "after its end the last wind continues, with the error of that lead time"
    if region.later is None:
        return replace(found, then=holds)
    begin_s = max(found.known_until_s, found.start_s)
    try:
        days = region.later(begin_s, math.ceil((end_s - begin_s) / 3600.0) + 1)
    except InputError:
        return replace(found, then=holds)
    days = days.at_height(found.height_m, region.exponent)
    weight = days.weights(found.site_lat, found.site_lon)
    first = max(math.ceil((begin_s - found.start_s) / found.slot_s - 0.5), 1)
    middle = found.start_s + (np.arange(first, found.slots) + 0.5) * found.slot_s
    slot = np.clip(np.floor((middle - days.start_s) / days.slot_s), 0, days.slots - 1).astype(np.int64)
    chosen = np.random.default_rng(region.seed).permutation(np.arange(len(found)) % len(days))
    fade = np.exp(-(middle - begin_s) / FADE_S)[:, None]
    parts = []
    for given, record in ((found.north, days.north), (found.east, days.east)):
        course = record[chosen][:, slot] @ weight.T
        last = given[:, first - 1 : first] - course[:, :1]
        parts.append(np.concatenate((given[:, :first], course + fade * last), axis=1))
    return replace(
        found, north=parts[0], east=parts[1], then="after its end the winds of the record in this season follow"
    )
