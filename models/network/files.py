"""Reading and writing stations and segments as CSV and GeoJSON."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import Fault, InputError, one_line, refuse
from skyway.models.base.fields import finite
from skyway.models.base.files import read_text, write_atomically
from skyway.models.base.geodesy import coordinate_faults, line_geometry
from skyway.models.base.json_text import json_text
from skyway.models.base.table import TableReader
from skyway.models.base.views import counted
from skyway.models.network.geojson import features, read_geojson
from skyway.models.network.station import Station
from skyway.models.queues.opening_hours import opening_hours

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from skyway.models.network.network import Network

MAX_BYTES = 64 * 1024 * 1024
MAX_PADS = 10_000
MAX_FAULTS = 100
"""A file with more faults is not read to its end."""
GEOJSON_ENDINGS = (".geojson", ".json")
_KINDS = {"Point": ("Point",), "LineString": ("LineString", "MultiLineString")}
"""Kinds of geometry that count as one: a line across the antimeridian has two parts."""
BOTH_WAYS = ("", "yes", "true", "1")
ONE_WAY = ("no", "false", "0")
STATION_FIELDS = (
    "id",
    "name",
    "lat",
    "lon",
    "elevation_m",
    "pads",
    "holding_spots",
    "recharge_power_w",
    "energy_price_per_kwh",
    "pad_fee",
    "open_hours",
)
"""Columns of a station file; only id, lat and lon are required."""
RARE_FIELDS = ("energy_price_per_kwh", "pad_fee", "open_hours")
"""Of these, columns that are written only if they have a value."""
MAX_PRICE = 1e6
"""Greatest price and fee, in the region's currency."""


def read_stations(
    path: Path, *, columns: Mapping[str, str] | None = None, pads: int = 5, holding_spots: int = 4
) -> tuple[Station, ...]:
    """Read stations from CSV or, by the ending ``.geojson`` or ``.json``, from GeoJSON points.

    `columns` gives the names in the file of those of `STATION_FIELDS` that have another name there; `pads` and
    `holding_spots` apply if the file has no value. An `InputError` has every fault in the file.
    """
    given = columns or {}
    names = {field: given.get(field, field) for field in STATION_FIELDS}
    faults: list[Fault] = []
    if path.suffix.lower() in GEOJSON_ENDINGS:
        rows = _geojson_rows(path, "Point", names, faults)
    else:
        needed = dict.fromkeys(("id", "lat", "lon", *given))
        rows = _csv_rows(path, [names[field] for field in needed if field in names], faults)
    stations: list[Station] = []
    first: dict[str, str] = {}
    for place, row in rows:
        if _too_many(faults, place):
            break
        found = len(faults)
        station = _station(_Row(row, names, place, faults), pads, holding_spots)
        if station.id in first:
            problem, remedy = "two stations have the same id", f"it is already {first[station.id]}"
            faults.append(_at(place, names["id"], problem, station.id, remedy))
        first.setdefault(station.id, f"on line {place.line}" if place.line else f"at {place.field}")
        if len(faults) == found:
            stations.append(station)
    if not faults and not stations:
        faults.append(Fault("has no stations", str(path)))
    refuse(faults)
    return tuple(stations)


def _at(place: Fault, field: str, problem: str, value: object = None, remedy: str | None = None) -> Fault:
    """Return a fault of one field at the place of a row."""
    path = f"{place.field}.{field}" if place.field else field
    return replace(place, field=path, problem=problem, value=value, remedy=remedy)


def _too_many(faults: list[Fault], place: Fault) -> bool:
    if len(faults) < MAX_FAULTS:
        return False
    faults.append(replace(place, problem="too many faults; the rest was not read"))
    return True


class _Row:
    """One row of a station file; `place` names its file and line, or feature."""

    def __init__(self, row: Mapping[str, str], names: Mapping[str, str], place: Fault, faults: list[Fault]) -> None:
        self.row, self.names, self.place, self.faults = row, names, place, faults

    def text(self, field: str) -> str:
        return self.row.get(self.names[field], "").strip()

    def fault(self, field: str, problem: str, remedy: str | None = None) -> None:
        self.faults.append(_at(self.place, self.names[field], problem, self.text(field) or None, remedy))

    def number(
        self, field: str, low: float = -math.inf, high: float = math.inf, remedy: str | None = None
    ) -> float | None:
        """Read a number in [low, high]; None, without a fault, if the cell is empty."""
        text = self.text(field)
        if not text:
            return None
        number = finite(text)
        if number is None:
            self.fault(field, "is not a number", "write 40.7, with a point" if "," in text else None)
        elif not low <= number <= high:
            self.fault(field, "out of range", remedy)
            return None
        return number

    def count(self, field: str, default: int) -> int:
        number = self.number(field)
        if number is None:
            return default
        if not 0 <= number <= MAX_PADS or number != int(number):
            self.fault(field, "must be a whole number", f"from 0 to {MAX_PADS}")
            return default
        return int(number)

    def position(self) -> tuple[float, float]:
        """Read (lat, lon); 0, 0 if they are wrong."""
        values = [self.number(field) for field in ("lat", "lon")]
        for field, value in zip(("lat", "lon"), values, strict=True):
            if value is None and not self.text(field):
                self.fault(field, "is empty")
        lat, lon = (0.0 if value is None else value for value in values)
        for fault in coordinate_faults(lat, lon):
            self.fault(fault.field or "lat", fault.problem, fault.remedy)
        if values == [0.0, 0.0]:
            self.fault("lat", "lies at 0,0", "give the true position")
        return lat, lon


