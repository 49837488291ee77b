"""Stations of a scenario near a place of a mission."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING

from skyway.models.base import geodesy

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from skyway.missions.items.coordinates import Point
    from skyway.models.network.station import Station

NEAR_STATION_M = 150.0
_CELL_DEG = 0.01
"""Side of the cells that are searched; more than `NEAR_STATION_M` up to 82 degrees of latitude."""


class NearStations:
    """Finds the stations within `NEAR_STATION_M` of a place, fast for any number of both."""

    def __init__(self, stations: Sequence[Station]) -> None:
        self._cells: dict[tuple[int, int], list[Station]] = defaultdict(list)
        for station in stations:
            self._cells[_cell(station.lat, station.lon)].append(station)

    def at(self, point: Point | None) -> Iterator[Station]:
        """Yield the stations at a place."""
        if point is None or not self._cells:
            return
        row, column = _cell(point.lat, point.lon)
        for north in (-1, 0, 1):
            for east in (-1, 0, 1):
                for station in self._cells.get((row + north, column + east), ()):
                    if geodesy.distance_m(station.lat, station.lon, point.lat, point.lon) <= NEAR_STATION_M:
                        yield station

    def ground_m(self, point: Point | None) -> float | None:
        """Height above sea level of the ground of a station at a place, None if none is known."""
        return next((station.elevation_m for station in self.at(point) if station.elevation_m is not None), None)


def _cell(lat: float, lon: float) -> tuple[int, int]:
    return math.floor(lat / _CELL_DEG), math.floor(lon / _CELL_DEG)
