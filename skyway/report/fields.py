"""Validated values of a journal: missing, mistyped or absurd values are unknown."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import SkywayError
from skyway.models.base.formatting import wind_text
from skyway.models.base.units import parse_instant
from skyway.models.wind.summary import summary_from

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from skyway.link.supervisor.journal import Record

LARGEST = 1e12
"""What is larger is no quantity of a flight."""
LONGEST = 2_000
"""Characters of a text."""
_FIRST_S, _LAST_S = 0.0, 4_102_444_800.0


def number(data: Mapping[str, Any], key: str) -> float | None:
    """Return a finite number; None where there is none."""
    value = data.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        found = float(value)
    except OverflowError:
        return None
    return found if math.isfinite(found) and abs(found) <= LARGEST else None


def share(data: Mapping[str, Any], key: str) -> float | None:
    """Return a number from 0 to 1; None where there is none."""
    found = number(data, key)
    return found if found is not None and 0.0 <= found <= 1.0 else None


def text(data: Mapping[str, Any], key: str) -> str | None:
    """Return a text, cut where it is endless; None where there is none."""
    value = data.get(key)
    return value[:LONGEST] if isinstance(value, str) and value else None


def truth(data: Mapping[str, Any], key: str) -> bool | None:
    """Return true or false; None where neither is told."""
    value = data.get(key)
    return value if isinstance(value, bool) else None


def table(data: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Return an object; an empty one where there is none."""
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
    """Return a position, degrees; None where it is none."""
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
    """Return an instant as POSIX seconds; None where it is none."""
    if not isinstance(value, str):
        return None
    try:
        found = parse_instant(value).timestamp()
    except (SkywayError, ValueError, OverflowError):
        return None
    return found if _FIRST_S <= found <= _LAST_S else None


def speed(north: float | None, east: float | None) -> float | None:
    """Return the length of a wind; None where it is unknown."""
    return None if north is None or east is None else math.hypot(north, east)


def direction(north: float | None, east: float | None) -> float | None:
    """Return where a wind comes FROM, degrees clockwise from north; None where it is unknown."""
    return None if north is None or east is None else math.degrees(math.atan2(-east, -north)) % 360.0


def forecast_words(data: Mapping[str, Any], prefix: str = "forecast_") -> str | None:
    """Return a summary of a forecast in the words that every wind is told in; None where the journal has none."""
    told = {name: number(data, f"{prefix}{name}") for name in ("mean_mps", "p10_mps", "p90_mps", "from_deg")}
    found = summary_from(told | {"sector_share": share(data, f"{prefix}sector_share")})
    return None if found is None else str(found)


def measured_words(data: Mapping[str, Any]) -> str | None:
    """Return the wind of a track as it was measured at the vehicle, with its sigma; None where it was not."""
    north, east = number(data, "wind_north_mps"), number(data, "wind_east_mps")
    length, comes_from, sigma = speed(north, east), direction(north, east), number(data, "wind_sigma_mps")
    source = text(data, "wind_source")
    if length is None or comes_from is None or source not in (None, "measured", "held"):
        return None
    earlier = ", measured earlier" if source == "held" else ""
    return f"{wind_text(length, comes_from, sigma)}{earlier}"


def timed(records: tuple[Record, ...]) -> Iterator[tuple[float, Record]]:
    """Go through the records that have an instant."""
    for record in records:
        at_s = instant_s(record.time)
        if at_s is not None:
            yield at_s, record