def _open_hours(row: _Row) -> str:
    """Read the opening hours of the pads, as they are written."""
    text = one_line(row.text("open_hours")).strip()
    try:
        opening_hours(text)
    except InputError as error:
        for fault in error.faults:
            row.fault("open_hours", fault.problem, fault.remedy)
    return text


def _station(row: _Row, pads: int, holding_spots: int) -> Station:
    identity = row.text("id")
    if not identity:
        row.fault("id", "is empty")
    elif one_line(identity) != identity:
        row.fault("id", "must be one line of plain text")
    lat, lon = row.position()
    return Station(
        id=identity,
        name=one_line(row.text("name")).strip() or identity,
        lat=lat,
        lon=lon,
        elevation_m=row.number("elevation_m", -450, 9000, "metres above mean sea level, -450 to 9000"),
        pads=row.count("pads", pads),
        holding_spots=row.count("holding_spots", holding_spots),
        recharge_power_w=row.number("recharge_power_w", 1, 1e6, "watts a pad delivers, 1 to 1000000"),
        energy_price_per_kwh=row.number("energy_price_per_kwh", 0, MAX_PRICE, "the price of a kWh, 0 or more"),
        pad_fee=row.number("pad_fee", 0, MAX_PRICE, "the price of each charge, 0 or more"),
        open_hours=_open_hours(row),
    )


def _csv_rows(path: Path, needed: Sequence[str], faults: list[Fault]) -> Iterator[tuple[Fault, Mapping[str, str]]]:
    """(place, cells by column) of each row that is not blank; rows that do not fit the header are faults."""
    place = Fault("", str(path))
    reader = TableReader(io.StringIO(read_text(path, max_bytes=MAX_BYTES), newline=""), str(path))
    try:
        header = [name.strip() for name in next(reader, [])]
        remedy = "the header has " + ", ".join(header) if header else "the file is empty"
        twice = [name for name in dict.fromkeys(header) if name and header.count(name) > 1]
        wrong = [replace(place, problem="two columns have this name", line=1, field=name) for name in twice]
        absent = [name for name in needed if name not in header]
        wrong += [replace(place, problem="column is missing", line=1, field=name, remedy=remedy) for name in absent]
        refuse(wrong)
        for cells in reader:
            here = replace(place, line=reader.line_num)
            if not any(cell.strip() for cell in cells):
                continue
            if len(cells) == len(header):
                yield here, dict(zip(header, cells, strict=True))
            else:
                faults.append(replace(here, problem=f"has {counted(len(cells), 'cell')}, the header has {len(header)}"))
    except csv.Error as error:
        raise InputError(f"is not CSV: {error}", str(path), reader.line_num) from error


def _geojson_rows(
    path: Path, kind: str, names: Mapping[str, str], faults: list[Fault]
) -> Iterator[tuple[Fault, Mapping[str, str]]]:
    """(place, properties as text) of each feature of one kind; a point's position joins its properties."""
    for number, feature in enumerate(features(read_geojson(path), str(path))):
        place = Fault("", str(path), None, f"features[{number}]")
        geometry, properties = feature.get("geometry"), feature.get("properties")
        if not isinstance(geometry, dict) or geometry.get("type") not in _KINDS[kind]:
            continue
        scalars = properties if isinstance(properties, dict) else {}
        row = {str(key): str(value) for key, value in scalars.items() if isinstance(value, str | int | float)}
        if kind == "Point":
            position = geometry.get("coordinates")
            if not isinstance(position, list) or len(position) < 2:
                faults.append(replace(place, problem="a point needs [lon, lat]", value=position))
                continue
            if names["id"] not in row and isinstance(feature.get("id"), str | int | float):
                row[names["id"]] = str(feature["id"])
            row[names["lon"]], row[names["lat"]] = str(position[0]), str(position[1])
            if len(position) > 2:
                row.setdefault(names["elevation_m"], str(position[2]))
        yield place, row


