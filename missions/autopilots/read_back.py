"""Comparison of a mission sent with the mission read back, by meaning, item by item.

A download is never identical to the upload. Each dialect defines the meaning of an item for its autopilot; two items with the
same meaning are the same, and nothing else is.
"""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as dataclass_field
from itertools import zip_longest
from typing import TYPE_CHECKING

from skyway.missions.autopilots.registry import family_named
from skyway.missions.items.commands import is_scaled
from skyway.missions.items.coordinates import E7
from skyway.missions.items.fence_items import CLAIMED_COUNT
from skyway.missions.items.geofence import FencePolygon, Geofence
from skyway.missions.items.mission import Mission
from skyway.missions.items.rally import RallyPoints

if TYPE_CHECKING:
    from collections.abc import Iterator

    from skyway.missions.autopilots.family import Family, Meaning
    from skyway.missions.items.geofence import FenceCircle

TOLERANCE_E7 = 2
"""Coordinates that pass through 32-bit floats or other scalings may move by this many units of 1e-7 degree."""
TOLERANCE_M = 0.011
"""Altitudes stored in centimetres."""
RELATIVE_TOLERANCE = 1e-6
"""Parameters are floats of 32 bits on the wire."""

_TOLERANCES: dict[str, float] = {"x": TOLERANCE_E7, "y": TOLERANCE_E7, "z": TOLERANCE_M}


@dataclass(frozen=True, slots=True)
class Difference:
    """One difference from the mission sent."""

    item: int | None
    """Number of the item (or of the fence area, or rally point); None concerns their count."""
    field: str
    """``command``, ``param1``, ``x``, ``altitude reference``, …"""
    sent: object
    read: object
    """The two values; None: absent."""
    in_e7: bool = dataclass_field(default=False, compare=False)
    """The values are a latitude or longitude in units of 1e-7 degree."""

    def __str__(self) -> str:
        where = "count" if self.item is None else f"item {self.item} {self.name}"
        return f"{where}: sent {self.words(self.sent)}, read back {self.words(self.read)}"

    @property
    def name(self) -> str:
        """The field, for a person."""
        return {"x": "latitude", "y": "longitude"}.get(self.field, self.field) if self.in_e7 else self.field

    def words(self, value: object) -> str:
        """Return one of the two values, for a person."""
        if value is None:
            return "nothing"
        if self.in_e7 and isinstance(value, (int, float)):
            return f"{value / E7:.7f}"
        return f"{value:.9g}" if isinstance(value, float) else str(value)


def diff(
    sent: Mission | Geofence | RallyPoints, read_back: Mission | Geofence | RallyPoints, autopilot: str
) -> tuple[Difference, ...]:
    """Return the differences in meaning between the items sent to an autopilot and those read back; empty if there are none.

    Both are of the same kind (otherwise a TypeError) and in our numbering (see `Family.from_wire`). Ignored is what the
    autopilot is known to rewrite (frames 3 and 6, NaN and 0 as yaw, altitudes in centimetres, parameters it does not
    keep); never ignored is what changes the flight. An `InputError` refuses an autopilot that skyway does not know.
    """
    dialect = family_named(autopilot)
    if isinstance(sent, Mission) and isinstance(read_back, Mission):
        return tuple(_missions(sent, read_back, dialect))
    if isinstance(sent, Geofence) and isinstance(read_back, Geofence):
        return tuple(_fences(sent, read_back))
    if isinstance(sent, RallyPoints) and isinstance(read_back, RallyPoints):
        return tuple(_rallies(sent, read_back))
    raise TypeError(f"cannot compare {type(sent).__name__} with {type(read_back).__name__}")


