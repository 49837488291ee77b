"""Pads that move: a van that stands at given places, or along a road, at given times.

CSV has a row for each stand; GeoJSON a point for each stand, or a line for the road with the time at which the van comes to each of its
places; it leaves for the next place as late as possible. Times are instants with a UTC offset, or hours and minutes after the first take-off.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Any

from skyway.models.base import geodesy
from skyway.models.base.errors import Fault, refuse
from skyway.models.base.formatting import distance_text, duration
from skyway.models.network.geojson import features, read_geojson
from skyway.models.network.station import Station
from skyway.models.orders.rows import Row, fault_at, read_rows

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

REQUIRED = ("van", "lat", "lon", "from", "until")
OPTIONAL = ("name", "elevation_m", "pads", "recharge_power_w")
SPEED_MPS = 10.0
"""Of a van on a road, if the file has no value."""
FASTEST_MPS = 40.0
MAX_PADS = 100
LONGEST_S = 7 * 86_400.0
GEOJSON_ENDINGS = (".geojson", ".json")


@dataclass(frozen=True, slots=True)
class VanStand:
    """One stand of a van; times are seconds after the first take-off."""

    station: Station
    van: str
    from_s: float
    until_s: float


@dataclass(frozen=True, slots=True)
class _Read:
    stand: VanStand
    place: Fault


def read_van_stands(path: Path, depart_s: float | None = None) -> tuple[VanStand, ...]:
    """Read the stands of vans, in order of van and time; `depart_s` is the first take-off, POSIX, where known.

    An `InputError` has every fault: times that are reversed or overlap, a van that could not drive that fast, instants without a
    known time of the first take-off.
    """
    faults: list[Fault] = []
    geojson = path.suffix.lower() in GEOJSON_ENDINGS
    rows = (
        _features(path, faults)
        if geojson
        else ((row, 0.0) for row in read_rows(path, "stands", REQUIRED, OPTIONAL, faults))
    )
    read: list[_Read] = []
    for row, drive_s in rows:
        found = len(faults)
        stand = _stand(row, depart_s, drive_s)
        if len(faults) == found:
            read.append(_Read(stand, row.place))
    if not faults and not read:
        faults.append(Fault("has no stands of vans", str(path)))
    read.sort(key=lambda one: (one.stand.van, one.stand.from_s))
    if not faults:
        for before, after in pairwise(read):
            faults += _drive(before.stand, after)
    refuse(list({str(fault): fault for fault in faults}.values()))  # all stands of a road have its properties
    return tuple(
        _numbered(one.stand, number)
        for _, group in groupby(read, key=lambda one: one.stand.van)
        for number, one in enumerate(group, start=1)
    )


def _numbered(stand: VanStand, number: int) -> VanStand:
    one = stand.station
    station = Station(
        f"{stand.van}-{number}", one.name or f"{stand.van}, stand {number}", one.lat, one.lon, one.elevation_m,
        one.pads, 0, one.recharge_power_w,
    )  # fmt: skip
    return VanStand(station, stand.van, stand.from_s, stand.until_s)


def _stand(row: Row, depart_s: float | None, drive_s: float) -> VanStand:
    """Read a stand; the van leaves `drive_s` before `until`, to reach another place by then."""
    lat, lon = row.number("lat", -90.0, 90.0), row.number("lon", -180.0, 180.0)
    van = row.text("van")
    height = row.number("elevation_m", -450.0, 9000.0, -math.inf)
    power_w = row.number("recharge_power_w", 1.0, 1e6, -math.inf)
    from_s, until_s = (_seconds(row, field, depart_s) for field in ("from", "until"))
    until_s -= drive_s
    if until_s <= from_s:
        row.fault("until", "is not later than from", "the van stands there from when until when")
    station = Station(
        van, row.text("name", ""), lat, lon, height if math.isfinite(height) else None,
        row.whole("pads", 1, MAX_PADS, 1), 0, power_w if math.isfinite(power_w) else None,
    )  # fmt: skip
    return VanStand(station, van, from_s, until_s)


def _seconds(row: Row, field: str, depart_s: float | None) -> float:
    """Read a time as seconds after the first take-off; NaN, with a fault, if it is invalid."""
    text = row.text(field)
    after = re.fullmatch(r"(\d{1,3}):([0-5]\d)(?::([0-5]\d))?", text)
    if after is not None:
        return 3600.0 * int(after[1]) + 60.0 * int(after[2]) + float(after[3] or 0)
    if not text:
        return math.nan
    if not re.match(r"\d{4}-", text):
        row.fault(
            field,
            "is not a time",
            "hours and minutes after the first take-off: 0:25, or an instant with its UTC offset",
        )
        return math.nan
    instant = row.instant(field)
    if instant is None:
        return math.nan
    if depart_s is None:
        row.fault(
            field,
            "is an instant, and the first take-off is not known",
            "give --depart, or hours and minutes after it: 0:25",
        )
        return math.nan
    seconds = instant.timestamp() - depart_s
    if abs(seconds) > LONGEST_S:
        row.fault(field, "is more than a week from the first take-off")
    return seconds


def _drive(before: VanStand, after: _Read) -> Iterator[Fault]:
    """Yield the obstacles to a van's drive from one stand to the next."""
    stand = after.stand
    if before.van != stand.van:
        return
    if stand.from_s < before.until_s:
        yield fault_at(
            after.place, "from", f"van {stand.van} still stands elsewhere", None, "end the stand before earlier"
        )
        return
    here, there = before.station, stand.station
    length = geodesy.distance_m(here.lat, here.lon, there.lat, there.lon)
    seconds = stand.from_s - before.until_s
    if length > FASTEST_MPS * seconds:
        told = f"van {stand.van} cannot drive {distance_text(length)} in {duration(seconds)}"
        yield fault_at(after.place, "from", told, None, "give it more time")


