"""Validated fields of third-party JSON; faults name the field."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.missions.items.coordinates import Point, to_e7
from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

MAX_FLOAT32 = 3.4028235e38
MAX_PARAM = float(2**31 - 1)
"""Largest parameter 5 or 6 that is no place: an integer of 32 bits on the wire."""


def fault(problem: str, file: str, field: str, value: object = None, remedy: str | None = None) -> InputError:
    """Make the error for one field."""
    return InputError(Fault(problem, file, None, field, value, remedy))


def number(value: object, file: str, field: str) -> float:
    """Take a number that a float on the wire can hold; null is NaN."""
    if type(value) is float and -MAX_FLOAT32 <= value <= MAX_FLOAT32:  # nearly always
        return value
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise fault("is not a number", file, field, value)
    if abs(value) > MAX_FLOAT32:
        raise fault("is too large for a mission", file, field, value)
    return float(value)


def integer(value: object, file: str, field: str, *, most: int) -> int:
    """Take a whole number from 0 to `most`; 3.0 counts as 3."""
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= most:
        raise fault(f"is not a whole number from 0 to {most}", file, field, value)
    return value


def mapping(value: object, file: str, field: str) -> Mapping[str, Any]:
    """Take a JSON object."""
    if not isinstance(value, dict):
        raise fault("is not an object", file, field, value)
    return value


def sequence(value: object, file: str, field: str) -> Sequence[Any]:
    """Take a JSON array."""
    if not isinstance(value, list):
        raise fault("is not a list", file, field, value)
    return value


def place(value: object, file: str, field: str) -> Point:
    """Take [latitude, longitude, …] in degrees."""
    pair = sequence(value, file, field)
    if len(pair) < 2:
        raise fault("is not [latitude, longitude]", file, field, value)
    lat, lon = number(pair[0], file, f"{field}[0]"), number(pair[1], file, f"{field}[1]")
    if not (-90.0 <= lat <= 90.0):
        raise fault("latitude is not between -90 and 90", file, field, pair[0])
    if not (-180.0 <= lon <= 180.0):
        raise fault("longitude is not between -180 and 180", file, field, pair[1])
    return Point(to_e7(lat), to_e7(lon))


def without(source: Mapping[str, Any], known: frozenset[str]) -> Mapping[str, Any]:
    """Return what is left of an object besides the keys that we understand."""
    return {key: value for key, value in source.items() if key not in known}


def quantity(
    source: Mapping[str, Any], key: str, file: str, field: str, *, least: float = -math.inf, positive: bool = False
) -> float:
    """Take a setting that must be there and be a finite number, not below `least`."""
    at, raw = f"{field}.{key}", source.get(key)
    value = number(raw, file, at)
    if math.isnan(value):
        raise fault("is missing: a number is needed", file, at)
    if value < least or (positive and value <= 0.0):
        raise fault("is not above 0" if positive else f"is below {least:g}", file, at, raw)
    return value


def flag(source: Mapping[str, Any], key: str, file: str, field: str, *, missing: bool | None = None) -> bool:
    """Take a setting that is true or false; `missing` where it is not there, if that is allowed."""
    value = source.get(key, missing)
    if not isinstance(value, bool):
        raise fault("is neither true nor false", file, f"{field}.{key}", value)
    return value
