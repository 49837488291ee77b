"""Contents of a weather file of any format: the series of one issue of one model at its places."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from skyway.models.base.errors import InputError
from skyway.models.base.geodesy import inverse, wrapped

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

NORTH, EAST, SPEED, FROM, GUST = "north", "east", "speed", "from", "gust"
SEA_PRESSURE = "sea_pressure"
"""Reduced to mean sea level."""
UNITS = {
    NORTH: "m/s",
    EAST: "m/s",
    SPEED: "m/s",
    FROM: "°",
    GUST: "m/s",
    "temperature": "K",
    "dewpoint": "K",
    "humidity": "%",
    "rain": "mm/h",
    "visibility": "m",
    "pressure": "Pa",
    SEA_PRESSURE: "Pa",
}
"""Quantities that are read, with the unit in which they are kept."""
RANGES = {
    SPEED: (0.0, math.inf), GUST: (-0.5, math.inf), FROM: (-180.0, 361.0), "temperature": (150.0, 350.0), "dewpoint": (100.0, 350.0),
    "humidity": (-5.0, 200.0), "rain": (-1.0, 1000.0), "visibility": (-1.0, 1e7), "pressure": (25_000.0, 110_000.0),
    SEA_PRESSURE: (85_000.0, 110_000.0),
}  # fmt: skip
"""Possible range of each, with room for rounding; beyond it a unit is wrong, or a number stands for a gap. Strong winds are checked when a plan uses them."""
SURFACE_M = 0.0
"""Height of quantities without one, such as rain."""
USUAL_HEIGHT_M = 10.0
"""Height of a wind or a gust at level "surface": WMO-No. 8, part I, chapter 5."""
WORLD_DEG = 300.0
"""A region wider than this counts as the whole world."""
MAX_CELLS = 120_000_000
"""Most values of one series."""
SAME = 1e-3
"""Values this close are the same, in whatever unit."""


class FieldKey(NamedTuple):
    """One quantity at one height above ground."""

    quantity: str
    """One of `UNITS`."""
    height_m: float


@dataclass(frozen=True, slots=True)
class Box:
    """A region: least and greatest latitude and longitude, degrees; it may cross the antimeridian (east above 180)."""

    south: float
    west: float
    north: float
    east: float

    @classmethod
    def around(cls, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> Box:
        """Return the smallest box that contains some places."""
        lons = np.unique(np.mod(lon, 360.0))
        gaps = np.diff(lons, append=lons[0] + 360.0)
        widest = int(np.argmax(gaps))
        west = float(wrapped(lons[(widest + 1) % len(lons)]))
        return cls(float(lat.min()), west, float(lat.max()), west + 360.0 - float(gaps[widest]))

    def wider(self, degrees: float) -> Box:
        """Return the box with a margin, in degrees of latitude, and as many kilometres of longitude."""
        shrink = max(math.cos(math.radians(max(abs(self.south), abs(self.north)))), 0.05)
        return Box(
            self.south - degrees, self.west - degrees / shrink, self.north + degrees, self.east + degrees / shrink
        )

    def holds(self, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether each place is inside."""
        middle, half = 0.5 * (self.west + self.east), 0.5 * (self.east - self.west)
        apart = np.abs(np.mod(lon - middle + 180.0, 360.0) - 180.0)
        return np.asarray((lat >= self.south) & (lat <= self.north) & (apart <= half))

    def __str__(self) -> str:
        lats = f"{_degrees(self.south, 'N', 'S')} to {_degrees(self.north, 'N', 'S')}"
        if self.east - self.west > WORLD_DEG:
            return f"{lats}, all longitudes"
        lons = f"{_degrees(wrapped(self.west), 'E', 'W')} to {_degrees(wrapped(self.east), 'E', 'W')}"
        return (
            f"{_degrees(self.south, 'N', 'S')}, {_degrees(wrapped(self.west), 'E', 'W')}"
            if self.single
            else f"{lats}, {lons}"
        )

    @property
    def single(self) -> bool:
        """Whether it is one point."""
        return self.south == self.north and self.west == self.east


def _degrees(value: float, above: str, below: str) -> str:
    return f"{abs(value):.2f}° {above if value >= 0.0 else below}"


