"""Files with prices of energy: by hour of the week, or as a record of past prices."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.fields import finite
from skyway.models.base.table import FaultCollector, Problem, read_table
from skyway.models.network.files import MAX_PRICE
from skyway.models.queues.load import WEEK_H, zone
from skyway.models.queues.load_files import EVERY_STATION, parse_hour, parse_station, sum_by_hour

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

_COLUMNS = ("station", "hour_of_week", "price_per_kwh")


def read_prices(path: Path, station_ids: Sequence[str]) -> NDArray[np.float64]:
    """Read a CSV table ``station,hour_of_week,price_per_kwh``, shape (stations, 168); NaN if no row has a price.

    Rows of station ``*`` hold for every station and hour without a row of its own. An `InputError` carries every fault:
    unknown station, hour outside 0-167, two rows for one hour, an invalid price, a missing column.
    """
    faults = FaultCollector(str(path))
    default = len(station_ids)
    known = {EVERY_STATION: default} | {name: number for number, name in enumerate(station_ids)}
    names = {number: name for name, number in known.items()}
    found = np.full((default + 1, WEEK_H), np.nan)
    first: dict[tuple[int, int], int] = {}
    for chunk in read_table(path, _COLUMNS, faults):
        station = chunk.decode("station", partial(parse_station, stations=known), faults, each_text_once=True)
        hour = chunk.decode("hour_of_week", parse_hour, faults)
        price = chunk.decode("price_per_kwh", _parse_price, faults)
        for row in np.flatnonzero(~np.isnan(station + hour + price)).tolist():
            place, line = (int(station[row]), int(hour[row])), int(chunk.lines[row])
            if place in first:
                problem = f"second row for station {names[place[0]]}, the first is line {first[place]}"
                remedy = "one row for each station and hour"
                faults.add(problem, remedy, line=line, field="hour_of_week", value=place[1])
            first.setdefault(place, line)
            found[place] = price[row]
    faults.raise_if_any()
    return np.where(np.isnan(found[:default]), found[default], found[:default])


def read_price_record(path: Path, station_ids: Sequence[str], timezone: str) -> tuple[NDArray[np.float64], list[str]]:
    """Read a record of prices, averaged by hour of the local week, shape (stations, 168); NaN if it has none.

    One row per hour, one column per station, as in a record of busy pads (`models.queues.load_files.read_occupancy`). A
    station's hours of the week without a value get the mean of its others. Warnings name columns that are not stations. An
    `InputError` carries every fault.
    """
    faults = FaultCollector(str(path))
    header, total, count, _ = sum_by_hour(path, station_ids, zone(timezone), faults, _parse_recorded)
    faults.raise_if_any()
    found = np.full((len(station_ids), WEEK_H), np.nan)
    named = [number for number, name in enumerate(station_ids) if name in header]
    for column, number in enumerate(named):
        there = count[:, column] > 0
        if there.any():
            mean = float(total[there, column].sum() / count[there, column].sum())
            found[number] = np.where(there, total[:, column] / np.maximum(count[:, column], 1), mean)
    strangers = len([name for name in header if name not in set(station_ids)])
    return found, [f"{path}: {strangers} columns are not stations of the network"] if strangers else []


def _parse_price(text: str) -> float | Problem:
    price = finite(text)
    if price is not None and 0.0 <= price <= MAX_PRICE:
        return price
    return Problem("not a price", "a number from 0 up, of the scenario's currency for a kWh")


def _parse_recorded(text: str) -> float | Problem:
    """Read a price of a record; NaN is a gap."""
    return np.nan if not text or text.lower() == "nan" else _parse_price(text)
