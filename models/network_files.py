"""Stations and segments as CSV and GeoJSON, in and out."""

from __future__ import annotations

import csv
import io
import json
from typing import TYPE_CHECKING, Any

from models.errors import Fault, InputError
from models.fields import finite
from models.files import read_text, write_atomically
from models.network import Network, Station, coordinate_faults
from models.zones import features, read_geojson

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path

MAX_BYTES = 64 * 1024 * 1024
MAX_PADS = 10_000
STATION_FIELDS = ("id", "name", "lat", "lon", "elevation_m", "pads", "holding_spots", "recharge_power_w")
"""Columns of a station file; all but id, lat and lon may be absent."""


def read_stations(
    path: Path, *, columns: Mapping[str, str] | None = None, pads: int = 5, holding_spots: int = 4
) -> tuple[Station, ...]:
    """Read stations from CSV or, by the ending ``.geojson`` or ``.json``, from GeoJSON points.

    Parameters
    ----------
    path : Path
        The file.
    columns : mapping, optional
        Column (or property) of the file for each of `STATION_FIELDS` that is called otherwise there.
    pads, holding_spots : int
        Where the file says nothing.

    Raises
    ------
    InputError
        With every fault in the file.
    """
    names = {field: (columns or {}).get(field, field) for field in STATION_FIELDS}
    faults: list[Fault] = []
    rows = _geojson_rows(path, faults) if path.suffix in (".geojson", ".json") else _csv_rows(path, names)
    stations: list[Station] = []
    first_line: dict[str, int] = {}
    for line, row in rows:
        found = len(faults)
        station = _station(_Row(row, names, str(path), line, faults), pads, holding_spots)
        if station.id in first_line:
            remedy = f"it stands on line {first_line[station.id]} already"
            faults.append(Fault("two stations have the same id", str(path), line, names["id"], station.id, remedy))
        first_line.setdefault(station.id, line)
        if len(faults) == found:
            stations.append(station)
    if not faults and not stations:
        faults.append(Fault("holds no stations", str(path)))
    if faults:
        raise InputError(faults)
    return tuple(stations)


class _Row:
    """One row of a station file."""

    def __init__(
        self, row: Mapping[str, Any], names: Mapping[str, str], file: str, line: int, faults: list[Fault]
    ) -> None:
        self.row, self.names, self.file, self.line, self.faults = row, names, file, line, faults

    def text(self, field: str) -> str:
        value = self.row.get(self.names[field])
        return "" if value is None else str(value).strip()

    def fault(self, field: str, problem: str, remedy: str | None = None) -> None:
        value = self.text(field)
        self.faults.append(Fault(problem, self.file, self.line, self.names[field], value or None, remedy))

    def number(self, field: str) -> float | None:
        """Read a finite number; None, without a fault, where the cell is empty."""
        text = self.text(field)
        if not text:
            return None
        number = finite(text)
        if number is None:
            self.fault(field, "is not a number")
        return number

    def count(self, field: str, default: int) -> int:
        number = self.number(field)
        if number is None:
            return default
        if not 0 <= number <= MAX_PADS or number != int(number):
            self.fault(field, "must be a whole number", f"from 0 to {MAX_PADS}")
            return default
        return int(number)


def _station(row: _Row, pads: int, holding_spots: int) -> Station:
    identity = row.text("id")
    if not identity:
        row.fault("id", "is empty")
    position = {}
    for field in ("lat", "lon"):
        number = row.number(field)
        if number is None and not row.text(field):
            row.fault(field, "is empty")
        position[field] = 0.0 if number is None else number
    for fault in coordinate_faults(position["lat"], position["lon"], file=row.file, line=row.line):
        row.faults.append(fault)
    if row.text("lat") and position == {"lat": 0.0, "lon": 0.0}:
        row.fault("lat", "lies at 0,0", "give the true position")
    elevation = row.number("elevation_m")
    if elevation is not None and not -450 <= elevation <= 9000:
        row.fault("elevation_m", "out of range", "metres above mean sea level, -450 to 9000")
    power = row.number("recharge_power_w")
    if power is not None and not 1 <= power <= 1e6:
        row.fault("recharge_power_w", "out of range", "watts a pad delivers, 1 to 1000000")
    return Station(
        id=identity,
        name=row.text("name") or identity,
        lat=position["lat"],
        lon=position["lon"],
        elevation_m=elevation,
        pads=row.count("pads", pads),
        holding_spots=row.count("holding_spots", holding_spots),
        recharge_power_w=power,
    )


def _csv_rows(path: Path, names: Mapping[str, str]) -> Iterable[tuple[int, Mapping[str, Any]]]:
    reader = open_csv(path)
    header = reader.fieldnames or ()
    missing = [names[field] for field in ("id", "lat", "lon") if names[field] not in header]
    if missing:
        remedy = "the header has " + ", ".join(header) if header else "the file is empty"
        raise InputError([Fault("column is missing", str(path), 1, name, None, remedy) for name in missing])
    return _numbered(reader, path)