def read_segments(path: Path, stations: Sequence[Station]) -> list[tuple[int, int]]:
    """Read directed segments (``from``, ``to`` station ids) from CSV or GeoJSON lines.

    A column or property ``both`` with ``no``, ``false`` or ``0`` makes a segment one-way. An `InputError` has every
    fault in the file: unknown ends, loops, missing columns.
    """
    index = {station.id: number for number, station in enumerate(stations)}
    faults: list[Fault] = []
    pairs: list[tuple[int, int]] = []
    if path.suffix.lower() in GEOJSON_ENDINGS:
        rows = _geojson_rows(path, "LineString", {}, faults)
    else:
        rows = _csv_rows(path, ("from", "to"), faults)
    for place, row in rows:
        if _too_many(faults, place):
            break
        names = {field: row.get(field, "").strip() for field in ("from", "to")}
        unknown = [field for field, name in names.items() if name not in index]
        faults += [_at(place, field, "is not a known station", names[field] or "nothing") for field in unknown]
        both = row.get("both", "").strip().casefold()
        if both not in BOTH_WAYS and both not in ONE_WAY:
            faults.append(_at(place, "both", "is not known", both, "yes or no"))
        if unknown:
            continue
        ends = index[names["from"]], index[names["to"]]
        if ends[0] == ends[1]:
            faults.append(_at(place, "to", "leads from a station to itself", names["to"]))
            continue
        pairs.append(ends)
        if both not in ONE_WAY:
            pairs.append(ends[::-1])
    refuse(faults)
    return pairs


def _used_fields(stations: Sequence[Station]) -> tuple[str, ...]:
    """Columns to write."""
    empty = [field for field in RARE_FIELDS if all(getattr(one, field) in (None, "") for one in stations)]
    return tuple(field for field in STATION_FIELDS if field not in empty)


def to_geojson(network: Network) -> dict[str, Any]:
    """Return stations as points and segments as lines; a segment flown both ways is one line."""
    used = _used_fields(network.stations)
    items: list[dict[str, Any]] = []
    for s in network.stations:
        properties = {field: getattr(s, field) for field in used if field not in ("lat", "lon")}
        point = {"type": "Point", "coordinates": [s.lon, s.lat]}
        items.append({"type": "Feature", "id": s.id, "geometry": point, "properties": properties})
    pairs = set(zip(network.tail.tolist(), network.head.tolist(), strict=True))
    for tail, head, length in zip(
        network.tail.tolist(), network.head.tolist(), network.distance_m.tolist(), strict=True
    ):
        both = (head, tail) in pairs
        if both and tail > head:
            continue
        a, b = network.stations[tail], network.stations[head]
        line = line_geometry(((a.lat, a.lon), (b.lat, b.lon)))
        properties = {
            "from": a.id,
            "to": b.id,
            "both": "yes" if both else "no",
            "distance_m": round(length, 1),
        }
        items.append({"type": "Feature", "geometry": line, "properties": properties})
    return {"type": "FeatureCollection", "features": items}


def write_geojson(network: Network, path: Path, *, force: bool = False) -> None:
    """Write stations and segments as GeoJSON."""
    write_atomically(path, json_text(to_geojson(network), indent=1) + "\n", force=force)


def write_graphml(network: Network, path: Path, *, force: bool = False) -> None:
    """Write the graph as GraphML, without unknown values of a station; needs networkx (extra ``graph``)."""
    import networkx as nx  # imported late: 90 ms

    graph = network.graph.copy()
    for _, attributes in graph.nodes(data=True):
        for name in [name for name, value in attributes.items() if value is None]:
            del attributes[name]
    write_atomically(path, "\n".join(nx.generate_graphml(graph)) + "\n", force=force)


def write_stations_csv(network: Network, path: Path, *, force: bool = False) -> None:
    """Write stations as CSV: `stations_csv`."""
    write_atomically(path, stations_csv(network.stations), force=force)


def stations_csv(stations: Sequence[Station]) -> str:
    """Return stations as CSV with the columns of `STATION_FIELDS`; those of `RARE_FIELDS` where any station has a value."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    used = _used_fields(stations)
    writer.writerow(used)
    for station in stations:
        if station.flyover:  # made again from the zones
            continue
        values = (getattr(station, field) for field in used)
        writer.writerow("" if value is None else value for value in values)
    return stream.getvalue()


def write_segments_csv(network: Network, path: Path, *, force: bool = False) -> None:
    """Write directed segments as CSV, one way each."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("from", "to", "both"))
    for tail, head in zip(network.tail.tolist(), network.head.tolist(), strict=True):
        ends = network.stations[tail], network.stations[head]
        if not any(station.flyover for station in ends):
            writer.writerow((ends[0].id, ends[1].id, "no"))
    write_atomically(path, stream.getvalue(), force=force)
