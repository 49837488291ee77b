"""Melbourne's charging sites as a network: real places, hours of use and wind that nobody here wrote."""

from __future__ import annotations

import csv
import gzip
import math
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError
from skyway.models.drones.drone import M200_V2
from skyway.models.flight.rules import FlightRules
from skyway.models.network.builders import build_network
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.queues.load_files import read_occupancy
from skyway.models.scenario.scenario import Scenario
from skyway.models.wind.columns import WindColumns
from skyway.models.wind.history import WindSite, read_history

if TYPE_CHECKING:
    from skyway.models.network.network import Network
    from skyway.models.queues.load import PadLoad

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
ZONE = "Australia/Melbourne"
SEGMENT_M = 13_000.0
CHARGING_MIN = 60.0
MAX_PADS = 8
SITE = WindSite("melbourne", -37.8136, 144.9631)


@lru_cache(maxsize=1)
def melbourne() -> Scenario:
    """The scenario.

    Raises
    ------
    InputError
        The data are not beside the checkout.
    """
    if not (DATA / "stations" / "melbourne_stations.csv").exists():
        remedy = "it needs melbourne_* in ../shared/data/stations and ../shared/data/wind beside the checkout"
        raise InputError(Fault("the data of Melbourne are not here", remedy=remedy))
    network = _network()
    columns = WindColumns(site=None, speed="windspeed", from_="winddir", speed_unit="km/h", time_zone=ZONE)
    history = read_history(DATA / "wind" / "melbourne_2023_hourly_weather.csv", columns, (SITE,), 10.0)
    return Scenario(
        name="Melbourne",
        network=network,
        drones=(M200_V2,),
        rules=FlightRules(),
        load=_load(network),
        history=history,
        wind_sites=(SITE,),
        timezone=ZONE,
    )


def _network() -> Network:
    """Sites with as many pads as were ever busy at once, at most `MAX_PADS`."""
    most: dict[str, float] = {}
    with gzip.open(DATA / "stations" / "melbourne_duration.csv.gz", "rt", encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            for key, text in row.items():
                if key.isdigit() and text:
                    most[key] = max(most.get(key, 0.0), float(text))
    with (DATA / "stations" / "melbourne_stations.csv").open(encoding="utf-8", newline="") as file:
        stations = [
            Station(
                row["station_id"],
                f"Charging site {row['station_id']}",
                float(row["latitude"]),
                float(row["longitude"]),
                None,
                min(max(math.ceil(most.get(row["station_id"], 1.0)), 1), MAX_PADS),
            )
            for row in csv.DictReader(file)
        ]
    return build_network(stations, ConnectionRule("max-length", SEGMENT_M))


def _load(network: Network) -> PadLoad:
    path = DATA / "stations" / "melbourne_duration.csv.gz"
    ids = [station.id for station in network.stations]
    load, _ = read_occupancy(path, ids, ZONE, network.pads, CHARGING_MIN)
    return load