def _missions(sent: Mission, read_back: Mission, dialect: Family) -> Iterator[Difference]:
    if len(sent) != len(read_back):
        yield Difference(None, "count", len(sent), len(read_back))
    for number, (ours, theirs) in enumerate(zip_longest(sent.items, read_back.items)):
        if ours is None or theirs is None:
            yield Difference(number, "command", ours and ours.name, theirs and theirs.name)
        elif ours != theirs:
            placed = is_scaled(ours.command, ours.frame)
            yield from _fields(number, dialect.meaning(ours), dialect.meaning(theirs), placed=placed)


def _fields(number: int, sent: Meaning, read: Meaning, *, placed: bool) -> Iterator[Difference]:
    if sent["command"] != read["command"]:
        yield Difference(number, "command", sent["command"], read["command"])
        return
    for name in dict.fromkeys((*sent, *read)):
        ours, theirs = sent.get(name), read.get(name)
        if not _same(name, ours, theirs):
            yield Difference(number, name, ours, theirs, in_e7=placed and name in ("x", "y"))


def _same(name: str, ours: float | str | None, theirs: float | str | None) -> bool:
    if ours is None:  # a value left to the vehicle comes back as nothing, or as 0
        return theirs is None or theirs == 0
    if theirs is None or isinstance(ours, str) or isinstance(theirs, str):
        return ours == theirs
    return abs(ours - theirs) <= _TOLERANCES.get(name, RELATIVE_TOLERANCE * abs(ours))


def _fences(sent: Geofence, read_back: Geofence) -> Iterator[Difference]:
    if len(sent.areas) != len(read_back.areas):
        yield Difference(None, "count", len(sent.areas), len(read_back.areas))
    if sent.return_point is not None and sent.return_point != read_back.return_point:
        yield Difference(None, "return point", sent.return_point, read_back.return_point)
    for number, (ours, theirs) in enumerate(zip_longest(sent.areas, read_back.areas)):
        if ours is None or theirs is None or type(ours) is not type(theirs):
            yield Difference(number, "area", ours and type(ours).__name__, theirs and type(theirs).__name__)
            continue
        yield from _areas(number, ours, theirs)


def _areas(number: int, ours: FencePolygon | FenceCircle, theirs: FencePolygon | FenceCircle) -> Iterator[Difference]:
    if ours.inclusion != theirs.inclusion:
        yield Difference(number, "inclusion", ours.inclusion, theirs.inclusion)
    if isinstance(ours, FencePolygon) and isinstance(theirs, FencePolygon):
        if len(ours.vertices) != len(theirs.vertices):
            yield Difference(number, "vertices", len(ours.vertices), len(theirs.vertices))
        elif not all(map(_close, ours.vertices, theirs.vertices)):
            yield Difference(number, "vertices", ours.vertices, theirs.vertices)
        if CLAIMED_COUNT in theirs.extra:  # acknowledged, but invalid
            yield Difference(number, "vertex count", len(ours.vertices), theirs.extra[CLAIMED_COUNT])
        return
    if isinstance(ours, FencePolygon) or isinstance(theirs, FencePolygon):
        return
    if not _close(ours.center, theirs.center):
        yield Difference(number, "center", ours.center, theirs.center)
    if not _same("radius", ours.radius_m, theirs.radius_m):
        yield Difference(number, "radius_m", ours.radius_m, theirs.radius_m)


def _close(ours: tuple[int, int], theirs: tuple[int, int]) -> bool:
    return max(abs(ours[0] - theirs[0]), abs(ours[1] - theirs[1])) <= TOLERANCE_E7


def _rallies(sent: RallyPoints, read_back: RallyPoints) -> Iterator[Difference]:
    if len(sent) != len(read_back):
        yield Difference(None, "count", len(sent), len(read_back))
    for number, (ours, theirs) in enumerate(zip(sent.points, read_back.points, strict=False)):
        if not _close(ours.point, theirs.point):
            yield Difference(number, "point", ours.point, theirs.point)
        if not _same("z", ours.altitude_m, theirs.altitude_m):
            yield Difference(number, "altitude_m", ours.altitude_m, theirs.altitude_m)
