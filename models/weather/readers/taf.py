"""TAF, the forecast for an aerodrome, as a series of its prevailing wind.

FM replaces the preceding forecast, BECMG changes to the new wind over its period, TEMPO and PROB do not change the prevailing wind: stronger wind in them
counts as a gust. A variable direction (VRB) is that of the preceding group, since it means a light wind.

Source: WMO-No. 306, Manual on Codes, volume I.1, FM 51 TAF, sections 51.1 to 51.10; ICAO Annex 3, appendix 5.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.units import SPEED_UNITS_MPS
from skyway.models.weather.weather import EAST, GUST, NORTH, SURFACE_M, USUAL_HEIGHT_M, FieldKey, Places, Weather
from skyway.models.wind.observed.metar import UNITS, WIND, nearest_s
from skyway.models.wind.triangle import vector

if TYPE_CHECKING:
    from collections.abc import Mapping

HEAD = re.compile(r"(?<![A-Z0-9/])([A-Z][A-Z0-9]{3}) +(\d{2})(\d{2})(\d{2})Z +(?:NIL\b|CNL\b|(\d{4})/(\d{4}))")
GROUP = re.compile(r"(?:^| )(FM\d{6}|(?:PROB\d{2} +)?(?:TEMPO|BECMG) +\d{4}/\d{4}|PROB\d{2} +\d{4}/\d{4})(?= |$)")
VISIBILITY = re.compile(r"(?:^| )(?:(P|M)?(?:(\d+) )?(\d+)(?:/(\d+))?SM|(\d{4})(?:NDV)?|(CAVOK))(?= |$)")
STATUTE_MILE_M = 1609.344
MAX_HOURS = 48.0
NAMED = ("TAF ", "TAF AMD ", "TAF COR ")
NOTHING = ("NIL", "CNL")
"""A report that was omitted; a forecast that was cancelled (FM 51 TAF, 51.1.4 and 51.1.6)."""


@dataclass(frozen=True, slots=True)
class _Wind:
    """Contents of one group; NaN: absent."""

    speed_mps: float
    from_deg: float
    gust_mps: float
    visibility_m: float


def is_taf(text: str) -> bool:
    """Whether a text contains a TAF, even an empty one (NIL)."""
    flat = _flat(text)
    return any(match[5] or flat[: match.start()].endswith(NAMED) for match in HEAD.finditer(flat))


def _flat(text: str) -> str:
    return " ".join(text.upper().replace("=", " = ").split())


def read_taf(text: str, file: str, near_s: float, stations: Mapping[str, tuple[float, float]]) -> list[Weather]:
    """Read the TAFs in a text; its month is that in which it was issued nearest to `near_s`, POSIX seconds.

    `stations` gives the places of known stations by identifier. An `InputError` quotes the group that cannot be read.
    """
    flat = _flat(text)
    heads = list(HEAD.finditer(flat))
    found: list[Weather] = []
    empty = []
    for one, after in zip(heads, [*heads[1:], None], strict=True):
        body = flat[one.end() : None if after is None else after.start()].partition("=")[0].strip()
        if not one[5] or body.startswith(NOTHING):
            empty.append(one[0].strip())
            found = [other for other in found if other.places.names != (one[1],)]
        else:
            found.append(_series(one, body, file, near_s, stations))
    if not found:
        problem = "has no TAF in force, only NIL or CNL" if empty else "has no TAF with a period"
        remedy = "give the newest one" if empty else "such as TAF KJFK 090315Z 0903/1006 27007KT"
        raise InputError(problem, file, value="; ".join(empty) or None, remedy=remedy)
    newest: dict[str, Weather] = {}
    for weather in found:  # an amendment replaces the earlier issue
        name = weather.places.names[0]
        if name not in newest or weather.issued_s >= newest[name].issued_s:
            newest[name] = weather
    return list(newest.values())


def _series(
    head: re.Match[str], body: str, file: str, near_s: float, stations: Mapping[str, tuple[float, float]]
) -> Weather:
    station, where = head[1], head[0]
    issued_s = nearest_s(int(head[2]), int(head[3]), int(head[4]), near_s)
    begin_s, end_s = _hour(head[5], issued_s, file, where), _hour(head[6], issued_s, file, where)
    if issued_s is None or not 0.0 < end_s - begin_s <= MAX_HOURS * 3600.0:
        raise InputError("no such period", file, field=station, value=where)
    marks = [(match[1], match.start(), match.end()) for match in GROUP.finditer(body)]
    texts = [("", body[: marks[0][1]] if marks else body)]
    for (mark, _, begin), after in zip(marks, [*marks[1:], None][: len(marks)], strict=True):
        texts.append((mark, body[begin : None if after is None else after[1]]))
    first = _group(texts[0][1], file, station)
    if math.isnan(first.speed_mps):
        raise InputError("has no wind", file, field=station, value=where, remedy="such as 27007KT after the period")
    hours = np.arange(math.floor(begin_s / 3600.0), math.ceil(end_s / 3600.0) + 1) * 3600.0
    periods = [
        (mark, *_period(mark, begin_s, end_s, issued_s, file), _group(words, file, station))
        for mark, words in texts[1:]
    ]
    times = np.unique(np.concatenate([hours, [one for _, start, stop, _ in periods for one in (start, stop)]]))
    times = times[(times >= begin_s) & (times <= end_s)]
    north, east, gust, visibility = _prevailing(first, periods, times)
    lat, lon = stations.get(station, (math.nan, math.nan))
    values = {
        FieldKey(NORTH, USUAL_HEIGHT_M): north, FieldKey(EAST, USUAL_HEIGHT_M): east, FieldKey(GUST, USUAL_HEIGHT_M): gust,
        FieldKey("visibility", SURFACE_M): visibility,
    }  # fmt: skip
    fields = {key: one.reshape(1, -1, 1) for key, one in values.items() if not np.isnan(one).all()}
    places = Places(np.array([lat]), np.array([lon]), f"aerodrome {station}", names=(station,))
    return Weather((file,), "TAF", station, issued_s, places, ("",), times, fields, holds=True)


def _prevailing(
    first: _Wind, periods: list[tuple[str, float, float, _Wind]], times: np.ndarray[tuple[int], np.dtype[np.float64]]
) -> tuple[np.ndarray[tuple[int], np.dtype[np.float64]], ...]:
    """North, east, gust and visibility at times, shape (times,) each."""
    direction = (
        first.from_deg
        if not math.isnan(first.from_deg)
        else next((w.from_deg for _, _, _, w in periods if w.from_deg == w.from_deg), 0.0)
    )
    north, east = (np.full(len(times), float(part)) for part in vector(first.speed_mps, direction))
    gust, visibility = np.full(len(times), first.gust_mps), np.full(len(times), first.visibility_m)
    for mark, start, stop, wind in periods:
        if not mark.startswith(("FM", "BECMG")):
            continue
        share = (
            np.clip((times - start) / max(stop - start, 1.0), 0.0, 1.0)
            if mark.startswith("BECMG")
            else (times >= start).astype(np.float64)
        )
        if not math.isnan(wind.speed_mps):
            direction = direction if math.isnan(wind.from_deg) else wind.from_deg
            to_north, to_east = (float(part) for part in vector(wind.speed_mps, direction))
            north, east = north + share * (to_north - north), east + share * (to_east - east)
            gust = np.where(share > 0.0, wind.gust_mps, gust)
        if not math.isnan(wind.visibility_m) or mark.startswith("FM"):
            visibility = np.where(share > 0.0, wind.visibility_m, visibility)
    for mark, start, stop, wind in periods:
        if mark.startswith(("FM", "BECMG")):
            continue
        inside = (times >= start) & (times < stop)
        strongest = np.fmax(wind.gust_mps, wind.speed_mps)
        gust = np.where(inside, np.fmax(gust, strongest), gust)
        visibility = np.where(inside, np.fmin(visibility, wind.visibility_m), visibility)
    return north, east, gust, visibility


def _period(mark: str, begin_s: float, end_s: float, issued_s: float, file: str) -> tuple[float, float]:
    """Begin and end of a change group, POSIX seconds."""
    if mark.startswith("FM"):
        start = nearest_s(int(mark[2:4]), int(mark[4:6]), int(mark[6:8]), issued_s)
        if start is None:
            raise InputError("no such time", file, value=mark)
        return start, start
    first, last = mark.rsplit(maxsplit=1)[-1].split("/")
    start, stop = _hour(first, issued_s, file, mark), _hour(last, issued_s, file, mark)
    if not begin_s - 3600.0 <= start <= stop <= end_s + 3600.0:
        raise InputError("is not within the period of the TAF", file, value=mark)
    return start, stop


def _hour(text: str, issued_s: float | None, file: str, where: str) -> float:
    found = None if issued_s is None else nearest_s(int(text[:2]), int(text[2:]), 0, issued_s)
    if found is None:
        raise InputError("no such day and hour", file, value=where, remedy="day and hour UTC, such as 0903/1006")
    return found


def _group(text: str, file: str, station: str) -> _Wind:
    """Wind and visibility of a group."""
    speed = degrees = gust = math.nan
    for word in text.split():
        match = WIND.fullmatch(word)
        if match is None:
            continue
        unit = SPEED_UNITS_MPS[UNITS[match[4]]]
        speed = unit * float(match[2]) if match[2].isdigit() else math.nan
        degrees = float(match[1]) if match[1].isdigit() else math.nan
        gust = unit * float(match[3]) if match[3] and match[3].isdigit() else math.nan
        if degrees > 360.0:
            raise InputError(
                "not a direction", file, field=station, value=word, remedy="degrees from 000 to 360, or VRB"
            )
        break
    return _Wind(speed, degrees, gust, _visibility(text))


def _visibility(text: str) -> float:
    match = VISIBILITY.search(text)
    if match is None:
        return math.nan
    _, whole, top, bottom, metres, cavok = match.groups()
    if cavok or metres == "9999":
        return 10_000.0
    if metres:
        return float(metres)
    miles = float(whole or 0) + float(top) / (float(bottom) if bottom and float(bottom) else 1.0)
    return miles * STATUTE_MILE_M
