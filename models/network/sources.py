"""Networks from Python objects: stations, tables, networkx graphs, GeoDataFrames."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.geodesy import coordinate_faults
from skyway.models.base.ranges import number_faults
from skyway.models.network.builders import build_network
from skyway.models.network.network import Network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.queues.opening_hours import opening_hours

if TYPE_CHECKING:
    from skyway.models.airspace.airspace import Airspace

_LATITUDE = ("lat", "latitude", "y")
_LONGITUDE = ("lon", "lng", "longitude", "x")
"""Names under which a table or graph may have a position; y and x are those of OSMnx."""
_WHOLE = ("pads", "holding_spots")
_REAL = ("elevation_m", "recharge_power_w", "energy_price_per_kwh", "pad_fee")
WGS84 = "EPSG:4326"


def network_of(
    source: Any,
    *,
    segments: Iterable[tuple[str, str]] | ConnectionRule | None = None,
    zones: Airspace | None = None,
) -> Network:
    """Build a network.

    Parameters
    ----------
    source : Network, sequence of Station or of mappings, DataFrame, GeoDataFrame or networkx graph
        Stations. Tables and graphs name them by ``id`` (or their index, or the node), place them by ``lat`` and
        ``lon`` (or ``y`` and ``x``, or the point of the geometry), and may have ``name``, ``pads``,
        ``holding_spots``, ``elevation_m``, ``recharge_power_w``, ``energy_price_per_kwh``, ``pad_fee`` and ``open_hours``.
    segments : pairs of station ids, ConnectionRule or None
        Directed segments, or the rule that makes them. None: the edges of a graph (both ways where it is undirected),
        else the default rule.
    zones : Airspace or None
        Segments that cross them are omitted.

    Raises
    ------
    InputError
        With every fault in every station.
    """
    if isinstance(source, Network):
        return source
    if hasattr(source, "nodes") and hasattr(source, "edges"):
        rows = [{"id": node, **attributes} for node, attributes in source.nodes(data=True)]
        if segments is None:
            segments = [(str(tail), str(head)) for tail, head, *_ in source.edges]
            segments += [] if source.is_directed() else [(head, tail) for tail, head in segments]
    else:
        rows = _rows(source)
    stations = _stations(rows)
    if segments is None or isinstance(segments, ConnectionRule):
        return build_network(stations, segments or ConnectionRule(), zones=zones)
    return Network.from_pairs(stations, _pairs(stations, segments), zones=zones)


def _rows(source: Any) -> list[Any]:
    """Return one mapping (or Station) for each station of a table or sequence."""
    if hasattr(source, "to_crs"):
        points = source.geometry if source.crs is None else source.to_crs(WGS84).geometry
        if set(points.geom_type) - {"Point"}:
            raise InputError("stations are points", field="geometry", value=", ".join(sorted(set(points.geom_type))))
        columns = source.drop(columns=source.geometry.name)
        positions = [{"lat": point.y, "lon": point.x} for point in points]
        return [row | place for row, place in zip(_table_rows(columns), positions, strict=True)]
    if hasattr(source, "to_dict") and hasattr(source, "columns"):
        return _table_rows(source)
    if isinstance(source, Iterable) and not isinstance(source, str | bytes | Mapping):
        return list(source)
    kinds = "stations, a DataFrame, a GeoDataFrame or a networkx graph"
    raise InputError("is not a network", field="stations", value=type(source).__name__, remedy=f"give {kinds}")


def _table_rows(table: Any) -> list[dict[str, Any]]:
    return [{"id": index, **row} for index, row in zip(table.index, table.to_dict("records"), strict=True)]


def _stations(rows: Iterable[Any]) -> list[Station]:
    faults: list[Fault] = []
    stations = [_given(row, faults) if isinstance(row, Station) else _station(row, faults) for row in rows]
    refuse(faults)
    if not stations:
        raise InputError(
            "there is none", field="stations", remedy="give at least one, such as Station(id, name, lat, lon)"
        )
    return stations


def _given(station: Station, faults: list[Fault]) -> Station:
    """Check a station; faults are collected."""
    numbers = {name: getattr(station, name) for name in ("lat", "lon", *_WHOLE, *_REAL)}
    found = [
        fault
        for name, value in numbers.items()
        if value is not None or name not in _REAL
        for fault in number_faults(name, value)
    ]
    faults += _named(found or coordinate_faults(station.lat, station.lon), station.id)
    return station


def _named(faults: Iterable[Fault], identity: str) -> list[Fault]:
    """Return faults of a station with its id."""
    return [replace(fault, problem=f"station {identity}: {fault.problem}") for fault in faults]


def _station(row: Any, faults: list[Fault]) -> Station:
    """Read one station; faults are collected."""
    if not isinstance(row, Mapping):
        faults.append(
            Fault("is not a station", field="stations", value=row, remedy="a Station, or a mapping with id, lat, lon")
        )
        return Station("", "", math.nan, math.nan)
    given = {key: value for key, value in row.items() if not _missing(value)}
    identity = str(given.get("id", ""))
    if not identity:
        faults.append(Fault("a station has no id", field="id", value=dict(row)))

    def number(names: tuple[str, ...], *, whole: bool = False) -> Any:
        value: Any = next((given[name] for name in names if name in given), "missing")
        try:
            read = float(value)
        except (TypeError, ValueError, OverflowError):
            faults.append(Fault(f"station {identity}: is not a number", field=names[0], value=value))
            return math.nan
        if whole and not (read >= 0.0 and read.is_integer()):
            faults.append(Fault(f"station {identity}: must be a whole number, 0 or more", field=names[0], value=value))
            return 0
        return int(read) if whole else read

    more = {key: number((key,), whole=key in _WHOLE) for key in (*_WHOLE, *_REAL) if key in given}
    hours = str(given.get("open_hours", ""))
    try:
        opening_hours(hours)
    except InputError as error:
        faults += _named(error.faults, identity)
    place = number(_LATITUDE), number(_LONGITUDE)
    faults += [] if any(map(math.isnan, place)) else _named(coordinate_faults(*place), identity)
    return Station(identity, str(given.get("name", identity)), *place, **more, open_hours=hours)


def _missing(value: Any) -> bool:
    return value is None or (isinstance(value, float | np.floating) and math.isnan(value))


def _pairs(stations: list[Station], segments: Iterable[Any]) -> Any:
    index = {station.id: number for number, station in enumerate(stations)}
    pairs, faults = [], []
    for segment in segments:
        if isinstance(segment, str) or not isinstance(segment, Sequence) or len(segment) != 2:
            faults.append(Fault("is not a pair", field="segments", value=repr(segment), remedy='("FROM", "TO")'))
            continue
        tail, head = segment
        strangers = [end for end in (tail, head) if str(end) not in index]
        faults += [Fault("is not a known station", field="segments", value=end) for end in strangers]
        pairs.append((index.get(str(tail), 0), index.get(str(head), 0)))
    refuse(faults)
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