@dataclass(frozen=True, eq=False)
class Places:
    """Points of a grid, or stations."""

    lat: NDArray[np.float64]
    lon: NDArray[np.float64]
    """Shape (points,). Degrees, WGS-84; NaN if a station's place is unknown."""
    kind: str
    """For people, such as ``lambert 93 x 65``, ``3 points``."""
    spacing_m: float = math.nan
    """Between neighbours of a grid; NaN: stations."""
    names: tuple[str, ...] = ()
    """Of stations."""

    @cached_property
    def box(self) -> Box | None:
        """Bounds of the places; None if they are unknown."""
        known = np.isfinite(self.lat) & np.isfinite(self.lon)
        return Box.around(self.lat[known], self.lon[known]) if known.any() else None

    def __len__(self) -> int:
        return len(self.lat)

    def __getitem__(self, chosen: NDArray[np.int64]) -> Places:
        names = tuple(self.names[number] for number in chosen) if self.names else ()
        return replace(self, lat=self.lat[chosen], lon=self.lon[chosen], names=names)

    def same_as(self, other: Places) -> bool:
        """Whether both are the same points in the same order."""
        return len(self) == len(other) and np.array_equal(self.lat, other.lat, equal_nan=True) and np.array_equal(
            self.lon, other.lon, equal_nan=True
        )  # fmt: skip


def grid_spacing_m(lat: NDArray[np.float64], lon: NDArray[np.float64]) -> float:
    """Return the median distance of neighbours in the order of a grid, metres; NaN for one point."""
    if len(lat) < 2:
        return math.nan
    steps, _ = inverse(lat[1:], lon[1:], lat[:-1], lon[:-1])
    return float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else math.nan


@dataclass(frozen=True, eq=False)
class Weather:
    """One issue of one model at its places, or one station's series.

    Attributes
    ----------
    files : tuple of str
        The files that it was read from.
    form : str
        Of the file: ``GRIB``, ``NetCDF``, ``Open-Meteo``, ``TAF``, ``METAR``, ``NBM``, ``CSV``.
    model : str
        Source of the forecast.
    issued_s : float
        POSIX seconds of the analysis that it starts from; NaN if the file does not state it.
    places : Places
        Its points.
    members : tuple of str
        Courses that are equally probable; one for a deterministic forecast. No member is a mean.
    times_s : ndarray, shape (times,)
        POSIX seconds that the values are for, ascending.
    fields : dict
        By `FieldKey`, arrays (members, times, points); NaN is a gap.
    holds : bool
        A value holds until the next one; otherwise it is interpolated.
    observed : bool
        Observations, or analyses, not a forecast.
    others : tuple of str
        Fields of the file that are not used.
    notes : tuple of str
        Notes for a person.
    probability : ndarray or None, shape (members,)
        Of the members where they are not equally probable; sums to 1.
    """

    files: tuple[str, ...]
    form: str
    model: str
    issued_s: float
    places: Places
    members: tuple[str, ...]
    times_s: NDArray[np.float64]
    fields: dict[FieldKey, NDArray[np.float64]]
    holds: bool = False
    observed: bool = False
    others: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    probability: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        shape = (len(self.members), len(self.times_s), len(self.places))
        wrong = [key for key, values in self.fields.items() if values.shape != shape]
        if wrong:
            raise InputError(f"the field {wrong[0].quantity} has another shape than its axes", self.name)

    @property
    def name(self) -> str:
        """The files, for people."""
        return self.files[0] + (f" and {len(self.files) - 1} more" if len(self.files) > 1 else "")

    @cached_property
    def wind_heights_m(self) -> tuple[float, ...]:
        """Heights at which there is a wind with its direction, ascending."""
        norths = {key.height_m for key in self.fields if key.quantity == NORTH}
        return tuple(sorted(norths & {key.height_m for key in self.fields if key.quantity == EAST}))

    @property
    def step_s(self) -> float:
        """The usual spacing of its times; NaN if there is one time."""
        return float(np.median(np.diff(self.times_s))) if len(self.times_s) > 1 else math.nan

    def needs_wind(self) -> None:
        """Raise an `InputError` with the reason if no wind can be planned with."""
        if self.wind_heights_m:
            return
        has = {key.quantity for key in self.fields}
        if SPEED in has or GUST in has:
            problem = "has wind speeds or gusts, but no direction: unusable for planning"
            remedy = "ask for the direction, too (wind_direction_10m, or u and v components)"
        elif NORTH in has or EAST in has:
            problem, remedy = "has only one component of the wind", "add the file with the other component"
        else:
            held = ", ".join(dict.fromkeys([*sorted(has), *self.others])) or "nothing"
            problem, remedy = f"has no wind, only {held}", "ask for the wind at 10, 80 or 100 m above ground"
        raise InputError(problem, self.name, remedy=remedy)


