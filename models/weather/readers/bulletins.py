"""Bulletins of stations: METARs, TAFs and the text of the National Blend of Models.

Source of the blend's text: NOAA, Meteorological Development Laboratory, "NBM Text Card Key" (vlab.noaa.gov/web/mdl/nbm-textcard-v4.1).
"""

from __future__ import annotations

import math
import re
from calendar import timegm
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.table import FaultCollector
from skyway.models.base.units import MPS_PER_KNOT
from skyway.models.weather.readers.taf import STATUTE_MILE_M, is_taf, read_taf
from skyway.models.weather.weather import (
    FROM,
    GUST,
    SPEED,
    SURFACE_M,
    USUAL_HEIGHT_M,
    FieldKey,
    Places,
    Weather,
    with_components,
)
from skyway.models.wind.observed.metar import START, parse_metars
from skyway.models.wind.triangle import vector

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

NBM_HEAD = re.compile(
    r"^\s*([A-Z0-9]{3,6})\s+NBM\s+V[\d.]+\s+(NB[A-Z])\s+GUIDANCE\s+(\d{1,2})/(\d{1,2})/(\d{4})\s+(\d{2})(\d{2})\s+UTC",
    re.MULTILINE,
)
NBM_FIELDS = {
    "WDR": FieldKey(FROM, USUAL_HEIGHT_M), "WSP": FieldKey(SPEED, USUAL_HEIGHT_M), "GST": FieldKey(GUST, USUAL_HEIGHT_M),
    "TMP": FieldKey("temperature", 2.0), "DPT": FieldKey("dewpoint", 2.0), "VIS": FieldKey("visibility", SURFACE_M),
}  # fmt: skip


def is_bulletin(text: str) -> bool:
    """Whether a text contains a bulletin of a supported kind."""
    return bool(NBM_HEAD.search(text) or is_taf(text) or START.search(text.upper()))


def read_bulletin(text: str, file: str, near_s: float, stations: Mapping[str, tuple[float, float]]) -> list[Weather]:
    """Read a bulletin; METARs and TAFs are of the month nearest to `near_s`, POSIX seconds. `stations`: places by identifier."""
    if NBM_HEAD.search(text):
        return _blend(text, file, stations)
    if is_taf(text):
        return read_taf(text, file, near_s, stations)
    return _metars(text, file, near_s, stations)


def _metars(text: str, file: str, near_s: float, stations: Mapping[str, tuple[float, float]]) -> list[Weather]:
    faults = FaultCollector(file)
    reports = parse_metars(text, near_s, faults)
    faults.raise_if_any()
    found = []
    for name in dict.fromkeys(one.station for one in reports):
        own = {
            one.time_s: one
            for one in sorted((r for r in reports if r.station == name), key=lambda r: (r.time_s, r.corrected))
        }
        times = np.array(sorted(own))
        speed = np.array([math.nan if own[t].speed_mps is None else own[t].speed_mps for t in times], dtype=np.float64)
        degrees = np.array([math.nan if own[t].from_deg is None else own[t].from_deg for t in times], dtype=np.float64)
        gust = np.array([math.nan if own[t].gust_mps is None else own[t].gust_mps for t in times], dtype=np.float64)
        north, east = vector(speed, np.where(speed == 0.0, 0.0, degrees))
        values = {"north": north, "east": east, GUST: gust}
        fields = {FieldKey(key, USUAL_HEIGHT_M): one.reshape(1, -1, 1) for key, one in values.items()}
        lat, lon = stations.get(name, (math.nan, math.nan))
        places = Places(np.array([lat]), np.array([lon]), f"station {name}", names=(name,))
        found.append(Weather((file,), "METAR", name, math.nan, places, ("",), times, fields, observed=True))
    if not found:
        raise InputError("has no report", file, remedy="a METAR a line, such as KEWR 101851Z 22010KT")
    return found


def _blend(text: str, file: str, stations: Mapping[str, tuple[float, float]]) -> list[Weather]:
    heads = list(NBM_HEAD.finditer(text))
    return [
        _card(one, text[one.end() : None if after is None else after.start()], file, stations)
        for one, after in zip(heads, [*heads[1:], None], strict=True)
    ]


def _card(head: re.Match[str], body: str, file: str, stations: Mapping[str, tuple[float, float]]) -> Weather:
    """One station's card: columns of three characters, no blank between them if a value has three digits."""
    station, month, day, year, hour = head[1], int(head[3]), int(head[4]), int(head[5]), int(head[6])
    rows = {
        line[:4].strip(): line[4:]
        for line in (raw.strip("\r") for raw in body.splitlines())
        if re.match(r" ?[A-Z][A-Z0-9]{2} ", line)
    }
    if not (1 <= month <= 12 and 1 <= day <= 31 and hour < 24):
        raise InputError("no such issue time", file, field=station, value=head[0].strip())
    issued_s = float(timegm((year, month, day, hour, int(head[7]), 0)))
    hours = _cells(rows.get("UTC", ""), file, "UTC")
    if not len(hours) or np.isnan(hours).any():
        raise InputError(
            "has no row of hours (UTC)", file, field=station, remedy="hourly (NBH) or short (NBS) text cards"
        )
    times, at = [], hour
    elapsed = 0.0
    for value in hours.tolist():
        step = (value - at) % 24 or 24
        elapsed, at = elapsed + step, value
        times.append(issued_s + 3600.0 * elapsed - 60.0 * int(head[7]))
    values: dict[FieldKey, NDArray[np.float64]] = {}
    for name, key in NBM_FIELDS.items():
        cells = _cells(rows.get(name, ""), file, name)
        row = np.full(len(times), math.nan)
        row[: len(cells)] = cells[: len(times)]
        values[key] = _in_si(name, row).reshape(1, -1, 1)
    fields = with_components({key: one for key, one in values.items() if not np.isnan(one).all()}, file)
    lat, lon = stations.get(station, (math.nan, math.nan))
    places = Places(np.array([lat]), np.array([lon]), f"station {station}", names=(station,))
    others = tuple(name for name in rows if name not in NBM_FIELDS and name != "UTC")
    return Weather((file,), "NBM", f"NBM at {station}", issued_s, places, ("",), np.array(times), fields, others=others)


def _cells(row: str, file: str, name: str) -> NDArray[np.float64]:
    """Numbers of a row; blank and -99 are missing."""
    found = []
    for begin in range(0, len(row.rstrip()), 3):
        text = row[begin : begin + 3].strip()
        try:
            value = float(text) if text else math.nan
        except ValueError:
            raise InputError("not a number", file, field=name, value=text) from None
        found.append(math.nan if value == -99.0 else value)
    return np.array(found)


def _in_si(name: str, row: NDArray[np.float64]) -> NDArray[np.float64]:
    if name == "WDR":
        return np.where((row < 0.0) | (row > 36.0), math.nan, 10.0 * row)
    if name in ("WSP", "GST"):
        return np.where(row < 0.0, math.nan, MPS_PER_KNOT * row)
    if name in ("TMP", "DPT"):
        return np.asarray((row - 32.0) / 1.8 + 273.15)
    return np.where(row < 0.0, math.nan, 0.1 * STATUTE_MILE_M * row)