def _features(path: Path, faults: list[Fault]) -> Iterator[tuple[Row, float]]:
    """Yield a row for each point, and for each place of a line, with the time for the drive to the next."""
    for number, feature in enumerate(features(read_geojson(path), str(path))):
        place = Fault("", str(path), None, f"features[{number}]")
        geometry, given = feature.get("geometry"), feature.get("properties")
        properties: dict[str, Any] = given if isinstance(given, dict) else {}
        kind = geometry.get("type") if isinstance(geometry, dict) else None
        coordinates = geometry.get("coordinates") if isinstance(geometry, dict) else None
        if kind not in ("Point", "LineString") or not isinstance(coordinates, list):
            continue
        places = [coordinates] if kind == "Point" else coordinates
        if not all(
            isinstance(one, list) and len(one) >= 2 and all(isinstance(x, int | float) for x in one) for one in places
        ):
            faults.append(fault_at(place, "coordinates", "must be longitude and latitude"))
            continue
        if kind == "Point":
            yield Row(properties | _at(coordinates, properties), place, faults), 0.0
        else:
            yield from _on_road(places, properties, place, faults)


def _at(coordinates: list[float], properties: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {"lon": coordinates[0], "lat": coordinates[1]}
    if len(coordinates) > 2 and "elevation_m" not in properties:
        found["elevation_m"] = coordinates[2]
    return found


def _on_road(
    places: list[list[float]], properties: dict[str, Any], place: Fault, faults: list[Fault]
) -> Iterator[tuple[Row, float]]:
    """Yield the stands on a road: each from the arrival of the van until it must leave, the last until `until`."""
    times = properties.get("times")
    if not isinstance(times, list) or len(times) != len(places):
        remedy = f"a time for each of the {len(places)} places: when the van comes there"
        faults.append(fault_at(place, "times", "must be a list as long as the line", None, remedy))
        return
    speed = Row(properties, place, faults).number("speed_mps", 0.5, FASTEST_MPS, SPEED_MPS)
    for number, (here, comes) in enumerate(zip(places, times, strict=True)):
        values, drive_s = properties | _at(here, properties) | {"from": comes}, 0.0
        if number + 1 < len(places):
            there = places[number + 1]
            drive_s = geodesy.distance_m(here[1], here[0], there[1], there[0]) / speed
            values["until"] = times[number + 1]
        yield Row(values, place, faults), drive_s
