"""Answers of Open-Meteo (JSON): one place or several, one model or several, single series or ensembles.

Units are those of `hourly_units`; a name ends in its height, ``_memberNN`` (the one without is the control) and, if several models were
requested, the model. Times without an offset are local by `utc_offset_seconds`: the offset does not change within an answer.

Source: Open-Meteo, "Weather Forecast API" and "Ensemble API" (open-meteo.com/en/docs).
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.geodesy import coordinate_faults
from skyway.models.base.units import MPS_PER_KMH, MPS_PER_KNOT, MPS_PER_MPH
from skyway.models.weather.weather import FROM, GUST, SPEED, SURFACE_M, FieldKey, Places, Weather, with_components

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

NAMES = {
    "wind_speed": SPEED, "windspeed": SPEED, "wind_direction": FROM, "winddirection": FROM, "wind_gusts": GUST, "windgusts": GUST,
    "temperature": "temperature", "dew_point": "dewpoint", "dewpoint": "dewpoint", "relative_humidity": "humidity",
    "relativehumidity": "humidity",
}  # fmt: skip
AT_SURFACE = {"precipitation": "rain", "visibility": "visibility", "surface_pressure": "pressure"}
FACTORS = {
    "km/h": MPS_PER_KMH, "kmh": MPS_PER_KMH, "m/s": 1.0, "ms": 1.0, "mp/h": MPS_PER_MPH, "mph": MPS_PER_MPH, "kn": MPS_PER_KNOT, "knots": MPS_PER_KNOT,
    "°": 1.0, "%": 1.0, "m": 1.0, "ft": 0.3048, "hPa": 100.0, "mm": 1.0, "inch": 25.4,
}  # fmt: skip
UNITS_OF = {
    SPEED: ("km/h", "kmh", "m/s", "ms", "mp/h", "mph", "kn", "knots"), FROM: ("°",), "humidity": ("%",), "rain": ("mm", "inch"),
    "visibility": ("m", "ft"), "pressure": ("hPa",), "temperature": ("°C", "°F"), "dewpoint": ("°C", "°F"),
}  # fmt: skip
UNITS_OF[GUST] = UNITS_OF[SPEED]
NAME = re.compile(r"([a-z_]+?)_(\d+)m(?:_member(\d+))?(?:_(?!member)([a-z][a-z0-9_]*))?")
PLAIN = re.compile(
    r"(precipitation|visibility|surface_pressure)(?:_member(\d+))?(?:_(?!member|probability)([a-z][a-z0-9_]*))?"
)
BLOCKS = {"minutely_15": 900.0, "hourly": 3600.0}


class Answer(msgspec.Struct):
    """One place of an answer."""

    latitude: float
    longitude: float
    utc_offset_seconds: int = 0
    hourly: dict[str, list[Any]] = {}
    hourly_units: dict[str, str] = {}
    minutely_15: dict[str, list[Any]] = {}
    minutely_15_units: dict[str, str] = {}


class Refused(msgspec.Struct):
    """Answer of the service to an invalid request."""

    error: bool
    reason: str = ""


def is_open_meteo(value: object) -> bool:
    """Whether decoded JSON is an answer of Open-Meteo, or its refusal."""
    first = value[0] if isinstance(value, list) and value else value
    return isinstance(first, dict) and (
        ({"latitude", "longitude"} <= set(first) and ("hourly" in first or "minutely_15" in first)) or "reason" in first
    )


def read_open_meteo(text: str, file: str) -> list[Weather]:
    """Read an answer; an `InputError` names the faulty field."""
    try:
        if "reason" in text[:2000] and '"hourly"' not in text:
            refused = msgspec.json.decode(text, type=Refused)
            raise InputError(
                f"is not a forecast: the service refused ({refused.reason})", file, remedy="request it again"
            )
        answers = msgspec.json.decode(text, type=list[Answer] | Answer)
    except (msgspec.ValidationError, msgspec.DecodeError, RecursionError) as error:
        raise InputError(f"is not an answer of Open-Meteo: {error}", file) from error
    answers = answers if isinstance(answers, list) else [answers]
    found: dict[str, list[tuple[Answer, _Block]]] = {}
    for number, answer in enumerate(answers):
        faults = coordinate_faults(answer.latitude, answer.longitude, file=file)
        if faults:
            raise InputError(faults)
        for name in BLOCKS:
            if "time" in getattr(answer, name):
                for block in _blocks(answer, name, file, number):
                    found.setdefault(f"{name} {block.model}", []).append((answer, block))
    if not found:
        raise InputError("has no hourly series", file, remedy="ask for hourly=wind_speed_80m,wind_direction_80m")
    return [_weather(parts, file) for parts in found.values()]


class _Block:
    """The series of one model at one place."""

    def __init__(self, model: str, times_s: NDArray[np.float64]) -> None:
        self.model, self.times_s = model, times_s
        self.series: dict[tuple[FieldKey, str], NDArray[np.float64]] = {}
        self.others: list[str] = []


def _blocks(answer: Answer, name: str, file: str, number: int) -> list[_Block]:
    table: Mapping[str, Sequence[Any]] = getattr(answer, name)
    units: Mapping[str, str] = getattr(answer, f"{name}_units")
    where = f"[{number}].{name}" if number else name
    times_s = _times(table["time"], units.get("time", "iso8601"), answer.utc_offset_seconds, file, where)
    found: dict[str, _Block] = {}
    for column, values in table.items():
        if column == "time":
            continue
        key, member, model = _named(column)
        block = found.setdefault(model, _Block(model, times_s))
        if key is None:
            block.others.append(column)
            continue
        block.series[key, member] = _numbers(
            values, key, units.get(column, ""), len(times_s), file, f"{where}.{column}", BLOCKS[name]
        )
    return list(found.values())


def _named(column: str) -> tuple[FieldKey | None, str, str]:
    """Contents of a column: (quantity and height, member, model)."""
    for pattern, names in ((NAME, NAMES), (PLAIN, AT_SURFACE)):
        match = pattern.fullmatch(column)
        if match is None or match[1] not in names:
            continue
        *_, member, model = match.groups()
        if re.match(r"previous_day\d", model or ""):
            return None, "", ""
        height = float(match[2]) if pattern is NAME else SURFACE_M
        return FieldKey(names[match[1]], height), member or "", model or ""
    return None, "", ""


def _times(values: Sequence[Any], unit: str, offset_s: int, file: str, where: str) -> NDArray[np.float64]:
    found = []
    for row, value in enumerate(values):
        try:
            if unit == "unixtime":
                found.append(float(value))
                continue
            instant = datetime.fromisoformat(value)
            shift = 0 if instant.tzinfo is not None else offset_s
            found.append(instant.replace(tzinfo=instant.tzinfo or UTC).timestamp() - shift)
        except (TypeError, ValueError, OverflowError):
            raise InputError("not a time", file, field=f"{where}.time[{row}]", value=value) from None
    times_s = np.array(found, dtype=np.float64)
    if not len(times_s) or (np.diff(times_s) <= 0.0).any() or not np.isfinite(times_s).all():
        raise InputError("times are missing or do not ascend", file, field=f"{where}.time")
    return times_s


def _numbers(
    values: Sequence[Any], key: FieldKey, unit: str, count: int, file: str, where: str, step_s: float
) -> NDArray[np.float64]:
    if len(values) != count:
        raise InputError(f"has {len(values)} values for {count} times", file, field=where)
    try:
        numbers = np.array([np.nan if value is None else value for value in values], dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError("has a value that is not a number", file, field=where) from None
    if np.isnan(numbers).all():
        return numbers  # the service gives no unit to a member without a value
    known = UNITS_OF[key.quantity]
    if unit not in known:
        raise InputError("not a unit that it can have", file, field=where, value=unit, remedy=" or ".join(known))
    if unit == "°C":
        return numbers + 273.15
    if unit == "°F":
        return np.asarray((numbers - 32.0) / 1.8 + 273.15)
    scale = 3600.0 / step_s if key.quantity == "rain" else 1.0
    return np.asarray(numbers * FACTORS[unit] * scale)


def _weather(parts: Sequence[tuple[Answer, _Block]], file: str) -> Weather:
    """Combine the places of one model."""
    members = tuple(sorted({member for _, block in parts for _, member in block.series}))
    empty = [
        name for name in members
        if all(np.isnan(values).all() for _, block in parts for (_, member), values in block.series.items() if member == name)
    ]  # fmt: skip
    kept = tuple(name for name in members if name not in empty) or members[:1] or ("",)
    times = np.unique(np.concatenate([block.times_s for _, block in parts]))
    shape = (len(kept), len(times), len(parts))
    fields: dict[FieldKey, NDArray[np.float64]] = {}
    for number, (_, block) in enumerate(parts):
        rows = np.searchsorted(times, block.times_s)
        for (key, member), values in block.series.items():
            if member in kept:
                fields.setdefault(key, np.full(shape, np.nan))[kept.index(member), rows, number] = values
    notes = []
    if empty:
        notes.append(f"members without a value are ignored: {', '.join(name or 'control' for name in empty)}")
    fields = with_components(fields, file)
    lat, lon = np.array([one.latitude for one, _ in parts]), np.array([one.longitude for one, _ in parts])
    model = parts[0][1].model or "Open-Meteo best match"
    labels = tuple(name or "0" for name in kept) if len(kept) > 1 else ("",)
    others = tuple(dict.fromkeys(name for _, block in parts for name in block.others))
    return Weather(
        (file,), "Open-Meteo", model, np.nan, Places(lat, lon, "1 point" if len(parts) == 1 else f"{len(parts)} points"), labels, times, fields,
        others=others, notes=tuple(notes),
    )  # fmt: skip