SPOKEN = {SPEED: "wind speed", FROM: "wind direction", SEA_PRESSURE: "pressure at sea level"}


def _check_ranges(fields: dict[FieldKey, NDArray[np.float64]], file: str) -> None:
    """Raise an `InputError` for an impossible value."""
    for key, values in fields.items():
        low, high = RANGES.get(key.quantity, (-math.inf, math.inf))
        known = values[np.isfinite(values)]
        for worst in (known.min(), known.max()) if known.size else ():
            if not low <= worst <= high:
                name = SPOKEN.get(key.quantity, key.quantity)
                problem = f"has a {name} of {float(worst):.6g} {UNITS[key.quantity]}: impossible"
                raise InputError(problem, file, remedy="check its unit, and its marker of missing values")


def with_components(fields: dict[FieldKey, NDArray[np.float64]], file: str) -> dict[FieldKey, NDArray[np.float64]]:
    """Add north and east, TOWARDS, where there are only speed and FROM direction, which are then removed.

    An `InputError` names an impossible value.
    """
    _check_ranges(fields, file)
    found = dict(fields)
    for key, speed in fields.items():
        if key.quantity != SPEED:
            continue
        other = FieldKey(FROM, key.height_m)
        parts = FieldKey(NORTH, key.height_m), FieldKey(EAST, key.height_m)
        if other in fields and not all(part in fields for part in parts):
            angle = np.radians(fields[other])
            calm = speed == 0.0
            found[parts[0]] = np.where(calm, 0.0, -speed * np.cos(angle))
            found[parts[1]] = np.where(calm, 0.0, -speed * np.sin(angle))
        if all(part in found for part in parts):
            del found[key]
            found.pop(other, None)
    return {
        key: values for key, values in found.items() if key.quantity != FROM or FieldKey(SPEED, key.height_m) in found
    }


def joined(parts: Sequence[Weather]) -> list[Weather]:
    """Join parts of one issue of one model at the same places, such as fields and steps in separate files."""
    found: list[Weather] = []
    for one in parts:
        for number, other in enumerate(found):
            issue = other.issued_s == one.issued_s or (math.isnan(other.issued_s) and math.isnan(one.issued_s))
            kind = (other.form, other.model, other.holds, other.observed) == (
                one.form,
                one.model,
                one.holds,
                one.observed,
            )
            if issue and kind and other.probability is None is one.probability and other.places.same_as(one.places):
                found[number] = _both(other, one)
                break
        else:
            found.append(one)
    return [replace(one, fields=with_components(one.fields, one.name)) for one in found]


def _both(first: Weather, second: Weather) -> Weather:
    times = np.union1d(first.times_s, second.times_s)
    members = tuple(dict.fromkeys((*first.members, *second.members)))
    shape = (len(members), len(times), len(first.places))
    fields: dict[FieldKey, NDArray[np.float64]] = {}
    for one in (first, second):
        rows = np.ix_(np.array([members.index(name) for name in one.members]), np.searchsorted(times, one.times_s))
        for key, values in one.fields.items():
            into = fields.setdefault(key, np.full(shape, np.nan))
            part = into[rows]
            if math.isnan(one.issued_s) and np.any(np.abs(part - values) > SAME):
                problem = f"has another {key.quantity} than {first.name} for the same place and time, and neither says when it was issued"
                raise InputError(problem, second.name, remedy="give only the newer one")
            into[rows] = np.where(np.isnan(values), part, values)
    if math.prod(shape) > MAX_CELLS:
        raise InputError("is too large for one region", first.name, remedy="cut it to the region and the hours needed")
    return replace(
        first,
        files=tuple(dict.fromkeys((*first.files, *second.files))),
        times_s=times,
        members=members,
        fields=fields,
        others=tuple(dict.fromkeys((*first.others, *second.others))),
        notes=tuple(dict.fromkeys((*first.notes, *second.notes))),
    )