def open_csv(path: Path) -> csv.DictReader[str]:
    """Open a CSV file of at most 64 MB with a header line."""
    return csv.DictReader(io.StringIO(read_text(path, max_bytes=MAX_BYTES), newline=""), restkey="", restval="")


def _numbered(reader: csv.DictReader[str], path: Path) -> Iterable[tuple[int, Mapping[str, Any]]]:
    try:
        for row in reader:
            yield reader.line_num, row
    except csv.Error as error:
        raise InputError(Fault(f"is not CSV: {error}", str(path), reader.line_num)) from None


def _geojson_rows(path: Path, faults: list[Fault]) -> Iterable[tuple[int, Mapping[str, Any]]]:
    for number, feature in enumerate(features(read_geojson(path)), start=1):
        geometry = feature.get("geometry")
        if not isinstance(geometry, dict) or geometry.get("type") != "Point":
            continue
        position = geometry.get("coordinates")
        if not isinstance(position, list) or len(position) < 2:
            faults.append(Fault("a point needs [lon, lat]", str(path), None, f"features[{number - 1}]"))
            continue
        properties = feature.get("properties")
        row = dict(properties) if isinstance(properties, dict) else {}
        row.setdefault("id", feature.get("id"))
        row["lon"], row["lat"] = position[0], position[1]
        if len(position) > 2:
            row.setdefault("elevation_m", position[2])
        yield number, row


def read_segments(path: Path, stations: Sequence[Station]) -> list[tuple[int, int]]:
    """Read directed segments (``from``, ``to`` station ids) from CSV or GeoJSON lines.

    A column or property ``both`` with ``no``, ``false`` or ``0`` makes a segment one-way.

    Raises
    ------
    InputError
        With every fault in the file: unknown ends, loops, missing columns.
    """
    index = {station.id: number for number, station in enumerate(stations)}
    faults: list[Fault] = []
    pairs: list[tuple[int, int]] = []
    for line, row in _segment_rows(path):
        ends: list[int] = []
        for field in ("from", "to"):
            identity = str(row.get(field) or "").strip()
            if identity in index:
                ends.append(index[identity])
            else:
                faults.append(Fault("names no station", str(path), line, field, identity or "nothing"))
        if len(ends) == 2 and ends[0] == ends[1]:
            faults.append(Fault("leads from a station to itself", str(path), line, "to", row.get("to")))
        elif len(ends) == 2:
            pairs.append((ends[0], ends[1]))
            if str(row.get("both", "")).strip().casefold() not in ("no", "false", "0"):
                pairs.append((ends[1], ends[0]))
    if faults:
        raise InputError(faults)
    return pairs


def _segment_rows(path: Path) -> Iterable[tuple[int, Mapping[str, Any]]]:
    if path.suffix in (".geojson", ".json"):
        for number, feature in enumerate(features(read_geojson(path)), start=1):
            geometry, properties = feature.get("geometry"), feature.get("properties")
            if isinstance(geometry, dict) and geometry.get("type") == "LineString" and isinstance(properties, dict):
                yield number, properties
        return
    reader = open_csv(path)
    missing = [name for name in ("from", "to") if name not in (reader.fieldnames or ())]
    if missing:
        raise InputError([Fault("column is missing", str(path), 1, name) for name in missing])
    yield from _numbered(reader, path)


def to_geojson(network: Network) -> dict[str, Any]:
    """Return stations as points and segments as lines; a segment flown both ways is one line."""
    items: list[dict[str, Any]] = []
    for s in network.stations:
        properties = {field: getattr(s, field) for field in STATION_FIELDS if field not in ("lat", "lon")}
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
        line = {"type": "LineString", "coordinates": [[a.lon, a.lat], [b.lon, b.lat]]}
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
    write_atomically(path, json.dumps(to_geojson(network), indent=1) + "\n", force=force)


def write_stations_csv(network: Network, path: Path, *, force: bool = False) -> None:
    """Write stations as CSV with the columns of `STATION_FIELDS`."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(STATION_FIELDS)
    for station in network.stations:
        values = (getattr(station, field) for field in STATION_FIELDS)
        writer.writerow("" if value is None else value for value in values)
    write_atomically(path, stream.getvalue(), force=force)


def write_segments_csv(network: Network, path: Path, *, force: bool = False) -> None:
    """Write directed segments as CSV, one way each."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("from", "to", "both"))
    for tail, head in zip(network.tail.tolist(), network.head.tolist(), strict=True):
        writer.writerow((network.stations[tail].id, network.stations[head].id, "no"))
    write_atomically(path, stream.getvalue(), force=force)
