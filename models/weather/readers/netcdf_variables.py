"""Variables of NetCDF files of version 3 and 4: their values, times and units."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.units import SPEED_UNITS_MPS
from skyway.models.weather.weather import EAST, GUST, NORTH, SPEED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

STEP_S = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "min": 60.0, "mins": 60.0, "minute": 60.0, "minutes": 60.0,
    "h": 3600.0, "hr": 3600.0, "hrs": 3600.0, "hour": 3600.0, "hours": 3600.0, "d": 86_400.0, "day": 86_400.0, "days": 86_400.0,
}  # fmt: skip
CALENDARS = ("standard", "gregorian", "proleptic_gregorian", "")

UNWRITTEN: dict[str, tuple[float, ...]] = {
    "f4": (float(np.float32(9.969209968386869e36)),),
    "f8": (9.969209968386869e36,),
    "i2": (-32767.0,),
    "i4": (-2147483647.0,),
}
"""Fill values of the netCDF library, by the type of a variable that names no value for it (netcdf.h, NC_FILL_*)."""


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable of a file."""

    name: str
    dimensions: tuple[str, ...]
    attributes: Mapping[str, Any]
    source: Any
    opened: Any
    """The file from which its values are read: it is closed with the last variable."""

    def text(self, name: str) -> str:
        """An attribute as text; empty if there is none."""
        value = self.attributes.get(name, "")
        if isinstance(value, np.ndarray):
            value = value.ravel()[0] if value.size else ""
        return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)

    def numbers(self, name: str) -> NDArray[np.float64]:
        """A numeric attribute; empty if there is none."""
        try:
            return np.atleast_1d(np.asarray(self.attributes.get(name, []), dtype=np.float64)).ravel()
        except (TypeError, ValueError):
            return np.empty(0)

    def values(self) -> NDArray[np.float64]:
        """All values, unpacked; missing ones are NaN."""
        raw = np.asarray(self.source[...])
        if raw.dtype.kind not in "iuf":
            return np.full(raw.shape, np.nan)
        values = raw.astype(np.float64)
        fills = [fill for name in ("_FillValue", "missing_value") for fill in self.numbers(name)]
        for fill in fills or UNWRITTEN.get(raw.dtype.str[1:], ()):
            values[values == fill] = np.nan
        low, high = self.numbers("valid_min"), self.numbers("valid_max")
        if self.numbers("valid_range").size == 2:
            low, high = self.numbers("valid_range")[:1], self.numbers("valid_range")[1:]
        if low.size:
            values[values < low[0]] = np.nan
        if high.size:
            values[values > high[0]] = np.nan
        scale, offset = self.numbers("scale_factor"), self.numbers("add_offset")
        return values * (scale[0] if scale.size else 1.0) + (offset[0] if offset.size else 0.0)


def opened(data: bytes, file: str) -> dict[str, Variable]:
    """Open a file and return its variables. Raises an `InputError` if it is damaged."""
    try:
        if data[:3] == b"CDF":
            from scipy.io import netcdf_file

            old: Any = netcdf_file(io.BytesIO(data), "r", mmap=False)
            return {
                name: Variable(name, tuple(one.dimensions), one._attributes, one.data, old)  # noqa: SLF001
                for name, one in old.variables.items()
            }
        import h5netcdf
        import h5py

        class Quiet(h5netcdf.File):  # type: ignore[misc, unused-ignore]
            """A damaged file is closed silently by Python's clean-up, too: it was never open for writing."""

            _writable = False

        new = Quiet(h5py.File(io.BytesIO(data), "r"), "r", decode_vlen_strings=True)
        return {
            name: Variable(name, tuple(one.dimensions), dict(one.attrs), one, new)
            for name, one in new.variables.items()
        }
    except ImportError:
        raise
    except Exception as error:  # a damaged file fails in many ways
        raise damaged(file, error) from error


def damaged(file: str, error: Exception) -> InputError:
    """Return the error of a file that cannot be read further."""
    return InputError(
        f"is a damaged NetCDF file: {type(error).__name__}: {error}", file, remedy="download the file again"
    )


def instants(one: Variable, file: str) -> NDArray[np.float64]:
    """Return times by their unit, POSIX seconds, shape (times,)."""
    units = one.text("units")
    found = re.fullmatch(r"\s*(\w+)\s+since\s+(.+?)\s*", units)
    calendar = one.text("calendar").lower()
    if found is None or found[1].lower() not in STEP_S or calendar not in CALENDARS:
        remedy = "such as hours since 2026-07-10 00:00:00, in the standard calendar"
        raise InputError("not a unit of time", file, field=one.name, value=f"{units} {calendar}".strip(), remedy=remedy)
    begin = _moment(found[2])
    if begin is None:
        raise InputError(
            "not a time",
            file,
            field=f"{one.name}:units",
            value=units,
            remedy="such as hours since 2026-07-10 00:00:00",
        )
    values = np.atleast_1d(one.values())
    times = begin + values * STEP_S[found[1].lower()]
    if not np.isfinite(times).all() or (np.abs(times) > 4e9).any() or not times.size:
        raise InputError("has times that are missing or cannot be", file, field=one.name)
    return np.asarray(times)


def in_unit(one: Variable, quantity: str, file: str) -> NDArray[np.float64]:
    """Values in the unit of `weather.UNITS`."""
    values = one.values()
    unit = re.sub(r"\s*\*{0,2}\^?-1\b", "-1", one.text("units").strip()).replace("s**-1", "s-1")
    plain = {
        "m s-1": "m/s",
        "ms-1": "m/s",
        "meters per second": "m/s",
        "knots": "kn",
        "mile/h": "mph",
        "km h-1": "km/h",
        "m.s-1": "m/s",
    }.get(unit.lower(), unit)
    if quantity in (NORTH, EAST, SPEED, GUST):
        if plain not in SPEED_UNITS_MPS:
            raise InputError(
                "not a unit of speed", file, field=f"{one.name}:units", value=one.text("units"), remedy="such as m s-1"
            )
        return values * SPEED_UNITS_MPS[plain]
    if quantity in ("temperature", "dewpoint") and plain.lower() in (
        "degc",
        "celsius",
        "degree_celsius",
        "degrees_c",
        "°c",
        "c",
    ):
        return values + 273.15
    if quantity == "rain" and plain.replace(" ", "") in ("kgm-2s-1", "mms-1"):
        return values * 3600.0
    if quantity == "humidity" and plain == "1":
        return values * 100.0
    return values


def _moment(text: str) -> float | None:
    """POSIX seconds of the begin of a unit of time, such as ``1900-01-01 00:00:0.0``; UTC unless stated otherwise."""
    found = re.fullmatch(
        r"(\d{1,4})-(\d{1,2})-(\d{1,2})(?:[T ]+(\d{1,2})(?::(\d{1,2}))?(?::(\d{1,2})(?:\.\d*)?)?)?\s*(Z|UTC|[+-]\d{1,2}(?::?\d{2})?)?",
        text.strip(),
    )
    if found is None:
        return None
    numbers = [int(part or 0) for part in found.groups()[:6]]
    zone = found[7] or ""
    shift = 0.0
    if zone[:1] in ("+", "-"):
        digits = zone[1:].replace(":", "")
        shift = (1 if zone[0] == "+" else -1) * (int(digits[:2]) * 3600.0 + int(digits[2:] or 0) * 60.0)
    try:
        begin = datetime(*numbers[:3], tzinfo=UTC) + timedelta(hours=numbers[3], minutes=numbers[4], seconds=numbers[5])  # type: ignore[misc, arg-type]
    except ValueError:
        return None
    return begin.timestamp() - shift
