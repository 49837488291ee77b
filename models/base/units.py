"""Units and conventions.

Inside the code: metres, metres per second, kilograms, joules, watts, seconds (float64); bearings and wind
directions in degrees clockwise from true north in [0, 360); wind directions are those that the wind blows FROM;
wind vectors are (north, east) and point where the air moves TOWARDS; instants are timezone-aware UTC in the
public API and POSIX seconds in kernels; state of charge is a fraction of nameplate energy, 0 to 1.
Wh, km/h, minutes and percent appear only where a person reads or types them.
"""

from __future__ import annotations

from datetime import UTC, datetime

from skyway.models.base.errors import InputError

J_PER_WH = 3600.0
MPS_PER_KMH = 1000.0 / 3600.0
MPS_PER_KNOT = 1852.0 / 3600.0
MPS_PER_MPH = 1609.344 / 3600.0
S_PER_H = 3600.0
S_PER_MIN = 60.0
GRAVITY_MPS2 = 9.80665
"""Standard gravity (ISO 80000-3)."""
AIR_DENSITY_KG_M3 = 1.225
"""Density of air at sea level in the standard atmosphere (ISO 2533)."""

SPEED_UNITS_MPS = {
    "m/s": 1.0,
    "mps": 1.0,
    "km/h": MPS_PER_KMH,
    "kmh": MPS_PER_KMH,
    "kph": MPS_PER_KMH,
    "kn": MPS_PER_KNOT,
    "knot": MPS_PER_KNOT,
    "knots": MPS_PER_KNOT,
    "kt": MPS_PER_KNOT,
    "mph": MPS_PER_MPH,
}
"""Metres per second in one of each unit that an input may name."""


def parse_instant(text: str, *, field: str = "time", file: str | None = None) -> datetime:
    """Read an ISO 8601 instant with its offset, such as ``2013-07-10T14:00-04:00``; returns it in UTC.

    An `InputError` that names `field` and `file` refuses a naive time, because it is ambiguous.
    """
    example = "write it as 2013-07-10T14:00-04:00 or 2013-07-10T18:00Z"
    try:
        instant = datetime.fromisoformat(text.strip())
    except ValueError as error:
        reason = "" if "isoformat" in str(error) else f": {error}"
        raise InputError(f"not an ISO 8601 time{reason}", file, None, field, text, example) from None
    if instant.tzinfo is None:
        raise InputError("the time has no UTC offset", file, None, field, text, example)
    return utc(instant)


def utc(instant: datetime) -> datetime:
    """Turn an aware instant into UTC; a naive one, and what is none, is an `InputError`."""
    given: object = instant
    if not isinstance(given, datetime):
        remedy = "a datetime with a time zone: datetime(2013, 7, 10, 18, tzinfo=UTC)"
        raise InputError("is not a time", field="time", value=repr(given), remedy=remedy)
    if instant.tzinfo is None:
        raise InputError("the time has no UTC offset", field="time", value=instant.isoformat())
    try:
        return instant.astimezone(UTC)
    except OverflowError:
        raise InputError("the time is out of range", field="time", value=instant.isoformat()) from None


def from_posix(posix_s: float) -> datetime:
    """Aware UTC instant of POSIX seconds."""
    return datetime.fromtimestamp(posix_s, UTC)


def iso(instant: datetime) -> str:
    """ISO 8601 in UTC with a ``Z``, with as many digits of the second as it has (0, 3 or 6)."""
    stamp = utc(instant)
    digits = "seconds" if not stamp.microsecond else "microseconds" if stamp.microsecond % 1000 else "milliseconds"
    return stamp.isoformat(timespec=digits).replace("+00:00", "Z")
