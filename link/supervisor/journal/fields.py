"""Validated values of a journal: missing, mistyped or absurd values are unknown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import SkywayError
from skyway.models.base.units import parse_instant

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from skyway.link.supervisor.journal.file import Record

LARGEST = 1e12
"""Larger values are no physical quantity of a flight."""
LONGEST = 2_000
"""Maximum length of a text, characters."""
_FIRST_S, _LAST_S = 0.0, 4_102_444_800.0


def number(data: Mapping[str, Any], key: str) -> float | None:
    """Return a finite number; None if there is none."""
    value = data.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        found = float(value)
    except OverflowError:
        return None
    return found if math.isfinite(found) and abs(found) <= LARGEST else None


def integer(data: Mapping[str, Any], key: str) -> int | None:
    """Return an integer; None if there is none."""
    found = number(data, key)
    return int(found) if found is not None and found == int(found) else None


def share(data: Mapping[str, Any], key: str) -> float | None:
    """Return a number from 0 to 1; None if there is none."""
    found = number(data, key)
    return found if found is not None and 0.0 <= found <= 1.0 else None


def text(data: Mapping[str, Any], key: str) -> str | None:
    """Return a text, cut at `LONGEST`; None if there is none."""
    value = data.get(key)
    return value[:LONGEST] if isinstance(value, str) and value else None


def truth(data: Mapping[str, Any], key: str) -> bool | None:
    """Return true or false; None if the value is neither."""
    value = data.get(key)
    return value if isinstance(value, bool) else None


def table(data: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Return an object; an empty one if there is none."""
    value = data.get(key)
    return value if isinstance(value, dict) else {}


def tables(data: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    """Return the objects of a list."""
    value = data.get(key)
    return [item for item in value if isinstance(item, dict)] if isinstance(value, list) else []


def words(data: Mapping[str, Any], key: str) -> list[str]:
    """Return the texts of a list."""
    value = data.get(key)
    return [item[:LONGEST] for item in value if isinstance(item, str)] if isinstance(value, list) else []


def place(lat: Any, lon: Any) -> tuple[float, float] | None:
    """Return a position, degrees; None if there is none."""
    found = {"lat": lat, "lon": lon}
    north, east = number(found, "lat"), number(found, "lon")
    if north is None or east is None or abs(north) > 90.0 or abs(east) > 180.0:
        return None
    return north, east


def places(data: Mapping[str, Any], key: str) -> list[tuple[float, float]]:
    """Return the positions of a list of ``[lat, lon]``."""
    value = data.get(key)
    pairs = [item for item in value if isinstance(item, list) and len(item) >= 2] if isinstance(value, list) else []
    return [found for pair in pairs if (found := place(pair[0], pair[1])) is not None]


def instant_s(value: Any) -> float | None:
    """Return an instant as POSIX seconds; None if there is none."""
    if not isinstance(value, str):
        return None
    try:
        found = parse_instant(value).timestamp()
    except (SkywayError, ValueError, OverflowError):
        return None
    return found if _FIRST_S <= found <= _LAST_S else None


def timed(records: tuple[Record, ...]) -> Iterator[tuple[float, Record]]:
    """Iterate over the records that have an instant."""
    for record in records:
        at_s = instant_s(record.time)
        if at_s is not None:
            yield at_s, record
